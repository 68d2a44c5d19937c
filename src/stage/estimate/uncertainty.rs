//! Finished estimations come in; the tables of what their uncertainty is made of, and whether it
//! can be believed, go out.

use super::batch::{Batch, Done, per, segment};
use super::limits;
use crate::config::list;
use crate::error::Result;
use crate::estimate::{
    Combination, Decision, Estimation, Influence, Point, Profile, Row, Support, covariance,
};
use crate::math::distribution::INTERVAL_95;
use crate::table::Table;

/// One line of `separability`.
struct Finding<'a> {
    batch: &'a Batch,
    number: i64,
    verdict: &'static str,
    information: f64,
    condition: f64,
    /// The row of the term and its change.
    term: Option<(&'a Row, f64)>,
    /// The segment of a finding without a term.
    segment: Option<usize>,
    /// A candidate, which may have no row.
    decision: Option<&'a Decision>,
    text: String,
}

/// Below this share of information nothing is left of it but rounding.
const NOTHING: f64 = 1e-12;

pub fn separability(model: &str, done: &[Done]) -> Result<Table> {
    let rows: Vec<Finding> = done.iter().flat_map(|(batch, e)| findings(batch, e)).collect();
    let term = |of: fn(&Batch, &Row) -> Option<String>| {
        rows.iter().map(move |f| f.term.and_then(|(row, _)| of(f.batch, row)))
    };
    let named = |of: fn(&Row) -> &String, or: fn(&Decision) -> &String| {
        rows.iter().map(move |f| f.term.map(|(row, _)| of(row)).or(f.decision.map(or)).cloned())
    };
    Table::build("separability")
        .repeat("model", model)
        .strings("group", rows.iter().map(|f| &f.batch.group))
        .i64("number", rows.iter().map(|f| f.number).collect::<Vec<_>>())
        .strings("verdict", rows.iter().map(|f| f.verdict))
        .f64("information", rows.iter().map(|f| f.information).collect::<Vec<_>>())
        .f64("condition", rows.iter().map(|f| f.condition).collect::<Vec<_>>())
        .opt_strings("parameter", named(|row| &row.name, |d| &d.parameter))
        .opt_strings(
            "segment",
            rows.iter().map(|f| segment(f.batch, f.term.map_or(f.segment, |(row, _)| row.segment))),
        )
        .opt_strings("of", term(|batch, row| per(batch, row).1))
        .opt_strings("unit", named(|row| &row.unit, |d| &d.unit))
        .f64(
            "change",
            rows.iter().map(|f| f.term.map_or(f64::NAN, |(_, change)| change)).collect::<Vec<_>>(),
        )
        .strings("text", rows.iter().map(|f| &f.text))
        .finish()
}

fn findings<'a>(batch: &'a Batch, e: &'a Estimation) -> Vec<Finding<'a>> {
    let condition = if e.verdict.condition.is_finite() { e.verdict.condition } else { f64::NAN };
    let (verdict, text) = if e.verdict.singular {
        ("not separable", "these data do not determine all parameters".to_string())
    } else if e.verdict.condition.is_nan() {
        ("unknown", "there is nothing to judge by".to_string())
    } else {
        let idle: Vec<&str> =
            e.rows.iter().filter(|row| row.idle).map(|row| row.name.as_str()).collect();
        let but = if idle.is_empty() { String::new() } else { format!(" but {}", list(&idle)) };
        let text = format!("these data determine all parameters{but}; condition {condition:.1e}");
        ("separable", text)
    };
    let whole = Finding {
        batch,
        number: 0,
        verdict,
        information: f64::NAN,
        condition,
        term: None,
        segment: None,
        decision: None,
        text,
    };
    let mut all = vec![whole];
    for combination in &e.verdict.combinations {
        let number = all.last().map_or(0, |f| f.number) + 1;
        let (verdict, text) = words(batch, combination);
        for term in &combination.terms {
            let of = |r: &&Row| {
                r.name == term.name && r.segment == term.segment && r.group == term.group
            };
            let term = e.rows.iter().find(of).map(|row| (row, term.change));
            let (information, text) = (combination.information, text.clone());
            let (condition, segment, decision) = (f64::NAN, None, None);
            all.push(Finding {
                batch,
                number,
                verdict,
                information,
                condition,
                term,
                segment,
                decision,
                text,
            });
        }
    }
    for row in e.rows.iter().filter(|r| r.at_bound) {
        let number = all.last().map_or(0, |f| f.number) + 1;
        let text = format!(
            "{} sits on its bound {}; the other estimates hold for it fixed there",
            row.name, row.value
        );
        let term = Some((row, f64::NAN));
        all.push(Finding {
            batch,
            number,
            verdict: "at a bound",
            information: f64::NAN,
            condition: f64::NAN,
            term,
            segment: None,
            decision: None,
            text,
        });
    }
    for row in e.rows.iter().filter(|r| r.idle) {
        let number = all.last().map_or(0, |f| f.number) + 1;
        let (verdict, text) = limits::idle(e, row);
        let (segment, decision) = (None, None);
        let (information, condition, term) = (0.0, f64::NAN, Some((row, 1.0)));
        all.push(Finding {
            batch,
            number,
            verdict,
            information,
            condition,
            term,
            segment,
            decision,
            text,
        });
    }
    for decision in &e.decisions {
        let number = all.last().map_or(0, |f| f.number) + 1;
        let (information, condition) = (f64::NAN, f64::NAN);
        let (verdict, text, decision) =
            (decision.support.as_str(), decided(decision), Some(decision));
        all.push(Finding {
            batch,
            number,
            verdict,
            information,
            condition,
            term: None,
            segment: None,
            decision,
            text,
        });
    }
    let left_out = e.left_out.iter().map(|l| (l.segment, "left out", l.why.clone()));
    let doubtful = e
        .doubtful
        .iter()
        .map(|d| (d.segment, "doubtful output", format!("{}: {}", d.output, d.why)));
    let stuck = e.stuck.iter().map(|(segment, state)| {
        (*segment, "stuck throughout", format!("{state}: friction holds it all along"))
    });
    for (segment, verdict, text) in left_out.chain(doubtful).chain(stuck) {
        let number = all.last().map_or(0, |f| f.number) + 1;
        let (information, condition) = (f64::NAN, f64::NAN);
        let (term, segment, decision) = (None, Some(segment), None);
        all.push(Finding {
            batch,
            number,
            verdict,
            information,
            condition,
            term,
            segment,
            decision,
            text,
        });
    }
    all
}

/// What was decided of a candidate.
fn decided(d: &Decision) -> String {
    let Decision { parameter, value, sd, start, .. } = d;
    if !d.held() {
        format!("{parameter} {value:.4e} +- {:.1e} (95%): estimated", INTERVAL_95 * sd)
    } else if d.support == Support::NotTaken {
        format!("{parameter} is not taken by the search (table searches): held at {start}")
    } else if value.is_finite() {
        format!(
            "{parameter} {value:.4e} +- {:.1e} (95%) if it were estimated: held at {start}",
            INTERVAL_95 * sd
        )
    } else if d.like.is_empty() {
        format!("{parameter} has no effect that these data show: held at {start}")
    } else {
        let like = list(&d.like);
        format!("{parameter} is not distinguishable from {like} by these data: held at {start}")
    }
}

fn words(batch: &Batch, combination: &Combination) -> (&'static str, String) {
    let name = |s: usize| segment(batch, Some(s)).unwrap_or_default().to_string();
    match (combination.terms.len(), combination.information <= NOTHING) {
        (0 | 1, true) => ("no effect", combination.words(&name)),
        (_, true) => ("not separable", combination.words(&name)),
        (_, false) => {
            let names = combination.names(&name).join(", ");
            ("hardly separable", format!("{names}: hardly determined by these data"))
        }
    }
}

/// What stands between the names of two constants whose errors are correlated.
pub const WITH: &str = " with ";

/// One contribution: of the noise, of an assumed constant, or of two whose errors are correlated.
struct Share<'a> {
    batch: &'a Batch,
    row: &'a Row,
    of: Of<'a>,
    contribution: f64,
    share: f64,
}

#[derive(Clone, Copy)]
enum Of<'a> {
    Noise,
    Constant(&'a Influence, f64),
    Pair(&'a Influence, &'a Influence),
}

impl<'a> Of<'a> {
    /// The constant and how it moves the estimate, where it is one.
    fn one(self) -> Option<(&'a Influence, f64)> {
        if let Of::Constant(influence, slope) = self { Some((influence, slope)) } else { None }
    }

    /// The constant, or both.
    fn name(self) -> Option<String> {
        let name = |i: &Influence| i.constant.quantity.name.clone();
        match self {
            Of::Noise => None,
            Of::Constant(i, _) => Some(name(i)),
            Of::Pair(a, b) => Some(format!("{}{WITH}{}", name(a), name(b))),
        }
    }

    /// The value of the constant; the correlation of a pair.
    fn value(self) -> f64 {
        match self {
            Of::Noise => f64::NAN,
            Of::Constant(i, _) => i.constant.value,
            Of::Pair(a, b) => {
                let with = a.constant.origin.as_ref().map(|origin| &origin.with);
                let of = with.and_then(|with| with.get(&b.constant.quantity.name));
                of.copied().unwrap_or(f64::NAN)
            }
        }
    }

    /// Where the values come from.
    fn source(self) -> Option<String> {
        let of = |i: &Influence| Some(i.constant.source.clone()).filter(|text| !text.is_empty());
        match self {
            Of::Noise => None,
            Of::Constant(i, _) | Of::Pair(i, _) => of(i),
        }
    }
}

pub fn budget(model: &str, done: &[Done]) -> Result<Table> {
    let mut rows: Vec<Share> = done.iter().flat_map(|(batch, e)| shares(batch, e)).collect();
    let key = |s: &Share| {
        (
            s.batch.group.clone(),
            s.row.name.clone(),
            segment(s.batch, s.row.segment).map(str::to_string),
            per(s.batch, s.row).1,
        )
    };
    rows.sort_by(|a, b| key(a).cmp(&key(b)).then(b.share.total_cmp(&a.share)));
    let number = |of: fn(&Influence, f64) -> f64| {
        rows.iter()
            .map(|s| s.of.one().map_or(f64::NAN, |(i, slope)| of(i, slope)))
            .collect::<Vec<_>>()
    };
    Table::build("budget")
        .repeat("model", model)
        .strings("group", rows.iter().map(|s| &s.batch.group))
        .opt_strings("segment", rows.iter().map(|s| segment(s.batch, s.row.segment)))
        .opt_strings("of", rows.iter().map(|s| per(s.batch, s.row).1))
        .strings("parameter", rows.iter().map(|s| &s.row.name))
        .strings("unit", rows.iter().map(|s| &s.row.unit))
        .opt_strings("constant", rows.iter().map(|s| s.of.name()))
        .opt_strings(
            "constant_unit",
            rows.iter().map(|s| s.of.one().map(|(i, _)| &i.constant.quantity.unit)),
        )
        .opt_strings("constant_source", rows.iter().map(|s| s.of.source()))
        .f64("constant_value", rows.iter().map(|s| s.of.value()).collect::<Vec<_>>())
        .f64("constant_sd", number(|i, _| i.constant.sd))
        .f64("sensitivity", number(|_, slope| slope))
        .f64("contribution", rows.iter().map(|s| s.contribution).collect::<Vec<_>>())
        .f64("share", rows.iter().map(|s| s.share).collect::<Vec<_>>())
        .finish()
}

fn shares<'a>(batch: &'a Batch, e: &'a Estimation) -> Vec<Share<'a>> {
    if e.budget.is_empty() {
        return Vec::new();
    }
    let mut all = Vec::new();
    for (i, row) in e.rows.iter().enumerate() {
        let (Some(sd), Some(total)) = (row.sd, row.sd_total) else { continue };
        let mut put = |of: Of<'a>, variance: f64| {
            let (contribution, share) =
                (variance.abs().sqrt().copysign(variance), variance / (total * total));
            all.push(Share { batch, row, of, contribution, share });
        };
        put(Of::Noise, sd * sd);
        for (k, influence) in e.budget.iter().enumerate() {
            let slope = influence.slopes.get(i).copied().unwrap_or(0.0);
            if slope != 0.0 {
                put(Of::Constant(influence, slope), (slope * influence.constant.sd).powi(2));
            }
            for other in &e.budget[k + 1..] {
                if let Some(joint) = covariance(influence, other, i).filter(|v| *v != 0.0) {
                    put(Of::Pair(influence, other), joint);
                }
            }
        }
    }
    all
}

pub fn profiles(model: &str, done: &[Done]) -> Result<Table> {
    let mut all: Vec<(&Batch, &Row, &Profile)> = Vec::new();
    for (batch, e) in done {
        all.extend(e.profiles.iter().filter_map(|p| Some((*batch, e.rows.get(p.row)?, p))));
    }
    all.sort_by_key(|(b, r, _)| (&b.group, &r.name, segment(b, r.segment), per(b, r).1));
    let rows: Vec<(&Batch, &Row, &Profile, &Point)> = all
        .iter()
        .flat_map(|(b, r, p)| p.points.iter().map(move |point| (*b, *r, *p, point)))
        .collect();
    Table::build("profiles")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, ..)| &b.group))
        .opt_strings("segment", rows.iter().map(|(b, r, ..)| segment(b, r.segment)))
        .opt_strings("of", rows.iter().map(|(b, r, ..)| per(b, r).1))
        .strings("parameter", rows.iter().map(|(_, r, ..)| &r.name))
        .strings("unit", rows.iter().map(|(_, r, ..)| &r.unit))
        .f64("value", rows.iter().map(|(.., point)| point.value).collect::<Vec<_>>())
        .f64("rise", rows.iter().map(|(.., point)| point.rise).collect::<Vec<_>>())
        .f64("limit", rows.iter().map(|(_, _, p, _)| p.limit).collect::<Vec<_>>())
        .f64("level", rows.iter().map(|(_, _, p, _)| p.level).collect::<Vec<_>>())
        .finish()
}
