//! The names that a model's sources declare: inputs, constants, parameters, equations, states,
//! tables.

use super::compile::{At, Compiler, Symbol, TableInfo, Uncertain};
use super::file::{Constant, Input, Values};
use super::functions;
use super::tables::Table;
use super::{Assumed, Constants, Parameter, Quantity, Scope, StartKind, State};
use crate::units::{Dim, Unit};

impl Compiler<'_> {
    fn add_symbol(&mut self, name: &str, symbol: Symbol, at: At) -> bool {
        if !valid_name(name) {
            self.error(&at, 0, format!("\"{name}\" is not a name: letters, digits and _ only, not beginning with a digit"));
            return false;
        }
        if functions::is_reserved(name) {
            self.error(
                &at,
                0,
                format!(
                    "\"{name}\" is a function or a constant of the language; choose another name"
                ),
            );
            return false;
        }
        if let Some((_, first)) = self.symbols.get(name) {
            let place = self.sources[first.source].doc.key_place(&first.key);
            self.error(&at, 0, format!("\"{name}\" is already declared at {place}"));
            return false;
        }
        self.symbols.insert(name.to_string(), (symbol, at));
        true
    }

    /// Declares every name of every source.
    pub(super) fn declare(&mut self, constants: &Constants) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            let at = |section: &str, name: &str| At {
                source: s,
                key: format!("{}{section}.{name}", source.prefix),
            };
            for (name, entry) in &source.file.inputs {
                let (unit, doc) = match entry {
                    Input::Unit(unit) => (unit, String::new()),
                    Input::Full(full) => (&full.unit, full.doc.clone()),
                };
                let here = at("inputs", name);
                let dim = self.unit(&here, unit);
                if self.repeats(name, dim, |s| matches!(s, Symbol::Input(_))) {
                    continue;
                }
                if self.add_symbol(name, Symbol::Input(self.model.inputs.len()), here) {
                    self.dims.insert(name.clone(), dim);
                    self.model.inputs.push(Quantity {
                        name: name.clone(),
                        unit: unit.clone(),
                        doc,
                    });
                }
            }
            for (name, entry) in &source.file.constants {
                self.constant(name, entry, at("constants", name), constants);
            }
            for (name, p) in &source.file.parameters {
                let here = at("parameters", name);
                let dim = self.unit(&here, &p.unit);
                let (min, max) =
                    (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
                if !(min <= p.start && p.start <= max) {
                    self.error(
                        &here,
                        0,
                        format!(
                            "\"{name}\" starts at {} outside its bounds {min} .. {max}",
                            p.start
                        ),
                    );
                }
                let quantity =
                    Quantity { name: name.clone(), unit: p.unit.clone(), doc: p.doc.clone() };
                if p.per.trim().is_empty() {
                    self.error(&here, 0, format!("\"{name}\": per is campaign, segment, or a column of the segments, not empty"));
                }
                let scope = Scope::parse(&p.per);
                if p.held_in.is_some() && !matches!(scope, Scope::Column(_)) {
                    self.error(&here, 0, format!("\"{name}\": held_in is a value of the column that it is per (per = \"flight\"), and it is per {}", scope.name()));
                }
                if self.add_symbol(name, Symbol::Parameter(self.model.parameters.len()), here) {
                    self.dims.insert(name.clone(), dim);
                    let prior_sd = p.sd.unwrap_or(f64::INFINITY);
                    self.model.parameters.push(Parameter {
                        quantity,
                        start: p.start,
                        min,
                        max,
                        scope,
                        held_in: p.held_in.clone(),
                        fixed: p.fixed,
                        prior_sd,
                    });
                }
            }
            for name in source.file.equations.keys() {
                let here = at("equations", name);
                self.add_symbol(name, Symbol::Equation(here.clone()), here);
            }
            for (name, state) in &source.file.states {
                let here = at("states", name);
                let dim = self.unit(&at("states", &format!("{name}.unit")), &state.unit);
                if self.add_symbol(name, Symbol::State(self.model.states.len()), here.clone()) {
                    self.dims.insert(name.clone(), dim);
                    let quantity = Quantity {
                        name: name.clone(),
                        unit: state.unit.clone(),
                        doc: state.doc.clone(),
                    };
                    self.model.states.push(State {
                        quantity,
                        start: StartKind::Measured,
                        min: None,
                        max: None,
                        rate_max: None,
                        noise: None,
                        start_sd: None,
                        rests: false,
                        hidden: false,
                    });
                    self.rates.push(None);
                    self.state_at.push(here);
                }
            }
        }
    }

    /// Whether `name` is declared already as the same kind of thing with the same unit (allowed for
    /// inputs and constants).
    fn repeats(&self, name: &str, dim: Dim, same: impl Fn(&Symbol) -> bool) -> bool {
        self.symbols.get(name).is_some_and(|(s, _)| same(s)) && self.dims.get(name) == Some(&dim)
    }

    fn constant(&mut self, name: &str, entry: &Constant, at: At, given: &Constants) {
        let (unit, own, own_sd, doc) = match entry {
            Constant::Unit(unit) => (unit, None, 0.0, String::new()),
            Constant::Full(full) => (&full.unit, full.value, full.sd, full.doc.clone()),
        };
        let dim = self.unit(&at, unit);
        let aircraft = given.0.get(name);
        let origin = aircraft.and_then(|a| a.origin.clone());
        let from = origin.as_ref().map_or("the aircraft file", |o| o.from.as_str());
        let source = aircraft.map(|a| a.source.clone()).unwrap_or_default();
        let (value, sd) = match aircraft {
            Some(a) => {
                match Unit::parse(&a.unit) {
                    Ok(u) if u.is_si() && u.dim == dim => {}
                    Ok(u) if u.dim == dim => self.error_help(
                        &at,
                        0,
                        format!("{from} gives \"{name}\" in {}", a.unit),
                        format!("constants are in SI: use {unit}"),
                    ),
                    Ok(u) => self.error(
                        &at,
                        0,
                        format!("\"{name}\" is in {dim} here, and in {} in {from}", u.dim),
                    ),
                    Err(what) => self.error(&at, 0, format!("\"{name}\" in {from}: {what}")),
                }
                (Some(a.value), a.sd)
            }
            None => (own, own_sd),
        };
        if self.repeats(name, dim, |s| matches!(s, Symbol::Constant(_))) {
            // a later source may give the value that an earlier one left open, or override it
            if let (Some(v), None, Some((Symbol::Constant(i), _))) =
                (value, aircraft, self.symbols.get(name))
            {
                (self.model.constants[*i].value, self.model.constants[*i].sd) = (v, sd);
            }
            return;
        }
        if self.add_symbol(name, Symbol::Constant(self.model.constants.len()), at) {
            self.dims.insert(name.to_string(), dim);
            let quantity = Quantity { name: name.to_string(), unit: unit.clone(), doc };
            let value = value.unwrap_or(f64::NAN);
            self.model.constants.push(Assumed { quantity, value, sd, source, origin });
        }
    }

    /// Makes parameters of constants that have an sd: of all of them fixed ones, or of those that are
    /// estimated.
    pub(super) fn open_constants(&mut self, uncertain: Uncertain) {
        for i in 0..self.model.constants.len() {
            let Assumed { quantity, value, sd, .. } = self.model.constants[i].clone();
            let (opens, fixed) = match uncertain {
                Uncertain::Estimated(names) => (names.contains(&quantity.name), false),
                Uncertain::Open => (true, true),
            };
            if !(opens && sd > 0.0 && value.is_finite()) {
                continue;
            }
            if let Some((symbol, _)) = self.symbols.get_mut(&quantity.name) {
                *symbol = Symbol::Parameter(self.model.parameters.len());
            }
            let (min, max) = (f64::NEG_INFINITY, f64::INFINITY);
            let scope = Scope::Campaign;
            self.model.parameters.push(Parameter {
                quantity,
                start: value,
                min,
                max,
                scope,
                held_in: None,
                fixed,
                prior_sd: if fixed { f64::INFINITY } else { sd },
            });
        }
    }

    pub(super) fn tables(&mut self) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            for (name, t) in &source.file.tables {
                let at = At { source: s, key: format!("tables.{name}") };
                let (x, y) = (self.unit(&at, &t.unit_x), self.unit(&at, &t.unit_y));
                let x2 = t.unit_x2.as_ref().map(|u| self.unit(&at, u));
                let x2_points = t.x2.clone().unwrap_or_default();
                let (rows, values) = match &t.y {
                    Values::Row(row) => (vec![1; row.len()], row.clone()),
                    Values::Rows(rows) => (rows.iter().map(Vec::len).collect(), rows.concat()),
                };
                let ascending = |p: &[f64]| {
                    p.windows(2).all(|w| w[0] < w[1]) && p.iter().all(|v| v.is_finite())
                };
                if t.x.is_empty() || !ascending(&t.x) || !ascending(&x2_points) {
                    self.error(&at, 0, format!("table \"{name}\": the break points must ascend and there must be at least one"));
                } else if x2.is_some() != t.x2.is_some() || t.x2.is_some() && x2_points.is_empty() {
                    self.error(&at, 0, format!("table \"{name}\": x2 and unit_x2 belong together, with at least one break point"));
                } else if rows.len() != t.x.len()
                    || rows.iter().any(|&r| r != x2_points.len().max(1))
                {
                    let wanted = format!("{} rows of {}", t.x.len(), x2_points.len().max(1));
                    self.error(
                        &at,
                        0,
                        format!(
                            "table \"{name}\": {wanted} values are wanted, {} values are there",
                            values.len()
                        ),
                    );
                } else {
                    let number = self.model.tables.0.len();
                    self.tables.insert(name.clone(), TableInfo { number, x, x2, y });
                    self.model.tables.0.push(Table { x: t.x.clone(), x2: x2_points, y: values });
                }
            }
        }
    }
}

fn valid_name(name: &str) -> bool {
    name.chars().next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
