//! A diagnosis in; what a person should know of it, in words, out.

use super::Told;
use crate::diagnose::{Diagnosis, Judged, Trouble, Value, Verdict};

/// Why there is no verdict.
pub fn trouble(trouble: &Trouble) -> &str {
    match trouble {
        Trouble::Base(why) | Trouble::Segments(why) => why,
    }
}

/// `C_m_eta_lag = 0.279 +- 0.002 1/rad`
pub fn value(v: &Value) -> String {
    let unit = if v.unit == "-" { String::new() } else { format!(" {}", v.unit) };
    let sd = v.sd.map(|sd| format!(" +- {}", digits(1.96 * sd))).unwrap_or_default();
    let check = v.check.as_ref().map(|(text, expected, _)| format!(" ({text} = {})", digits(*expected))).unwrap_or_default();
    format!("{} = {}{sd}{unit}{check}", v.name, digits(v.value))
}

/// Three significant digits.
pub fn digits(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let before_point = libm::floor(libm::log10(v.abs())) as i32 + 1;
    if (-2..6).contains(&before_point) { format!("{v:.*}", (3 - before_point).max(0) as usize) } else { format!("{v:.2e}") }
}

/// The estimated parameters of a candidate, with 95% intervals.
pub fn values(judged: &Judged) -> String {
    let all = judged.refit.iter().flat_map(|r| &r.values).filter(|v| !v.held);
    all.map(value).collect::<Vec<_>>().join(", ")
}

/// One candidate's evidence in words.
pub fn evidence(judged: &Judged, limit: f64) -> String {
    let Some(refit) = &judged.refit else { return judged.why.clone() };
    let realised: f64 = refit.held_out.iter().map(|g| g.realised).sum();
    let predicted: f64 = refit.held_out.iter().map(|g| g.predicted).sum();
    format!(
        "log-likelihood gains {} on the training maneuvers (luck: {}), and {} on the held-out ones, where {} is predicted",
        digits(refit.gain),
        digits(limit),
        digits(realised),
        digits(predicted)
    )
}

/// Where an added block comes from, for a comment in the model file.
pub fn provenance(told: &Told, judged: &Judged) -> String {
    format!(
        "{}\nFound by the diagnosis \"{}\": {}; {}.",
        judged.sentence,
        told.config.name(),
        values(judged),
        evidence(judged, 0.0)
    )
}

/// The verdict as a sentence or two.
pub fn verdict(d: &Diagnosis) -> String {
    let names = || {
        let chosen = d.rounds.iter().filter_map(|r| r.judged.get(*r.class.first()?));
        chosen.map(|j| format!("{} ({})", j.sentence, values(j))).collect::<Vec<_>>().join("; ")
    };
    let left = || {
        let first: Vec<String> = d.located.iter().take(3).map(|l| format!("{} answers to {}", l.output, l.source)).collect();
        first.join("; ")
    };
    match &d.verdict {
        Verdict::NothingMissing => "Nothing is missing that these flights could show.".into(),
        Verdict::Named => format!("The model lacks: {}.", names()),
        Verdict::OneOfThese => {
            let classes: Vec<String> = d.rounds.iter().filter(|r| !r.class.is_empty()).map(class).collect();
            format!("The model lacks: {}.", classes.join("; and "))
        }
        Verdict::Located if d.added.is_empty() => {
            format!("Something is missing that no effect of the library explains: {}.", left())
        }
        Verdict::Located => format!("Something remains unexplained: {}. It is made smaller by: {}.", left(), names()),
        Verdict::None(why) => format!("No verdict: {}.", trouble(why)),
    }
}

/// The class of one round.
fn class(round: &crate::diagnose::Round) -> String {
    let all: Vec<&Judged> = round.class.iter().filter_map(|&c| round.judged.get(c)).collect();
    match &all[..] {
        [one] => format!("{} ({})", one.sentence, values(one)),
        several => {
            let names: Vec<String> = several.iter().map(|j| format!("{} ({})", j.sentence, values(j))).collect();
            let mut separate: Vec<&str> = several.iter().map(|j| j.separate.as_str()).filter(|s| !s.is_empty()).collect();
            separate.dedup();
            let fly = if separate.is_empty() { String::new() } else { format!("; to separate them: {}", separate.join("; ")) };
            format!("one of these, which the flights cannot separate: {}{fly}", names.join(" | "))
        }
    }
}
