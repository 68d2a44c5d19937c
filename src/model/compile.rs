//! Parsed model files to a compiled model: names looked up, units checked, equations sorted, everything one graph.
//!
//! All mistakes of a model are collected. An equation is built when it is first needed; one that is needed while it is being built is
//! a cycle.

use std::collections::{BTreeMap, HashMap};

use indexmap::IndexMap;

use super::expr::{self, Expr, Kind, Operator};
use super::file::{Constant, Input, Value, Values};
use super::fragments::Source;
use super::functions;
use super::graph::{Graph, Leaf, Node, Op, View};
use super::tables::Table;
use super::{Assumed, Constants, Delay, Delayed, Model, Parameter, Quantity, Scope, StartKind, State};
use crate::config;
use crate::error::{Error, Errors};
use crate::units::{Dim, Unit};

pub(super) const SECOND: Dim = Dim([0, 0, 12, 0, 0]);

/// A node with its dimension; `None` is the literal 0, which fits every unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Typed {
    pub node: Node,
    pub dim: Option<Dim>,
}

/// Where an expression stands: source number and dotted key.
#[derive(Debug, Clone)]
pub(super) struct At {
    source: usize,
    key: String,
}

#[derive(Debug, Clone)]
enum Symbol {
    Input(usize),
    Constant(usize),
    Parameter(usize),
    State(usize),
    Equation(At),
}

#[derive(Debug, Clone, Copy)]
enum Status {
    Active,
    Done(Option<Typed>),
}

pub(super) struct TableInfo {
    pub number: usize,
    pub x: Dim,
    pub x2: Option<Dim>,
    pub y: Dim,
}

pub(super) struct Compiler<'a> {
    sources: &'a [Source],
    symbols: IndexMap<String, (Symbol, At)>,
    status: HashMap<String, Status>,
    path: Vec<String>,
    dims: BTreeMap<String, Dim>,
    rates: Vec<Option<Node>>,
    state_at: Vec<At>,
    pub tables: IndexMap<String, TableInfo>,
    pub errors: Errors,
    pub model: Model,
}

/// Compiles gathered sources (fragments first, the model itself last) with the aircraft's constants.
pub fn compile(name: &str, sources: &[Source], constants: &Constants) -> Result<Model, Errors> {
    let mut c = Compiler {
        sources,
        symbols: IndexMap::new(),
        status: HashMap::new(),
        path: Vec::new(),
        dims: BTreeMap::new(),
        rates: Vec::new(),
        state_at: Vec::new(),
        tables: IndexMap::new(),
        errors: Errors::default(),
        model: Model { name: name.to_string(), ..Default::default() },
    };
    if let Some(last) = sources.last() {
        c.model.title = last.file.title.clone();
        c.model.source = last.file.source.clone();
    }
    c.declare(constants);
    c.tables();
    c.states();
    c.outputs();
    c.trim();
    c.unused_equations();
    let Compiler { mut model, errors, rates, sources, .. } = c;
    errors.or(())?;
    model.rates = rates.into_iter().flatten().collect();
    model.layout = super::program::Layout {
        states: model.states.len(),
        inputs: model.inputs.len(),
        delayed: model.delays.len(),
        parameters: model.parameters.len(),
    };
    model.text = sources.iter().map(|s| s.doc.text()).collect::<Vec<_>>().join("\n# ---\n");
    Ok(model)
}

impl Compiler<'_> {
    fn error(&mut self, at: &At, offset: usize, what: impl Into<String>) {
        let place = self.sources[at.source].doc.place_in(&at.key, offset);
        self.errors.push(Error::at(place, what));
    }

    pub(super) fn error_help(&mut self, at: &At, offset: usize, what: impl Into<String>, help: impl Into<String>) {
        let place = self.sources[at.source].doc.place_in(&at.key, offset);
        self.errors.push(Error::at(place, what).help(help));
    }

    /// A coherent SI unit at a key, or an error that names the SI unit to use.
    fn unit(&mut self, at: &At, text: &str) -> Dim {
        match Unit::parse(text) {
            Ok(unit) if unit.is_si() => unit.dim,
            Ok(unit) => {
                let si = if unit.dim == Dim::NONE { "rad or -".to_string() } else { unit.dim.to_string() };
                self.error_help(at, 0, format!("unit \"{text}\" is not a coherent SI unit"), format!("models are in SI: use {si}"));
                unit.dim
            }
            Err(what) => {
                self.error(at, 0, what);
                Dim::NONE
            }
        }
    }

    fn add_symbol(&mut self, name: &str, symbol: Symbol, at: At) -> bool {
        if !valid_name(name) {
            self.error(&at, 0, format!("\"{name}\" is not a name: letters, digits and _ only, not beginning with a digit"));
            return false;
        }
        if functions::is_reserved(name) {
            self.error(&at, 0, format!("\"{name}\" is a function or a constant of the language; choose another name"));
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
    fn declare(&mut self, constants: &Constants) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            let at = |section: &str, name: &str| At { source: s, key: format!("{section}.{name}") };
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
                    self.model.inputs.push(Quantity { name: name.clone(), unit: unit.clone(), doc });
                }
            }
            for (name, entry) in &source.file.constants {
                self.constant(name, entry, at("constants", name), constants);
            }
            for (name, p) in &source.file.parameters {
                let here = at("parameters", name);
                let dim = self.unit(&here, &p.unit);
                let (min, max) = (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
                if !(min <= p.start && p.start <= max) {
                    self.error(&here, 0, format!("\"{name}\" starts at {} outside its bounds {min} .. {max}", p.start));
                }
                let quantity = Quantity { name: name.clone(), unit: p.unit.clone(), doc: p.doc.clone() };
                let scope = if p.per == super::file::Per::Segment { Scope::Segment } else { Scope::Campaign };
                if self.add_symbol(name, Symbol::Parameter(self.model.parameters.len()), here) {
                    self.dims.insert(name.clone(), dim);
                    let prior_sd = p.sd.unwrap_or(f64::INFINITY);
                    self.model.parameters.push(Parameter { quantity, start: p.start, min, max, scope, fixed: p.fixed, prior_sd });
                }
            }
            for name in source.file.equations.keys() {
                let here = at("equations", name);
                self.add_symbol(name, Symbol::Equation(here.clone()), here);
            }
            for (name, state) in &source.file.states {
                let here = at("states", name);
                let dim = self.unit(&At { source: s, key: format!("states.{name}.unit") }, &state.unit);
                if self.add_symbol(name, Symbol::State(self.model.states.len()), here.clone()) {
                    self.dims.insert(name.clone(), dim);
                    let quantity = Quantity { name: name.clone(), unit: state.unit.clone(), doc: state.doc.clone() };
                    self.model.states.push(State { quantity, start: StartKind::Measured, min: None, max: None, hidden: false });
                    self.rates.push(None);
                    self.state_at.push(here);
                }
            }
        }
    }

    /// Whether `name` is declared already as the same kind of thing with the same unit (allowed for inputs and constants).
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
        let (value, sd) = match aircraft {
            Some(a) => {
                match Unit::parse(&a.unit) {
                    Ok(u) if u.is_si() && u.dim == dim => {}
                    Ok(u) if u.dim == dim => self.error_help(
                        &at,
                        0,
                        format!("the aircraft file gives \"{name}\" in {}", a.unit),
                        format!("constants are in SI: use {unit}"),
                    ),
                    Ok(u) => self.error(&at, 0, format!("\"{name}\" is in {dim} here, and in {} in the aircraft file", u.dim)),
                    Err(what) => self.error(&at, 0, format!("\"{name}\" in the aircraft file: {what}")),
                }
                (Some(a.value), a.sd)
            }
            None => (own, own_sd),
        };
        if self.repeats(name, dim, |s| matches!(s, Symbol::Constant(_))) {
            // a later source may give the value that an earlier one left open, or override it
            if let (Some(v), None, Some((Symbol::Constant(i), _))) = (value, aircraft, self.symbols.get(name)) {
                (self.model.constants[*i].value, self.model.constants[*i].sd) = (v, sd);
            }
            return;
        }
        if self.add_symbol(name, Symbol::Constant(self.model.constants.len()), at) {
            self.dims.insert(name.to_string(), dim);
            let quantity = Quantity { name: name.to_string(), unit: unit.clone(), doc };
            self.model.constants.push(Assumed { quantity, value: value.unwrap_or(f64::NAN), sd });
        }
    }

    fn tables(&mut self) {
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
                let ascending = |p: &[f64]| p.windows(2).all(|w| w[0] < w[1]) && p.iter().all(|v| v.is_finite());
                if t.x.is_empty() || !ascending(&t.x) || !ascending(&x2_points) {
                    self.error(&at, 0, format!("table \"{name}\": the break points must ascend and there must be at least one"));
                } else if x2.is_some() != t.x2.is_some() || t.x2.is_some() && x2_points.is_empty() {
                    self.error(&at, 0, format!("table \"{name}\": x2 and unit_x2 belong together, with at least one break point"));
                } else if rows.len() != t.x.len() || rows.iter().any(|&r| r != x2_points.len().max(1)) {
                    let wanted = format!("{} rows of {}", t.x.len(), x2_points.len().max(1));
                    self.error(&at, 0, format!("table \"{name}\": {wanted} values are wanted, {} values are there", values.len()));
                } else {
                    let number = self.model.tables.0.len();
                    self.tables.insert(name.clone(), TableInfo { number, x, x2, y });
                    self.model.tables.0.push(Table { x: t.x.clone(), x2: x2_points, y: values });
                }
            }
        }
    }

    fn states(&mut self) {
        for i in 0..self.model.states.len() {
            self.state_rate(i);
        }
        let sources = self.sources;
        for i in 0..self.state_at.len() {
            let at = self.state_at[i].clone();
            let name = self.model.states[i].quantity.name.clone();
            let Some(entry) = sources[at.source].file.states.get(&name) else { continue };
            let dim = self.dims[&name];
            let key = |field: &str| At { source: at.source, key: format!("states.{name}.{field}") };
            self.model.states[i].start = match &entry.start {
                Value::Text(text) if text == "measured" => StartKind::Measured,
                value => match self.value(value, &key("start"), dim, "start") {
                    Some(node) => StartKind::Expression(node),
                    None => continue,
                },
            };
            for (field, limit) in [("min", &entry.min), ("max", &entry.max)] {
                let node = limit.as_ref().and_then(|v| self.limit(v, &key(field), dim, field));
                if field == "min" {
                    self.model.states[i].min = node;
                } else {
                    self.model.states[i].max = node;
                }
            }
        }
    }

    /// A number in the unit of its place, or an expression that must have that unit.
    fn value(&mut self, value: &Value, at: &At, dim: Dim, what: &str) -> Option<Node> {
        match value {
            Value::Number(x) => Some(self.model.graph.c(*x)),
            Value::Text(text) => {
                let typed = self.expression(text, at)?;
                self.expect(typed, dim, at, 0, what);
                Some(typed.node)
            }
        }
    }

    /// Like `value`, but of constants and parameters only.
    fn limit(&mut self, value: &Value, at: &At, dim: Dim, what: &str) -> Option<Node> {
        let node = self.value(value, at, dim, what)?;
        if self.model.graph.depends(node) & super::graph::depends::TRAJECTORY != 0 {
            self.error(at, 0, format!("{what} must not change along a trajectory: numbers, constants and parameters only"));
            return None;
        }
        Some(node)
    }

    fn expect(&mut self, typed: Typed, dim: Dim, at: &At, offset: usize, what: &str) {
        if let Some(d) = typed.dim
            && d != dim
        {
            self.error(at, offset, format!("{what} must be in {dim}, the expression is in {d}"));
        }
    }

    /// The rate of state i, limits included.
    pub(super) fn state_rate(&mut self, i: usize) -> Option<Typed> {
        let name = self.model.states[i].quantity.name.clone();
        let dim = self.dims.get(&name).copied().unwrap_or(Dim::NONE).over(SECOND);
        if let Some(node) = self.rates[i] {
            return Some(Typed { node, dim: Some(dim) });
        }
        let at = self.state_at.get(i)?.clone();
        let sources = self.sources;
        let entry = sources[at.source].file.states.get(&name)?;
        let key = |field: &str| At { source: at.source, key: format!("states.{name}.{field}") };
        let typed = self.once(&format!("rate({name})"), &key("rate"), |c| c.expression(&entry.rate, &key("rate")))?;
        self.expect(typed, dim, &key("rate"), 0, "the rate");
        let state_dim = self.dims[&name];
        let mut node = typed.node;
        if let Some(limit) = &entry.rate_max {
            let high = self.limit(limit, &key("rate_max"), dim, "rate_max")?;
            let g = &mut self.model.graph;
            let low = g.neg(high);
            node = g.min(node, high);
            node = g.max(node, low);
        }
        let x = self.model.graph.leaf(Leaf::State(i));
        for (field, limit) in [("min", &entry.min), ("max", &entry.max)] {
            let Some(bound) = limit.as_ref().and_then(|v| self.limit(v, &key(field), state_dim, field)) else { continue };
            let g = &mut self.model.graph;
            let zero = g.c(0.0);
            // beyond the stop the rate cannot lead further out
            let (beyond, back) =
                if field == "min" { (g.sub(bound, x), g.max(node, zero)) } else { (g.sub(x, bound), g.min(node, zero)) };
            node = g.select(beyond, back, node);
        }
        self.rates[i] = Some(node);
        Some(Typed { node, dim: Some(dim) })
    }

    /// Builds what `name` stands for once; a second visit while it is being built is a cycle.
    fn once(&mut self, name: &str, at: &At, build: impl FnOnce(&mut Self) -> Option<Typed>) -> Option<Typed> {
        match self.status.get(name) {
            Some(Status::Done(typed)) => return *typed,
            Some(Status::Active) => {
                let from = self.path.iter().position(|n| n == name).unwrap_or(0);
                let chain = self.path[from..].join(" -> ");
                self.error(at, 0, format!("\"{name}\" depends on itself: {chain} -> {name}"));
                return None;
            }
            None => {}
        }
        self.status.insert(name.to_string(), Status::Active);
        self.path.push(name.to_string());
        let typed = build(self);
        self.path.pop();
        self.status.insert(name.to_string(), Status::Done(typed));
        typed
    }

    fn outputs(&mut self) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            for (name, output) in &source.file.outputs {
                let at = At { source: s, key: format!("outputs.{name}.value") };
                let dim = self.unit(&At { source: s, key: format!("outputs.{name}.unit") }, &output.unit);
                if self.model.outputs.iter().any(|o| o.name == *name) {
                    self.error(&at, 0, format!("output \"{name}\" is declared twice"));
                }
                let Some(typed) = self.expression(&output.value, &at) else { continue };
                self.expect(typed, dim, &at, 0, &format!("output \"{name}\""));
                self.model.outputs.push(Quantity { name: name.clone(), unit: output.unit.clone(), doc: output.doc.clone() });
                self.model.output_nodes.push(typed.node);
            }
        }
    }

    fn trim(&mut self) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            let Some(trim) = &source.file.trim else { continue };
            for (i, name) in trim.free.iter().enumerate() {
                let at = At { source: s, key: format!("trim.free.{i}") };
                match self.symbols.get(name).map(|(symbol, _)| symbol.clone()) {
                    Some(Symbol::State(k)) => self.model.trim.free.push((name.clone(), Leaf::State(k))),
                    Some(Symbol::Input(k)) => self.model.trim.free.push((name.clone(), Leaf::Input(k))),
                    Some(Symbol::Parameter(k)) => self.model.trim.free.push((name.clone(), Leaf::Parameter(k))),
                    Some(_) => self.error(&at, 0, format!("\"{name}\" is not a state, an input or a parameter")),
                    None => self.unknown(name, &at, 0),
                }
            }
            for (i, text) in trim.zero.iter().enumerate() {
                let at = At { source: s, key: format!("trim.zero.{i}") };
                let node = match self.model.outputs.iter().position(|o| o.name == *text) {
                    Some(k) if !self.symbols.contains_key(text) => Some(self.model.output_nodes[k]),
                    _ => self.expression(text, &at).map(|t| t.node),
                };
                if let Some(node) = node {
                    self.model.trim.zero.push((text.clone(), node));
                }
            }
        }
    }

    /// Equations nothing refers to are checked as well.
    fn unused_equations(&mut self) {
        let equations: Vec<(String, At)> = self
            .symbols
            .iter()
            .filter_map(|(name, (symbol, _))| match symbol {
                Symbol::Equation(at) => Some((name.clone(), at.clone())),
                _ => None,
            })
            .collect();
        for (name, at) in equations {
            if let Some(typed) = self.equation(&name, &at) {
                self.model.equations.insert(name, typed.node);
            }
        }
    }

    fn equation(&mut self, name: &str, at: &At) -> Option<Typed> {
        let sources = self.sources;
        let text = sources[at.source].file.equations.get(name)?;
        self.once(name, at, |c| c.expression(text, at))
    }

    fn expression(&mut self, text: &str, at: &At) -> Option<Typed> {
        match expr::parse(text) {
            Ok(tree) => self.build(&tree, at),
            Err((offset, what)) => {
                self.error(at, offset, what);
                None
            }
        }
    }

    /// An expression as a node with its dimension; mistakes are filed and give `None`.
    pub(super) fn build(&mut self, e: &Expr, at: &At) -> Option<Typed> {
        match &e.kind {
            Kind::Number(x) => {
                let dim = if *x == 0.0 { None } else { Some(Dim::NONE) };
                Some(Typed { node: self.model.graph.c(*x), dim })
            }
            Kind::Name(name) => self.name(name, e.at, at),
            Kind::Negative(inner) => {
                let a = self.build(inner, at)?;
                Some(Typed { node: self.model.graph.neg(a.node), dim: a.dim })
            }
            Kind::Binary(op, left, right) => {
                let (a, b) = (self.build(left, at), self.build(right, at));
                self.binary(*op, a?, b?, left, right, at)
            }
            Kind::Call(name, arguments) => functions::call(self, name, arguments, e.at, at),
        }
    }

    fn binary(&mut self, op: Operator, a: Typed, b: Typed, left: &Expr, right: &Expr, at: &At) -> Option<Typed> {
        let unitless = |t: Typed| t.dim.unwrap_or(Dim::NONE);
        match op {
            Operator::Add | Operator::Sub => {
                let dim = self.same_unit(a, b, right.at, at, if op == Operator::Add { "added to" } else { "subtracted from" })?;
                let g = &mut self.model.graph;
                let node = if op == Operator::Add { g.add(a.node, b.node) } else { g.sub(a.node, b.node) };
                Some(Typed { node, dim })
            }
            Operator::Mul => {
                let node = self.model.graph.mul(a.node, b.node);
                Some(Typed { node, dim: Some(unitless(a).times(unitless(b))) })
            }
            Operator::Div => {
                if self.model.graph.constant(b.node) == Some(0.0) {
                    self.error(at, right.at, "division by zero");
                    return None;
                }
                let node = self.model.graph.div(a.node, b.node);
                Some(Typed { node, dim: Some(unitless(a).over(unitless(b))) })
            }
            Operator::Pow => {
                if b.dim.is_some_and(|d| d != Dim::NONE) {
                    self.error(at, right.at, format!("an exponent has no unit, this one is in {}", unitless(b)));
                    return None;
                }
                let Some(exponent) = self.model.graph.constant(b.node) else {
                    self.error_help(at, right.at, "the exponent must be constant", "write exp(b*log(a)) for a varying exponent");
                    return None;
                };
                let Some(dim) = unitless(a).power(exponent) else {
                    self.error(at, left.at, format!("{} cannot be raised to the power {exponent}", unitless(a)));
                    return None;
                };
                Some(Typed { node: self.model.graph.pow(a.node, exponent), dim: Some(dim) })
            }
        }
    }

    /// The common dimension of two operands that must agree (a literal 0 agrees with anything).
    pub(super) fn same_unit(&mut self, a: Typed, b: Typed, offset: usize, at: &At, verb: &str) -> Option<Option<Dim>> {
        match (a.dim, b.dim) {
            (Some(x), Some(y)) if x != y => {
                self.error(at, offset, format!("{y} cannot be {verb} {x}"));
                None
            }
            (x, y) => Some(x.or(y)),
        }
    }

    fn unknown(&mut self, name: &str, at: &At, offset: usize) {
        let known: Vec<String> = self.symbols.keys().cloned().collect();
        let what = format!("unknown name \"{name}\"");
        match config::nearest(name, known.iter().map(String::as_str)) {
            Some(near) => self.error_help(at, offset, what, format!("did you mean \"{near}\"?")),
            None => self.error_help(
                at,
                offset,
                what,
                "every name is declared in [inputs], [constants], [parameters], [equations] or [states]",
            ),
        }
    }

    fn name(&mut self, name: &str, offset: usize, at: &At) -> Option<Typed> {
        match name {
            "pi" => return Some(Typed { node: self.model.graph.c(std::f64::consts::PI), dim: Some(Dim::NONE) }),
            "t" => return Some(Typed { node: self.model.graph.leaf(Leaf::Time), dim: Some(SECOND) }),
            _ => {}
        }
        let Some((symbol, declared)) = self.symbols.get(name).cloned() else {
            self.unknown(name, at, offset);
            return None;
        };
        let dim = self.dims.get(name).copied();
        let node = match symbol {
            Symbol::Input(i) => self.model.graph.leaf(Leaf::Input(i)),
            Symbol::Parameter(i) => self.model.graph.leaf(Leaf::Parameter(i)),
            Symbol::State(i) => self.model.graph.leaf(Leaf::State(i)),
            Symbol::Constant(i) => {
                let value = self.model.constants[i].value;
                if value.is_nan() {
                    let unit = self.model.constants[i].quantity.unit.clone();
                    let what = format!("constant \"{name}\" has no value");
                    let place = self.sources[declared.source].doc.key_place(&declared.key);
                    let error = Error::at(place, what).help(format!(
                        "add to the aircraft file: {name} = {{ value = ..., unit = \"{unit}\", sd = ..., source = \"...\" }}"
                    ));
                    if !self.errors.0.contains(&error) {
                        self.errors.push(error);
                    }
                    return None;
                }
                self.model.graph.c(value)
            }
            Symbol::Equation(place) => return self.equation(name, &place),
        };
        Some(Typed { node, dim })
    }

    /// What `delay` may be taken of.
    pub(super) fn delayable(&self, name: &str) -> Option<(Delayed, Option<Dim>)> {
        match self.symbols.get(name)?.0 {
            Symbol::Input(i) => Some((Delayed::Input(i), self.dims.get(name).copied())),
            Symbol::State(i) => Some((Delayed::State(i), self.dims.get(name).copied())),
            _ => None,
        }
    }

    pub(super) fn delay(&mut self, of: Delayed, tau: Node) -> Node {
        let known = self.model.delays.iter().position(|d| d.of == of && d.tau == tau);
        let k = known.unwrap_or_else(|| {
            self.model.delays.push(Delay { of, tau });
            self.model.delays.len() - 1
        });
        self.model.graph.leaf(Leaf::Delayed(k))
    }

    /// The hidden state of `lag(x, T)`, one for equal arguments.
    pub(super) fn lag(&mut self, x: Typed, time: Node) -> Node {
        let name = format!("lag({},{})", x.node, time);
        if let Some(i) = self.model.states.iter().position(|s| s.quantity.name == name) {
            return self.model.graph.leaf(Leaf::State(i));
        }
        let i = self.model.states.len();
        let dim = x.dim.unwrap_or(Dim::NONE);
        let g = &mut self.model.graph;
        let leaf = g.leaf(Leaf::State(i));
        let gap = g.sub(x.node, leaf);
        let rate = g.div(gap, time);
        let quantity = Quantity { name: name.clone(), unit: dim.to_string(), doc: "state of a lag()".into() };
        self.model.states.push(State { quantity, start: StartKind::Expression(x.node), min: None, max: None, hidden: true });
        self.rates.push(Some(rate));
        self.dims.insert(name, dim);
        leaf
    }

    /// d/dt of a node along the trajectory: rates of states and inputs by the chain rule.
    pub(super) fn total_rate(&mut self, node: Node, offset: usize, at: &At) -> Option<Node> {
        let mut total = self.model.graph.c(0.0);
        for leaf in self.leaves(node) {
            let rate = match leaf {
                Leaf::State(i) => self.state_rate(i)?.node,
                Leaf::Input(i) => self.model.graph.leaf(Leaf::InputRate(i)),
                Leaf::Time => self.model.graph.c(1.0),
                Leaf::Parameter(_) | Leaf::StartValue(_) => continue,
                Leaf::Delayed(_) | Leaf::InputRate(_) => {
                    self.error(at, offset, "rate() of a delayed value or of a rate is not available");
                    return None;
                }
            };
            let g = &mut self.model.graph;
            let slope = g.derivative(node, leaf);
            let term = g.mul(slope, rate);
            total = g.add(total, term);
        }
        Some(total)
    }

    pub(super) fn leaves(&self, node: Node) -> Vec<Leaf> {
        self.model.graph.leaves(&[node])
    }

    pub(super) fn graph(&mut self) -> &mut Graph {
        &mut self.model.graph
    }

    pub(super) fn report(&mut self, at: &At, offset: usize, what: String) {
        self.error(at, offset, what);
    }
}

impl Graph {
    /// The leaves that nodes depend on, in a fixed order.
    pub fn leaves(&self, nodes: &[Node]) -> Vec<Leaf> {
        let mut out = std::collections::BTreeSet::new();
        let mut seen = vec![false; self.len()];
        let mut stack = nodes.to_vec();
        while let Some(n) = stack.pop() {
            if std::mem::replace(&mut seen[n as usize], true) {
                continue;
            }
            match self.view(n) {
                View::Leaf(leaf) => {
                    out.insert(leaf);
                }
                View::Op(_, a, b, c) => stack.extend([a, b, c]),
                View::Const(_) => {}
            }
        }
        out.into_iter().collect()
    }

    /// `node` with leaves replaced.
    pub fn substitute(&mut self, node: Node, with: &BTreeMap<Leaf, Node>) -> Node {
        let mut seen = std::collections::BTreeSet::new();
        let mut stack = vec![node];
        while let Some(n) = stack.pop() {
            if seen.insert(n)
                && let View::Op(_, a, b, c) = self.view(n)
            {
                stack.extend([a, b, c]);
            }
        }
        let mut map: HashMap<Node, Node> = HashMap::new();
        for n in seen {
            let m = match self.view(n) {
                View::Const(_) => n,
                View::Leaf(leaf) => with.get(&leaf).copied().unwrap_or(n),
                View::Op(op, a, b, c) => self.rebuild(op, map[&a], map[&b], map[&c]),
            };
            map.insert(n, m);
        }
        map[&node]
    }

    fn rebuild(&mut self, op: Op, a: Node, b: Node, c: Node) -> Node {
        match op {
            Op::Add => self.add(a, b),
            Op::Sub => self.sub(a, b),
            Op::Mul => self.mul(a, b),
            Op::Div => self.div(a, b),
            Op::Neg => self.neg(a),
            Op::Select => self.select(a, b, c),
            op => self.op(op, a, b, c),
        }
    }
}

fn valid_name(name: &str) -> bool {
    name.chars().next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
