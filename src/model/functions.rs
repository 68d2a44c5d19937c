//! The functions of the language: argument units, result units, graph nodes. One visible list.

use super::amend::Target;
use super::compile::{At, Compiler, SECOND, Typed};
use super::expr::{Expr, Kind};
use super::graph::{Leaf, Node, Op, View};
use crate::units::Dim;

/// Name, number of arguments, and how it reads in a message.
const FUNCTIONS: &[(&str, &[usize], &str)] = &[
    ("sin", &[1], "sin(x)"),
    ("cos", &[1], "cos(x)"),
    ("tan", &[1], "tan(x)"),
    ("asin", &[1], "asin(x)"),
    ("acos", &[1], "acos(x)"),
    ("atan", &[1], "atan(x)"),
    ("exp", &[1], "exp(x)"),
    ("log", &[1], "log(x)"),
    ("tanh", &[1], "tanh(x)"),
    ("sqrt", &[1], "sqrt(x)"),
    ("abs", &[1], "abs(x)"),
    ("sign", &[1], "sign(x)"),
    ("atan2", &[2], "atan2(y, x)"),
    ("hypot", &[2], "hypot(x, y)"),
    ("min", &[2], "min(a, b)"),
    ("max", &[2], "max(a, b)"),
    ("clamp", &[3], "clamp(x, lo, hi)"),
    ("deadband", &[2], "deadband(x, w)"),
    ("select", &[3], "select(c, a, b)"),
    ("delay", &[2], "delay(x, tau)"),
    ("smooth", &[3], "smooth(x, T, w)"),
    ("lag", &[2], "lag(x, T)"),
    ("rate", &[1], "rate(x)"),
    ("slope", &[2], "slope(y, x)"),
    ("without", &[2], "without(y, x)"),
    ("output", &[1], "output(name)"),
    ("table", &[2, 3], "table(name, x) or table(name, x, x2)"),
];

pub fn is_reserved(name: &str) -> bool {
    name == "pi" || name == "t" || FUNCTIONS.iter().any(|f| f.0 == name)
}

fn elementary(name: &str) -> Option<Op> {
    Some(match name {
        "sin" => Op::Sin,
        "cos" => Op::Cos,
        "tan" => Op::Tan,
        "asin" => Op::Asin,
        "acos" => Op::Acos,
        "atan" => Op::Atan,
        "exp" => Op::Exp,
        "log" => Op::Log,
        "tanh" => Op::Tanh,
        _ => return None,
    })
}

/// A call as a typed node; mistakes are filed with the compiler.
pub(super) fn call(c: &mut Compiler, name: &str, arguments: &[Expr], offset: usize, at: &At) -> Option<Typed> {
    let Some((_, counts, form)) = FUNCTIONS.iter().find(|f| f.0 == name) else {
        let near = crate::config::nearest(name, FUNCTIONS.iter().map(|f| f.0));
        let known: Vec<&str> = FUNCTIONS.iter().map(|f| f.0).collect();
        let help = near.map_or(format!("functions: {}", known.join(" ")), |n| format!("did you mean \"{n}\"?"));
        c.error_help(at, offset, format!("unknown function \"{name}\""), help);
        return None;
    };
    if !counts.contains(&arguments.len()) {
        c.report(at, offset, format!("{form} is wanted, {} argument(s) are there", arguments.len()));
        return None;
    }
    match name {
        "delay" => return delay(c, arguments, offset, at),
        "table" => return table(c, arguments, at),
        "slope" | "without" => return varied(c, name == "slope", arguments, at),
        "output" => return output(c, arguments, at),
        _ => {}
    }
    let built: Vec<Option<Typed>> = arguments.iter().map(|e| c.build(e, at)).collect();
    let a: Vec<Typed> = built.into_iter().collect::<Option<_>>()?;
    if let Some(op) = elementary(name) {
        unitless(c, a[0], arguments[0].at, at, name)?;
        return Some(Typed { node: c.graph().unary(op, a[0].node), dim: Some(Dim::NONE) });
    }
    let x = a[0];
    match name {
        "sqrt" => {
            let Some(dim) = x.dim.unwrap_or(Dim::NONE).power(0.5) else {
                c.report(at, arguments[0].at, "this unit has no square root".into());
                return None;
            };
            Some(Typed { node: c.graph().unary(Op::Sqrt, x.node), dim: Some(dim) })
        }
        "abs" => Some(Typed { node: c.graph().unary(Op::Abs, x.node), dim: x.dim }),
        "sign" => Some(Typed { node: c.graph().unary(Op::Sign, x.node), dim: Some(Dim::NONE) }),
        "atan2" => {
            c.same_unit(x, a[1], arguments[1].at, at, "compared with")?;
            Some(Typed { node: c.graph().op(Op::Atan2, x.node, a[1].node, a[1].node), dim: Some(Dim::NONE) })
        }
        "hypot" => {
            let dim = c.same_unit(x, a[1], arguments[1].at, at, "added to")?;
            let g = c.graph();
            let (p, q) = (g.mul(x.node, x.node), g.mul(a[1].node, a[1].node));
            let sum = g.add(p, q);
            Some(Typed { node: g.unary(Op::Sqrt, sum), dim })
        }
        "min" | "max" => {
            let dim = c.same_unit(x, a[1], arguments[1].at, at, "compared with")?;
            let g = c.graph();
            let node = if name == "min" { g.min(x.node, a[1].node) } else { g.max(x.node, a[1].node) };
            Some(Typed { node, dim })
        }
        "clamp" => {
            let dim = c.same_unit(x, a[1], arguments[1].at, at, "compared with")?;
            let dim = c.same_unit(Typed { node: x.node, dim }, a[2], arguments[2].at, at, "compared with")?;
            let g = c.graph();
            let low = g.max(x.node, a[1].node);
            Some(Typed { node: g.min(low, a[2].node), dim })
        }
        "deadband" => {
            let dim = c.same_unit(x, a[1], arguments[1].at, at, "compared with")?;
            let g = c.graph();
            let w = a[1].node;
            let (above, minus) = (g.sub(x.node, w), g.add(x.node, w));
            let below = g.neg(minus);
            let zero = g.c(0.0);
            let low = g.select(below, minus, zero);
            Some(Typed { node: g.select(above, above, low), dim })
        }
        "select" => {
            let dim = c.same_unit(a[1], a[2], arguments[2].at, at, "an alternative to")?;
            Some(Typed { node: c.graph().select(x.node, a[1].node, a[2].node), dim })
        }
        "lag" => {
            seconds(c, a[1], arguments[1].at, at, "the time constant of lag()")?;
            let node = c.lag(x, a[1].node);
            Some(Typed { node, dim: x.dim })
        }
        "smooth" => {
            seconds(c, a[1], arguments[1].at, at, "the reach of smooth()")?;
            c.same_unit(x, a[2], arguments[2].at, at, "compared with")?;
            Some(Typed { node: c.smooth([x.node, a[1].node, a[2].node], x.dim, offset, at)?, dim: x.dim })
        }
        "rate" => {
            let node = c.total_rate(x.node, offset, at)?;
            Some(Typed { node, dim: Some(x.dim.unwrap_or(Dim::NONE).over(SECOND)) })
        }
        _ => None,
    }
}

fn unitless(c: &mut Compiler, x: Typed, offset: usize, at: &At, name: &str) -> Option<()> {
    match x.dim {
        Some(d) if d != Dim::NONE => {
            c.report(at, offset, format!("{name}() takes a number without unit (or rad), this one is in {d}"));
            None
        }
        _ => Some(()),
    }
}

fn seconds(c: &mut Compiler, x: Typed, offset: usize, at: &At, what: &str) -> Option<()> {
    match x.dim {
        Some(d) if d != SECOND => {
            c.report(at, offset, format!("{what} must be in s, this one is in {d}"));
            None
        }
        _ => Some(()),
    }
}

fn delay(c: &mut Compiler, arguments: &[Expr], offset: usize, at: &At) -> Option<Typed> {
    let (x, tau) = (c.build(&arguments[0], at), c.build(&arguments[1], at));
    let (x, tau) = (x?, tau?);
    seconds(c, tau, arguments[1].at, at, "a delay")?;
    if c.leaves(tau.node).iter().any(|l| matches!(l, Leaf::Delayed(_))) {
        c.report(at, offset, "a delay time cannot itself depend on a delayed value".into());
        return None;
    }
    Some(Typed { node: c.delayed(x.node, tau.node, arguments[0].at, at)?, dim: x.dim })
}

/// `slope(y, x)`: dy/dx; `without(y, x)`: y where x is zero. Both for an input, a state or a parameter x.
fn varied(c: &mut Compiler, slope: bool, arguments: &[Expr], at: &At) -> Option<Typed> {
    let (y, x) = (c.build(&arguments[0], at), c.build(&arguments[1], at));
    let (y, x) = (y?, x?);
    let View::Leaf(leaf @ (Leaf::Input(_) | Leaf::State(_) | Leaf::Parameter(_))) = c.graph().view(x.node) else {
        c.report(at, arguments[1].at, "slope() and without() take an input, a state or a parameter here".into());
        return None;
    };
    let g = c.graph();
    if slope {
        let dim = y.dim.unwrap_or(Dim::NONE).over(x.dim.unwrap_or(Dim::NONE));
        return Some(Typed { node: g.derivative(y.node, leaf), dim: Some(dim) });
    }
    let with = [(leaf, g.c(0.0))].into();
    Some(Typed { node: g.substitute(y.node, &with), dim: y.dim })
}

/// The value of an output, which is a name space of its own.
fn output(c: &mut Compiler, arguments: &[Expr], at: &At) -> Option<Typed> {
    let Kind::Name(name) = &arguments[0].kind else {
        c.report(at, arguments[0].at, "the argument of output() is the name of an output".into());
        return None;
    };
    let target = Target::Output(name.clone());
    if !c.sources.iter().any(|s| s.file.outputs.contains_key(name)) {
        c.report(at, arguments[0].at, format!("there is no output \"{name}\""));
        return None;
    }
    let seen = c.seen(&target, at);
    c.amended_value(&target, seen, at)
}

fn table(c: &mut Compiler, arguments: &[Expr], at: &At) -> Option<Typed> {
    let Kind::Name(name) = &arguments[0].kind else {
        c.report(at, arguments[0].at, "the first argument of table() is the name of a table".into());
        return None;
    };
    let Some(info) = c.tables.get(name) else {
        let known: Vec<String> = c.tables.keys().cloned().collect();
        c.error_help(at, arguments[0].at, format!("unknown table \"{name}\""), format!("tables: {}", known.join(", ")));
        return None;
    };
    let (number, x, x2, y) = (info.number, info.x, info.x2, info.y);
    if x2.is_some() != (arguments.len() == 3) {
        let wanted = if x2.is_some() { "two arguments" } else { "one argument" };
        c.report(at, arguments[0].at, format!("table \"{name}\" has {wanted}"));
        return None;
    }
    let mut nodes: Vec<Node> = Vec::new();
    for (e, dim) in arguments[1..].iter().zip([Some(x), x2]) {
        let typed = c.build(e, at)?;
        if let (Some(d), Some(wanted)) = (typed.dim, dim)
            && d != wanted
        {
            c.report(at, e.at, format!("table \"{name}\" takes {wanted} here, this is in {d}"));
            return None;
        }
        nodes.push(typed.node);
    }
    let g = c.graph();
    let k = g.c(number as f64);
    let node = match nodes[..] {
        [x] => g.op(Op::Table, x, k, k),
        [x, y] => g.op(Op::Table2, x, y, k),
        _ => return None,
    };
    Some(Typed { node, dim: Some(y) })
}
