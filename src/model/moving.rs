//! States that friction or a stop may hold: which they are, and their rates.
//!
//! A velocity with friction obeys `v' = f - F sign(v)`; at rest it stays there while `|f| <= F`
//! (citation 3, 4). A position with stops whose rate is a state has no velocity on the stop. Both
//! are one rate, `select(held, 0, f - side*F)`: `held` and `side` are constant between the instants
//! at which something begins to move, turns round, or comes to rest, and the integration finds
//! these.

use super::Moving;
use super::amend::Target;
use super::compile::{At, Compiler, SECOND, Typed};
use super::file::Value;
use super::graph::{Leaf, Node};
use crate::units::Dim;

impl Compiler<'_> {
    /// Finds the states that have friction, and those that are the velocity of a state with stops.
    pub(super) fn movers(&mut self) {
        let declared = self.state_at.len();
        let mut positions: Vec<Option<usize>> = vec![None; declared];
        for i in 0..declared {
            let Some(j) = self.velocity_behind_a_stop(i) else { continue };
            if let Some(other) = positions[j].replace(i) {
                let name = |i: usize| &self.model.states[i].quantity.name;
                let what = format!(
                    "the stops of \"{}\" and \"{}\" would both hold \"{}\"",
                    name(other),
                    name(i),
                    name(j)
                );
                let at = self.state_at[i].clone();
                self.error_help(&at, 0, what, "give each of them a velocity of its own");
            }
        }
        let nothing = self.model.graph.c(0.0);
        for (velocity, position) in positions.into_iter().enumerate() {
            if position.is_some() || self.has_friction(velocity) {
                self.model.moving.push(Moving {
                    velocity,
                    position,
                    free: nothing,
                    friction: None,
                });
            }
        }
    }

    fn has_friction(&self, i: usize) -> bool {
        let name = &self.model.states[i].quantity.name;
        let entry = self.sources[self.state_at[i].source].file.states.get(name);
        entry.is_some_and(|e| e.friction.is_some())
            || self.amendments_of(&Target::Friction(name.clone())) > 0
    }

    /// The state that is the rate of state `i`, where `i` has a stop and nothing amends either.
    fn velocity_behind_a_stop(&self, i: usize) -> Option<usize> {
        let name = &self.model.states[i].quantity.name;
        let entry = self.sources[self.state_at[i].source].file.states.get(name)?;
        let limits = [Target::Min(name.clone()), Target::Max(name.clone())];
        if !limits.iter().any(|target| self.is_limited(target, i)) || entry.rate_max.is_some() {
            return None;
        }
        let velocity = entry.rate.trim();
        let amended = self.amendments_of(&Target::Rate(name.clone()))
            + self.amendments_of(&Target::Name(velocity.to_string()));
        let found = (0..self.state_at.len())
            .find(|&j| j != i && self.model.states[j].quantity.name == velocity);
        found.filter(|_| amended == 0)
    }

    /// The rate of mover `k`, whose rate would be `free`.
    pub(super) fn held_rate(&mut self, k: usize, free: Node, at: &At) -> Option<Node> {
        let i = self.model.moving[k].velocity;
        let mut sliding = free;
        if self.has_friction(i) {
            let target = Target::Friction(self.model.states[i].quantity.name.clone());
            let friction = self.amended_value(&target, self.amendments_of(&target), at)?.node;
            let g = &mut self.model.graph;
            let side = g.leaf(Leaf::Side(k));
            let against = g.mul(side, friction);
            sliding = g.sub(free, against);
            self.model.moving[k].friction = Some(friction);
        }
        self.model.moving[k].free = free;
        let g = &mut self.model.graph;
        let (held, nothing) = (g.leaf(Leaf::Held(k)), g.c(0.0));
        Some(g.select(held, nothing, sliding))
    }

    /// The friction of state `i` as its line says it; none is zero.
    pub(super) fn own_friction(&mut self, i: usize) -> Option<Typed> {
        let name = self.model.states[i].quantity.name.clone();
        let dim = self.dims.get(&name).copied().unwrap_or(Dim::NONE).over(SECOND);
        let at = self.state_at.get(i)?.clone();
        let sources = self.sources;
        let entry = sources[at.source].file.states.get(&name)?;
        let Some(value) = &entry.friction else {
            return Some(Typed { node: self.model.graph.c(0.0), dim: Some(dim) });
        };
        let at = self.at(at.source, format!("states.{name}.friction"));
        self.once(&format!("friction({name})"), &at, |c| {
            if entry.rate_max.is_some() {
                c.error(&at, 0, format!("\"{name}\" has friction and a rate_max: one of them"));
            }
            let node = c.limit(value, &at, dim, "friction")?;
            if let Some(level) = c.model.graph.constant(node).filter(|level| *level < 0.0) {
                c.error_help(
                    &at,
                    0,
                    format!("friction is {level}, and it cannot be negative"),
                    "it is a level, and acts against the motion by itself",
                );
            }
            Some(Typed { node, dim: Some(dim) })
        })
    }

    /// Whether the line of state `i` says that limit.
    pub(super) fn has_own(&self, target: &Target, i: usize) -> bool {
        self.own_line(target, i).is_some()
    }

    /// Whether state `i` has that limit, of its own or by an effect.
    fn is_limited(&self, target: &Target, i: usize) -> bool {
        self.has_own(target, i) || self.amendments_of(target) > 0
    }

    /// What the line of state `i` says of a limit.
    fn own_line(&self, target: &Target, i: usize) -> Option<Value> {
        let name = &self.model.states[i].quantity.name;
        let at = self.state_at.get(i)?;
        let entry = self.sources[at.source].file.states.get(name)?;
        if matches!(target, Target::Min(_)) { entry.min.clone() } else { entry.max.clone() }
    }

    /// The limit of state `i` as its line says it; none is infinite.
    pub(super) fn own_limit(&mut self, target: &Target, i: usize) -> Option<Typed> {
        let name = self.model.states[i].quantity.name.clone();
        let dim = self.dims.get(&name).copied()?;
        let (field, none) = match target {
            Target::Min(_) => ("min", f64::NEG_INFINITY),
            _ => ("max", f64::INFINITY),
        };
        let Some(value) = self.own_line(target, i) else {
            return Some(Typed { node: self.model.graph.c(none), dim: Some(dim) });
        };
        let at = self.at(self.state_at[i].source, format!("states.{name}.{field}"));
        self.once(&format!("{field}({name})"), &at, |c| {
            let node = c.value(&value, &at, dim, field)?;
            c.known_at_once(node, &at, field).then_some(())?;
            Some(Typed { node, dim: Some(dim) })
        })
    }

    /// The limit of state `i` with what effects make of it; none where it has none.
    pub(super) fn bound(&mut self, target: &Target, i: usize) -> Option<Node> {
        if !self.is_limited(target, i) {
            return None;
        }
        let at = self.state_at.get(i)?.clone();
        let node = self.amended_value(target, self.amendments_of(target), &at)?.node;
        self.known_at_once(node, &at, "a limit").then_some(node)
    }
}
