//! Operation lists of a compiled model in; the same operations as C, and the sums of sensitivities
//! that their results go into, out. Names in the C: `x` states, `s` sensitivities, `k` their rates.

use koehler::model::graph::{Node, Op};
use koehler::model::linear::Sparse;
use koehler::model::{Code, Instruction, Model, Program};
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;

/// A list of operations: values of some nodes, behind them their derivatives.
pub struct List {
    pub name: &'static str,
    program: Program,
    pub sparse: Sparse,
    /// Leaves of a model: below this a register is read from a point.
    width: usize,
    inputs: usize,
    parameters: std::ops::Range<usize>,
    /// Where the entries stand that change along a trajectory, by register.
    slots: BTreeMap<usize, usize>,
}

/// Numbers one by one, or lanes of eight.
#[derive(Clone, Copy, PartialEq)]
pub enum Kind {
    Single,
    Lanes,
}

/// An entry of a Jacobian as the sums read it.
enum Factor {
    One,
    Number(String),
}

impl List {
    pub fn of(model: &Model, name: &'static str, nodes: &[Node], free: &[usize]) -> List {
        let (sparse, program) = model.differentiated(&mut model.graph.clone(), nodes, free);
        let written: Vec<u32> = (program.body().iter())
            .flat_map(|i| [Some(i.to), (i.code == Code::SinCos).then_some(i.b)])
            .flatten()
            .collect();
        let mut slots = BTreeMap::new();
        for k in nodes.len()..program.outputs() {
            let register = program.register(k);
            let next = slots.len();
            if written.contains(&(register as u32)) {
                slots.entry(register).or_insert(next);
            }
        }
        let layout = model.layout;
        List {
            name,
            program,
            sparse,
            width: layout.time() + 1,
            inputs: layout.input(),
            parameters: layout.parameter()..layout.parameter() + layout.parameters,
            slots,
        }
    }

    /// Operations, and entries that change along a trajectory.
    pub fn size(&self) -> [usize; 2] {
        [self.program.operations(), self.slots.len()]
    }

    /// The function that fills the file of what depends on parameters alone.
    pub fn prologue(&self) -> String {
        let (name, n) = (self.name, self.program.file_len());
        let mut out = format!(
            "static double f_{name}[{n}];\nstatic void prepare_{name}(const double *p) {{ double *f = f_{name};\n"
        );
        for (register, x) in self.program.constants() {
            let _ = writeln!(out, "  f[{register}] = {x:e};");
        }
        for (i, register) in self.parameters.clone().enumerate() {
            let _ = writeln!(out, "  f[{register}] = p[{i}];");
        }
        for i in self.program.prologue() {
            let [a, b, c] = [i.a, i.b, i.c].map(|r| format!("f[{r}]"));
            let _ = writeln!(out, "  f[{}] = {};", i.to, expression(i, Kind::Single, &a, &b, &c));
        }
        out + "}\n"
    }

    /// The operations at the states `x0`.. (or another letter) and inputs `u0`..; names of values
    /// and entries begin with `tag`.
    pub fn body(&self, kind: Kind, tag: &str, x: &str, u: &str) -> (String, HashMap<u32, String>) {
        let mut names: HashMap<u32, String> = HashMap::new();
        let (mut out, number) = (String::new(), if kind == Kind::Single { "double" } else { "T" });
        let letter = suffix(kind);
        for (n, i) in self.program.body().iter().enumerate() {
            let [a, b, c] = [i.a, i.b, i.c].map(|r| self.operand(&names, kind, r, x, u));
            let to = format!("{tag}{n}");
            if i.code == Code::SinCos {
                let cos = format!("{tag}c{n}");
                let _ =
                    writeln!(out, "{number} {to}, {cos}; sin_cos_{letter}({a}, &{to}, &{cos});");
                names.insert(i.b, cos);
            } else {
                let _ = writeln!(out, "const {number} {to} = {};", expression(i, kind, &a, &b, &c));
            }
            names.insert(i.to, to);
        }
        (out, names)
    }

    fn operand(
        &self,
        names: &HashMap<u32, String>,
        kind: Kind,
        r: u32,
        x: &str,
        u: &str,
    ) -> String {
        let at = r as usize;
        match names.get(&r) {
            Some(name) => name.clone(),
            None if at < self.inputs => format!("{x}{at}"),
            None if at < self.width => format!("{u}{}", at - self.inputs),
            None if kind == Kind::Single => format!("f_{}[{r}]", self.name),
            None => format!("one_l(f_{}[{r}])", self.name),
        }
    }

    /// Value `k` after the operations.
    pub fn value(
        &self,
        names: &HashMap<u32, String>,
        kind: Kind,
        k: usize,
        x: &str,
        u: &str,
    ) -> String {
        self.operand(names, kind, self.program.register(k) as u32, x, u)
    }

    /// Stores the entries that change, as lanes, from `to` on.
    pub fn store(&self, names: &HashMap<u32, String>, to: &str) -> String {
        let line = |(register, slot): (&usize, &usize)| {
            format!("*(T*)({to} + {slot} * LW) = {};\n", names[&(*register as u32)])
        };
        self.slots.iter().map(line).collect()
    }

    fn factor(&self, output: usize, changing: &dyn Fn(u32, usize) -> String) -> Factor {
        let register = self.program.register(output);
        let constant = self.program.constants().iter().find(|c| c.0 as usize == register);
        match (constant, self.slots.get(&register)) {
            (Some((_, 1.0)), _) => Factor::One,
            (_, Some(slot)) => Factor::Number(changing(register as u32, *slot)),
            _ => Factor::Number(format!("f_{}[{register}]", self.name)),
        }
    }

    /// `to(row, v) = sum of entries times s, and the direct part`, vector by vector; `changing` says
    /// where an entry is found.
    pub fn sums(
        &self,
        rows: std::ops::Range<usize>,
        lanes: [usize; 2],
        changing: &dyn Fn(u32, usize) -> String,
        s: &str,
        to: &dyn Fn(usize, usize, &str) -> String,
    ) -> String {
        let [w, all] = lanes;
        let mut out = String::new();
        for row in rows {
            for v in 0..all / w {
                let mut sum: Option<String> = None;
                let direct = self.sparse.parameters.iter().filter(|e| e.row == row);
                for e in direct.filter(|e| (1 + e.column) / w == v) {
                    let x = match self.factor(e.output, changing) {
                        Factor::One => "1.0".into(),
                        Factor::Number(x) => x,
                    };
                    let before = sum.unwrap_or("NOTHING".into());
                    sum = Some(format!("PUT({before}, {}, {x})", (1 + e.column) % w));
                }
                for e in self.sparse.states.iter().filter(|e| e.row == row) {
                    let s = format!("{s}{}_{v}", e.column);
                    sum = Some(match (self.factor(e.output, changing), sum) {
                        (Factor::One, None) => s,
                        (Factor::One, Some(sum)) => format!("{sum} + {s}"),
                        (Factor::Number(x), None) => format!("ALL({x}) * {s}"),
                        (Factor::Number(x), Some(sum)) => format!("FMA(ALL({x}), {s}, {sum})"),
                    });
                }
                out += &to(row, v, &sum.unwrap_or("NOTHING".into()));
            }
        }
        out
    }
}

fn suffix(kind: Kind) -> char {
    if kind == Kind::Single { 's' } else { 'l' }
}

fn expression(i: &Instruction, kind: Kind, a: &str, b: &str, c: &str) -> String {
    let letter = suffix(kind);
    let Code::Op(op) = i.code else { panic!("sine and cosine are two values") };
    match op {
        Op::Add => format!("{a} + {b}"),
        Op::Sub => format!("{a} - {b}"),
        Op::Mul => format!("{a} * {b}"),
        Op::Div => format!("{a} / {b}"),
        Op::Neg => format!("-{a}"),
        Op::Fma => format!("fma_{letter}({a}, {b}, {c})"),
        Op::Fms => format!("fma_{letter}({a}, {b}, -{c})"),
        Op::Fnma => format!("fma_{letter}(-{a}, {b}, {c})"),
        other => panic!("the printer has no {other:?}: the HFB-320 asks for none"),
    }
}
