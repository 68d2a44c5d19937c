//! Measured and modelled outputs of a maneuver and tolerances come in; what each of them allows, how
//! much of it is used, and whether the tests are passed, go out.

use super::file::Of;
use super::judge::Output;
use super::tolerances::{Checked, Limit};
use crate::math::median;
use crate::signal::oscillation::{Oscillation, oscillation};

/// Whether an error is within its tolerance, from the best to the worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    Within,
    Undetermined,
    Outside,
}

impl Verdict {
    pub fn as_str(self) -> &'static str {
        match self {
            Verdict::Within => "within",
            Verdict::Outside => "outside",
            Verdict::Undetermined => "not determined",
        }
    }
}

/// One tolerance in one maneuver.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// Place of the tolerance in the list.
    pub place: usize,
    /// What is compared, SI; not a number for a response, or where it is not determined.
    pub measured: f64,
    pub modelled: f64,
    /// Largest error and how large it may be, SI.
    pub error: f64,
    pub allowed: f64,
    pub verdict: Verdict,
    /// That of the group of alternatives that it belongs to.
    pub group: Verdict,
    /// Why it is not determined.
    pub why: Option<String>,
}

/// What the tolerances that are for a maneuver say of it; its steps are flown in `times`, s.
pub fn judge(
    all: &[Checked],
    is_for: impl Fn(&Checked) -> bool,
    outputs: &[&Output],
    times: [f64; 2],
) -> Vec<Judged> {
    let mut judged: Vec<Judged> = Vec::new();
    for (place, one) in all.iter().enumerate().filter(|(_, one)| is_for(one)) {
        if let Some(output) = outputs.iter().find(|o| o.name == one.told.output) {
            judged.push(against(one, place, output, times));
        }
    }
    let key = |one: &Judged| {
        let told = &all[one.place].told;
        (&told.test, told.group.as_ref().ok_or(one.place))
    };
    let groups: Vec<Verdict> = judged
        .iter()
        .map(|one| best(judged.iter().filter(|o| key(o) == key(one)).map(|o| o.verdict)))
        .collect();
    judged.iter_mut().zip(groups).for_each(|(one, group)| one.group = group);
    judged
}

/// Of alternatives one suffices; what is not determined might have been that one.
fn best(all: impl Iterator<Item = Verdict>) -> Verdict {
    all.min().unwrap_or(Verdict::Undetermined)
}

/// The groups of a test must all pass.
pub fn worst(all: impl Iterator<Item = Verdict>) -> Verdict {
    all.max().unwrap_or(Verdict::Undetermined)
}

fn against(one: &Checked, place: usize, output: &Output, times: [f64; 2]) -> Judged {
    let compared = match one.told.of {
        Of::Response => response(output, times[0]),
        of => free(output, times[1], of),
    };
    let judged = |measured, modelled, error, allowed, verdict, why| Judged {
        place,
        measured,
        modelled,
        error,
        allowed,
        verdict,
        group: verdict,
        why,
    };
    let allowed = |of: f64| match one.limit {
        Limit::Within(limit) => limit,
        Limit::Share(share) => share * of.abs(),
    };
    match compared {
        Ok(Compared { measured, modelled, error, of }) => {
            let allowed = allowed(of);
            let verdict = if error <= allowed { Verdict::Within } else { Verdict::Outside };
            judged(measured, modelled, error, allowed, verdict, None)
        }
        Err(why) => {
            let nan = f64::NAN;
            judged(nan, nan, nan, allowed(nan), Verdict::Undetermined, Some(why))
        }
    }
}

/// An error, and what a share is a share of.
struct Compared {
    measured: f64,
    modelled: f64,
    error: f64,
    of: f64,
}

/// The largest error of the samples, and the largest change of what was measured from its median
/// before the first step (where nothing was recorded before it: from the first sample).
fn response(output: &Output, first_step: f64) -> Result<Compared, String> {
    let pairs = output.measured.iter().zip(&output.modelled);
    let errors = pairs.map(|(z, y)| (z - y).abs()).filter(|e| e.is_finite());
    let error = errors.fold(f64::NAN, f64::max);
    if error.is_nan() {
        return Err("nothing was measured".into());
    }
    let there = || output.t.iter().zip(&output.measured).filter(|(_, z)| z.is_finite());
    let before: Vec<f64> = there().filter(|(t, _)| **t < first_step).map(|(_, z)| *z).collect();
    let from = if before.is_empty() {
        there().map(|(_, z)| *z).next().unwrap_or(f64::NAN)
    } else {
        median(&before)
    };
    let of = there().map(|(_, z)| (z - from).abs()).fold(0.0, f64::max);
    Ok(Compared { measured: f64::NAN, modelled: f64::NAN, error, of })
}

/// A property of the free oscillation after the last step, measured and modelled at the same times.
fn free(output: &Output, last_step: f64, of: Of) -> Result<Compared, String> {
    let from = output.t.partition_point(|t| *t < last_step);
    let both = |k: &usize| output.measured[*k].is_finite() && output.modelled[*k].is_finite();
    let all: Vec<usize> = (from..output.t.len()).filter(both).collect();
    let t: Vec<f64> = all.iter().map(|&k| output.t[k]).collect();
    let found = |of_what: &str, y: &[f64]| {
        let y: Vec<f64> = all.iter().map(|&k| y[k]).collect();
        let property = |one: Oscillation| match of {
            Of::HalfTime => one.half_time(),
            Of::DampingRatio => Ok(one.damping_ratio()),
            Of::Period | Of::Response => Ok(one.period),
        };
        oscillation(&t, &y).and_then(property).map_err(|why| format!("{of_what}: {why}"))
    };
    let measured = found("measured", &output.measured)?;
    let modelled = found("modelled", &output.modelled)?;
    Ok(Compared { measured, modelled, error: (measured - modelled).abs(), of: measured })
}

#[cfg(test)]
mod tests {
    use super::super::file::Tolerance;
    use super::*;
    use std::f64::consts::TAU;

    /// Quiet for 1 s, a step until 2 s, then an oscillation; the model's has another period and size.
    fn output(period: f64, size: f64) -> Output {
        let t: Vec<f64> = (0..1500).map(|k| 0.01 * f64::from(k)).collect();
        let free = |period: f64, size: f64, t: f64| match t {
            t if t < 1.0 => 0.0,
            t if t < 2.0 => size * (t - 1.0),
            t => size * libm::exp(-0.1 * (t - 2.0)) * libm::cos(TAU * (t - 2.0) / period),
        };
        let of = |period, size| t.iter().map(|t| free(period, size, *t)).collect::<Vec<f64>>();
        let (measured, modelled) = (of(4.0, 1.0), of(period, size));
        Output { name: "r".into(), t, measured, modelled, ..Output::default() }
    }

    fn one(of: Of, group: Option<&str>, limit: Limit) -> Checked {
        let told = Tolerance {
            test: "test".into(),
            group: group.map(String::from),
            output: "r".into(),
            of,
            ..Tolerance::default()
        };
        Checked { told, limit, unit: String::new() }
    }

    fn judged(all: &[Checked], output: &Output) -> Vec<Judged> {
        judge(all, |_| true, &[output], [1.0, 2.0])
    }

    #[test]
    fn the_largest_error_is_held_against_a_share_of_the_largest_change() {
        let all = [one(Of::Response, None, Limit::Share(0.1))];
        let found = &judged(&all, &output(4.0, 1.08))[0];
        assert!((found.error - 0.08).abs() < 1e-9 && (found.allowed - 0.1).abs() < 1e-9);
        assert_eq!(found.verdict, Verdict::Within);
        assert_eq!(judged(&all, &output(4.0, 1.2))[0].verdict, Verdict::Outside);
    }

    #[test]
    fn period_and_damping_are_those_after_the_last_step() {
        let all = [
            one(Of::Period, None, Limit::Share(0.1)),
            one(Of::HalfTime, None, Limit::Share(0.1)),
            one(Of::DampingRatio, None, Limit::Within(0.02)),
        ];
        let found = judged(&all, &output(4.6, 1.0));
        assert!((found[0].measured - 4.0).abs() < 0.01 && (found[0].error - 0.6).abs() < 0.01);
        let verdicts: Vec<Verdict> = found.iter().map(|one| one.verdict).collect();
        assert_eq!(verdicts, [Verdict::Outside, Verdict::Within, Verdict::Within]);
        let mut short = output(4.0, 1.0);
        short.measured[400..].fill(f64::NAN);
        let found = &judged(&all, &short)[0];
        assert_eq!(found.verdict, Verdict::Undetermined);
        let why = found.why.as_deref().expect("a reason");
        assert!(why.starts_with("measured: ") && why.contains("period"), "{why}");
    }

    #[test]
    fn of_alternatives_one_suffices_and_groups_must_all_pass() {
        let narrow = |group| one(Of::Response, group, Limit::Within(0.01));
        let wide = |group| one(Of::Response, group, Limit::Within(1.0));
        let groups = |all: &[Checked]| -> Vec<Verdict> {
            judged(all, &output(4.0, 1.1)).iter().map(|one| one.group).collect()
        };
        let (yes, no) = (Verdict::Within, Verdict::Outside);
        assert_eq!(groups(&[narrow(Some("a")), wide(Some("a"))]), [yes, yes]);
        assert_eq!(groups(&[narrow(None), wide(None)]), [no, yes]);
        assert_eq!(worst([yes, no, Verdict::Undetermined].into_iter()), no);
        assert_eq!(worst([yes, Verdict::Undetermined].into_iter()), Verdict::Undetermined);
    }
}
