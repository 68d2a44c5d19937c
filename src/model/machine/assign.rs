//! A list of steps in; instructions with registers (`registers` says which) out.

use super::encode::{ADD, Assembler, FIRST, LOAD, MUL, Place, Rm, SPLAT, SQRT, STORE, Sum, fused};
use super::frame::{argument, call};
use super::list::{Function, List, Step, Value};
use super::registers::{NEVER, Registers};
use super::sine::{self, Sine};

/// A mask for the first lanes stands here; masks 1 to 6 name single lanes.
pub const TAIL: u8 = 7;

/// What remains to be done behind the end of a function.
pub struct Rest {
    sines: Vec<Sine>,
    /// Bytes of the frame.
    pub frame: usize,
}

impl Rest {
    /// The parts of sines and cosines that are rarely wanted.
    pub fn finish(self, asm: &mut Assembler) {
        for sine in self.sines {
            sine.finish(asm);
        }
    }
}

/// Instructions of `list`.
pub fn assign(asm: &mut Assembler, list: &List) -> Rest {
    let (steps, n) = (&list.0[..], list.0.len());
    let (mut when, mut again) = (vec![NEVER; n], vec![[NEVER; 4]; n]);
    for (i, step) in steps.iter().enumerate().rev() {
        let (operands, count) = step.operands();
        for (again, &v) in again[i].iter_mut().zip(&operands[..count]) {
            *again = when[v as usize];
        }
        operands[..count].iter().for_each(|&v| when[v as usize] = i as u32);
    }
    let registers = if asm.wide() { 32 } else { 16 };
    let mut assign = Registers {
        asm,
        steps,
        again,
        when,
        register: vec![None; n],
        slot: vec![None; n],
        held: vec![None; registers],
        pinned: 0,
        slots: 0,
        free_slots: Vec::new(),
        left: Vec::new(),
        sines: Vec::new(),
        now: 0,
    };
    (0..n).for_each(|i| assign.step(i));
    Rest { frame: assign.place(assign.slots).at as usize, sines: assign.sines }
}

impl Registers<'_> {
    fn step(&mut self, i: usize) {
        (self.pinned, self.now) = (0, i as u32);
        self.free_slots.append(&mut self.left);
        let step = self.steps[i];
        let (operands, count) = step.operands();
        for (&v, &again) in operands[..count].iter().zip(&self.again[i]) {
            self.when[v as usize] = again;
            self.pinned |= self.register[v as usize].map_or(0, |r| 1 << r);
        }
        let operands = &operands[..count];
        let to = i as Value;
        match step {
            Step::Vector(_) | Step::Number(_) | Step::Zero | Step::Cosine => {}
            Step::Two(form, a, b) => {
                let swap = (form == ADD || form == MUL) && !self.is_held(a) && self.is_held(b);
                let (a, b) = if swap { (b, a) } else { (a, b) };
                let (a, b) = (self.register(a), self.last(b));
                let reg = self.result(to, operands);
                self.asm.op(form, reg, a, b);
            }
            Step::Root(a) => {
                let a = self.last(a);
                let reg = self.result(to, operands);
                self.asm.op(SQRT, reg, 0, a);
            }
            Step::Fused(signs, factors) => {
                let (reg, second, last, sum) = self.factors(factors);
                self.release(operands);
                self.hold(to, reg);
                self.asm.op(fused(sum, signs), reg, second, last);
            }
            Step::Choose { x, y, yes, no } => {
                let [x, yes, no] = [x, yes, no].map(|v| self.register(v));
                let (y, mask) = (self.last(y), self.take());
                let reg = self.result(to, operands);
                self.asm.choose([reg, yes, no], x, y, mask);
            }
            Step::Insert(before, lane, place) => self.insert(to, before, lane, place),
            Step::Sine(x) => self.sine(to, x),
            Step::Call(function, arguments) => self.call(to, function, arguments),
            Step::Store(a, place) => {
                let a = self.register(a);
                self.asm.op(STORE, a, 0, Rm::Vector(place));
                self.release(operands);
            }
            Step::StoreFirst(a, place, n) => {
                let a = self.register(a);
                self.store_first(a, place, n);
                self.release(operands);
            }
            Step::Fetch(to, from, more) => {
                self.asm.fetch(to, from);
                self.asm.add_register(to, more);
            }
        }
    }

    /// The registers of a fused multiply-add: the first is one of the three and is written.
    fn factors(&mut self, [a, b, c]: [Value; 3]) -> (u8, u8, Rm, Sum) {
        let done = |v: &Value| self.when[*v as usize] == NEVER && self.is_held(*v);
        let away = |v: &Value| !self.is_held(*v);
        let order = [c, a, b];
        let over = order.into_iter().find(done).or_else(|| order.into_iter().find(away));
        let over = over.unwrap_or(c);
        let reg = match self.register[over as usize] {
            Some(r) if self.when[over as usize] == NEVER => r,
            Some(from) => {
                let r = self.take();
                self.asm.op(LOAD, r, 0, Rm::Register(from));
                r
            }
            None => {
                let r = self.take();
                self.read(over, r);
                r
            }
        };
        let (second, last, sum) = if over == c {
            let (second, last) = if self.is_held(a) { (a, b) } else { (b, a) };
            (second, last, Sum::M231)
        } else {
            let factor = if over == a { b } else { a };
            let number = matches!(self.steps[factor as usize], Step::Number(_));
            match self.is_held(factor) || (number && !self.is_held(c)) {
                true => (factor, c, Sum::M213),
                false => (c, factor, Sum::M132),
            }
        };
        let (second, last) = (self.register(second), self.last(last));
        // what is overwritten is no longer where it was
        if self.register[over as usize] == Some(reg) {
            (self.register[over as usize], self.held[reg as usize]) = (None, None);
        }
        (reg, second, last, sum)
    }

    fn insert(&mut self, to: Value, before: Option<Value>, lane: u8, place: Place) {
        let number = Rm::Number(place);
        let dies = |v: &Value| self.when[*v as usize] == NEVER;
        match before {
            None if lane == 0 => {
                let r = self.result(to, &[]);
                self.asm.op(FIRST, r, 0, number);
            }
            None if self.asm.wide() => {
                let r = self.result(to, &[]);
                self.asm.masked(SPLAT, r, 0, number, lane, true);
            }
            None => {
                let (spare, r) = (self.take(), self.result(to, &[]));
                self.asm.zero(r);
                self.asm.insert(r, r, lane, place, spare);
            }
            Some(v) if self.asm.wide() => {
                debug_assert!(dies(&v), "what is inserted into is not read again");
                let r = self.register(v);
                self.release(&[v]);
                self.hold(to, r);
                self.asm.masked(SPLAT, r, 0, number, lane, false);
            }
            Some(v) => {
                let (spare, from) = (self.take(), self.register(v));
                let r = self.result(to, &[v]);
                self.asm.insert(r, from, lane, place, spare);
            }
        }
    }

    fn store_first(&mut self, a: u8, place: Place, n: u8) {
        if self.asm.wide() {
            return self.asm.masked(STORE, a, 0, Rm::Vector(place), TAIL, false);
        }
        let mask = self.take();
        self.asm.op(LOAD, mask, 0, Rm::Vector(super::literals::first(n)));
        self.asm.store_masked(a, mask, place);
    }

    fn sine(&mut self, to: Value, x: Value) {
        let x_in = self.register(x);
        let spare = [(); 8].map(|()| self.take());
        self.release(&[x]);
        let live = (0..self.held.len() as u8).filter(|&r| self.held[r as usize].is_some());
        let live = live.collect();
        self.pinned |= 1 << x_in;
        let [sin, cos] = [0, 1].map(|k| {
            let r = self.take();
            self.hold(to + k, r);
            r
        });
        let registers = sine::Registers { x: x_in, sin, cos, spare };
        self.sines.push(Sine::begin(self.asm, registers, live));
    }

    fn call(&mut self, to: Value, function: Function, arguments: [Value; 3]) {
        for (k, v) in (0..).zip(arguments) {
            let r = self.register(v);
            self.asm.op(STORE, r, 0, Rm::Vector(argument(k)));
        }
        self.release(&arguments);
        (0..self.held.len() as u8).for_each(|r| self.evict(r));
        call(self.asm, function);
        let r = self.result(to, &[]);
        self.asm.op(LOAD, r, 0, Rm::Vector(argument(0)));
    }
}
