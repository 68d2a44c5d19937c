//! A model and the records of a campaign in; what is known of both besides the model, out.

use std::collections::BTreeMap;

use indexmap::IndexMap;

use crate::dynamics::Record;
use crate::model::Model;

/// What is known about the campaign besides the model.
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Role to names of the model, where its names do not tell (`output(name)` for an output).
    pub roles: IndexMap<String, Vec<String>>,
    /// The outputs that are measured: no other has a sensor. Empty: all of them.
    pub measured: Vec<String>,
    /// Half the range of inputs and outputs in the data, by name, SI.
    pub sizes: BTreeMap<String, f64>,
    /// The middle of these ranges, by name.
    pub middles: BTreeMap<String, f64>,
}

impl Context {
    /// What the records of a campaign tell about the inputs and outputs of a model.
    pub fn of(model: &Model, records: &[&Record]) -> Context {
        let mut context = Context::default();
        for (i, input) in model.inputs.iter().enumerate() {
            let values =
                records.iter().flat_map(|r| r.inputs.iter().skip(i).step_by(model.inputs.len()));
            context.put(&input.name, values);
        }
        for (o, output) in model.outputs.iter().enumerate() {
            let channels = || records.iter().flat_map(|r| &r.channels).filter(|c| c.output == o);
            if channels().next().is_some() {
                context.measured.push(output.name.clone());
                // A state of the same name is measured by it; an input of that name is known
                // already.
                if model.input(&output.name).is_none() {
                    context.put(&output.name, channels().flat_map(|c| &c.z));
                }
            }
        }
        context
    }

    fn put<'a>(&mut self, name: &str, values: impl Iterator<Item = &'a f64>) {
        let range = |(low, high): (f64, f64), &v: &f64| {
            if v.is_finite() { (low.min(v), high.max(v)) } else { (low, high) }
        };
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), range);
        if low <= high {
            self.sizes.insert(name.to_string(), (high - low) / 2.0);
            self.middles.insert(name.to_string(), (high + low) / 2.0);
        }
    }
}
