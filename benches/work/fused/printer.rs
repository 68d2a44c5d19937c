//! A model with its operation lists in; the C of what all shapes of a pass are made of out.

use super::Shape;
use super::list::{Kind, List};
use koehler::model::Model;
use std::fmt::Write;

/// Directions of a row: the first lane is the output itself, as in the program by hand.
pub const LANES: usize = 16;

/// The model with its lists of operations, and the width of the vectors of directions.
pub struct Printer {
    pub states: usize,
    pub outputs: usize,
    /// Rates with their entries; outputs with theirs; both; rates alone.
    pub stage: List,
    pub outs: List,
    pub point: List,
    pub rates: List,
    pub w: usize,
}

impl Printer {
    pub fn new(model: &Model, w: usize) -> Printer {
        let free: Vec<usize> = (0..model.parameters.len()).collect();
        let both: Vec<_> = model.rates.iter().chain(&model.output_nodes).copied().collect();
        Printer {
            states: model.states.len(),
            outputs: model.outputs.len(),
            stage: List::of(model, "stage", &model.rates, &free),
            outs: List::of(model, "outs", &model.output_nodes, &free),
            point: List::of(model, "point", &both, &free),
            rates: List::of(model, "rates", &model.rates, &[]),
            w,
        }
    }

    pub fn program(&self, shape: Shape) -> String {
        let mut out = format!("#define W {}\n#define LW W\n{}", self.w, include_str!("fused.h"));
        let lists = [&self.stage, &self.outs, &self.point, &self.rates];
        lists.iter().for_each(|list| out += &list.prologue());
        let _ = writeln!(
            out,
            "static void prepare(const double *p) {{ prepare_stage(p); prepare_outs(p); prepare_point(p); prepare_rates(p); }}"
        );
        out + &match shape {
            Shape::Fused => self.fused(),
            Shape::Segments => self.segments(),
            Shape::Passes => self.passes(),
        }
    }

    /// `f` for every state and vector of directions.
    pub fn each(&self, f: impl Fn(usize, usize) -> String) -> String {
        (0..self.states)
            .flat_map(|i| (0..LANES / self.w).map(move |v| (i, v)))
            .map(|(i, v)| f(i, v))
            .collect()
    }

    /// Sensitivities at the start of a record.
    pub fn begin(&self) -> String {
        let first = LANES - self.states;
        self.each(|i, v| {
            let own = (first + i) / self.w == v;
            let at = (first + i) % self.w;
            let start = if own { format!("PUT(NOTHING, {at}, 1.0)") } else { "NOTHING".into() };
            format!("V s{i}_{v} = {start}, st{i}_{v}, as{i}_{v};\n")
        })
    }

    /// The sensitivities after stage `n` (1 to 4) with the rates `k`.
    pub fn led(&self, n: usize) -> String {
        self.each(|i, v| {
            lead(
                n,
                &format!("k{i}_{v}"),
                &format!("s{i}_{v}"),
                &format!("st{i}_{v}"),
                &format!("as{i}_{v}"),
                "FMA",
                "ALL",
            )
        })
    }

    /// The states after stage `n` with the rates `r`.
    pub fn led_states(&self, n: usize, kind: Kind, r: &[String]) -> String {
        let (fma, all) = if kind == Kind::Single { ("fma_s", "one_s") } else { ("fma_l", "one_l") };
        let line = |(i, r): (usize, &String)| {
            lead(n, r, &format!("x{i}"), &format!("xt{i}"), &format!("ax{i}"), fma, all)
        };
        r.iter().enumerate().map(line).collect()
    }

    pub fn rates_of(
        &self,
        list: &List,
        s: &str,
        changing: &dyn Fn(u32, usize) -> String,
    ) -> String {
        let k = |i: usize, v: usize, sum: &str| format!("const V k{i}_{v} = {sum};\n");
        list.sums(0..self.states, [self.w, LANES], changing, s, &k)
    }

    /// Rows of the outputs, which stand behind `first` other rows of the list, to `row`.
    pub fn rows_of(
        &self,
        list: &List,
        first: usize,
        changing: &dyn Fn(u32, usize) -> String,
    ) -> String {
        let put = |j: usize, v: usize, sum: &str| {
            format!("*(V*)(row + {}) = {sum};\n", (j - first) * LANES + v * self.w)
        };
        list.sums(first..first + self.outputs, [self.w, LANES], changing, "s", &put)
    }

    /// The sensitivities of one lane through a chunk, entries and values from memory: `E(n)` where
    /// those of stage n are, `O` those of the outputs, `Y` the values.
    pub fn sweep(&self, first: &List, outs: &List, before: usize) -> String {
        let mut out = String::from("for (int t = t0; t < t1; t++, row += NY * L) {\n");
        out += &self.rows_of(outs, before, &|_, slot| format!("O(t)[{slot} * LW]"));
        for j in 0..self.outputs {
            let _ = writeln!(out, "row[{}] = Y(t)[{j} * LW];", j * LANES);
        }
        out += "if (t + 1 == N) break;\n";
        for n in 1..=4 {
            let (list, s) = if n == 1 { (first, "s") } else { (&self.stage, "st") };
            let rates = self.rates_of(list, s, &|_, slot| format!("E(t, {})[{slot} * LW]", n - 1));
            let _ = writeln!(out, "{{\n{rates}{}}}", self.led(n));
        }
        out + "}\n"
    }
}

/// Inputs at start, middle and end of a step.
pub const INPUTS: &str = "const double *u = U[t], *z = U[t + 1 < N ? t + 1 : t];\n\
    const double ua0 = u[0], ua1 = u[1], ub0 = z[0], ub1 = z[1], um0 = ua0 + 0.5 * (ub0 - ua0), um1 = ua1 + 0.5 * (ub1 - ua1);\n";
pub const INPUTS_L: &str = "const double *u = U[t], *z = U[t + 1 < N ? t + 1 : t];\n\
    const T ua0 = one_l(u[0]), ua1 = one_l(u[1]), ub0 = one_l(z[0]), ub1 = one_l(z[1]), um0 = one_l(u[0] + 0.5 * (z[0] - u[0])), um1 = one_l(u[1] + 0.5 * (z[1] - u[1]));\n";

/// The pass at a new point is the next iteration's: no other pass for its cost.
pub const NO_COST: &str = "static void plain(const double *p, const double *x0, double *ss) { }\n";

/// One number, or vector, after a stage of the Runge-Kutta method.
fn lead(n: usize, k: &str, x: &str, next: &str, sum: &str, fma: &str, all: &str) -> String {
    match n {
        1 => format!("{sum} = {k}; {next} = {fma}({all}(.5 * DT), {k}, {x});\n"),
        2 => format!(
            "{sum} = {fma}({all}(2.0), {k}, {sum}); {next} = {fma}({all}(.5 * DT), {k}, {x});\n"
        ),
        3 => {
            format!("{sum} = {fma}({all}(2.0), {k}, {sum}); {next} = {fma}({all}(DT), {k}, {x});\n")
        }
        _ => format!("{x} = {fma}({all}(DT / 6), {sum} + {k}, {x});\n"),
    }
}
