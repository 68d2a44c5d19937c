//! Expressions to nodes of the graph: operators, names, and what delays, lags and rates add to the
//! model.

use std::collections::BTreeMap;

use super::amend::Target;
use super::compile::{At, Compiler, SECOND, Symbol, Typed};
use super::functions;
use super::graph::{Graph, Leaf, Node};
use super::syntax::{Expr, Kind, Operator};
use super::{Delay, Delayed, Quantity, StartKind, State};
use crate::config;
use crate::error::Error;
use crate::units::Dim;

impl Compiler<'_> {
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

    fn binary(
        &mut self,
        op: Operator,
        a: Typed,
        b: Typed,
        left: &Expr,
        right: &Expr,
        at: &At,
    ) -> Option<Typed> {
        let unitless = |t: Typed| t.dim.unwrap_or(Dim::NONE);
        match op {
            Operator::Add | Operator::Sub => {
                let dim = self.same_unit(
                    a,
                    b,
                    right.at,
                    at,
                    if op == Operator::Add { "added to" } else { "subtracted from" },
                )?;
                let g = &mut self.model.graph;
                let node =
                    if op == Operator::Add { g.add(a.node, b.node) } else { g.sub(a.node, b.node) };
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
                    self.error(
                        at,
                        right.at,
                        format!("an exponent has no unit, this one is in {}", unitless(b)),
                    );
                    return None;
                }
                if let Some(power) = self.power_of_opened(a, b) {
                    return Some(power);
                }
                let Some(exponent) = self.model.graph.constant(b.node) else {
                    self.error_help(
                        at,
                        right.at,
                        "the exponent must be constant",
                        "write exp(b*log(a)) for a varying exponent",
                    );
                    return None;
                };
                let Some(dim) = unitless(a).power(exponent) else {
                    self.error(
                        at,
                        left.at,
                        format!("{} cannot be raised to the power {exponent}", unitless(a)),
                    );
                    return None;
                };
                Some(Typed { node: self.model.graph.pow(a.node, exponent), dim: Some(dim) })
            }
        }
    }

    /// `a^b` where `b` is made of constants that have been opened (see `Model::opened`):
    /// `exp(b log a)`, with the dimension that the constants' values give.
    fn power_of_opened(&mut self, a: Typed, b: Typed) -> Option<Typed> {
        let values = |leaf: Leaf| match leaf {
            Leaf::Parameter(p) => {
                let p = &self.model.parameters[p];
                self.model
                    .constants
                    .iter()
                    .find(|c| c.quantity.name == p.quantity.name)
                    .map(|c| c.value)
            }
            _ => None,
        };
        let leaves = self.model.graph.leaves(&[b.node]);
        if leaves.is_empty() {
            return None;
        }
        let known: Vec<(Leaf, f64)> =
            leaves.iter().map(|&l| values(l).map(|v| (l, v))).collect::<Option<_>>()?;
        let g = &mut self.model.graph;
        let known = known.into_iter().map(|(leaf, value)| (leaf, g.c(value))).collect();
        let folded = g.substitute(b.node, &known);
        let dim = a.dim.unwrap_or(Dim::NONE).power(g.constant(folded)?)?;
        let log = g.unary(super::graph::Op::Log, a.node);
        let product = g.mul(b.node, log);
        Some(Typed { node: g.unary(super::graph::Op::Exp, product), dim: Some(dim) })
    }

    /// The common dimension of two operands that must agree (a literal 0 agrees with anything).
    pub(super) fn same_unit(
        &mut self,
        a: Typed,
        b: Typed,
        offset: usize,
        at: &At,
        verb: &str,
    ) -> Option<Option<Dim>> {
        match (a.dim, b.dim) {
            (Some(x), Some(y)) if x != y => {
                self.error(at, offset, format!("{y} cannot be {verb} {x}"));
                None
            }
            (x, y) => Some(x.or(y)),
        }
    }

    pub(super) fn unknown(&mut self, name: &str, at: &At, offset: usize) {
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
            "pi" => {
                return Some(Typed {
                    node: self.model.graph.c(std::f64::consts::PI),
                    dim: Some(Dim::NONE),
                });
            }
            "t" => {
                return Some(Typed { node: self.model.graph.leaf(Leaf::Time), dim: Some(SECOND) });
            }
            _ => {}
        }
        match self.seen(&Target::Name(name.to_string()), at) {
            0 => self.own_value(name, offset, at),
            seen => self.amended_value(&Target::Name(name.to_string()), seen, at),
        }
    }

    /// What a name stands for by its own declaration, effects apart.
    pub(super) fn own_value(&mut self, name: &str, offset: usize, at: &At) -> Option<Typed> {
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
                    // What nobody here asks for may have been meant.
                    let idle = self.given.0.keys().map(String::as_str);
                    let idle = idle.filter(|other| !self.symbols.contains_key(*other));
                    let meant =
                        crate::config::nearest(name, idle).map_or_else(String::new, |other| {
                            format!("did you mean this by \"{other}\" of the aircraft file? Else ")
                        });
                    let error = Error::at(place, what).help(format!(
                        "{meant}add to the aircraft file: {name} = {{ value = ..., unit = \"{unit}\", sd = ..., source = \"...\" }}"
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

    /// A node at time t - tau: each input and state in it is read from the past.
    pub(super) fn delayed(
        &mut self,
        node: Node,
        tau: Node,
        offset: usize,
        at: &At,
    ) -> Option<Node> {
        let mut with = BTreeMap::new();
        for leaf in self.leaves(node) {
            let past = match leaf {
                Leaf::Input(i) => self.delay(Delayed::Input(i), tau),
                Leaf::State(i) => self.delay(Delayed::State(i), tau),
                Leaf::Time => {
                    let now = self.model.graph.leaf(Leaf::Time);
                    self.model.graph.sub(now, tau)
                }
                Leaf::Parameter(_) | Leaf::StartValue(_) => continue,
                Leaf::Delayed(k) if self.is_smooth_now(k) => self.smooth_ago(k, tau),
                Leaf::Delayed(_) | Leaf::InputRate(_) | Leaf::Held(_) | Leaf::Side(_) => {
                    self.error(
                        at,
                        offset,
                        "delay() of a delayed value or of a rate is not available",
                    );
                    return None;
                }
            };
            with.insert(leaf, past);
        }
        Some(self.model.graph.substitute(node, &with))
    }

    /// `x` with its input, one of the same unit, without small movements: `[x, reach, width]`.
    pub(super) fn smooth(
        &mut self,
        [x, reach, within]: [Node; 3],
        dim: Option<Dim>,
        offset: usize,
        at: &At,
    ) -> Option<Node> {
        let leaves = self.leaves(x);
        let inputs =
            leaves.iter().filter_map(|l| if let Leaf::Input(i) = l { Some(*i) } else { None });
        let inputs: Vec<usize> = inputs
            .filter(|&i| dim.is_none_or(|dim| self.dims[&self.model.inputs[i].name] == dim))
            .collect();
        let past = leaves.iter().any(|l| matches!(l, Leaf::Delayed(_) | Leaf::InputRate(_)));
        let [input] = inputs[..] else {
            self.error(at, offset, "smooth() is of one input in the unit of its width: what is not recorded has no future");
            return None;
        };
        if past {
            self.error(at, offset, "smooth() of a delayed value or of a rate is not available");
            return None;
        }
        if self
            .model
            .graph
            .leaves(&[reach, within])
            .iter()
            .any(|l| !matches!(l, Leaf::Parameter(_)))
        {
            self.error(
                at,
                offset,
                "the reach and the width of smooth() cannot change during a record",
            );
            return None;
        }
        let pair = [
            Delay { of: Delayed::Smooth(input), tau: reach },
            Delay { of: Delayed::Within(input), tau: within },
        ];
        let known = (0..self.model.delays.len())
            .find(|&k| self.model.delays[k..].starts_with(&pair) && self.is_smooth_now(k));
        let k = known.unwrap_or_else(|| {
            self.model.delays.extend(pair);
            self.model.delays.len() - 2
        });
        let smooth = self.model.graph.leaf(Leaf::Delayed(k));
        Some(self.model.graph.substitute(x, &BTreeMap::from([(Leaf::Input(input), smooth)])))
    }

    /// Whether a delay is a `smooth()` of the present.
    fn is_smooth_now(&self, k: usize) -> bool {
        let of = |k: usize| self.model.delays.get(k).map(|d| d.of);
        matches!(of(k), Some(Delayed::Smooth(_))) && Delayed::ago(k, of).is_none()
    }

    /// The same `smooth()` at time t - tau.
    fn smooth_ago(&mut self, k: usize, tau: Node) -> Node {
        let of = match self.model.delays[k].of {
            Delayed::Smooth(i) => Delayed::Ago(i),
            other => other,
        };
        let late = Delay { of, tau };
        let three = [self.model.delays[k], self.model.delays[k + 1], late];
        let known = self.model.delays.windows(3).position(|d| *d == three);
        let k = known.unwrap_or_else(|| {
            self.model.delays.extend(three);
            self.model.delays.len() - 3
        });
        self.model.graph.leaf(Leaf::Delayed(k))
    }

    fn delay(&mut self, of: Delayed, tau: Node) -> Node {
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
        let quantity =
            Quantity { name: name.clone(), unit: dim.to_string(), doc: "state of a lag()".into() };
        self.model.states.push(State {
            quantity,
            start: StartKind::Expression(x.node),
            min: None,
            max: None,
            rate_max: None,
            noise: None,
            start_sd: None,
            rests: false,
            hidden: true,
        });
        self.rates.push(Some(rate));
        self.dims.insert(name, dim);
        leaf
    }

    /// d/dt of a node along the trajectory: rates of states and inputs by the chain rule.
    pub(super) fn total_rate(&mut self, node: Node, offset: usize, at: &At) -> Option<Node> {
        let mut total = self.model.graph.c(0.0);
        for leaf in self.leaves(node) {
            let rate = match leaf {
                Leaf::State(i) => self.rate_seen(i, at)?.node,
                Leaf::Input(i) => self.model.graph.leaf(Leaf::InputRate(i)),
                Leaf::Time => self.model.graph.c(1.0),
                Leaf::Parameter(_) | Leaf::StartValue(_) => continue,
                Leaf::Delayed(_) | Leaf::InputRate(_) | Leaf::Held(_) | Leaf::Side(_) => {
                    self.error(
                        at,
                        offset,
                        "rate() of a delayed value or of a rate is not available",
                    );
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

    /// Where a parameter starts.
    pub(super) fn start(&self, parameter: usize) -> Option<f64> {
        Some(self.model.parameters.get(parameter)?.start)
    }

    pub(super) fn report(&mut self, at: &At, offset: usize, what: String) {
        self.error(at, offset, what);
    }
}
