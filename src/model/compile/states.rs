//! The states of a model while it is compiled: their rates with limits and stops, starts, noise.

use super::{At, Compiler, SECOND, Typed};
use crate::model::StartKind;
use crate::model::amend::Target;
use crate::model::file::Value;
use crate::model::graph::Leaf;
use crate::units::Dim;

impl Compiler<'_> {
    pub(super) fn states(&mut self) {
        for i in 0..self.model.states.len() {
            self.state_rate(i);
        }
        let sources = self.sources;
        for i in 0..self.state_at.len() {
            let at = self.state_at[i].clone();
            let name = self.model.states[i].quantity.name.clone();
            let Some(entry) = sources[at.source].file.states.get(&name) else { continue };
            let dim = self.dims[&name];
            let prefix = &sources[at.source].prefix;
            let key = |field: &str| At {
                source: at.source,
                key: format!("{prefix}states.{name}.{field}"),
            };
            self.model.states[i].start = match &entry.start {
                Value::Text(text) if text == "measured" => StartKind::Measured,
                value => match self.value(value, &key("start"), dim, "start") {
                    Some(node) => StartKind::Expression(node),
                    None => continue,
                },
            };
            self.model.states[i].min = self.bound(&Target::Min(name.clone()), i);
            self.model.states[i].max = self.bound(&Target::Max(name.clone()), i);
            let per_root = SECOND.power(0.5).map_or(dim, |root| dim.over(root));
            self.model.states[i].noise =
                entry.noise.as_ref().and_then(|v| self.limit(v, &key("noise"), per_root, "noise"));
            let start_sd = entry.start_sd.as_ref();
            self.model.states[i].start_sd =
                start_sd.and_then(|v| self.limit(v, &key("start_sd"), dim, "start_sd"));
        }
        self.limits_of_limits();
        self.starts_of_noise();
    }

    /// The uncertainty of a start is asked for by a filter alone.
    fn starts_of_noise(&mut self) {
        let driven = self.model.is_driven();
        let uncertain = (0..self.state_at.len()).find(|&i| self.model.states[i].start_sd.is_some());
        if let Some(i) = uncertain.filter(|_| !driven) {
            let name = self.model.states[i].quantity.name.clone();
            let at = self.state_at[i].clone();
            let what = format!("\"{name}\" has a start_sd, but no noise drives the model");
            let help =
                "estimate the start instead (`initial` of the method), or give a state `noise`";
            self.error_help(&at, 0, what, help);
        }
    }

    /// A limit may depend on states that have limits themselves: they are put on theirs first. In a
    /// circle none of them is the first.
    fn limits_of_limits(&mut self) {
        let (order, _) = self.model.limited_in_order();
        let is_limited = |i: &usize| {
            let state = &self.model.states[*i];
            state.min.or(state.max).is_some() && !order.contains(i)
        };
        let circle: Vec<usize> = (0..self.state_at.len()).filter(is_limited).collect();
        if let Some(first) = circle.first() {
            let names =
                circle.iter().map(|i| format!("\"{}\"", self.model.states[*i].quantity.name));
            let names = names.collect::<Vec<_>>().join(", ");
            let what = format!("the limits of {names} depend on each other, or on themselves");
            let help = "let one of them depend on inputs, or on states without limits";
            let at = self.state_at[*first].clone();
            self.error_help(&at, 0, what, help);
        }
    }

    /// The rate of state i, limits included.
    pub(in crate::model) fn state_rate(&mut self, i: usize) -> Option<Typed> {
        let name = self.model.states[i].quantity.name.clone();
        let dim = self.dims.get(&name).copied().unwrap_or(Dim::NONE).over(SECOND);
        if let Some(node) = self.rates[i] {
            return Some(Typed { node, dim: Some(dim) });
        }
        let at = self.state_at.get(i)?.clone();
        let sources = self.sources;
        let entry = sources[at.source].file.states.get(&name)?;
        let prefix = &sources[at.source].prefix;
        let key =
            |field: &str| At { source: at.source, key: format!("{prefix}states.{name}.{field}") };
        let target = Target::Rate(name.clone());
        let typed = self.amended_value(&target, self.amendments_of(&target), &key("rate"))?;
        let mut node = typed.node;
        self.model.states[i].rests = self.model.graph.constant(node) == Some(0.0);
        if let Some(k) = self.model.moving.iter().position(|m| m.velocity == i) {
            node = self.held_rate(k, node, &key("friction"))?;
        }
        if let Some(limit) = &entry.rate_max {
            let high = self.limit(limit, &key("rate_max"), dim, "rate_max")?;
            self.model.states[i].rate_max = Some(high);
            let g = &mut self.model.graph;
            let low = g.neg(high);
            node = g.min(node, high);
            node = g.max(node, low);
            // Below zero there is no motion that it allows.
            let none = g.c(f64::NAN);
            node = g.select(low, none, node);
        }
        if self.model.moving.iter().any(|m| m.position == Some(i)) {
            // its velocity is zero on the stop
            self.rates[i] = Some(node);
            return Some(Typed { node, dim: Some(dim) });
        }
        let x = self.model.graph.leaf(Leaf::State(i));
        for target in [Target::Min(name.clone()), Target::Max(name.clone())] {
            let Some(bound) = self.bound(&target, i) else { continue };
            self.unstopped.entry(i).or_insert(node);
            let g = &mut self.model.graph;
            let zero = g.c(0.0);
            // on the stop and beyond it the rate cannot lead further out
            let (inside, back) = if matches!(target, Target::Min(_)) {
                (g.sub(x, bound), g.max(node, zero))
            } else {
                (g.sub(bound, x), g.min(node, zero))
            };
            node = g.select(inside, node, back);
        }
        self.rates[i] = Some(node);
        Some(Typed { node, dim: Some(dim) })
    }

    /// The rate of state i as its line says it.
    pub(in crate::model) fn own_rate(&mut self, i: usize) -> Option<Typed> {
        let name = self.model.states[i].quantity.name.clone();
        let dim = self.dims.get(&name).copied().unwrap_or(Dim::NONE).over(SECOND);
        let at = self.state_at.get(i)?.clone();
        let sources = self.sources;
        let entry = sources[at.source].file.states.get(&name)?;
        let at = self.at(at.source, format!("states.{name}.rate"));
        let typed = self.once(&format!("rate({name})"), &at, |c| c.expression(&entry.rate, &at))?;
        self.expect(typed, dim, &at, 0, "the rate");
        Some(Typed { node: typed.node, dim: Some(dim) })
    }
}
