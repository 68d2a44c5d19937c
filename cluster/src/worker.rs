//! A worker: where its scheduler is and which folders it may use come in; it does the work that is
//! handed to it until it is told to stop.

use crate::args::WorkerArgs;
use crate::desk::Desk;
use crate::roots::Roots;
use crate::tls::Tls;
use crate::{identity, link, plan, sandbox, stage, tls};
use arrow_flight::flight_service_server::FlightServiceServer;
use ballista_core::JobId;
use ballista_core::config::TaskSchedulingPolicy;
use ballista_core::error::BallistaError;
use ballista_core::registry::BallistaFunctionRegistry;
use ballista_core::serde::protobuf::GetJobStatusParams;
use ballista_core::serde::protobuf::scheduler_grpc_client::SchedulerGrpcClient;
use ballista_executor::ArrowFlightServerProvider;
use ballista_executor::execution_engine::{
    DefaultExecutionEngine, ExecutionEngine, QueryStageExecutor,
};
use ballista_executor::executor_process::{ExecutorProcessConfig, start_executor_process};
use ballista_executor::flight_service::BallistaFlightService;
use datafusion::physical_plan::ExecutionPlan;
use datafusion::prelude::SessionConfig;
use koehler::error::{Error, Result};
use std::error::Error as _;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Endpoint;
use tonic::transport::server::TcpIncoming;

/// Runs a worker.
///
/// # Errors
/// It cannot listen, its folders are not there, or the scheduler refuses it.
pub fn run(args: &WorkerArgs) -> Result<()> {
    let certificates = args.link.certificates()?;
    let (host, port) = link::host_port(&args.listen)?;
    let (scheduler, _) = link::host_port(&args.scheduler)?;
    for host in [host, scheduler] {
        tls::guarded(host, certificates.as_ref(), args.link.insecure)?;
    }
    let roots = Roots::found(&args.data, &args.out)?;
    let scratch = tempfile::tempdir()
        .map_err(|e| Error::new(format!("cannot make a folder for what is fetched: {e}")))?;
    if let Some(why) = sandbox::enter(&roots, scratch.path()) {
        eprintln!(
            "note: only the pipeline and the output folder are held to --data and --out: {why}"
        );
    }
    let threads = args.jobs.unwrap_or_else(cores).max(1);
    let desk = Arc::new(Desk::new(roots, threads, args.keep << 20)?);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|e| Error::new(format!("cannot start: {e}")))?;
    let listener = TcpListener::bind((host, port))
        .map_err(|e| Error::new(format!("cannot listen on {}: {e}", args.listen)))?;
    let address = listener.local_addr().map_err(|e| Error::new(e.to_string()))?;
    let config = config(args, desk, listener, address, certificates.clone(), scratch.path())?;
    runtime.block_on(async {
        greet(args, certificates).await?;
        println!("worker {} with {threads} threads for {}", config.executor_id, args.scheduler);
        let ended = start_executor_process(Arc::new(config)).await;
        ended.map_err(|e| Error::new(format!("the worker stopped: {e}")))
    })
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get())
}

fn config(
    args: &WorkerArgs,
    desk: Arc<Desk>,
    listener: TcpListener,
    address: SocketAddr,
    certificates: Option<Tls>,
    scratch: &Path,
) -> Result<ExecutorProcessConfig> {
    let (scheduler_host, scheduler_port) = link::host_port(&args.scheduler)?;
    let host = args.host.clone().unwrap_or_else(|| address.ip().to_string());
    let mut registry = BallistaFunctionRegistry::default();
    let vcores = args.jobs.unwrap_or_else(cores).max(1);
    registry.scalar_functions.insert(plan::STAGE.into(), stage::stage(Some(desk)));
    let session = certificates.clone();
    Ok(ExecutorProcessConfig {
        executor_id: format!("{host}:{}", address.port()),
        bind_host: address.ip().to_string(),
        external_host: Some(host),
        port: address.port(),
        grpc_port: address.port(),
        scheduler_host: scheduler_host.into(),
        scheduler_port,
        scheduler_connect_timeout_seconds: 30,
        vcores,
        task_scheduling_policy: TaskSchedulingPolicy::PullStaged,
        work_dir: Some(scratch.to_string_lossy().into_owned()),
        grpc_max_decoding_message_size: link::MESSAGE as u32,
        grpc_max_encoding_message_size: link::MESSAGE as u32,
        executor_heartbeat_interval_seconds: 5,
        // What works here is not the engine's own: its memory is not to be divided.
        memory_pool_size: Some(0),
        override_execution_engine: Some(Arc::new(OursAlone(DefaultExecutionEngine::new()))),
        override_function_registry: Some(Arc::new(registry)),
        override_config_producer: Some(Arc::new(move || link::session(session.as_ref()))),
        override_arrow_flight_service: Some(served(listener, certificates.clone())),
        override_create_grpc_client_endpoint: Some(link::endpoints(certificates)),
        ..ExecutorProcessConfig::default()
    })
}

/// The service that results are fetched from.
fn served(listener: TcpListener, tls: Option<Tls>) -> Arc<ArrowFlightServerProvider> {
    let listener = Mutex::new(Some(listener));
    Arc::new(move |folder, _, mut shutdown, _| {
        let listener = listener.lock().unwrap_or_else(|p| p.into_inner()).take();
        let tls = tls.clone();
        tokio::spawn(async move {
            let listener = listener.ok_or_else(|| BallistaError::General("served twice".into()))?;
            listener.set_nonblocking(true)?;
            let incoming = TcpIncoming::from(tokio::net::TcpListener::from_std(listener)?);
            let service = FlightServiceServer::new(BallistaFlightService::new(folder))
                .max_decoding_message_size(link::MESSAGE)
                .max_encoding_message_size(link::MESSAGE);
            link::server(tls.as_ref())?
                .add_service(InterceptedService::new(service, identity::intercept))
                .serve_with_incoming_shutdown(incoming, shutdown.recv())
                .await
                .map_err(BallistaError::TonicError)
        })
    })
}

/// Runs plans of our form and no others.
struct OursAlone(DefaultExecutionEngine);

impl ExecutionEngine for OursAlone {
    fn create_query_stage_exec(
        &self,
        job: JobId,
        stage: usize,
        task: usize,
        partitions: Vec<usize>,
        plan: Arc<dyn ExecutionPlan>,
        folder: &str,
        config: &SessionConfig,
    ) -> datafusion::common::Result<Arc<dyn QueryStageExecutor>> {
        plan::check(&plan)?;
        self.0.create_query_stage_exec(job, stage, task, partitions, plan, folder, config)
    }
}

/// Asks the scheduler for nothing, so that a worker which is refused learns why.
async fn greet(args: &WorkerArgs, certificates: Option<Tls>) -> Result<()> {
    let failed = |why: String| {
        Error::new(format!("cannot work for the scheduler at {}: {why}", args.scheduler))
    };
    let address = format!("http://{}", args.scheduler);
    let endpoint = Endpoint::from_shared(address).map_err(|e| failed(e.to_string()))?;
    let endpoint = link::endpoints(certificates)(endpoint).map_err(|e| failed(e.to_string()))?;
    let mut tries = 0;
    let channel = loop {
        match endpoint.connect().await {
            Ok(channel) => break channel,
            // It may be started a little later.
            Err(_) if tries < 30 => tokio::time::sleep(Duration::from_secs(1)).await,
            Err(e) => return Err(failed(link::chain(&e))),
        }
        tries += 1;
    };
    let nothing = GetJobStatusParams { job_id: "none".into() };
    match SchedulerGrpcClient::new(channel).get_job_status(nothing).await {
        // It refuses this program, or there is no scheduler that speaks as this one does.
        Err(status)
            if status.code() == tonic::Code::FailedPrecondition || status.source().is_some() =>
        {
            Err(failed(link::chain(&status)))
        }
        _ => Ok(()),
    }
}
