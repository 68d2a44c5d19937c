//! Machine code from a program: a list of operations in; a function over many points, or over
//! Runge-Kutta steps, out, with the interpreter's bits.
//!
//! Cranelift generates it in some milliseconds (`opt_level = none`: the graph has shared everything
//! already, and its scheduler only makes spills). Additions to divisions, fused multiply-adds,
//! square roots and choices are instructions, sine and cosine the polynomial of `arithmetic`; every
//! other function and the tables are calls of the very functions that the interpreter calls.
//! Constants and what depends on parameters alone are loaded from the prepared register file where
//! they are used.
//!
//! Where there is no generator for this machine, or it fails, there is no `Native`, and the
//! interpreter does the same work.

mod emit;

use cranelift_codegen::settings::{self, Configurable};
use cranelift_jit::{JITBuilder, JITModule};

use super::arithmetic::apply;
use super::graph::Op;
use super::program::Program;
use super::tables::Tables;
use emit::{emit, literals};

/// All outputs at points that are given (`Native::run`): file, points, number of points, out,
/// tables.
pub type Points = unsafe extern "C" fn(*const f64, *const f64, i64, *mut f64, *const Tables);
/// Runge-Kutta steps, the outputs being the rates of the states (`Native::march`): file, points,
/// number of steps, states, tables, weights.
pub type Steps =
    unsafe extern "C" fn(*const f64, *mut f64, i64, *mut f64, *const Tables, *const f64);

/// What the code does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    Points,
    Steps,
}

/// The type of a function that is made.
pub trait Function: Copy {
    const FORM: Form;
    /// # Safety
    /// `code` is a function that `emit` made of that form.
    unsafe fn of(code: *const u8) -> Self;
}

impl Function for Points {
    const FORM: Form = Form::Points;
    unsafe fn of(code: *const u8) -> Self {
        // SAFETY: the caller's promise.
        unsafe { std::mem::transmute::<*const u8, Points>(code) }
    }
}

impl Function for Steps {
    const FORM: Form = Form::Steps;
    unsafe fn of(code: *const u8) -> Self {
        // SAFETY: the caller's promise.
        unsafe { std::mem::transmute::<*const u8, Steps>(code) }
    }
}

/// A program as machine code. It owns the memory of the code, which lives exactly as long.
pub struct Native<F: Function> {
    module: Option<JITModule>,
    function: F,
    width: usize,
    registers: usize,
    outputs: usize,
    /// Numbers that the code loads.
    _literals: Box<[f64]>,
}

// SAFETY: after `compile` nothing touches the module until it is dropped, and the code only reads
// what it owns.
unsafe impl<F: Function> Send for Native<F> {}
// SAFETY: as above.
unsafe impl<F: Function> Sync for Native<F> {}

impl<F: Function> std::fmt::Debug for Native<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "Native({:?}, {} outputs)", F::FORM, self.outputs)
    }
}

impl<F: Function> Drop for Native<F> {
    fn drop(&mut self) {
        if let Some(module) = self.module.take() {
            // SAFETY: `function` is private and called by methods alone, which borrow what is being
            // dropped.
            unsafe { module.free_memory() }
        }
    }
}

impl<F: Function> Native<F> {
    /// Machine code for the body of `program`. The first `width` registers are read from a point
    /// (states, inputs, delayed values, time), all others from the prepared register file. `None`
    /// where this machine has no generator.
    pub fn compile(program: &Program, width: usize) -> Option<Native<F>> {
        let mut flags = settings::builder();
        let verify = if cfg!(debug_assertions) { "true" } else { "false" };
        for (name, value) in [
            ("opt_level", "none"),
            ("is_pic", "false"),
            ("enable_verifier", verify),
            ("unwind_info", "false"),
        ] {
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
        let id = match emit(&mut module, program, width, &literals, F::FORM) {
            Some(id) => id,
            None => {
                // SAFETY: no function of the module was handed out.
                unsafe { module.free_memory() };
                return None;
            }
        };
        // SAFETY: `emit` made it of this form.
        let function = unsafe { F::of(module.get_finalized_function(id)) };
        let (registers, outputs) = (program.file_len(), program.outputs());
        Some(Native {
            module: Some(module),
            function,
            width,
            registers,
            outputs,
            _literals: literals,
        })
    }
}

impl Native<Steps> {
    /// Takes the states `x` through Runge-Kutta steps: `points` holds four rows of the width per
    /// step, whose states are filled in. `weights`: per stage the weight of its rates and how far
    /// they lead to the next stage, then what the weighed sum is multiplied by.
    pub fn march(
        &self,
        file: &[[f64; 1]],
        points: &mut [f64],
        x: &mut [f64],
        weights: &[f64; 9],
        tables: &Tables,
    ) {
        let steps = points.len() / (4 * self.width);
        assert!(file.len() >= self.registers, "a register file of another program");
        assert!(x.len() == self.outputs, "one rate per state");
        if steps > 0 {
            // SAFETY: the code reads registers below `registers`, the `4 steps` rows and the
            // weights, and writes states there and in `x`.
            unsafe {
                (self.function)(
                    file.as_ptr().cast(),
                    points.as_mut_ptr(),
                    steps as i64,
                    x.as_mut_ptr(),
                    tables,
                    weights.as_ptr(),
                );
            }
        }
    }
}

impl Native<Points> {
    /// All outputs at all `points` (rows of the width) into rows of `out`. `file`: the program's
    /// own registers, prepared.
    pub fn run(&self, file: &[[f64; 1]], points: &[f64], out: &mut [f64], tables: &Tables) {
        let n = points.len().checked_div(self.width).unwrap_or(1);
        assert!(file.len() >= self.registers, "a register file of another program");
        assert!(out.len() >= n * self.outputs, "no room for the outputs");
        if n > 0 {
            // SAFETY: the code reads registers below `registers` and the `n` points, and writes `n`
            // rows of `outputs`.
            unsafe {
                (self.function)(
                    file.as_ptr().cast(),
                    points.as_ptr(),
                    n as i64,
                    out.as_mut_ptr(),
                    tables,
                )
            }
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
        let model =
            Model::parse("all", MODEL, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
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
        let native =
            Native::<Points>::compile(&program, width).expect("a generator for this machine");
        let mut file = program.registers::<1>();
        file[model.layout.parameter()] = [0.7];
        program.prepare(&mut file, &model.tables);
        let values = [
            0.0,
            -0.0,
            0.3,
            -0.9,
            1.0,
            -1.0,
            2.5,
            1e3,
            -7e4,
            1.1e5,
            -1e12,
            f64::INFINITY,
            f64::NAN,
            1e-310,
        ];
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
