//! Items in; the one form of plan that this engine knows out, and of any plan whether it has that
//! form.

use crate::stage;
use arrow_array::{BinaryArray, RecordBatch, StringArray, UInt64Array};
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use ballista_core::execution_plans::ShuffleWriterExec;
use datafusion::common::config::ConfigOptions;
use datafusion::common::{DataFusionError, Result};
use datafusion::datasource::memory::MemorySourceConfig;
use datafusion::datasource::source::DataSourceExec;
use datafusion::physical_expr::expressions::Column;
use datafusion::physical_expr::{PhysicalExpr, ScalarFunctionExpr};
use datafusion::physical_plan::ExecutionPlan;
use datafusion::physical_plan::projection::ProjectionExec;
use datafusion_proto::protobuf::physical_expr_node::ExprType;
use datafusion_proto::protobuf::physical_plan_node::PhysicalPlanType;
use datafusion_proto::protobuf::{PhysicalExprNode, PhysicalPlanNode};
use std::sync::Arc;

/// Name of the one function.
pub const STAGE: &str = "stage";

/// A query has at most so many tasks. How many items a task has depends on their number alone.
const TASKS: usize = 256;

/// What travels: number of the item, function, parameters, item.
fn sent() -> SchemaRef {
    Arc::new(Schema::new(vec![
        Field::new("i", DataType::UInt64, false),
        Field::new("function", DataType::Utf8, false),
        Field::new("parameters", DataType::Binary, false),
        Field::new("item", DataType::Binary, false),
    ]))
}

/// A query over these items: a table of them, in as many parts as there are tasks, and a projection
/// that calls the function.
///
/// # Errors
/// The engine does not take it.
pub fn of(
    function: &str,
    parameters: &[u8],
    items: &[(usize, Vec<u8>)],
) -> Result<Arc<dyn ExecutionPlan>> {
    let tasks = items.chunks(items.len().div_ceil(TASKS).max(1));
    let parts = tasks.map(|items| Ok(vec![batch(function, parameters, items)?]));
    let parts: Vec<Vec<RecordBatch>> = parts.collect::<Result<_>>()?;
    let table = MemorySourceConfig::try_new_exec(&parts, sent(), None)?;
    let column = |name: &str, i: usize| Arc::new(Column::new(name, i)) as Arc<dyn PhysicalExpr>;
    let args = vec![column("function", 1), column("parameters", 2), column("item", 3)];
    let options = Arc::new(ConfigOptions::default());
    let call = ScalarFunctionExpr::try_new(stage::stage(None), args, &sent(), options)?;
    let call: Arc<dyn PhysicalExpr> = Arc::new(call);
    let columns = [(column("i", 0), "i".to_string()), (call, "answer".to_string())];
    Ok(Arc::new(ProjectionExec::try_new(columns, table)?))
}

fn batch(function: &str, parameters: &[u8], items: &[(usize, Vec<u8>)]) -> Result<RecordBatch> {
    let n = items.len();
    let numbers = items.iter().map(|(i, _)| *i as u64);
    let columns: Vec<arrow_array::ArrayRef> = vec![
        Arc::new(UInt64Array::from_iter_values(numbers)),
        Arc::new(StringArray::from_iter_values(std::iter::repeat_n(function, n))),
        Arc::new(BinaryArray::from_iter_values(std::iter::repeat_n(parameters, n))),
        Arc::new(BinaryArray::from_iter_values(items.iter().map(|(_, item)| item))),
    ];
    Ok(RecordBatch::try_new(sent(), columns)?)
}

/// What goes back, from a batch of it: number of the item and answer.
///
/// # Errors
/// It is something else.
pub fn rows(batch: &RecordBatch) -> Result<Vec<(usize, Vec<u8>)>> {
    let column = |i: usize| batch.columns().get(i).map(|column| column.as_any());
    let numbers = column(0).and_then(|any| any.downcast_ref::<UInt64Array>());
    let answers = column(1).and_then(|any| any.downcast_ref::<BinaryArray>());
    match (numbers, answers) {
        (Some(numbers), Some(answers)) => Ok(numbers
            .values()
            .iter()
            .zip(answers)
            .map(|(i, answer)| (*i as usize, answer.unwrap_or_default().to_vec()))
            .collect()),
        _ => Err(DataFusionError::Execution("rows of another form came back".into())),
    }
}

/// Whether a plan that a client sends has the form of ours: the table it carries, and the function.
pub fn is_ours(plan: &PhysicalPlanNode) -> bool {
    let column = |expr: &PhysicalExprNode| matches!(expr.expr_type, Some(ExprType::Column(_)));
    let call = |expr: &PhysicalExprNode| match &expr.expr_type {
        Some(ExprType::ScalarUdf(udf)) => udf.name == STAGE && udf.args.iter().all(column),
        _ => column(expr),
    };
    let Some(PhysicalPlanType::Projection(projection)) = &plan.physical_plan_type else {
        return false;
    };
    let input = projection.input.as_ref().and_then(|input| input.physical_plan_type.as_ref());
    projection.expr.iter().all(call) && matches!(input, Some(PhysicalPlanType::MemoryScan(_)))
}

/// The same of the plan of a task, as a worker gets it.
///
/// # Errors
/// It has another form.
pub fn check(plan: &Arc<dyn ExecutionPlan>) -> Result<()> {
    let refused = |what: &str| {
        Err(DataFusionError::Execution(format!("refused: this worker runs no plan with {what}")))
    };
    if let Some(source) = plan.downcast_ref::<DataSourceExec>() {
        return match source.data_source().downcast_ref::<MemorySourceConfig>() {
            Some(_) => Ok(()),
            None => refused("a source of data but the items of a job"),
        };
    }
    if let Some(projection) = plan.downcast_ref::<ProjectionExec>() {
        if !projection.expr().iter().all(|projected| is_call(&projected.expr)) {
            return refused("another function");
        }
    } else if plan.downcast_ref::<ShuffleWriterExec>().is_none() {
        return refused(plan.name());
    }
    plan.children().into_iter().try_for_each(check)
}

/// A column, or the function over columns.
fn is_call(expr: &Arc<dyn PhysicalExpr>) -> bool {
    let column = |expr: &Arc<dyn PhysicalExpr>| expr.downcast_ref::<Column>().is_some();
    match expr.downcast_ref::<ScalarFunctionExpr>() {
        Some(call) => call.name() == STAGE && call.args().iter().all(column),
        None => column(expr),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballista_core::serde::BallistaPhysicalExtensionCodec;
    use datafusion::physical_plan::empty::EmptyExec;
    use datafusion_proto::physical_plan::AsExecutionPlan;

    fn sent_as(plan: Arc<dyn ExecutionPlan>) -> PhysicalPlanNode {
        let codec = BallistaPhysicalExtensionCodec::default();
        PhysicalPlanNode::try_from_physical_plan(plan, &codec).expect("a message")
    }

    #[test]
    fn our_plan_passes_and_no_other() {
        let items: Vec<(usize, Vec<u8>)> = (0..600).map(|i| (i, vec![i as u8])).collect();
        let plan = of("f@1", b"p", &items).expect("a plan");
        assert!(check(&plan).is_ok());
        assert!(is_ours(&sent_as(plan.clone())));
        // Three items to a task: their number decides it, and nothing else.
        assert_eq!(plan.properties().output_partitioning().partition_count(), 200);
        let nothing: Arc<dyn ExecutionPlan> = Arc::new(EmptyExec::new(sent()));
        assert!(check(&nothing).is_err() && !is_ours(&sent_as(nothing.clone())));
        let column: Arc<dyn PhysicalExpr> = Arc::new(Column::new("i", 0));
        let over = ProjectionExec::try_new([(column, "i".to_string())], nothing).expect("a plan");
        let over: Arc<dyn ExecutionPlan> = Arc::new(over);
        assert!(check(&over).is_err() && !is_ours(&sent_as(over)));
    }

    #[test]
    fn what_comes_back_is_numbered() {
        let answers = BinaryArray::from_iter_values([b"b", b"a"]);
        let numbers = UInt64Array::from(vec![1, 0]);
        let batch = RecordBatch::try_from_iter([
            ("i", Arc::new(numbers) as arrow_array::ArrayRef),
            ("answer", Arc::new(answers) as arrow_array::ArrayRef),
        ]);
        let found = rows(&batch.expect("a batch")).expect("rows");
        assert_eq!(found, [(1, b"b".to_vec()), (0, b"a".to_vec())]);
    }
}
