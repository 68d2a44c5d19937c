//! A refitted candidate in; whether it may be believed, and why not, out. And the class of those
//! that may be, alike.

use super::judged::{Judged, Standing};
use super::refit::{Left, shared};
use super::surrogate::times;
use super::value::{Gain, Value};
use crate::diagnose::effect::Family;
use crate::diagnose::settings::Settings;
use crate::diagnose::thresholds::Thresholds;
use crate::math::distribution::normal_quantile;
use crate::math::products::dot;

/// A size that is fewer sd from null may be none. *Convention*.
const NONE_SDS: f64 = 2.0;

/// Why a candidate that passes is not named yet, at the round's null maximum (99%).
pub fn is_faint(judged: &Judged, limit: f64, thresholds: &Thresholds) -> Option<String> {
    let wanted = times(thresholds.name_factor, limit, judged.screened.taken, thresholds);
    let words = format!("evidence {:.1}, where {wanted:.1} makes a name", judged.evidence);
    (!(judged.evidence > wanted)).then_some(words)
}

/// Why a refitted candidate may not be believed; none where it may.
pub fn objection(judged: &Judged, settings: &Settings) -> Option<(Standing, String)> {
    let (refit, thresholds) = (judged.refit.as_ref()?, &settings.thresholds);
    if !refit.converged {
        return Some((Standing::FitFailed, "its full fit did not settle".into()));
    }
    if let Some(v) = refit.values.iter().find(|v| v.at_bound) {
        return Some((
            Standing::Bounds,
            format!("{} sits on its physical bound {:.4} {}", v.name, v.value, v.unit),
        ));
    }
    for v in &refit.values {
        if let Some((text, expected, within)) = &v.check
            && is_against(v, *expected, *within, thresholds.physics_sds)
        {
            let words = format!(
                "{} = {:.4} {}, where physics expects {text} = {expected:.4}",
                v.name, v.value, v.unit
            );
            return Some((Standing::Bounds, words));
        }
    }
    if let Some(name) = undetermined(&refit.values) {
        return Some((Standing::Unidentifiable, format!("the flights do not determine {name}")));
    }
    // One number for all is another effect, with fewer parameters, or the base's own.
    if refit.alike.is_some_and(|p| p > thresholds.scatter_p) {
        let words = "it is the same in all flights, as far as they tell".into();
        return Some((Standing::Bounds, words));
    }
    if let Some(objection) = held_out_objection(&refit.held_out, settings, judged.noise) {
        return Some(objection);
    }
    // What share of the small movements did not happen is another one where more of them did.
    let scatter = refit
        .heterogeneity
        .filter(|_| !judged.noise)
        .filter(|c| c.p < thresholds.scatter_p && c.share > thresholds.scatter_share)?;
    let words = format!(
        "its size differs from maneuver to maneuver by {:.0}% more than its uncertainty",
        100.0 * scatter.share
    );
    Some((Standing::Inconsistent, words))
}

/// Further from what physics expects than its tolerance, by more than the estimate's own
/// uncertainty.
fn is_against(v: &Value, expected: f64, within: f64, sds: f64) -> bool {
    let off = (v.value - expected).abs() - within * expected.abs();
    off > sds * v.sd.unwrap_or(0.0)
}

/// The parameter without which an effect is not known. One with a size of its own needs all it has:
/// what size it is hangs on its shape. Of several sizes (a sensor's place along two axes) one must be known,
/// and the others may be none. One that is there or not (its size held) needs one shape: of
/// two stops the flights may reach one, of a stall show where it begins, not how late it ends.
fn undetermined(values: &[Value]) -> Option<&str> {
    let fitted: Vec<&Value> = values.iter().filter(|v| !v.held && !v.own).collect();
    let known = fitted.iter().any(|v| v.null.is_some() && v.is_determined);
    let loose = fitted.iter().find(|v| !(v.is_determined || known && is_none(v)))?;
    let sized = fitted.iter().any(|v| v.null.is_some());
    (sized || fitted.iter().all(|v| !v.is_determined)).then_some(&loose.name)
}

/// Whether a size is none, as far as the flights tell.
fn is_none(v: &Value) -> bool {
    v.null.zip(v.sd).is_some_and(|(null, sd)| (v.value - null).abs() < NONE_SDS * sd)
}

/// The least that a maneuver must gain. A gain predicted to be `g` is normal about `g` with the sd
/// `sqrt(2 g)`: where more than `decisive` is predicted, it must be a gain, or lie within what
/// noise allows all `count` of them together in 99 of 100 cases (only below `g = 11` can that be a
/// loss for one, below 17 for six); elsewhere it must be no loss beyond noise.
fn least(predicted: f64, settings: &Settings, count: usize, of_noise: bool) -> f64 {
    let thresholds = &settings.thresholds;
    let noise = (2.0 * predicted.max(thresholds.least_predicted)).sqrt();
    let allowed = allowed(settings, count, of_noise);
    match predicted > settings.decisive {
        true => (predicted - allowed * noise).min(0.0),
        false => -allowed.max(thresholds.loss_sds) * noise,
    }
}

/// By how many sd noise lets `count` gains together fall short of what is predicted.
fn allowed(settings: &Settings, count: usize, of_noise: bool) -> f64 {
    let thresholds = &settings.thresholds;
    let normal = normal_quantile(1.0 - thresholds.held_out_p / count as f64);
    match of_noise {
        true => thresholds.noise_bias + thresholds.noise_scatter * normal,
        false => normal,
    }
}

/// The least that all of them must gain together: the half of what is predicted, or what noise leaves of it,
/// whichever is less.
fn least_of_all(predicted: f64, settings: &Settings, of_noise: bool) -> f64 {
    let by_noise = predicted - allowed(settings, 1, of_noise) * (2.0 * predicted).sqrt();
    by_noise.min(settings.thresholds.held_out_half * predicted)
}

/// The rule of the held-out maneuvers, one by one and together.
pub fn held_out_objection(
    gains: &[Gain],
    settings: &Settings,
    of_noise: bool,
) -> Option<(Standing, String)> {
    if gains.is_empty() {
        return Some((Standing::Untold, "no maneuver is held out".into()));
    }
    if gains.iter().any(|g| !(g.predicted.is_finite() && g.realised.is_finite())) {
        return Some((
            Standing::Untold,
            "the model does not run over a held-out maneuver: it cannot tell".into(),
        ));
    }
    let predicted: f64 = gains.iter().map(|g| g.predicted).sum();
    let realised: f64 = gains.iter().map(|g| g.realised).sum();
    if !(predicted > settings.decisive) {
        let why = format!(
            "on held-out maneuvers it predicts a gain of {predicted:.1} only: they cannot tell"
        );
        return Some((Standing::Untold, why));
    }
    if !(realised > settings.decisive.max(least_of_all(predicted, settings, of_noise))) {
        return Some((
            Standing::HeldOut,
            format!("held-out maneuvers gain {realised:.1} where {predicted:.1} is predicted"),
        ));
    }
    let fails = |g: &&Gain| !(g.realised > least(g.predicted, settings, gains.len(), of_noise));
    let worst = gains.iter().filter(fails).min_by(|a, b| a.realised.total_cmp(&b.realised))?;
    let why = format!(
        "a held-out maneuver gains {:.1} where {:.1} is predicted",
        worst.realised, worst.predicted
    );
    Some((Standing::HeldOut, why))
}

/// Whether an effect that is tested, and contradicted, gives way to one that explains the same and is not:
/// what that one leaves of it would not stand in the way of its name.
pub fn gives_way(this: &Judged, to: &Judged, thresholds: &Thresholds) -> bool {
    this.standing.is_doubt()
        && to.instead.is_some_and(|share| share > thresholds.replaces)
        && to.evidence > (1.0 - thresholds.rest_share) * this.evidence
}

/// A candidate that passes: its place among those judged, and what its fit leaves.
pub type Passing = (usize, Left);

/// How far a candidate that passes is from the best one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// Its place among those judged.
    pub at: usize,
    /// By how much less evidence it has.
    pub less: f64,
    /// By how much less it is distinguished from it: a difference counts for as much less as it
    /// scatters more than noise lets it.
    pub margin: f64,
    /// It explains what the best one explains, and not something else.
    pub replaces: bool,
}

/// The distance of each that passes.
pub fn distances(
    judged: &[Judged],
    base: &Left,
    passing: &[Passing],
    settings: &Settings,
) -> Vec<Distance> {
    let evidence = |p: &Passing| judged[p.0].evidence;
    let Some(best) = passing.iter().max_by(|a, b| evidence(a).total_cmp(&evidence(b))) else {
        return Vec::new();
    };
    let one = |p: &Passing| Distance {
        at: p.0,
        less: evidence(best) - evidence(p),
        margin: settings.apart * dispersion(&best.1, &p.1),
        replaces: best.0 == p.0 || shared(base, &best.1, &p.1) > settings.thresholds.replaces,
    };
    passing.iter().map(one).collect()
}

/// Those that explain the same as the best and are not distinguishable from it, best evidence first, errors of sensors before
/// physics, and terms of a series, which name no cause, last.
pub fn class(judged: &[Judged], distances: &[Distance]) -> Vec<usize> {
    let last = |d: &Distance| match (judged[d.at].family, judged[d.at].series) {
        (Family::Sensor, _) => 0,
        (_, false) => 1,
        (_, true) => 2,
    };
    let mut class: Vec<&Distance> =
        distances.iter().filter(|d| d.less < d.margin && d.replaces).collect();
    class.sort_by(|a, b| last(a).cmp(&last(b)).then(a.less.total_cmp(&b.less)));
    class.into_iter().map(|d| d.at).collect()
}

/// Variance of a difference of log-likelihood over what it is by noise, at least 1
/// (quasi-likelihood; Wedderburn, Biometrika 61, 1974). In a maneuver the better of two leaves `a`,
/// and the other one `a + d`, so that they differ by `d'd/2 + a'd`. If the better one is right, `a`
/// is white noise and `a'd` has the variance `d'd`. Where both are wrong it has more: each follows
/// in its own way what neither explains.
fn dispersion(better: &Left, other: &Left) -> f64 {
    let (mut found, mut noise) = (0.0, 0.0);
    for (a, b) in better.iter().zip(other) {
        let d: Vec<f64> = b.iter().zip(a).map(|(b, a)| b - a).collect();
        found += dot(a, &d).powi(2);
        noise += dot(&d, &d);
    }
    (found / noise).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::search::tried::Screened;

    fn objects(gains: &[(f64, f64)]) -> bool {
        let gains: Vec<Gain> = gains
            .iter()
            .map(|&(predicted, realised)| Gain { segment: 0, predicted, realised })
            .collect();
        held_out_objection(&gains, &Settings::default(), false).is_some()
    }

    /// A parameter of value 1 between 0 and 10: a size where `null` says so.
    fn value(name: &str, null: Option<f64>, sd: Option<f64>) -> Value {
        let (name, unit) = (name.to_string(), "-".to_string());
        let (at_bound, held, own, is_determined) = (false, false, false, false);
        let value = Value {
            name,
            unit,
            doc: String::new(),
            value: 1.0,
            sd,
            null,
            span: 10.0,
            at_bound,
            held,
            own,
            of: None,
            from: None,
            left: None,
            check: None,
            is_determined,
        };
        value.judged(&Thresholds::default())
    }

    #[test]
    fn an_effect_that_is_there_or_not_needs_one_shape_and_one_with_a_size_all() {
        let there = Value { held: true, ..value("k", Some(0.0), None) };
        let (low, high) = (value("low", None, None), value("high", None, Some(0.2)));
        assert_eq!(undetermined(&[there.clone(), low.clone(), high.clone()]), None);
        assert_eq!(
            undetermined(&[there, low.clone(), value("high", None, Some(2.6))]),
            Some("low")
        );
        let size = value("size", Some(0.0), Some(0.1));
        assert_eq!(undetermined(&[size.clone(), high.clone()]), None);
        assert_eq!(undetermined(&[size, low]), Some("low"));
        assert_eq!(undetermined(&[value("size", Some(0.0), Some(0.6)), high]), Some("size"));
        // Of two sizes one may be none.
        let (x, none) = (value("x", Some(0.0), Some(0.1)), value("z", Some(0.0), Some(0.7)));
        assert_eq!(undetermined(&[x.clone(), none.clone()]), None);
        assert_eq!(undetermined(&[none.clone(), none.clone()]), Some("z"));
        assert_eq!(undetermined(&[x, value("z", Some(0.0), None)]), Some("z"));
    }

    /// A candidate that passes with this evidence.
    fn judged(name: &str, family: Family, evidence: f64) -> Judged {
        let (name, text) = (name.to_string(), String::new);
        let screened = Screened {
            gain: 0.0,
            taken: 1,
            at: Vec::new(),
            left: 1.0,
            imitators: Vec::new(),
            references: Vec::new(),
            silent: false,
        };
        Judged {
            effect: name.clone(),
            name,
            family,
            series: false,
            noise: false,
            sentence: text(),
            signature: text(),
            separate: text(),
            screened,
            score: 0.0,
            refit: None,
            evidence,
            instead: None,
            replaces: false,
            standing: Standing::Chance,
            why: text(),
        }
    }

    #[test]
    fn two_are_told_apart_by_less_where_neither_explains_what_is_left() {
        let noise = |s: usize, k: usize| {
            libm::sin((7919 * s + 104_729 * k * k) as f64) * std::f64::consts::SQRT_2
        };
        let shape = |k: usize| 0.2 * libm::sin(0.1 * k as f64);
        let left = |of: &dyn Fn(usize, usize) -> f64| -> Left {
            (0..9).map(|s| (0..200).map(|k| of(s, k)).collect()).collect()
        };
        // The better one leaves noise, or half of what the other one leaves more of.
        let (white, half) = (left(&noise), left(&|s, k| noise(s, k) + shape(k)));
        let other = left(&|s, k| noise(s, k) + 2.0 * shape(k));
        assert!(dispersion(&white, &half) < 1.5, "{}", dispersion(&white, &half));
        assert!(dispersion(&half, &other) > 3.0, "{}", dispersion(&half, &other));
        assert_eq!(dispersion(&white, &white), 1.0);
        // Evidence 10 apart: enough of it there, not here. One that is as good is told first where
        // it is an error of a sensor.
        let all = [
            judged("best", Family::Aerodynamic, 50.0),
            judged("next", Family::Aerodynamic, 40.0),
            judged("late", Family::Sensor, 48.0),
        ];
        let class = |first: &Left, second: &Left| {
            let passing = [(0, first.clone()), (1, second.clone()), (2, first.clone())];
            let base = left(&|s, k| noise(s, k) + 8.0 * shape(k));
            class(&all, &distances(&all, &base, &passing, &Settings::default()))
        };
        assert_eq!(class(&white, &half), [2, 0]);
        assert_eq!(class(&half, &other), [2, 0, 1]);
    }

    #[test]
    fn what_is_contradicted_gives_way_to_what_explains_the_same_and_nearly_as_much() {
        let contradicted = Judged {
            standing: Standing::HeldOut,
            ..judged("contradicted", Family::Aerodynamic, 678.0)
        };
        let other = |evidence: f64, instead: Option<f64>| Judged {
            instead,
            standing: Standing::Chosen,
            ..judged("other", Family::Aerodynamic, evidence)
        };
        let gives = |this: &Judged, to: Judged| gives_way(this, &to, &Thresholds::default());
        assert!(gives(&contradicted, other(661.0, Some(0.97))));
        // less than four fifths of the evidence, something else, or nothing against the first
        assert!(!gives(&contradicted, other(500.0, Some(0.97))));
        assert!(!gives(&contradicted, other(661.0, Some(0.3))));
        assert!(!gives(&contradicted, other(661.0, None)));
        let passing = Judged { standing: Standing::Chosen, ..contradicted };
        assert!(!gives(&passing, other(661.0, Some(0.97))));
    }

    #[test]
    fn every_held_out_maneuver_must_agree_as_far_as_noise_allows() {
        assert!(!objects(&[(20.0, 18.0), (5.0, 2.0), (0.5, -1.0)]));
        // A loss where much is predicted; one that noise explains; one beyond noise where nothing
        // is predicted.
        assert!(objects(&[(20.0, 18.0), (15.0, -0.5)]));
        assert!(!objects(&[(20.0, 18.0), (4.0, -1.0)]));
        assert!(objects(&[(20.0, 18.0), (0.5, -6.0)]));
        // The model does not run over one: words, and no number that is none.
        let broken = [20.0, f64::NAN].map(|predicted| Gain {
            segment: 0,
            predicted,
            realised: predicted - 1.0,
        });
        let (standing, why) =
            held_out_objection(&broken, &Settings::default(), false).expect("an objection");
        assert!(standing == Standing::Untold && !why.contains("NaN"), "{why}");
        // Of noise that is taken out a loss of three sd is one of many; of anything else it is none.
        let loss = [(40.0, 38.0), (20.0, -1.0)].map(|(predicted, realised)| Gain {
            segment: 0,
            predicted,
            realised,
        });
        let of = |noise| held_out_objection(&loss, &Settings::default(), noise).is_some();
        assert!(of(false) && !of(true));
        // They cannot tell, or tell nothing in sum.
        assert!(objects(&[(1.0, 1.5)]) && objects(&[]) && objects(&[(4.0, 1.0), (4.0, 1.0)]));
    }
}
