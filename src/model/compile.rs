//! Parsed model files to a compiled model: names looked up, units checked, equations sorted,
//! everything one graph.
//!
//! All mistakes of a model are collected. An equation is built when it is first needed; one that is
//! needed while it is being built is a cycle.

mod states;

use std::collections::{BTreeMap, HashMap};

use indexmap::IndexMap;

use super::amend::{Amendment, Target};
use super::file::Value;
use super::fragments::Source;
use super::graph::{Leaf, Node};
use super::syntax;
use super::{Constants, Model, Quantity};
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
    pub source: usize,
    pub key: String,
}

#[derive(Debug, Clone)]
pub(super) enum Symbol {
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
    pub(super) sources: &'a [Source],
    /// The aircraft's constants.
    pub(super) given: &'a Constants,
    pub(super) symbols: IndexMap<String, (Symbol, At)>,
    status: HashMap<String, Status>,
    path: Vec<String>,
    pub(super) dims: BTreeMap<String, Dim>,
    /// As `rate()` reads them: zero where a state rests on its stop.
    pub(super) rates: Vec<Option<Node>>,
    /// Of the states with stops, as they would be without: the integration itself holds them there.
    unstopped: BTreeMap<usize, Node>,
    pub(super) state_at: Vec<At>,
    pub tables: IndexMap<String, TableInfo>,
    pub(super) amended: IndexMap<Target, Vec<Amendment>>,
    pub errors: Errors,
    pub model: Model,
}

/// What becomes of constants with an sd.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Uncertain<'a> {
    /// Numbers like all others, but for these: parameters with the sd for a prior.
    Estimated(&'a [String]),
    /// Fixed parameters, so that there are derivatives with respect to them.
    Open,
}

/// Compiles gathered sources (fragments first, the model itself last) with the aircraft's
/// constants.
pub fn compile(
    name: &str,
    sources: &[Source],
    constants: &Constants,
    uncertain: Uncertain<'_>,
) -> Result<Model, Errors> {
    let mut c = Compiler {
        sources,
        given: constants,
        symbols: IndexMap::new(),
        status: HashMap::new(),
        path: Vec::new(),
        dims: BTreeMap::new(),
        rates: Vec::new(),
        unstopped: BTreeMap::new(),
        state_at: Vec::new(),
        tables: IndexMap::new(),
        amended: IndexMap::new(),
        errors: Errors::default(),
        model: Model { name: name.to_string(), ..Default::default() },
    };
    if let Some(last) = sources.iter().rfind(|s| s.amends.is_none()) {
        c.model.title = last.file.title.clone();
        c.model.source = last.file.source.clone();
    }
    c.declare(constants);
    c.amendments();
    c.open_constants(uncertain);
    c.tables();
    c.movers();
    c.states();
    c.outputs();
    c.trim();
    c.unused_equations();
    c.unused_amendments();
    let Compiler { mut model, errors, rates, unstopped, sources, dims, .. } = c;
    errors.or(())?;
    let rates = rates.into_iter().enumerate();
    model.rates = rates.filter_map(|(i, rate)| unstopped.get(&i).copied().or(rate)).collect();
    model.dims = dims;
    model.fuse();
    model.layout = super::program::Layout {
        states: model.states.len(),
        inputs: model.inputs.len(),
        delayed: model.delays.len(),
        moving: model.moving.len(),
        parameters: model.parameters.len(),
    };
    let files = sources.iter().filter(|s| s.amends.is_none());
    model.text = files.map(|s| s.doc.text()).collect::<Vec<_>>().join("\n# ---\n");
    Ok(model)
}

impl Compiler<'_> {
    /// A key of a source, within its effect where the source is one.
    pub(super) fn at(&self, source: usize, key: impl std::fmt::Display) -> At {
        At { source, key: format!("{}{key}", self.sources[source].prefix) }
    }

    pub(super) fn error(&mut self, at: &At, offset: usize, what: impl Into<String>) {
        let place = self.sources[at.source].doc.place_in(&at.key, offset);
        self.errors.push(Error::at(place, what));
    }

    pub(super) fn error_help(
        &mut self,
        at: &At,
        offset: usize,
        what: impl Into<String>,
        help: impl Into<String>,
    ) {
        let place = self.sources[at.source].doc.place_in(&at.key, offset);
        self.errors.push(Error::at(place, what).help(help));
    }

    /// A coherent SI unit at a key, or an error that names the SI unit to use.
    pub(super) fn unit(&mut self, at: &At, text: &str) -> Dim {
        match Unit::parse(text) {
            Ok(unit) if unit.is_si() => unit.dim,
            Ok(unit) => {
                let si = Unit::si_of(text, unit.dim);
                self.error_help(
                    at,
                    0,
                    format!("unit \"{text}\" is not a coherent SI unit"),
                    format!("models are in SI: use {si}"),
                );
                unit.dim
            }
            Err(what) => {
                self.error(at, 0, what);
                Dim::NONE
            }
        }
    }

    /// A number in the unit of its place, or an expression that must have that unit.
    pub(super) fn value(&mut self, value: &Value, at: &At, dim: Dim, what: &str) -> Option<Node> {
        match value {
            Value::Number(x) => Some(self.model.graph.c(*x)),
            Value::Text(text) => {
                let typed = self.expression(text, at)?;
                self.expect(typed, dim, at, 0, what);
                Some(typed.node)
            }
        }
    }

    /// Like `value`, but of what is known at an instant without the motion there.
    pub(super) fn limit(&mut self, value: &Value, at: &At, dim: Dim, what: &str) -> Option<Node> {
        let node = self.value(value, at, dim, what)?;
        let is_late = self.leaves(node).iter().any(|leaf| matches!(leaf, Leaf::Delayed(_)));
        if is_late {
            self.error(at, 0, format!("{what} is of the present: no delays"));
        }
        (self.known_at_once(node, at, what) && !is_late).then_some(node)
    }

    /// Whether a limit or a level is of what is known at an instant without the motion there; an
    /// error where not.
    pub(super) fn known_at_once(&mut self, node: Node, at: &At, what: &str) -> bool {
        let of_motion =
            |leaf: &Leaf| matches!(leaf, Leaf::InputRate(_) | Leaf::Held(_) | Leaf::Side(_));
        if self.leaves(node).iter().any(of_motion) {
            self.error(
                at,
                0,
                format!("{what} is a number or an expression of inputs, states, constants and parameters: no rates"),
            );
            return false;
        }
        true
    }

    fn expect(&mut self, typed: Typed, dim: Dim, at: &At, offset: usize, what: &str) {
        if let Some(d) = typed.dim
            && d != dim
        {
            self.error(at, offset, format!("{what} must be in {dim}, the expression is in {d}"));
        }
    }

    /// Builds what `name` stands for once; a second visit while it is being built is a cycle.
    pub(super) fn once(
        &mut self,
        name: &str,
        at: &At,
        build: impl FnOnce(&mut Self) -> Option<Typed>,
    ) -> Option<Typed> {
        match self.status.get(name) {
            Some(Status::Done(typed)) => return *typed,
            Some(Status::Active) => {
                let from = self.path.iter().position(|n| n == name).unwrap_or(0);
                let chain = self.path[from..].join(" -> ");
                let help = "an equation cannot need its own value: solve for it by hand, or make one of them a state that follows the others (rate = \"(expression - x)/T\", with a T that is short against the motion)";
                let what = format!("\"{name}\" depends on itself: {chain} -> {name}");
                self.error_help(at, 0, what, help);
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
                let at = self.at(s, format!("outputs.{name}.value"));
                if self.model.outputs.iter().any(|o| o.name == *name) {
                    self.error(&at, 0, format!("output \"{name}\" is declared twice"));
                }
                let target = Target::Output(name.clone());
                let Some(typed) = self.amended_value(&target, self.amendments_of(&target), &at)
                else {
                    continue;
                };
                self.model.outputs.push(Quantity {
                    name: name.clone(),
                    unit: output.unit.clone(),
                    doc: output.doc.clone(),
                });
                self.model.output_nodes.push(typed.node);
            }
        }
    }

    /// The output `name` as its line says it.
    pub(super) fn own_output(&mut self, name: &str) -> Option<Typed> {
        let sources = self.sources;
        let (s, output) = sources
            .iter()
            .enumerate()
            .find_map(|(s, source)| Some((s, source.file.outputs.get(name)?)))?;
        let at = self.at(s, format!("outputs.{name}.value"));
        self.once(&format!("output({name})"), &at, |c| {
            let dim = c.unit(&At { source: s, key: format!("outputs.{name}.unit") }, &output.unit);
            let typed = c.expression(&output.value, &at)?;
            c.expect(typed, dim, &at, 0, &format!("output \"{name}\""));
            Some(Typed { node: typed.node, dim: Some(dim) })
        })
    }

    fn trim(&mut self) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            let Some(trim) = &source.file.trim else { continue };
            for (i, name) in trim.free.iter().enumerate() {
                let at = At { source: s, key: format!("trim.free.{i}") };
                match self.symbols.get(name).map(|(symbol, _)| symbol.clone()) {
                    Some(Symbol::State(k)) => {
                        self.model.trim.free.push((name.clone(), Leaf::State(k)))
                    }
                    Some(Symbol::Input(k)) => {
                        self.model.trim.free.push((name.clone(), Leaf::Input(k)))
                    }
                    Some(Symbol::Parameter(k)) => {
                        self.model.trim.free.push((name.clone(), Leaf::Parameter(k)))
                    }
                    Some(_) => self.error(
                        &at,
                        0,
                        format!("\"{name}\" is not a state, an input or a parameter"),
                    ),
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
            let target = Target::Name(name.clone());
            if let Some(typed) = self.amended_value(&target, self.amendments_of(&target), &at) {
                self.dims.insert(name.clone(), typed.dim.unwrap_or(Dim::NONE));
                self.model.equations.insert(name, typed.node);
            }
        }
    }

    pub(super) fn equation(&mut self, name: &str, at: &At) -> Option<Typed> {
        let sources = self.sources;
        let text = sources[at.source].file.equations.get(name)?;
        self.once(name, at, |c| c.expression(text, at))
    }

    pub(super) fn expression(&mut self, text: &str, at: &At) -> Option<Typed> {
        match syntax::parse(text) {
            Ok(tree) => self.build(&tree, at),
            Err((offset, what)) => {
                self.error(at, offset, what);
                None
            }
        }
    }
}
