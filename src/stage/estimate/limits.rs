//! Finished estimations come in; the tables of the limits of states that they reach, and what was measured on them,
//! go out, and what is said of those that they do not reach.

use super::batch::{Batch, Done, segment};
use crate::error::Result;
use crate::estimate::{Estimation, Idle, Over, Piece, Reached, Row};
use crate::table::Table;

/// A change of an input over a piece that is no more than this share of its mean is none.
const STEADY: f64 = 0.01;

/// A limit and one of the inputs that limits depend on.
type Of<'a> = (&'a Batch, &'a Reached, Option<&'a Over>);

pub fn reached(model: &str, done: &[Done]) -> Result<Table> {
    let limits = done.iter().flat_map(|(b, e)| e.reached.iter().map(move |limit| (*b, limit)));
    let mut rows: Vec<Of> = limits
        .flat_map(|(b, limit)| {
            let none = limit.inputs.is_empty().then_some((b, limit, None));
            limit.inputs.iter().map(move |over| (b, limit, Some(over))).chain(none)
        })
        .collect();
    rows.sort_by_key(|(b, ..)| &b.group);
    let text = |of: fn(&Reached) -> String| rows.iter().map(move |(_, limit, _)| of(limit));
    let number = |of: &dyn Fn(&Of) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
    let input = |of: fn(&Over) -> f64| {
        rows.iter().map(|(.., over)| over.map_or(f64::NAN, of)).collect::<Vec<f64>>()
    };
    let follows = |of: fn(&crate::estimate::Follows) -> f64| {
        number(&|(_, limit, _)| limit.follows.as_ref().map_or(f64::NAN, of))
    };
    Table::build("reached")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, ..)| &b.group))
        .strings("state", text(|limit| limit.state.clone()))
        .strings("limit", text(|limit| limit.limit.to_string()))
        .strings("unit", text(|limit| limit.unit.clone()))
        .strings("verdict", text(|limit| verdict(limit).to_string()))
        .i64("segments", rows.iter().map(|r| r.1.active.len() as i64).collect::<Vec<_>>())
        .i64("of", rows.iter().map(|r| r.1.segments.len() as i64).collect::<Vec<_>>())
        .f64("seconds", number(&|(_, limit, _)| seconds(limit)))
        .opt_strings("input", rows.iter().map(|(.., over)| over.map(|over| &over.name)))
        .opt_strings("unit_input", rows.iter().map(|(.., over)| over.map(|over| &over.unit)))
        .f64("lower", input(|over| over.lower))
        .f64("upper", input(|over| over.upper))
        .f64("extreme", number(&|(_, limit, _)| limit.extreme))
        .opt_strings("segment", rows.iter().map(|(b, limit, _)| segment(b, limit.segment)))
        .f64("at", input(|over| over.at))
        .f64("rms_near", follows(|f| f.near))
        .f64("rms_elsewhere", follows(|f| f.elsewhere))
        .strings("text", text(words))
        .finish()
}

/// A piece of a stretch on a limit, and one of the inputs that limits depend on.
type Part<'a> = (&'a Batch, &'a Reached, &'a Piece, usize);

pub fn plateaus(model: &str, done: &[Done]) -> Result<Table> {
    let limits = done.iter().flat_map(|(b, e)| e.reached.iter().map(move |limit| (*b, limit)));
    let mut rows: Vec<Part> = limits
        .flat_map(|(b, limit)| limit.pieces.iter().map(move |piece| (b, limit, piece)))
        .flat_map(|(b, limit, piece)| (0..limit.inputs.len()).map(move |j| (b, limit, piece, j)))
        .collect();
    rows.sort_by_key(|(b, ..)| &b.group);
    let number = |of: &dyn Fn(&Piece, usize) -> f64| {
        rows.iter().map(|(_, _, piece, j)| of(piece, *j)).collect::<Vec<f64>>()
    };
    Table::build("plateaus")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, ..)| &b.group))
        .strings(
            "segment",
            rows.iter().map(|(b, limit, piece, _)| {
                segment(b, Some(limit.segments[piece.place])).unwrap_or_default()
            }),
        )
        .strings("state", rows.iter().map(|(_, limit, ..)| &limit.state))
        .strings("limit", rows.iter().map(|(_, limit, ..)| limit.limit))
        .f64("t_s", number(&|piece, _| piece.t))
        .f64("seconds", number(&|piece, _| piece.seconds))
        .i64("n", rows.iter().map(|(_, _, piece, _)| piece.count as i64).collect::<Vec<_>>())
        .strings("unit", rows.iter().map(|(_, limit, ..)| &limit.unit))
        .f64("measured", number(&|piece, _| piece.measured))
        .f64("modelled", number(&|piece, _| piece.modelled))
        .strings("input", rows.iter().map(|(_, limit, _, j)| &limit.inputs[*j].name))
        .strings("unit_x", rows.iter().map(|(_, limit, _, j)| &limit.inputs[*j].unit))
        .f64("x", number(&|piece, j| piece.inputs[j][0]))
        .f64("change", number(&|piece, j| piece.inputs[j][1]))
        .strings("way", rows.iter().map(|(_, _, piece, j)| way(piece.inputs[*j])))
        .finish()
}

/// Whether an input rises over a piece, from its mean and its change.
fn way([mean, change]: [f64; 2]) -> &'static str {
    match change {
        c if c.abs() <= STEADY * mean.abs() => "steady",
        c if c > 0.0 => "rises",
        _ => "falls",
    }
}

fn seconds(limit: &Reached) -> f64 {
    limit.active.iter().map(|(_, seconds)| seconds).sum()
}

fn verdict(limit: &Reached) -> &'static str {
    match (limit.active.is_empty(), limit.follows) {
        (false, _) => "reached",
        (true, Some(follows)) if !follows.agrees() => "not reached, yet not followed",
        (true, _) => "not reached",
    }
}

/// What became of a limit.
fn words(limit: &Reached) -> String {
    let Reached { state, limit: which, .. } = limit;
    if limit.active.is_empty() {
        return format!("{which} of {state} is {}", not_reached(limit));
    }
    let over = |o: &Over| format!("{} {:.4} to {:.4} {}", o.name, o.lower, o.upper, o.unit);
    let inputs: Vec<String> = limit.inputs.iter().map(over).collect();
    let at = if inputs.is_empty() { String::new() } else { format!(", at {}", inputs.join(", ")) };
    format!(
        "{which} of {state} is reached in {} of {}, for {:.1} s{at}",
        limit.active.len(),
        limit.segments.len(),
        seconds(limit)
    )
}

/// `not reached: at least 0.21 rad at V_c 72.0 m/s; what was measured follows there (...)`
fn not_reached(limit: &Reached) -> String {
    let at: Vec<String> =
        limit.inputs.iter().map(|o| format!("{} {:.4} {}", o.name, o.at, o.unit)).collect();
    let at = if at.is_empty() { String::new() } else { format!(" at {}", at.join(", ")) };
    let least = if limit.limit == "min" { "at most" } else { "at least" };
    let mut text = format!("not reached: {least} {:.4} {}{at}", limit.extreme, limit.unit);
    if let Some(follows) = limit.follows {
        let does = if follows.agrees() { "follows" } else { "does not follow" };
        text += &format!(
            "; what was measured {does} there (r.m.s. residual {:.2e}, elsewhere {:.2e})",
            follows.near, follows.elsewhere
        );
    }
    text
}

/// What is said of a parameter that no output notices: the verdict, and the sentence.
pub fn idle(estimation: &Estimation, row: &Row) -> (&'static str, String) {
    // Coefficients of one limit start together, where the motion is: not always where the file says.
    let at =
        if row.value == row.start { row.start.to_string() } else { format!("{:.4e}", row.value) };
    let held = format!("held at {at}; the other estimates hold for that");
    match estimation.why_idle(row) {
        Idle::NotReached(limit) => {
            let (which, state) = (limit.limit, &limit.state);
            let text = format!(
                "{} belongs to {which} of {state}, {}: {held}",
                row.name,
                not_reached(limit)
            );
            ("not reached", text)
        }
        Idle::Delays => {
            let text =
                format!("{} is not determined, what it delays has no effect: {held}", row.name);
            ("not determined", text)
        }
        Idle::NoEquation => {
            let text = format!("{} is in none of the equations that can be used: {held}", row.name);
            ("in no equation", text)
        }
        Idle::NoEffect => {
            ("no effect", format!("{} has no effect on the measured outputs: {held}", row.name))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Follows;

    fn limit(active: Vec<(usize, f64)>, follows: Option<[f64; 2]>) -> Reached {
        let over = |name: &str, unit: &str, lower, upper, at| Over {
            name: name.into(),
            unit: unit.into(),
            lower,
            upper,
            at,
        };
        Reached {
            state: "eta".into(),
            limit: "max",
            unit: "rad".into(),
            parameters: vec!["down_0".into()],
            active,
            segments: vec![0, 1, 2],
            inputs: vec![over("V_c", "m/s", 72.0, 111.0, 85.0)],
            extreme: 0.2,
            segment: Some(1),
            follows: follows.map(|[near, elsewhere]| Follows {
                near,
                elsewhere,
                behind: 0.0,
                count: 200,
            }),
            pieces: Vec::new(),
        }
    }

    #[test]
    fn what_became_of_a_limit_in_words() {
        let reached = limit(vec![(0, 1.5), (2, 2.0)], None);
        let wanted = "max of eta is reached in 2 of 3, for 3.5 s, at V_c 72.0000 to 111.0000 m/s";
        assert_eq!((words(&reached).as_str(), verdict(&reached)), (wanted, "reached"));
        let not = limit(Vec::new(), Some([1.02e-3, 1e-3]));
        let wanted = "max of eta is not reached: at least 0.2000 rad at V_c 85.0000 m/s; what was measured follows there (r.m.s. residual \
                      1.02e-3, elsewhere 1.00e-3)";
        assert_eq!((words(&not).as_str(), verdict(&not)), (wanted, "not reached"));
        let other = limit(Vec::new(), Some([5e-3, 1e-3]));
        assert!(words(&other).contains("what was measured does not follow there"));
        assert_eq!(verdict(&other), "not reached, yet not followed");
    }

    #[test]
    fn what_changes_by_less_than_a_hundredth_is_steady() {
        let ways = [way([80.0, 0.5]), way([80.0, 2.0]), way([80.0, -2.0]), way([0.0, 0.0])];
        assert_eq!(ways, ["steady", "rises", "falls", "steady"]);
    }
}
