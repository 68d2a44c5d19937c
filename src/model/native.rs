//! Machine code from a program: a list of operations in, a function over many points out, with the interpreter's bits.
//!
//! Cranelift generates it in some milliseconds (`opt_level = none`: the graph has shared everything already, and its scheduler only
//! makes spills). Additions to divisions, fused multiply-adds, square roots and choices are instructions, sine and cosine the
//! polynomial of `arithmetic`; every other function and the tables are calls of the very functions that the interpreter calls. Constants
//! and what depends on parameters alone are loaded from the prepared register file where they are used.
//!
//! Where there is no generator for this machine, or it fails, there is no `Native`, and the interpreter does the same work.

use std::collections::HashMap;

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::types::{F64, I64};
use cranelift_codegen::ir::{AbiParam, BlockArg, FuncRef, InstBuilder, MemFlagsData, Value};
use cranelift_codegen::settings::{self, Configurable};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{Linkage, Module};

use super::arithmetic::{COS, HALF_PI, REACH, ROUND, SIN, TWO_OVER_PI, apply};
use super::graph::Op;
use super::program::{Code, Instruction, Program};
use super::tables::Tables;

/// file, points, number of points, out, tables
type Function = unsafe extern "C" fn(*const f64, *const f64, i64, *mut f64, *const Tables);

/// A program as machine code. It owns the memory of the code, which lives exactly as long.
pub struct Native {
    module: Option<JITModule>,
    function: Function,
    width: usize,
    registers: usize,
    outputs: usize,
    /// Numbers that the code loads.
    _literals: Box<[f64]>,
}

// SAFETY: after `compile` nothing touches the module until it is dropped, and the code only reads what it owns.
unsafe impl Send for Native {}
// SAFETY: as above.
unsafe impl Sync for Native {}

impl std::fmt::Debug for Native {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "Native({} outputs)", self.outputs)
    }
}

impl Drop for Native {
    fn drop(&mut self) {
        if let Some(module) = self.module.take() {
            // SAFETY: `function` is private and called by `run` alone, which borrows what is being dropped.
            unsafe { module.free_memory() }
        }
    }
}

impl Native {
    /// Machine code for the body of `program`. The first `width` registers are read from a point (states, inputs, delayed values,
    /// time), all others from the prepared register file. `None` where this machine has no generator.
    pub fn compile(program: &Program, width: usize) -> Option<Native> {
        let mut flags = settings::builder();
        let verify = if cfg!(debug_assertions) { "true" } else { "false" };
        for (name, value) in [("opt_level", "none"), ("is_pic", "false"), ("enable_verifier", verify), ("unwind_info", "false")] {
            flags.set(name, value).ok()?;
        }
        let isa = cranelift_native::builder().ok()?.finish(settings::Flags::new(flags)).ok()?;
        let mut builder = JITBuilder::with_isa(isa, cranelift_module::default_libcall_names());
        for (op, function) in CALLS {
            builder.symbol(format!("{op:?}"), *function as *const u8);
        }
        for (op, function) in TABLES {
            builder.symbol(format!("{op:?}"), *function as *const u8);
        }
        let mut module = JITModule::new(builder);
        let literals = literals();
        let id = match emit(&mut module, program, width, &literals) {
            Some(id) => id,
            None => {
                // SAFETY: no function of the module was handed out.
                unsafe { module.free_memory() };
                return None;
            }
        };
        // SAFETY: the signature `emit` declares is that of `Function`.
        let function = unsafe { std::mem::transmute::<*const u8, Function>(module.get_finalized_function(id)) };
        let (registers, outputs) = (program.file_len(), program.outputs());
        Some(Native { module: Some(module), function, width, registers, outputs, _literals: literals })
    }

    /// All outputs at all `points` (rows of the width) into rows of `out`. `file`: the program's own registers, prepared.
    pub fn run(&self, file: &[[f64; 1]], points: &[f64], out: &mut [f64], tables: &Tables) {
        let n = points.len().checked_div(self.width).unwrap_or(1);
        assert!(file.len() >= self.registers, "a register file of another program");
        assert!(out.len() >= n * self.outputs, "no room for the outputs");
        if n > 0 {
            // SAFETY: the code reads registers below `registers` and the `n` points, and writes `n` rows of `outputs`.
            unsafe { (self.function)(file.as_ptr().cast(), points.as_ptr(), n as i64, out.as_mut_ptr(), tables) }
        }
    }
}

macro_rules! calls {
    ($($op:ident),*) => {
        /// Functions without an instruction: the interpreter's own.
        const CALLS: &[(Op, extern "C" fn(f64, f64, f64) -> f64)] = &[$((Op::$op, {
            extern "C" fn call(a: f64, b: f64, c: f64) -> f64 {
                apply(Op::$op, a, b, c)
            }
            call
        })),*];
    };
}
calls!(Sin, Cos, Tan, Asin, Acos, Atan, Atan2, Exp, Log, Tanh, Pow);

macro_rules! tables {
    ($($op:ident($t:ident, $a:ident, $b:ident, $c:ident) = $e:expr),*) => {
        const TABLES: &[(Op, extern "C" fn(&Tables, f64, f64, f64) -> f64)] = &[$((Op::$op, {
            #[allow(unused_variables)]
            extern "C" fn call($t: &Tables, $a: f64, $b: f64, $c: f64) -> f64 {
                $e
            }
            call
        })),*];
    };
}
tables!(
    Table(t, a, b, c) = t.one(b, a, false),
    TableSlope(t, a, b, c) = t.one(b, a, true),
    Table2(t, a, b, c) = t.two(c, a, b)[0],
    Table2SlopeX(t, a, b, c) = t.two(c, a, b)[1],
    Table2SlopeY(t, a, b, c) = t.two(c, a, b)[2]
);

fn literals() -> Box<[f64]> {
    SIN.iter().chain(&COS).chain(&HALF_PI).chain(&[TWO_OVER_PI, ROUND, -0.5, 1.0, REACH, 0.0, -1.0]).copied().collect()
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

fn emit(module: &mut JITModule, program: &Program, width: usize, literals: &[f64]) -> Option<cranelift_module::FuncId> {
    let mut context = module.make_context();
    let mut frontend = FunctionBuilderContext::new();
    context.func.signature.params.extend([I64; 5].map(AbiParam::new));
    let id = module.declare_function("program", Linkage::Export, &context.func.signature).ok()?;
    let mut calls = HashMap::new();
    for (op, table) in CALLS.iter().map(|c| (c.0, false)).chain(TABLES.iter().map(|t| (t.0, true))) {
        let mut signature = module.make_signature();
        signature.params.extend(table.then(|| AbiParam::new(I64)));
        signature.params.extend([F64; 3].map(AbiParam::new));
        signature.returns.push(AbiParam::new(F64));
        let function = module.declare_function(&format!("{op:?}"), Linkage::Import, &signature).ok()?;
        calls.insert(op, module.declare_func_in_func(function, &mut context.func));
    }
    let mut b = FunctionBuilder::new(&mut context.func, &mut frontend);
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let [file, points, n, out, tables] = <[Value; 5]>::try_from(b.block_params(entry).to_vec()).ok()?;
    let literals = b.ins().iconst(I64, literals.as_ptr() as i64);
    // one turn per point: its address, where its outputs go, how many are left
    let (turn, end) = (b.create_block(), b.create_block());
    let carried = [points, out, n];
    carried.iter().for_each(|_| {
        b.append_block_param(turn, I64);
    });
    b.ins().jump(turn, &carried.map(BlockArg::from));
    b.switch_to_block(turn);
    let [point, out, left] = <[Value; 3]>::try_from(b.block_params(turn).to_vec()).ok()?;
    let mut emitter = Emitter { b, file, point, tables, literals, width: width as u32, values: HashMap::new(), calls };
    for i in program.body() {
        emitter.instruction(i)?;
    }
    let flags = MemFlagsData::trusted();
    for k in 0..program.outputs() {
        let value = emitter.get(program.register(k) as u32);
        emitter.b.ins().store(flags, value, out, 8 * k as i32);
    }
    let mut b = emitter.b;
    let point = b.ins().iadd_imm_s(point, 8 * width as i64);
    let out = b.ins().iadd_imm_s(out, 8 * program.outputs() as i64);
    let left = b.ins().iadd_imm_s(left, -1);
    b.ins().brif(left, turn, &[point, out, left].map(BlockArg::from), end, &[]);
    b.switch_to_block(end);
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

impl Emitter<'_> {
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
                let call = self.b.ins().call(call, if table { &with_tables } else { &with_tables[1..] });
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

    /// The polynomial of `arithmetic`, operation by operation; out of its reach the same calls as there.
    fn sin_cos(&mut self, x: Value) -> Option<(Value, Value)> {
        let (near, far, done) = (self.b.create_block(), self.b.create_block(), self.b.create_block());
        self.b.append_block_param(done, F64);
        self.b.append_block_param(done, F64);
        let reach = self.literal(REACH_AT);
        let size = self.b.ins().fabs(x);
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
        let z = self.b.ins().fmul(r, r);
        let z2 = self.b.ins().fmul(z, z);
        let z4 = self.b.ins().fmul(z2, z2);
        let (p, q) = (self.sum(0, z, z2, z4), self.sum(COS_AT, z, z2, z4));
        let rz = self.b.ins().fmul(r, z);
        let sin = self.b.ins().fma(rz, p, tail);
        let (half, one) = (self.literal(MINUS_HALF_AT), self.literal(ONE_AT));
        let w = self.b.ins().fma(half, z, one);
        let cos = self.b.ins().fma(z2, q, w);
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

#[cfg(test)]
mod tests {
    use super::super::{Constants, Model};
    use super::*;

    const MODEL: &str = r#"
        title = "Every operation"
        [inputs]
        x = { unit = "rad" }
        [parameters]
        a = { unit = "-", start = 0.7 }
        [tables]
        T = { x = [-1.0, 0.0, 2.0], unit_x = "rad", y = [1.0, 3.0, 2.0], unit_y = "-" }
        T2 = { x = [-1.0, 2.0], unit_x = "rad", x2 = [0.0, 1.0, 3.0], unit_x2 = "-", y = [[1.0, 3.0, 2.0], [4.0, 0.0, -2.0]], unit_y = "-" }
        [states]
        s = { unit = "-", rate = "sin(x)*a*g1", start = 0.0 }
        [constants]
        g1 = { unit = "1/s", value = 3.0 }
        [outputs]
        o1 = { unit = "-", value = "sin(x) + a*cos(x) + sin(3*x) - cos(2 - x)*x" }
        o2 = { unit = "-", value = "tan(x)*asin(clamp(x, -1, 1)) + acos(deadband(clamp(x, -1, 1), 0.1)) + atan2(x, s) + tanh(x)" }
        o3 = { unit = "-", value = "exp(-x^2) + log(1 + x^2) + sqrt(abs(x)) + sign(x)*max(x, a) + min(x, s) + abs(x)^1.3 + 1/x" }
        o4 = { unit = "-", value = "select(x, s*s - x*a, x*s - a) + table(T, x) + table(T2, x, s)" }
    "#;

    /// Values and all derivatives.
    fn program() -> (Model, Program) {
        let model = Model::parse("all", MODEL, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
        let mut graph = model.graph.clone();
        let mut nodes: Vec<_> = model.rates.iter().chain(&model.output_nodes).copied().collect();
        for node in nodes.clone() {
            for leaf in graph.leaves(&[node]) {
                nodes.push(graph.derivative(node, leaf));
            }
        }
        let program = Program::lower(&graph, &nodes, &model.layout);
        (model, program)
    }

    #[test]
    fn every_operation_has_the_interpreters_bits() {
        let (model, program) = program();
        let width = model.layout.time() + 1;
        let native = Native::compile(&program, width).expect("a generator for this machine");
        let mut file = program.registers::<1>();
        file[model.layout.parameter()] = [0.7];
        program.prepare(&mut file, &model.tables);
        let values = [0.0, -0.0, 0.3, -0.9, 1.0, -1.0, 2.5, 1e3, -7e4, 1.1e5, -1e12, f64::INFINITY, f64::NAN, 1e-310];
        let mut points = Vec::new();
        for x in values {
            for s in values {
                let mut point = vec![0.0; width];
                (point[0], point[model.layout.input()]) = (s, x);
                points.extend(point);
            }
        }
        let mut out = vec![0.0; points.len() / width * program.outputs()];
        native.run(&file, &points, &mut out, &model.tables);
        for (point, row) in points.chunks(width).zip(out.chunks(program.outputs())) {
            for (slot, x) in file.iter_mut().zip(point) {
                *slot = [*x];
            }
            program.run(&mut file, &model.tables);
            for (k, got) in row.iter().enumerate() {
                let want = program.output(&file, k)[0];
                let same = got.to_bits() == want.to_bits() || (got.is_nan() && want.is_nan());
                assert!(same, "output {k} at {point:?}: {got:e}, interpreter {want:e}");
            }
        }
    }
}
