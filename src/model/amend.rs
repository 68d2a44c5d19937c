//! The `add` and `replace` lines of a model's effects in; what equations, rates, outputs and names
//! mean with them, out.
//!
//! The amendments of one target apply in the order of the effects. Everybody reads the last value,
//! except an effect that amends the target itself: it reads what was there before it. So
//! `replace = { de = "lag(de, T)" }` is no cycle, and two effects on one input form a chain.

use super::compile::{At, Compiler, Typed};
use crate::units::Dim;

/// What an effect can act on.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Target {
    /// An input, constant, parameter, equation or state, as expressions read it.
    Name(String),
    /// The rate of a state.
    Rate(String),
    /// The friction of a state.
    Friction(String),
    /// The lower and the upper limit of a state.
    Min(String),
    Max(String),
    Output(String),
}

impl Target {
    /// `"C_m"`, `"rate(q)"`, `"friction(q)"`, `"max(delta)"`, `"output(alpha)"`.
    fn parse(text: &str) -> Target {
        let inside = |function: &str| {
            text.strip_prefix(function)?
                .strip_prefix('(')?
                .strip_suffix(')')
                .map(|s| s.trim().to_string())
        };
        let of = |function: &str, kind: fn(String) -> Target| inside(function).map(kind);
        let found = of("rate", Target::Rate)
            .or_else(|| of("friction", Target::Friction))
            .or_else(|| of("min", Target::Min))
            .or_else(|| of("max", Target::Max))
            .or_else(|| of("output", Target::Output));
        found.unwrap_or_else(|| Target::Name(text.trim().to_string()))
    }

    fn text(&self) -> String {
        match self {
            Target::Name(name) => name.clone(),
            Target::Rate(state) => format!("rate({state})"),
            Target::Friction(state) => format!("friction({state})"),
            Target::Min(state) => format!("min({state})"),
            Target::Max(state) => format!("max({state})"),
            Target::Output(output) => format!("output({output})"),
        }
    }
}

/// One line of an effect.
#[derive(Debug, Clone)]
pub(super) struct Amendment {
    adds: bool,
    at: At,
    expression: String,
}

impl Compiler<'_> {
    /// Gathers the lines of all effects by what they act on.
    pub(super) fn amendments(&mut self) {
        let sources = self.sources;
        for (s, source) in sources.iter().enumerate() {
            let Some(effect) = &source.amends else { continue };
            let lines = effect
                .add
                .iter()
                .map(|l| (l, true))
                .chain(effect.replace.iter().map(|l| (l, false)));
            for ((key, expression), adds) in lines {
                let at = self.at(s, format!("{}.{key}", if adds { "add" } else { "replace" }));
                let target = Target::parse(key);
                if self.exists(&target, adds, &at) {
                    self.amended.entry(target).or_default().push(Amendment {
                        adds,
                        at,
                        expression: expression.clone(),
                    });
                }
            }
        }
    }

    /// Lines that nothing reads are checked as well.
    pub(super) fn unused_amendments(&mut self) {
        for (target, lines) in self.amended.clone() {
            if let Some(last) = lines.last() {
                self.amended_value(&target, lines.len(), &last.at);
            }
        }
    }

    fn exists(&mut self, target: &Target, adds: bool, at: &At) -> bool {
        let known = match target {
            Target::Name(name) => self.symbols.contains_key(name),
            Target::Rate(state) | Target::Friction(state) => {
                self.model.states.iter().any(|s| s.quantity.name == *state)
            }
            // a state without a limit gets one where it is put in place of none
            Target::Min(state) | Target::Max(state) => {
                let i = self.model.states.iter().position(|s| s.quantity.name == *state);
                i.is_some_and(|i| !adds || self.has_own(target, i))
            }
            Target::Output(output) => {
                self.sources.iter().any(|s| s.file.outputs.contains_key(output))
            }
        };
        if !known {
            let verb = if adds { "add to" } else { "replace" };
            let help = "an effect acts on a name of the model, on rate(a state), on friction(a state), on min(a state) and max(a state), or on output(an output)";
            self.error_help(at, 0, format!("there is no {} to {verb}", target.text()), help);
        }
        known
    }

    /// How many amendments a target has.
    pub(super) fn amendments_of(&self, target: &Target) -> usize {
        self.amended.get(target).map_or(0, Vec::len)
    }

    /// How many of them an expression at `at` sees.
    pub(super) fn seen(&self, target: &Target, at: &At) -> usize {
        let all = self.amended.get(target).map_or(&[][..], Vec::as_slice);
        all.iter().position(|a| a.at.source == at.source).unwrap_or(all.len())
    }

    /// The target with its first `count` amendments.
    pub(super) fn amended_value(
        &mut self,
        target: &Target,
        count: usize,
        at: &At,
    ) -> Option<Typed> {
        let Some(last) = count.checked_sub(1) else { return self.own_target(target, at) };
        let line = self.amended.get(target)?.get(last)?.clone();
        self.once(&format!("{} with {count} effects", target.text()), &line.at, |c| {
            let before = c.amended_value(target, last, &line.at)?;
            let new = c.expression(&line.expression, &line.at)?;
            let verb = if line.adds { "added to" } else { "put in place of" };
            let dim = c.same_unit(before, new, 0, &line.at, verb)?;
            let node = if line.adds { c.graph().add(before.node, new.node) } else { new.node };
            Some(Typed { node, dim: dim.or(Some(Dim::NONE)) })
        })
    }

    fn own_target(&mut self, target: &Target, at: &At) -> Option<Typed> {
        match target {
            Target::Name(name) => self.own_value(name, 0, at),
            Target::Rate(state) => {
                let i = self.model.states.iter().position(|s| s.quantity.name == *state)?;
                self.own_rate(i)
            }
            Target::Friction(state) => {
                let i = self.model.states.iter().position(|s| s.quantity.name == *state)?;
                self.own_friction(i)
            }
            Target::Min(state) | Target::Max(state) => {
                let i = self.model.states.iter().position(|s| s.quantity.name == *state)?;
                self.own_limit(target, i)
            }
            Target::Output(output) => self.own_output(output),
        }
    }

    /// The rate of state i as an expression at `at` sees it: with stops and limits, unless an
    /// effect amends that very rate.
    pub(super) fn rate_seen(&mut self, i: usize, at: &At) -> Option<Typed> {
        let target = Target::Rate(self.model.states[i].quantity.name.clone());
        let seen = self.seen(&target, at);
        if seen == self.amendments_of(&target) {
            self.state_rate(i)
        } else {
            self.amended_value(&target, seen, at)
        }
    }
}
