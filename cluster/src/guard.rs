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

/// The engine's scheduler behind the guard.
pub struct Guarded(pub SchedulerServer<LogicalPlanNode, PhysicalPlanNode>);

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

/// Hands calls on as they are.
macro_rules! handed_on {
    ($($name:ident: $params:ty => $result:ty,)*) => {
        $(async fn $name(&self, request: Request<$params>) -> Answer<$result> {
            SchedulerGrpc::$name(&self.0, request).await
        })*
    };
}

#[tonic::async_trait]
impl SchedulerGrpc for Guarded {
    type ExecuteQueryPushStream =
        <SchedulerServer<LogicalPlanNode, PhysicalPlanNode> as SchedulerGrpc>::ExecuteQueryPushStream;

    async fn execute_query_push(
        &self,
        request: Request<ExecuteQueryParams>,
    ) -> Answer<Self::ExecuteQueryPushStream> {
        ours(request.get_ref())?;
        self.0.execute_query_push(request).await
    }

    async fn execute_query(
        &self,
        request: Request<ExecuteQueryParams>,
    ) -> Answer<ExecuteQueryResult> {
        ours(request.get_ref())?;
        self.0.execute_query(request).await
    }

    async fn poll_work(&self, request: Request<PollWorkParams>) -> Answer<PollWorkResult> {
        // The engine takes the address of the caller where a worker does not say its own, and
        // panics where there is none.
        let metadata = request.get_ref().metadata.as_ref();
        if metadata.is_none_or(|m| m.host.is_none() || m.specification.is_none()) {
            return Err(Status::invalid_argument("a worker says its host and its size"));
        }
        self.0.poll_work(request).await
    }

    handed_on! {
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
}
