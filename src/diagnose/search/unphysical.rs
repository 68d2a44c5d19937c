//! What the base's parameters were and are with everything that was added, in; what of that speaks
//! against the model as a whole, out.
//!
//! An effect that is really missing makes the other derivatives better known. One that stands in for
//! something else may turn the sign of a derivative that was known, or move one out of what is known
//! of it from elsewhere: the model predicts these flights then, and is wrong in its parts.

use crate::diagnose::base::found::Found;
use crate::diagnose::gap::before_after::Shift;
use crate::diagnose::thresholds::Thresholds;
use crate::math::digits;

/// Words on each parameter that turned its sign, or left its prior.
pub fn unphysical(shifts: &[Shift], last: &Found, thresholds: &Thresholds) -> Vec<String> {
    let known = |v: f64, sd: Option<f64>| sd.is_some_and(|sd| v.abs() > thresholds.turned_sds * sd);
    let turned = shifts.iter().filter(|s| {
        s.before * s.after < 0.0 && known(s.before, s.before_sd) && known(s.after, s.after_sd)
    });
    let turned = turned.map(|s| {
        let (before, after, unit) = (digits(s.before), digits(s.after), &s.unit);
        format!("{} turns its sign, from {before} to {after} {unit}", s.name)
    });
    turned.chain(beyond_priors(last, thresholds)).collect()
}

/// Parameters that were known before the flights and are not there any more.
fn beyond_priors(last: &Found, thresholds: &Thresholds) -> Vec<String> {
    let case = last.case();
    let layout = &case.layout;
    let one = |&i: &usize| {
        let (centre, sd) = (layout.centre[i], layout.prior_sd[i]);
        let off = (last.fit.theta[i] - centre).abs() / sd;
        (sd > 0.0 && off.is_finite() && off > thresholds.prior_sds).then(|| {
            let unknown = &case.unknowns[i];
            let (is, unit) = (digits(last.fit.theta[i]), &unknown.unit);
            format!(
                "{} = {is} {unit} is {off:.1} sd from what was known of it before ({})",
                unknown.name,
                digits(centre)
            )
        })
    };
    last.free.iter().filter_map(one).collect()
}
