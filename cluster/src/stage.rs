//! The one function of the engine: names of functions, parameters and items as columns in, answers as
//! a column out.

use crate::desk::Desk;
use crate::plan::STAGE;
use arrow_array::builder::BinaryBuilder;
use arrow_array::{Array, BinaryArray, StringArray};
use arrow_schema::DataType;
use datafusion::common::{DataFusionError, Result};
use datafusion::logical_expr::{
    ColumnarValue, ScalarFunctionArgs, ScalarUDF, ScalarUDFImpl, Signature, Volatility,
};
use std::hash::{Hash, Hasher};
use std::sync::Arc;

/// `stage(name@version, parameters, item) -> answer`
#[derive(Debug)]
pub struct Stage {
    signature: Signature,
    /// Where work is done; none in a process that only plans or collects.
    desk: Option<Arc<Desk>>,
}

impl PartialEq for Stage {
    fn eq(&self, other: &Stage) -> bool {
        self.desk.is_some() == other.desk.is_some()
    }
}

impl Eq for Stage {}

impl Hash for Stage {
    fn hash<H: Hasher>(&self, state: &mut H) {
        STAGE.hash(state);
    }
}

/// The function as the engine knows it.
pub fn stage(desk: Option<Arc<Desk>>) -> Arc<ScalarUDF> {
    // Volatile: no planner may think that it can call it itself.
    let types = vec![DataType::Utf8, DataType::Binary, DataType::Binary];
    let signature = Signature::exact(types, Volatility::Volatile);
    Arc::new(ScalarUDF::from(Stage { signature, desk }))
}

fn wrong(what: &str) -> DataFusionError {
    DataFusionError::Execution(format!("{STAGE}: {what}"))
}

fn column<T: Array + Clone + 'static>(args: &ScalarFunctionArgs, i: usize) -> Result<T> {
    let array = match args.args.get(i) {
        Some(value) => value.to_array(args.number_rows)?,
        None => return Err(wrong("an argument is missing")),
    };
    array.as_any().downcast_ref::<T>().cloned().ok_or_else(|| wrong("an argument of another type"))
}

impl ScalarUDFImpl for Stage {
    fn name(&self) -> &str {
        STAGE
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _: &[DataType]) -> Result<DataType> {
        Ok(DataType::Binary)
    }

    fn invoke_with_args(&self, args: ScalarFunctionArgs) -> Result<ColumnarValue> {
        let desk = self.desk.as_ref().ok_or_else(|| wrong("only workers do work"))?;
        let functions: StringArray = column(&args, 0)?;
        let parameters: BinaryArray = column(&args, 1)?;
        let items: BinaryArray = column(&args, 2)?;
        let mut answers = BinaryBuilder::new();
        for i in 0..args.number_rows {
            let answer = desk.answer(functions.value(i), parameters.value(i), items.value(i));
            answers.append_value(answer.encoded());
        }
        let answers: BinaryArray = answers.finish();
        Ok(ColumnarValue::Array(Arc::new(answers)))
    }
}
