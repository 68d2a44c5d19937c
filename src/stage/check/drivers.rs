//! Inputs of a model and the columns that there are in; the columns that drive it, with agreeing
//! units, or the mistakes, out.

use super::columns::{Columns, Found};
use super::unknown::unknown;
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use crate::model::{Model, Quantity};
use crate::stage::channels::Stated;
use crate::units::Unit;
use indexmap::IndexMap;

/// Whether two units have one dimension.
pub fn agree(a: &str, b: &str) -> bool {
    match (Unit::parse(a), Unit::parse(b)) {
        (Ok(a), Ok(b)) => a.dim == b.dim,
        _ => false,
    }
}

/// A signal or column whose unit has another dimension than what it is taken for.
pub struct Unlike<'a> {
    pub name: &'a str,
    pub unit: &'a str,
    /// Unit that is wanted, and what wants it.
    pub wanted: &'a str,
    pub by: &'a str,
    /// The unit as the channel map states it; none for what is computed.
    pub stated: Option<&'a Stated>,
}

impl Unlike<'_> {
    /// The mistake: of a signal where its unit is stated, so that it is one however many want the
    /// signal (`pipeline::plan::once`), of a column where it is wanted.
    pub fn error(&self, at: Place) -> Error {
        let Unlike { name, unit, wanted, by, stated } = self;
        match stated {
            Some(Stated { unit, place }) => {
                let what = format!("signal \"{name}\" is in {unit}, {wanted} is wanted");
                Error::at(place.clone(), what).help(format!(
                    "correct its unit, or name another signal where this one is wanted\n    {by} wants it at {at}"
                ))
            }
            None => Error::at(at, format!("{by} is in {wanted}, column \"{name}\" in {unit}"))
                .help("map another column to it, or correct the unit in the model"),
        }
    }
}

/// Checks that the keys of a mapping are names of the model.
pub fn keys_are_known(
    map: &IndexMap<String, String>,
    known: &[Quantity],
    kind: &str,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) {
    let names: Vec<&str> = known.iter().map(|q| q.name.as_str()).collect();
    for name in map.keys().filter(|name| !names.contains(&name.as_str())) {
        errors.push(unknown(doc, &format!("{key}.{name}"), kind, name, &names));
    }
}

/// The column for one input of a model, by the mapping or by its own name.
pub fn driver(
    input: &Quantity,
    map: &IndexMap<String, String>,
    columns: &Columns,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) -> Option<String> {
    let mapped = map.get(&input.name);
    let name = mapped.unwrap_or(&input.name);
    let at = if mapped.is_some() { format!("{key}.{}", input.name) } else { key.to_string() };
    match columns.find(name) {
        Found::Known(column) if !agree(&column.unit, &input.unit) => {
            let stated = column.stated.as_ref().filter(|_| !column.made);
            let by = format!("input \"{}\" of the model", input.name);
            let (unit, wanted) = (&column.unit, &input.unit);
            errors.push(Unlike { name, unit, wanted, by: &by, stated }.error(doc.place(&at)));
        }
        Found::Known(_) | Found::Unsure => (),
        Found::Missing => {
            let mut error = unknown(doc, &at, "signal or column", name, &columns.names());
            if mapped.is_none() {
                error.what = format!(
                    "input \"{}\" of the model has no column of this name, and none is mapped to it",
                    input.name
                );
            }
            if name == "v" && columns.unit("v_body").is_some() {
                let help = format!(
                    "the flight path's v is the column \"v_body\": inputs = {{ {} = \"v_body\" }}",
                    input.name
                );
                error.help = Some(help);
            }
            errors.push(error);
            return None;
        }
    }
    Some(name.clone())
}

/// The columns that drive a model, in the order of its inputs.
pub fn drivers(
    model: &Model,
    map: &IndexMap<String, String>,
    columns: &Columns,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) -> Vec<String> {
    keys_are_known(map, &model.inputs, "input of the model", doc, key, errors);
    model.inputs.iter().filter_map(|input| driver(input, map, columns, doc, key, errors)).collect()
}
