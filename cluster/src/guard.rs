//! Calls of clients and workers in; those of this program, with plans of our form, to the engine's
//! scheduler out. All others are refused before anything of them is looked at.

use crate::plan;
use ballista_core::serde::protobuf::execute_query_params::Query;
use ballista_core::serde::protobuf::scheduler_grpc_server::SchedulerGrpc;
use ballista_core::serde::protobuf::{
    CancelJobParams, CancelJobResult, CleanJobDataParams, CleanJobDataResult,
    CreateUpdateSessionParams, CreateUpdateSessionResult, ExecuteQueryParams, ExecuteQueryResult,
    ExecutorStoppedParams, ExecutorStoppedResult, GetJobMetricsParams, GetJobMetricsResult,
    GetJobStatusParams, GetJobStatusResult, HeartBeatParams, HeartBeatResult, PollWorkParams,
    PollWorkResult, RegisterExecutorParams, RegisterExecutorResult, RemoveSessionParams,
    RemoveSessionResult, UpdateTaskStatusParams, UpdateTaskStatusResult,
};
use ballista_scheduler::scheduler_server::SchedulerServer;
use datafusion_proto::physical_plan::AsExecutionPlan;
use datafusion_proto::protobuf::{LogicalPlanNode, PhysicalPlanNode};
use tonic::{Request, Response, Status};

type Scheduler = SchedulerServer<LogicalPlanNode, PhysicalPlanNode>;

/// The engine's scheduler behind the guard.
pub struct Guarded(pub Scheduler);

type Answer<T> = Result<Response<T>, Status>;

/// Refuses a query that is not a call of our function over items that it carries.
fn ours(params: &ExecuteQueryParams) -> Result<(), Status> {
    let refused = |what: &str| Err(Status::permission_denied(format!("refused: {what}")));
    let Some(Query::PhysicalPlan(bytes)) = &params.query else {
        return refused("only plans of koehler-cluster are run here");
    };
    match PhysicalPlanNode::try_decode(bytes) {
        Ok(plan) if plan::is_ours(&plan) => Ok(()),
        Ok(_) => refused("a plan with more than items and the one function"),
        Err(e) => refused(&e.to_string()),
    }
}

/// Refuses a worker that does not say where it is and how large: the engine panics over it.
fn known(params: &PollWorkParams) -> Result<(), Status> {
    match &params.metadata {
        Some(m) if m.host.is_some() && m.specification.is_some() && m.os_info.is_some() => Ok(()),
        _ => Err(Status::invalid_argument("a worker says its host, its size and its system")),
    }
}

/// The guard: what it looks at, and the calls that it hands on as they are. (One macro over all of it:
/// methods of a trait with `async` have to stand where the attribute sees them.)
macro_rules! guarded {
    ($($name:ident: $params:ty => $result:ty,)*) => {
        #[tonic::async_trait]
        impl SchedulerGrpc for Guarded {
            type ExecuteQueryPushStream = <Scheduler as SchedulerGrpc>::ExecuteQueryPushStream;

            async fn execute_query_push(
                &self,
                request: Request<ExecuteQueryParams>,
            ) -> Answer<Self::ExecuteQueryPushStream> {
                ours(request.get_ref())?;
                SchedulerGrpc::execute_query_push(&self.0, request).await
            }

            async fn execute_query(
                &self,
                request: Request<ExecuteQueryParams>,
            ) -> Answer<ExecuteQueryResult> {
                ours(request.get_ref())?;
                SchedulerGrpc::execute_query(&self.0, request).await
            }

            async fn poll_work(&self, request: Request<PollWorkParams>) -> Answer<PollWorkResult> {
                known(request.get_ref())?;
                SchedulerGrpc::poll_work(&self.0, request).await
            }

            $(async fn $name(&self, request: Request<$params>) -> Answer<$result> {
                SchedulerGrpc::$name(&self.0, request).await
            })*
        }
    };
}

guarded! {
    register_executor: RegisterExecutorParams => RegisterExecutorResult,
    heart_beat_from_executor: HeartBeatParams => HeartBeatResult,
    update_task_status: UpdateTaskStatusParams => UpdateTaskStatusResult,
    create_update_session: CreateUpdateSessionParams => CreateUpdateSessionResult,
    remove_session: RemoveSessionParams => RemoveSessionResult,
    get_job_status: GetJobStatusParams => GetJobStatusResult,
    get_job_metrics: GetJobMetricsParams => GetJobMetricsResult,
    executor_stopped: ExecutorStoppedParams => ExecutorStoppedResult,
    cancel_job: CancelJobParams => CancelJobResult,
    clean_job_data: CleanJobDataParams => CleanJobDataResult,
}
