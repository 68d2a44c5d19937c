//! What the base's parameters were and are with everything that was added, in; what of that speaks
//! against the model as a whole, out.
//!
//! A parameter that leaves what was known of it from elsewhere says that what was named stands in for
//! something else: the model predicts these flights then, and is wrong in its parts. A derivative that
//! turns its sign is told, and no more: what is missing may have turned it before (an accelerometer off its
//! place makes `C_L_de` negative, and brought to its place positive, as it is).

use crate::diagnose::base::found::Found;
use crate::diagnose::gap::before_after::Shift;
use crate::diagnose::thresholds::Thresholds;
use crate::math::digits;
use crate::model::extend::is_shift;

/// Words on each derivative that is known and turned its sign; the zero shift of a sensor has no sign of its own.
pub fn turned(shifts: &[Shift], thresholds: &Thresholds) -> Vec<String> {
    let known = |v: f64, sd: Option<f64>| sd.is_some_and(|sd| v.abs() > thresholds.turned_sds * sd);
    let turned = shifts.iter().filter(|s| {
        !is_shift(&s.name)
            && s.before * s.after < 0.0
            && known(s.before, s.before_sd)
            && known(s.after, s.after_sd)
    });
    let words = |s: &Shift| {
        let (before, after, unit) = (digits(s.before), digits(s.after), &s.unit);
        format!("{} turns its sign, from {before} to {after} {unit}", s.name)
    };
    turned.map(words).collect()
}

/// Words on each parameter that was known before the flights and is not there any more.
pub fn unphysical(last: &Found, thresholds: &Thresholds) -> Vec<String> {
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
