//! The generator: a program in; instructions of a function over points, or of Runge-Kutta steps,
//! out.

use std::collections::HashMap;

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::types::{F64, I64};
use cranelift_codegen::ir::{AbiParam, Block, BlockArg, FuncRef, InstBuilder, MemFlagsData, Value};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::JITModule;
use cranelift_module::{FuncId, Linkage, Module};

use super::super::arithmetic::{COS, HALF_PI, REACH, ROUND, SIN, SMALL, TWO_OVER_PI};
use super::super::graph::Op;
use super::super::instruction::{Code, Instruction};
use super::super::program::Program;
use super::{CALLS, Form, TABLES};

/// The numbers that the code loads; they have to live as long as it.
pub fn literals() -> Box<[f64]> {
    SIN.iter()
        .chain(&COS)
        .chain(&HALF_PI)
        .chain(&[TWO_OVER_PI, ROUND, -0.5, 1.0, REACH, 0.0, -1.0, SMALL])
        .copied()
        .collect()
}

/// Positions in `literals`.
const COS_AT: usize = SIN.len();
const HALF_PI_AT: usize = COS_AT + COS.len();
const TWO_OVER_PI_AT: usize = HALF_PI_AT + HALF_PI.len();
const ROUND_AT: usize = TWO_OVER_PI_AT + 1;
const MINUS_HALF_AT: usize = ROUND_AT + 1;
const ONE_AT: usize = MINUS_HALF_AT + 1;
const REACH_AT: usize = ONE_AT + 1;
const ZERO_AT: usize = REACH_AT + 1;
const MINUS_ONE_AT: usize = ZERO_AT + 1;
const SMALL_AT: usize = MINUS_ONE_AT + 1;

/// Defines the function in `module`.
pub fn emit(
    module: &mut JITModule,
    program: &Program,
    width: usize,
    literals: &[f64],
    form: Form,
) -> Option<FuncId> {
    let mut context = module.make_context();
    let mut frontend = FunctionBuilderContext::new();
    context.func.signature.params.extend([I64; 5].map(AbiParam::new));
    if form == Form::Steps {
        context.func.signature.params.push(AbiParam::new(I64));
    }
    let id = module.declare_function("program", Linkage::Export, &context.func.signature).ok()?;
    let mut calls = HashMap::new();
    for (op, table) in CALLS.iter().map(|c| (c.0, false)).chain(TABLES.iter().map(|t| (t.0, true)))
    {
        let mut signature = module.make_signature();
        signature.params.extend(table.then(|| AbiParam::new(I64)));
        signature.params.extend([F64; 3].map(AbiParam::new));
        signature.returns.push(AbiParam::new(F64));
        let function =
            module.declare_function(&format!("{op:?}"), Linkage::Import, &signature).ok()?;
        calls.insert(op, module.declare_func_in_func(function, &mut context.func));
    }
    let mut b = FunctionBuilder::new(&mut context.func, &mut frontend);
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let given = b.block_params(entry).to_vec();
    let [file, point, _, _, tables] = <[Value; 5]>::try_from(given.get(..5)?).ok()?;
    let literals = b.ins().iconst(I64, literals.as_ptr() as i64);
    let emitter = Emitter {
        b,
        file,
        point,
        tables,
        literals,
        width: width as u32,
        values: HashMap::new(),
        calls,
    };
    let mut b = match form {
        Form::Points => emitter.points(program, &given)?,
        Form::Steps => emitter.steps(program, &given)?,
    };
    b.ins().return_(&[]);
    b.seal_all_blocks();
    b.finalize(module.isa().frontend_config());
    module.define_function(id, &mut context).ok()?;
    module.finalize_definitions().ok()?;
    Some(id)
}

struct Emitter<'f> {
    b: FunctionBuilder<'f>,
    file: Value,
    point: Value,
    tables: Value,
    literals: Value,
    width: u32,
    /// What the registers hold that a point or an instruction has filled.
    values: HashMap<u32, Value>,
    calls: HashMap<Op, FuncRef>,
}

impl<'f> Emitter<'f> {
    /// One turn per point: its address, where its outputs go, how many are left.
    fn points(mut self, program: &Program, given: &[Value]) -> Option<FunctionBuilder<'f>> {
        let (turn, end) = (self.b.create_block(), self.b.create_block());
        let [_, points, n, out, _] = <[Value; 5]>::try_from(given.get(..5)?).ok()?;
        let carried = self.enter(turn, &[points, out, n]);
        let [point, out, left] = <[Value; 3]>::try_from(carried).ok()?;
        self.point = point;
        for i in program.body() {
            self.instruction(i)?;
        }
        for k in 0..program.outputs() {
            let value = self.get(program.register(k) as u32);
            self.b.ins().store(MemFlagsData::trusted(), value, out, 8 * k as i32);
        }
        let mut b = self.b;
        let point = b.ins().iadd_imm_s(point, 8 * i64::from(self.width));
        let out = b.ins().iadd_imm_s(out, 8 * program.outputs() as i64);
        let left = b.ins().iadd_imm_s(left, -1);
        b.ins().brif(left, turn, &[point, out, left].map(BlockArg::from), end, &[]);
        b.switch_to_block(end);
        Some(b)
    }

    /// One turn per step, inside it one per stage: the states of the stage, the weighed sum of
    /// rates so far, the stage's address and that of its weights. The same operations as in
    /// `dynamics::propagate`.
    fn steps(mut self, program: &Program, given: &[Value]) -> Option<FunctionBuilder<'f>> {
        let flags = MemFlagsData::trusted();
        let [_, points, n, states, _, weights] = <[Value; 6]>::try_from(given.to_vec()).ok()?;
        let nx = program.outputs();
        let [turn, stage, close, end] = std::array::from_fn(|_| self.b.create_block());
        let mut first = vec![points, n];
        for k in 0..nx {
            first.push(self.b.ins().load(F64, flags, states, 8 * k as i32));
        }
        let last = self.b.ins().iadd_imm_s(weights, 64);
        let outer = self.enter(turn, &first);
        let zero = self.literal(ZERO_AT);
        let mut begin = vec![outer[0], weights];
        begin.extend_from_slice(&outer[2..]);
        begin.extend(std::iter::repeat_n(zero, nx));
        let inner = self.enter(stage, &begin);
        let [point, weight] = [inner[0], inner[1]];
        self.point = point;
        for k in 0..nx {
            self.values.insert(k as u32, inner[2 + k]);
            self.b.ins().store(flags, inner[2 + k], point, 8 * k as i32);
        }
        for i in program.body() {
            self.instruction(i)?;
        }
        let rates: Vec<Value> = (0..nx).map(|k| self.get(program.register(k) as u32)).collect();
        let mut b = self.b;
        let w = b.ins().load(F64, flags, weight, 0);
        let ahead = b.ins().load(F64, flags, weight, 8);
        let point = b.ins().iadd_imm_s(point, 8 * i64::from(self.width));
        let weight = b.ins().iadd_imm_s(weight, 16);
        let (mut next, mut sums) = (vec![point, weight], Vec::new());
        for k in 0..nx {
            let led = b.ins().fmul(ahead, rates[k]);
            next.push(b.ins().fadd(outer[2 + k], led));
            let weighed = b.ins().fmul(w, rates[k]);
            sums.push(b.ins().fadd(inner[2 + nx + k], weighed));
        }
        next.extend_from_slice(&sums);
        let more = b.ins().icmp(IntCC::NotEqual, weight, last);
        let next: Vec<BlockArg> = next.into_iter().map(BlockArg::from).collect();
        b.ins().brif(more, stage, &next, close, &[]);
        b.switch_to_block(close);
        let h6 = b.ins().load(F64, flags, last, 0);
        let left = b.ins().iadd_imm_s(outer[1], -1);
        let mut again = vec![BlockArg::from(point), BlockArg::from(left)];
        for k in 0..nx {
            let change = b.ins().fmul(h6, sums[k]);
            let x = b.ins().fadd(outer[2 + k], change);
            // written after every step: the states stay where the caller finds them
            b.ins().store(flags, x, states, 8 * k as i32);
            again.push(BlockArg::from(x));
        }
        b.ins().brif(left, turn, &again, end, &[]);
        b.switch_to_block(end);
        Some(b)
    }

    /// Jumps to a block that carries values of the same types, and continues there: its parameters.
    fn enter(&mut self, block: Block, carried: &[Value]) -> Vec<Value> {
        for &value in carried {
            let kind = self.b.func.dfg.value_type(value);
            self.b.append_block_param(block, kind);
        }
        let carried: Vec<BlockArg> = carried.iter().map(|&v| BlockArg::from(v)).collect();
        self.b.ins().jump(block, &carried);
        self.b.switch_to_block(block);
        self.b.block_params(block).to_vec()
    }

    fn load(&mut self, from: Value, number: usize) -> Value {
        self.b.ins().load(F64, MemFlagsData::trusted(), from, 8 * number as i32)
    }

    fn literal(&mut self, at: usize) -> Value {
        self.load(self.literals, at)
    }

    fn get(&mut self, register: u32) -> Value {
        if let Some(&value) = self.values.get(&register) {
            return value;
        }
        if register >= self.width {
            return self.load(self.file, register as usize);
        }
        let value = self.load(self.point, register as usize);
        self.values.insert(register, value);
        value
    }

    fn instruction(&mut self, i: &Instruction) -> Option<()> {
        let a = self.get(i.a);
        let op = match i.code {
            Code::SinCos | Code::Op(Op::Sin | Op::Cos) => {
                let (sin, cos) = self.sin_cos(a)?;
                self.values.insert(i.to, if i.code == Code::Op(Op::Cos) { cos } else { sin });
                if i.code == Code::SinCos {
                    self.values.insert(i.b, cos);
                }
                return Some(());
            }
            Code::Op(op) => op,
        };
        let (b, c) = (self.get(i.b), self.get(i.c));
        let value = match op {
            Op::Add => self.b.ins().fadd(a, b),
            Op::Sub => self.b.ins().fsub(a, b),
            Op::Mul => self.b.ins().fmul(a, b),
            Op::Div => self.b.ins().fdiv(a, b),
            Op::Neg => self.b.ins().fneg(a),
            Op::Fma => self.b.ins().fma(a, b, c),
            Op::Fms => {
                let c = self.b.ins().fneg(c);
                self.b.ins().fma(a, b, c)
            }
            Op::Fnma => {
                let a = self.b.ins().fneg(a);
                self.b.ins().fma(a, b, c)
            }
            Op::Sqrt => self.b.ins().sqrt(a),
            Op::Abs => self.b.ins().fabs(a),
            Op::Min => self.choose(b, a, a, b),
            Op::Max => self.choose(a, b, a, b),
            Op::Select => {
                let zero = self.literal(ZERO_AT);
                self.choose(a, zero, b, c)
            }
            Op::Sign => {
                let [zero, one, minus] = [ZERO_AT, ONE_AT, MINUS_ONE_AT].map(|at| self.literal(at));
                let other = self.choose(zero, a, minus, zero);
                self.choose(a, zero, one, other)
            }
            op => {
                let call = *self.calls.get(&op)?;
                let table = TABLES.iter().any(|t| t.0 == op);
                let with_tables = [self.tables, a, b, c];
                let call =
                    self.b.ins().call(call, if table { &with_tables } else { &with_tables[1..] });
                *self.b.inst_results(call).first()?
            }
        };
        self.values.insert(i.to, value);
        Some(())
    }

    /// `yes` where x > y, else `no`.
    fn choose(&mut self, x: Value, y: Value, yes: Value, no: Value) -> Value {
        let greater = self.b.ins().fcmp(FloatCC::GreaterThan, x, y);
        self.b.ins().select(greater, yes, no)
    }

    /// The polynomial of `arithmetic`, operation by operation; out of its reach the same calls as
    /// there.
    fn sin_cos(&mut self, x: Value) -> Option<(Value, Value)> {
        let [small, large, near, far, done] = std::array::from_fn(|_| self.b.create_block());
        self.b.append_block_param(done, F64);
        self.b.append_block_param(done, F64);
        let (reach, limit) = (self.literal(REACH_AT), self.literal(SMALL_AT));
        let size = self.b.ins().fabs(x);
        let inside = self.b.ins().fcmp(FloatCC::LessThanOrEqual, size, limit);
        self.b.ins().brif(inside, small, &[], large, &[]);
        self.b.switch_to_block(small);
        let zero = self.literal(ZERO_AT);
        let tail = self.b.ins().fadd(x, zero);
        let (sin, cos) = self.polynomials(x, tail);
        self.b.ins().jump(done, &[sin, cos].map(BlockArg::from));
        self.b.switch_to_block(large);
        let inside = self.b.ins().fcmp(FloatCC::LessThanOrEqual, size, reach);
        self.b.ins().brif(inside, near, &[], far, &[]);
        self.b.switch_to_block(far);
        self.b.set_cold_block(far);
        let mut values = Vec::new();
        for op in [Op::Sin, Op::Cos] {
            let call = self.b.ins().call(*self.calls.get(&op)?, &[x, x, x]);
            values.push(BlockArg::from(*self.b.inst_results(call).first()?));
        }
        self.b.ins().jump(done, &values);
        self.b.switch_to_block(near);
        let (sin, cos) = self.sin_cos_near(x);
        self.b.ins().jump(done, &[sin, cos].map(BlockArg::from));
        self.b.switch_to_block(done);
        match self.b.block_params(done) {
            &[sin, cos] => Some((sin, cos)),
            _ => None,
        }
    }

    fn sin_cos_near(&mut self, x: Value) -> (Value, Value) {
        let (factor, round) = (self.literal(TWO_OVER_PI_AT), self.literal(ROUND_AT));
        let rounded = self.b.ins().fma(x, factor, round);
        let k = self.b.ins().fsub(rounded, round);
        let k = self.b.ins().fneg(k);
        let parts = [0, 1, 2].map(|i| self.literal(HALF_PI_AT + i));
        let r = self.b.ins().fma(k, parts[0], x);
        let r = self.b.ins().fma(k, parts[1], r);
        let tail = self.b.ins().fma(k, parts[2], r);
        let (sin, cos) = self.polynomials(r, tail);
        let plain = MemFlagsData::new();
        let bits = self.b.ins().bitcast(I64, plain, rounded);
        let odd = self.b.ins().band_imm_s(bits, 1);
        let mask = self.b.ins().ineg(odd);
        let next = self.b.ins().iadd_imm_s(bits, 1);
        let [sin_sign, cos_sign] = [bits, next].map(|q| {
            let q = self.b.ins().ishl_imm_u(q, 62);
            self.b.ins().band_imm_s(q, i64::MIN)
        });
        let (s, c) = (self.b.ins().bitcast(I64, plain, sin), self.b.ins().bitcast(I64, plain, cos));
        let both = self.b.ins().bxor(s, c);
        let swap = self.b.ins().band(both, mask);
        let [sin, cos] = [(s, sin_sign), (c, cos_sign)].map(|(v, sign)| {
            let v = self.b.ins().bxor(v, swap);
            let v = self.b.ins().bxor(v, sign);
            self.b.ins().bitcast(F64, plain, v)
        });
        (sin, cos)
    }

    fn polynomials(&mut self, r: Value, tail: Value) -> (Value, Value) {
        let z = self.b.ins().fmul(r, r);
        let z2 = self.b.ins().fmul(z, z);
        let z4 = self.b.ins().fmul(z2, z2);
        let (p, q) = (self.sum(0, z, z2, z4), self.sum(COS_AT, z, z2, z4));
        let rz = self.b.ins().fmul(r, z);
        let sin = self.b.ins().fma(rz, p, tail);
        let (half, one) = (self.literal(MINUS_HALF_AT), self.literal(ONE_AT));
        let w = self.b.ins().fma(half, z, one);
        (sin, self.b.ins().fma(z2, q, w))
    }

    /// Six coefficients in powers of z, in the order of `arithmetic`.
    fn sum(&mut self, at: usize, z: Value, z2: Value, z4: Value) -> Value {
        let c: [Value; 6] = std::array::from_fn(|i| self.literal(at + i));
        let high = self.b.ins().fma(c[5], z, c[4]);
        let middle = self.b.ins().fma(c[3], z, c[2]);
        let low = self.b.ins().fma(c[1], z, c[0]);
        let rest = self.b.ins().fma(middle, z2, low);
        self.b.ins().fma(high, z4, rest)
    }
}
