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
        if entry.min.is_none() && entry.max.is_none() || entry.rate_max.is_some() {
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
}
