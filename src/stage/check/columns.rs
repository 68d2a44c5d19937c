//! Signals, flight path and derived outputs come in; the columns that there are, or may be, go out.

use super::unknown::unknown;
use crate::config::Doc;
use crate::error::Errors;
use crate::model::Model;
use crate::stage::channels::{Channels, Stated};
use crate::table::schema;
use indexmap::IndexMap;
use std::collections::BTreeSet;

/// Everything a model can be driven by or compared with, by name.
#[derive(Debug, Clone, Default)]
pub struct Columns {
    all: IndexMap<String, Column>,
    /// Names that a stage with mistakes may have a column for.
    unsure: BTreeSet<String>,
    /// It is not even known which names: there may be a column of any.
    open: bool,
}

/// What a name stands for.
pub enum Found<'a> {
    Known(&'a Column),
    /// A stage with mistakes may have it. Nothing is said about it: the mistake is that stage's.
    Unsure,
    Missing,
}

#[derive(Debug, Clone)]
pub struct Column {
    /// SI unit.
    pub unit: String,
    /// Unit of the signal of the channel map with this name; a reconstructed column may have taken
    /// its place in the samples.
    pub signal: Option<String>,
    /// That unit as the channel map states it, and where.
    pub stated: Option<Stated>,
    /// Its values are reconstructed or derived, not those of the signal.
    pub made: bool,
}

impl Columns {
    /// The signals of the channel map, nothing being said of those whose unit is a mistake; none where
    /// it cannot be read.
    pub fn of_signals(channels: Option<&Channels>) -> Columns {
        let Some(channels) = channels else { return Columns { open: true, ..Columns::default() } };
        let column = |name: &String| Column {
            unit: channels.unit(name),
            signal: Some(channels.unit(name)),
            stated: channels.stated(name),
            made: false,
        };
        let all: IndexMap<_, _> =
            channels.map.signal.keys().map(|name| (name.clone(), column(name))).collect();
        let no_unit = all.iter().filter(|(_, column)| column.unit.is_empty());
        let unsure = no_unit.map(|(name, _)| name.clone()).collect();
        Columns { all, unsure, ..Columns::default() }
    }

    /// With the columns of the flight path that the kinematic model has; none where the model has
    /// mistakes.
    pub fn with_flight_path(mut self, kinematics: Option<&Model>) -> Columns {
        for column in schema("flightpath").iter().flat_map(|s| &s.columns) {
            match kinematics {
                Some(model) if model.output(&column.name).is_some() => {
                    self.put(&column.name, &column.unit)
                }
                Some(_) => (),
                None => drop(self.unsure.insert(column.name.clone())),
            }
        }
        self
    }

    /// With the outputs of the model of `[derive]`.
    pub fn with_derived(mut self, derived: Option<&Model>) -> Columns {
        for output in derived.iter().flat_map(|m| &m.outputs) {
            self.put(&output.name, &output.unit);
        }
        self
    }

    /// With the outputs that the model of `[derive]` declares, which has mistakes; none where it
    /// cannot be read.
    pub fn with_unsure(mut self, declared: Option<Vec<String>>) -> Columns {
        self.open |= declared.is_none();
        self.unsure.extend(declared.unwrap_or_default());
        self
    }

    /// Files an error for every two columns of the samples table whose names differ by case only,
    /// at what a person can rename: a signal, else the model of `[derive]`.
    pub fn distinct(&self, channels: &Channels, doc: &Doc, errors: &mut Errors) {
        let of = |table: &str| {
            schema(table)
                .iter()
                .flat_map(|s| &s.columns)
                .map(|c| c.name.as_str())
                .collect::<Vec<_>>()
        };
        let (own, path) = (of("samples"), of("flightpath"));
        let all: Vec<&str> = own.iter().copied().chain(self.names()).collect();
        for (i, &name) in all.iter().enumerate() {
            let Some(&other) =
                all[..i].iter().find(|other| other.to_lowercase() == name.to_lowercase())
            else {
                continue;
            };
            let what = format!(
                "\"{other}\" and \"{name}\" would both be columns of the table `samples`, and many readers (DuckDB, Spark) take them for one"
            );
            let signals = &channels.map.signal;
            let (error, rest) = match [name, other].into_iter().find(|n| signals.contains_key(*n)) {
                Some(signal) => (
                    channels.doc.error(&format!("signal.{signal}"), what),
                    if signal == name { other } else { name },
                ),
                None => (doc.error("derive.model", what), ""),
            };
            errors.push(error.help(match path.contains(&rest) && !own.contains(&rest) && !signals.contains_key(rest) {
                true => {
                    format!("call the signal \"{rest}\" as the flight path does, which then takes its place, or something else")
                }
                false => "give one of them another name".to_string(),
            }));
        }
    }

    /// With one more column.
    pub fn put(&mut self, name: &str, unit: &str) {
        let (signal, stated) =
            self.all.get(name).map(|c| (c.signal.clone(), c.stated.clone())).unwrap_or_default();
        let column = Column { unit: unit.to_string(), signal, stated, made: true };
        self.all.insert(name.to_string(), column);
    }

    pub fn names(&self) -> Vec<&str> {
        self.all.keys().map(String::as_str).collect()
    }

    /// What a name stands for.
    pub fn find(&self, name: &str) -> Found<'_> {
        match self.all.get(name) {
            _ if self.unsure.contains(name) => Found::Unsure,
            Some(column) => Found::Known(column),
            None if self.open => Found::Unsure,
            None => Found::Missing,
        }
    }

    /// The unit of the signal of this name, whatever column has taken the name.
    pub fn signal(&self, name: &str) -> Option<&str> {
        self.all.get(name)?.signal.as_deref()
    }

    /// The unit of the signal of this name as the channel map states it, and where.
    pub fn stated(&self, name: &str) -> Option<&Stated> {
        self.all.get(name)?.stated.as_ref()
    }

    /// The unit of a column, if there is one; empty where a stage with mistakes may have it.
    pub fn unit(&self, name: &str) -> Option<String> {
        match self.find(name) {
            Found::Known(column) => Some(column.unit.clone()),
            Found::Unsure => Some(String::new()),
            Found::Missing => None,
        }
    }

    /// Nothing more is said of a name: that there is none has been told where it was met first.
    pub fn told(&mut self, name: &str) {
        self.unsure.insert(name.to_string());
    }

    /// As `unit`; files an error where there is no column of this name.
    pub fn look_up(
        &self,
        name: &str,
        kind: &str,
        doc: &Doc,
        key: &str,
        errors: &mut Errors,
    ) -> Option<String> {
        let unit = self.unit(name);
        if unit.is_none() {
            errors.push(unknown(doc, key, kind, name, &self.names()));
        }
        unit
    }
}
