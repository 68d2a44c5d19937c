//! A scheduler: where it listens comes in; it hands the work of runs out to workers until it is
//! stopped.

use crate::args::SchedulerArgs;
use crate::guard::Guarded;
use crate::tls::Tls;
use crate::{identity, link, stage, tls};
use ballista_core::config::TaskSchedulingPolicy;
use ballista_core::serde::protobuf::scheduler_grpc_server::SchedulerGrpcServer;
use ballista_scheduler::cluster::BallistaCluster;
use ballista_scheduler::config::SchedulerConfig;
use ballista_scheduler::scheduler_process::create_scheduler;
use datafusion::execution::{SessionState, SessionStateBuilder};
use datafusion::prelude::SessionConfig;
use datafusion_proto::protobuf::{LogicalPlanNode, PhysicalPlanNode};
use koehler::error::{Error, Result};
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::server::TcpIncoming;

/// Runs a scheduler.
///
/// # Errors
/// It cannot listen there.
pub fn run(args: &SchedulerArgs) -> Result<()> {
    let certificates = args.link.certificates()?;
    let (host, port) = link::host_port(&args.listen)?;
    tls::guarded(host, certificates.as_ref(), args.link.insecure)?;
    let failed = |e: std::io::Error| Error::new(format!("cannot listen on {}: {e}", args.listen));
    let listener = TcpListener::bind((host, port)).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let runtime =
        tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(failed)?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener).map_err(failed)?;
        println!("scheduler at {address}");
        tokio::select! {
            ended = serve(listener, address, certificates) => {
                ended.map_err(|e| Error::new(format!("the scheduler stopped: {}", link::chain(&*e))))
            }
            _ = tokio::signal::ctrl_c() => Ok(()),
        }
    })
}

async fn serve(
    listener: tokio::net::TcpListener,
    address: SocketAddr,
    certificates: Option<Tls>,
) -> std::result::Result<(), link::Wrong> {
    let config = Arc::new(config(address, certificates.clone()));
    let cluster = BallistaCluster::new_from_config(&config).await?;
    let scheduler = create_scheduler::<LogicalPlanNode, PhysicalPlanNode>(cluster, config).await?;
    let service = SchedulerGrpcServer::new(Guarded(scheduler))
        .max_decoding_message_size(link::MESSAGE)
        .max_encoding_message_size(link::MESSAGE);
    link::server(certificates.as_ref())?
        .add_service(InterceptedService::new(service, identity::intercept))
        .serve_with_incoming(TcpIncoming::from(listener))
        .await?;
    Ok(())
}

fn config(address: SocketAddr, certificates: Option<Tls>) -> SchedulerConfig {
    let session = certificates.clone();
    SchedulerConfig {
        external_host: address.ip().to_string(),
        bind_host: address.ip().to_string(),
        bind_port: address.port(),
        // Workers ask for work: only what they made is fetched from them.
        scheduling_policy: TaskSchedulingPolicy::PullStaged,
        executor_timeout_seconds: link::LOST_AFTER.as_secs(),
        expire_dead_executor_interval_seconds: 2,
        no_executors_grace_period_seconds: 0,
        grpc_server_max_decoding_message_size: link::MESSAGE as u32,
        grpc_server_max_encoding_message_size: link::MESSAGE as u32,
        grpc_client_max_message_size: link::MESSAGE as u32,
        override_config_producer: Some(Arc::new(move || link::session(session.as_ref()))),
        override_session_builder: Some(Arc::new(planning)),
        override_create_grpc_client_endpoint: Some(link::endpoints(certificates.clone())),
        use_tls: certificates.is_some(),
        ..SchedulerConfig::default()
    }
}

/// What plans are read with: the function by name, which nobody can call here.
fn planning(config: SessionConfig) -> datafusion::common::Result<SessionState> {
    let mut state = SessionStateBuilder::new().with_default_features().with_config(config).build();
    let udf: datafusion::logical_expr::ScalarUDF = stage::stage(None).as_ref().clone();
    datafusion::execution::FunctionRegistry::register_udf(&mut state, Arc::new(udf))?;
    Ok(state)
}
