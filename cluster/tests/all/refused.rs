//! What reaches a port and is not ours is turned away, and the reason is said.

use crate::campaign::program;
use crate::processes::Process;
use ballista_core::serde::protobuf::execute_query_params::Query;
use ballista_core::serde::protobuf::scheduler_grpc_client::SchedulerGrpcClient;
use ballista_core::serde::protobuf::{ExecuteQueryParams, GetJobStatusParams};
use datafusion_proto::physical_plan::AsExecutionPlan;
use datafusion_proto::protobuf::physical_plan_node::PhysicalPlanType;
use datafusion_proto::protobuf::{EmptyExecNode, PhysicalPlanNode};
use koehler_cluster::link;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use tonic::Code;
use tonic::transport::{Channel, Endpoint};

fn scheduler() -> (Process, String) {
    let mut command = program();
    let scheduler = Process::start(command.args(["scheduler", "--listen", "127.0.0.1:0"]));
    let address = scheduler.said.rsplit(' ').next().expect("an address").to_string();
    (scheduler, format!("http://{address}"))
}

/// A client that says it is us, or something else.
async fn client(address: &str, other: Option<&'static str>) -> SchedulerGrpcClient<Channel> {
    let endpoint = Endpoint::from_shared(address.to_string()).expect("an address");
    let endpoint = link::endpoints(None)(endpoint).expect("an endpoint");
    let endpoint = match other {
        Some(other) => endpoint.user_agent(other).expect("a name"),
        None => endpoint,
    };
    SchedulerGrpcClient::new(endpoint.connect().await.expect("connected"))
}

fn on_a_runtime<F: Future>(future: F) -> F::Output {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    runtime.expect("threads").block_on(future)
}

#[test]
fn programs_of_another_version_or_machine() {
    let (_scheduler, address) = scheduler();
    on_a_runtime(async {
        let nothing = || GetJobStatusParams { job_id: "none".into() };
        let ours = client(&address, None).await.get_job_status(nothing()).await;
        assert!(ours.err().is_none_or(|status| status.code() != Code::FailedPrecondition));
        for (other, why) in [
            ("python", "it is no koehler-cluster"),
            ("koehler-cluster/1:2:x86_64-linux:yes", "code version is 1 there"),
        ] {
            let theirs = client(&address, Some(other)).await.get_job_status(nothing()).await;
            let status = theirs.expect_err("refused");
            assert_eq!(status.code(), Code::FailedPrecondition);
            assert!(status.message().contains(why), "{}", status.message());
        }
    });
}

#[test]
fn plans_of_others() {
    let (_scheduler, address) = scheduler();
    let mut empty = Vec::new();
    let node = EmptyExecNode::default();
    let plan = PhysicalPlanNode { physical_plan_type: Some(PhysicalPlanType::Empty(node)) };
    plan.try_encode(&mut empty).expect("bytes");
    let queries = [
        Query::LogicalPlan(Vec::new()),
        Query::SubstraitPlan(Vec::new()),
        Query::PhysicalPlan(empty),
        Query::PhysicalPlan(b"nonsense".to_vec()),
    ];
    on_a_runtime(async {
        for query in queries {
            let params = || ExecuteQueryParams { query: Some(query.clone()), ..Default::default() };
            let mut client = client(&address, None).await;
            let pulled = client.execute_query(params()).await.expect_err("refused");
            let pushed = client.execute_query_push(params()).await.expect_err("refused");
            assert_eq!(
                (pulled.code(), pushed.code()),
                (Code::PermissionDenied, Code::PermissionDenied)
            );
        }
    });
}

#[test]
fn addresses_of_others_without_certificates() {
    let out = std::env::temp_dir();
    let out = out.to_str().expect("text");
    for args in [
        &["scheduler", "--listen", "0.0.0.0:0"][..],
        &["worker", "127.0.0.1:1", "--listen", "0.0.0.0:0", "--out", out],
        &["worker", "node7:50050", "--out", out],
        &["run", "pipeline.toml", "--cluster", "node7:50050"],
    ] {
        let output = program().args(args).output().expect("started");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("no mutual TLS") && said.contains("--insecure"), "{said}");
    }
    let mut open = program();
    let open = Process::start(open.args(["scheduler", "--listen", "0.0.0.0:0", "--insecure"]));
    assert!(open.said.starts_with("scheduler at 0.0.0.0:"), "{}", open.said);
}

/// The plain program, where it was built beside this one.
fn plain() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_BIN_EXE_koehler-cluster")).with_file_name("koehler");
    let there = path.is_file();
    if !there {
        println!("skipped: build `koehler` with the same profile first");
    }
    there.then_some(path)
}

#[test]
fn the_plain_program_starts_this_one_or_says_how_it_is_built() {
    let Some(plain) = plain() else { return };
    let scheduler =
        Process::start(Command::new(&plain).args(["scheduler", "--listen", "127.0.0.1:0"]));
    assert!(scheduler.said.starts_with("scheduler at 127.0.0.1:"), "{}", scheduler.said);
    let elsewhere = tempfile::tempdir().expect("a folder");
    let alone = elsewhere.path().join("koehler");
    std::fs::copy(&plain, &alone).expect("copied");
    for args in [&["scheduler"][..], &["worker", "x:1"], &["run", "p.toml", "--cluster", "x:1"]] {
        let output = Command::new(&alone).args(args).env("PATH", "").output().expect("started");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("cargo build --profile cluster --package koehler-cluster"), "{said}");
    }
    // Something else of that name.
    let other = elsewhere.path().join("koehler-cluster");
    std::fs::write(&other, "#!/bin/sh\necho 123\n").expect("written");
    std::fs::set_permissions(&other, Permissions::from_mode(0o755)).expect("set");
    let output = Command::new(&alone).arg("scheduler").output().expect("started");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("is made from other sources"), "{said}");
}
