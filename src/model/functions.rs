//! The functions of the language: argument units, result units, graph nodes. One visible list,
//! every row with all that its function is.

use super::amend::Target;
use super::compile::{At, Compiler, SECOND, Typed};
use super::graph::{Graph, Leaf, Node, Op, View};
use super::syntax::{Expr, Kind};
use crate::units::Dim;

/// One function of the language.
struct Function {
    name: &'static str,
    /// Numbers of arguments that it takes.
    counts: &'static [usize],
    /// How it reads in a message.
    form: &'static str,
    build: Build,
}

/// How a call becomes nodes. Those are operations (`Op`), each with its value (`arithmetic::apply`)
/// and its derivative (`Graph::derivative`), both matched without a way out: neither a function nor
/// an operation can be listed and left without them.
enum Build {
    /// One operation on a number without unit.
    Elementary(Op),
    /// From its arguments' nodes.
    Of(fn(&mut Compiler, &Call, &[Typed]) -> Option<Typed>),
    /// From the text of its arguments: some are names, not values.
    Text(fn(&mut Compiler, &Call) -> Option<Typed>),
}

/// A call where it stands.
struct Call<'a> {
    arguments: &'a [Expr],
    offset: usize,
    at: &'a At,
}

const fn row(
    name: &'static str,
    counts: &'static [usize],
    form: &'static str,
    build: Build,
) -> Function {
    Function { name, counts, form, build }
}

const FUNCTIONS: &[Function] = &[
    row("sin", &[1], "sin(x)", Build::Elementary(Op::Sin)),
    row("cos", &[1], "cos(x)", Build::Elementary(Op::Cos)),
    row("tan", &[1], "tan(x)", Build::Elementary(Op::Tan)),
    row("asin", &[1], "asin(x)", Build::Elementary(Op::Asin)),
    row("acos", &[1], "acos(x)", Build::Elementary(Op::Acos)),
    row("atan", &[1], "atan(x)", Build::Elementary(Op::Atan)),
    row("exp", &[1], "exp(x)", Build::Elementary(Op::Exp)),
    row("log", &[1], "log(x)", Build::Elementary(Op::Log)),
    row("tanh", &[1], "tanh(x)", Build::Elementary(Op::Tanh)),
    row("sqrt", &[1], "sqrt(x)", Build::Of(sqrt)),
    row(
        "abs",
        &[1],
        "abs(x)",
        Build::Of(|c, _, a| {
            Some(Typed { node: c.graph().unary(Op::Abs, a[0].node), dim: a[0].dim })
        }),
    ),
    row(
        "sign",
        &[1],
        "sign(x)",
        Build::Of(|c, _, a| Some(number(c.graph().unary(Op::Sign, a[0].node)))),
    ),
    row("atan2", &[2], "atan2(y, x)", Build::Of(atan2)),
    row("hypot", &[2], "hypot(x, y)", Build::Of(hypot)),
    row("min", &[2], "min(a, b)", Build::Of(|c, call, a| extreme(c, call, a, Graph::min))),
    row("max", &[2], "max(a, b)", Build::Of(|c, call, a| extreme(c, call, a, Graph::max))),
    row("clamp", &[3], "clamp(x, lo, hi)", Build::Of(clamp)),
    row("deadband", &[2], "deadband(x, w)", Build::Of(deadband)),
    row("select", &[3], "select(c, a, b)", Build::Of(select)),
    row("delay", &[2], "delay(x, tau)", Build::Text(delay)),
    row("smooth", &[3], "smooth(x, T, w)", Build::Of(smooth)),
    row("lag", &[2], "lag(x, T)", Build::Of(lag)),
    row("rate", &[1], "rate(x)", Build::Of(rate)),
    row("slope", &[2], "slope(y, x)", Build::Text(|c, call| varied(c, true, call))),
    row("without", &[2], "without(y, x)", Build::Text(|c, call| varied(c, false, call))),
    row("output", &[1], "output(name)", Build::Text(output)),
    row("table", &[2, 3], "table(name, x) or table(name, x, x2)", Build::Text(table)),
];

pub fn is_reserved(name: &str) -> bool {
    name == "pi" || name == "t" || FUNCTIONS.iter().any(|f| f.name == name)
}

/// A call as a typed node; mistakes are filed with the compiler.
pub(super) fn call(
    c: &mut Compiler,
    name: &str,
    arguments: &[Expr],
    offset: usize,
    at: &At,
) -> Option<Typed> {
    let Some(function) = FUNCTIONS.iter().find(|f| f.name == name) else {
        let near = crate::config::nearest(name, FUNCTIONS.iter().map(|f| f.name));
        let known: Vec<&str> = FUNCTIONS.iter().map(|f| f.name).collect();
        let help = near.map_or(format!("functions: {}", known.join(" ")), |n| {
            format!("did you mean \"{n}\"?")
        });
        c.error_help(at, offset, format!("unknown function \"{name}\""), help);
        return None;
    };
    if !function.counts.contains(&arguments.len()) {
        c.report(
            at,
            offset,
            format!("{} is wanted, {} argument(s) are there", function.form, arguments.len()),
        );
        return None;
    }
    let call = Call { arguments, offset, at };
    match function.build {
        Build::Text(build) => build(c, &call),
        Build::Of(build) => {
            let a = values(c, &call)?;
            build(c, &call, &a)
        }
        Build::Elementary(op) => {
            let a = values(c, &call)?;
            unitless(c, a[0], arguments[0].at, at, name)?;
            Some(number(c.graph().unary(op, a[0].node)))
        }
    }
}

/// The arguments, all of them built before one is missed: every mistake is told.
fn values(c: &mut Compiler, call: &Call) -> Option<Vec<Typed>> {
    let built: Vec<Option<Typed>> = call.arguments.iter().map(|e| c.build(e, call.at)).collect();
    built.into_iter().collect()
}

fn number(node: Node) -> Typed {
    Typed { node, dim: Some(Dim::NONE) }
}

fn sqrt(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    let Some(dim) = a[0].dim.unwrap_or(Dim::NONE).power(0.5) else {
        c.report(call.at, call.arguments[0].at, "this unit has no square root".into());
        return None;
    };
    Some(Typed { node: c.graph().unary(Op::Sqrt, a[0].node), dim: Some(dim) })
}

fn atan2(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    c.same_unit(a[0], a[1], call.arguments[1].at, call.at, "compared with")?;
    Some(number(c.graph().op(Op::Atan2, a[0].node, a[1].node, a[1].node)))
}

fn hypot(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    let dim = c.same_unit(a[0], a[1], call.arguments[1].at, call.at, "added to")?;
    let g = c.graph();
    let (p, q) = (g.mul(a[0].node, a[0].node), g.mul(a[1].node, a[1].node));
    let sum = g.add(p, q);
    Some(Typed { node: g.unary(Op::Sqrt, sum), dim })
}

fn extreme(
    c: &mut Compiler,
    call: &Call,
    a: &[Typed],
    of: fn(&mut Graph, Node, Node) -> Node,
) -> Option<Typed> {
    let dim = c.same_unit(a[0], a[1], call.arguments[1].at, call.at, "compared with")?;
    Some(Typed { node: of(c.graph(), a[0].node, a[1].node), dim })
}

fn clamp(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    let dim = c.same_unit(a[0], a[1], call.arguments[1].at, call.at, "compared with")?;
    let dim = c.same_unit(
        Typed { node: a[0].node, dim },
        a[2],
        call.arguments[2].at,
        call.at,
        "compared with",
    )?;
    if let [Some(low), Some(high)] = [a[1], a[2]].map(|x| c.graph().constant(x.node))
        && low > high
    {
        let what = format!("clamp() keeps between {low} and {high}: the first is above the second");
        c.report(call.at, call.arguments[1].at, what);
        return None;
    }
    let g = c.graph();
    let low = g.max(a[0].node, a[1].node);
    Some(Typed { node: g.min(low, a[2].node), dim })
}

/// A constant that may not be below zero: half a width, a time.
fn not_negative(c: &mut Compiler, x: Typed, offset: usize, at: &At, what: &str) -> Option<()> {
    let Some(negative) = c.graph().constant(x.node).filter(|value| *value < 0.0) else {
        return Some(());
    };
    c.report(at, offset, format!("{what} is {negative}: it cannot be below zero"));
    None
}

fn deadband(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    let dim = c.same_unit(a[0], a[1], call.arguments[1].at, call.at, "compared with")?;
    not_negative(c, a[1], call.arguments[1].at, call.at, "half the width of deadband()")?;
    let (g, x, w) = (c.graph(), a[0].node, a[1].node);
    let (above, minus) = (g.sub(x, w), g.add(x, w));
    let below = g.neg(minus);
    let zero = g.c(0.0);
    let low = g.select(below, minus, zero);
    Some(Typed { node: g.select(above, above, low), dim })
}

fn select(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    let dim = c.same_unit(a[1], a[2], call.arguments[2].at, call.at, "an alternative to")?;
    Some(Typed { node: c.graph().select(a[0].node, a[1].node, a[2].node), dim })
}

fn lag(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    seconds(c, a[1], call.arguments[1].at, call.at, "the time constant of lag()")?;
    let node = c.lag(a[0], a[1].node);
    Some(Typed { node, dim: a[0].dim })
}

fn smooth(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    seconds(c, a[1], call.arguments[1].at, call.at, "the reach of smooth()")?;
    c.same_unit(a[0], a[2], call.arguments[2].at, call.at, "compared with")?;
    let node = c.smooth([a[0].node, a[1].node, a[2].node], a[0].dim, call.offset, call.at)?;
    Some(Typed { node, dim: a[0].dim })
}

fn rate(c: &mut Compiler, call: &Call, a: &[Typed]) -> Option<Typed> {
    let node = c.total_rate(a[0].node, call.offset, call.at)?;
    Some(Typed { node, dim: Some(a[0].dim.unwrap_or(Dim::NONE).over(SECOND)) })
}

fn unitless(c: &mut Compiler, x: Typed, offset: usize, at: &At, name: &str) -> Option<()> {
    match x.dim {
        Some(d) if d != Dim::NONE => {
            c.report(
                at,
                offset,
                format!("{name}() takes a number without unit (or rad), this one is in {d}"),
            );
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

/// The longest delay, s: nothing between a pilot and a recorder is later, and every record has to begin so
/// much earlier.
const LONGEST_DELAY: f64 = 10.0;

/// Of what a parameter delays its start is held against the limit.
fn not_long(c: &mut Compiler, tau: Typed, offset: usize, at: &At) -> Option<()> {
    let value = match c.graph().view(tau.node) {
        View::Const(value) => value,
        View::Leaf(Leaf::Parameter(i)) => c.start(i).unwrap_or_default(),
        _ => return Some(()),
    };
    if value <= LONGEST_DELAY {
        return Some(());
    }
    c.report(at, offset, format!("a delay is at most {LONGEST_DELAY} s, this one is {value} s"));
    None
}

fn delay(c: &mut Compiler, &Call { arguments, offset, at }: &Call) -> Option<Typed> {
    let (x, tau) = (c.build(&arguments[0], at), c.build(&arguments[1], at));
    let (x, tau) = (x?, tau?);
    seconds(c, tau, arguments[1].at, at, "a delay")?;
    not_negative(c, tau, arguments[1].at, at, "a delay")?;
    not_long(c, tau, arguments[1].at, at)?;
    if c.leaves(tau.node).iter().any(|l| matches!(l, Leaf::Delayed(_))) {
        c.report(at, offset, "a delay time cannot itself depend on a delayed value".into());
        return None;
    }
    Some(Typed { node: c.delayed(x.node, tau.node, arguments[0].at, at)?, dim: x.dim })
}

/// `slope(y, x)`: dy/dx; `without(y, x)`: y where x is zero. Both for an input, a state or a
/// parameter x.
fn varied(c: &mut Compiler, slope: bool, &Call { arguments, at, .. }: &Call) -> Option<Typed> {
    let (y, x) = (c.build(&arguments[0], at), c.build(&arguments[1], at));
    let (y, x) = (y?, x?);
    let View::Leaf(leaf @ (Leaf::Input(_) | Leaf::State(_) | Leaf::Parameter(_))) =
        c.graph().view(x.node)
    else {
        c.report(
            at,
            arguments[1].at,
            "slope() and without() take an input, a state or a parameter here".into(),
        );
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
fn output(c: &mut Compiler, &Call { arguments, at, .. }: &Call) -> Option<Typed> {
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

fn table(c: &mut Compiler, &Call { arguments, at, .. }: &Call) -> Option<Typed> {
    let Kind::Name(name) = &arguments[0].kind else {
        c.report(
            at,
            arguments[0].at,
            "the first argument of table() is the name of a table".into(),
        );
        return None;
    };
    let Some(info) = c.tables.get(name) else {
        let known: Vec<String> = c.tables.keys().cloned().collect();
        c.error_help(
            at,
            arguments[0].at,
            format!("unknown table \"{name}\""),
            format!("tables: {}", known.join(", ")),
        );
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
