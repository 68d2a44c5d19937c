//! Which register holds which value: the value that is read again last leaves when one is wanted.
//!
//! Memory is read again later, a result is kept in the frame. What is not in a register is an
//! instruction's last operand straight from memory where that can be.

use super::encode::{Assembler, LOAD, Place, Rm, SPLAT, STORE, Vector};
use super::frame::kept;
use super::list::{Step, Value};
use super::sine::Sine;

pub const NEVER: u32 = u32::MAX;

/// Registers, and what is known of the values of a list.
pub struct Registers<'a> {
    pub asm: &'a mut Assembler,
    pub steps: &'a [Step],
    /// Per step when its operands are read again.
    pub again: Vec<[u32; 4]>,
    /// When a value is read next.
    pub when: Vec<u32>,
    pub register: Vec<Option<u8>>,
    pub slot: Vec<Option<u32>>,
    /// What a register holds.
    pub held: Vec<Option<Value>>,
    /// Registers that the present step needs, bit by bit.
    pub pinned: u32,
    pub slots: u32,
    pub free_slots: Vec<u32>,
    /// Those that the present step reads for the last time.
    pub left: Vec<u32>,
    pub sines: Vec<Sine>,
    pub now: u32,
}

impl Registers<'_> {
    pub fn is_held(&self, v: Value) -> bool {
        self.register[v as usize].is_some()
    }

    /// A register for the present step: a free one, or that of the value that is read last.
    pub fn take(&mut self) -> u8 {
        let free = |r: &usize| self.pinned >> r & 1 == 0;
        let cost = |r: &usize| match self.held[*r] {
            None => u32::MAX,
            Some(v) => {
                let wait = self.when[v as usize].saturating_sub(self.now);
                let kept = self.steps[v as usize].is_leaf() || self.slot[v as usize].is_some();
                wait.saturating_mul(if kept { 4 } else { 1 }).min(u32::MAX - 1)
            }
        };
        // a step needs a dozen registers at most
        let r = (0..self.held.len()).filter(free).max_by_key(cost).unwrap_or(0) as u8;
        self.evict(r);
        self.pinned |= 1 << r;
        r
    }

    pub fn evict(&mut self, r: u8) {
        let Some(v) = self.held[r as usize].take() else { return };
        let at = v as usize;
        self.register[at] = None;
        if self.when[at] != NEVER && self.slot[at].is_none() && !self.steps[at].is_leaf() {
            let slot = self.free_slots.pop().unwrap_or_else(|| {
                self.slots += 1;
                self.slots - 1
            });
            self.slot[at] = Some(slot);
            let place = self.place(slot);
            self.asm.op(STORE, r, 0, Rm::Vector(place));
        }
    }

    pub fn hold(&mut self, v: Value, r: u8) {
        self.pinned |= 1 << r;
        if self.when[v as usize] != NEVER {
            self.register[v as usize] = Some(r);
            self.held[r as usize] = Some(v);
        }
    }

    /// Operands that are not read again leave their registers and places.
    pub fn release(&mut self, operands: &[Value]) {
        for &v in operands.iter().filter(|&&v| self.when[v as usize] == NEVER) {
            if let Some(r) = self.register[v as usize].take() {
                self.held[r as usize] = None;
                self.pinned &= !(1 << r);
            }
            self.left.extend(self.slot[v as usize].take());
        }
    }

    /// A register for a result; it may be that of an operand.
    pub fn result(&mut self, v: Value, operands: &[Value]) -> u8 {
        self.release(operands);
        let r = self.take();
        self.hold(v, r);
        r
    }

    /// Where a value is kept in the frame.
    pub fn place(&self, slot: u32) -> Place {
        kept(slot, self.asm.vector)
    }

    /// A value in memory, if it is there.
    pub fn memory(&self, v: Value) -> Option<Rm> {
        match (self.slot[v as usize], self.steps[v as usize]) {
            (Some(slot), _) => Some(Rm::Vector(self.place(slot))),
            (_, Step::Vector(place)) => Some(Rm::Vector(place)),
            (_, Step::Number(place)) => Some(Rm::Number(place)),
            _ => None,
        }
    }

    /// Reads a value from memory, or makes it zero.
    pub fn read(&mut self, v: Value, r: u8) {
        match self.memory(v) {
            Some(number @ Rm::Number(_)) => self.asm.op(SPLAT, r, 0, number),
            Some(vector) => self.asm.op(LOAD, r, 0, vector),
            None => self.asm.zero(r),
        }
    }

    /// The register of a value.
    pub fn register(&mut self, v: Value) -> u8 {
        let r = self.register[v as usize].unwrap_or_else(|| {
            let r = self.take();
            self.read(v, r);
            (self.register[v as usize], self.held[r as usize]) = (Some(r), Some(v));
            r
        });
        self.pinned |= 1 << r;
        r
    }

    /// A value as the last operand of an instruction.
    pub fn last(&mut self, v: Value) -> Rm {
        match self.memory(v) {
            Some(Rm::Number(_)) if self.asm.vector == Vector::Four => {}
            Some(memory) if !self.is_held(v) => return memory,
            _ => {}
        }
        Rm::Register(self.register(v))
    }
}
