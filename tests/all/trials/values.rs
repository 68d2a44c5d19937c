//! What was hidden, in which amount, and the candidate that is it, in; the value that it should have and the
//! one that was found, out.

use super::aircraft::Aircraft;
use super::truth::Hidden;
use koehler::diagnose::{Diagnosis, Finding, Judged};

/// The size of an effect that was hidden and named.
#[derive(Debug, Clone)]
pub struct Compared {
    pub name: String,
    pub truth: f64,
    pub found: f64,
    /// None: the flights do not determine it.
    pub sd: Option<f64>,
}

impl Compared {
    /// Distance from the truth as a share of it.
    pub fn off(&self) -> f64 {
        ((self.found - self.truth) / self.truth).abs()
    }

    /// Distance from the truth in standard deviations.
    pub fn sds(&self) -> f64 {
        self.sd.map_or(f64::NAN, |sd| (self.found - self.truth) / sd)
    }

    /// Within three standard deviations, or a tenth.
    pub fn is_right(&self) -> bool {
        self.sds().abs() <= 3.0 || self.off() <= 0.1
    }

    pub fn told(&self) -> String {
        let sd = self.sd.map_or("?".to_string(), |sd| format!("{sd:.2e}"));
        let (name, found, truth) = (&self.name, self.found, self.truth);
        format!("{name} {found:.4e} +- {sd}, hidden {truth:.4e}")
    }
}

/// The value of a finding, if something hidden is in its class and has one.
pub fn compared(
    diagnosis: &Diagnosis,
    finding: &Finding,
    (hidden, amount): (&Hidden, f64),
    aircraft: &Aircraft,
) -> Option<Compared> {
    let judged = &diagnosis.rounds[finding.round].judged;
    // What was added is what a user reads first.
    let class = std::iter::once(finding.added).chain(finding.class.iter().copied());
    let one = class.map(|c| &judged[c]).find(|j| hidden.is.contains(&j.name.as_str()))?;
    let truth = meant(hidden, &one.effect, amount, aircraft)?;
    let (found, sd) = size(one)?;
    Some(Compared { name: one.name.clone(), truth, found, sd })
}

/// The parameter that says how much of an effect there is: its size, or its shape where it is there or not; of
/// two ends of a range the upper one, which is the one that is hidden.
fn size(judged: &Judged) -> Option<(f64, Option<f64>)> {
    let values = &judged.refit.as_ref()?.values;
    let fitted = || values.iter().filter(|v| !v.held);
    let size = fitted().find(|v| v.null.is_some());
    let value = match judged.effect.as_str() {
        "actuator-limit" => fitted().next_back(),
        _ => size.or_else(|| fitted().next()),
    }?;
    Some((value.value, value.sd))
}

/// What an amount of something hidden is in an effect's own size; none where the effect has another form.
fn meant(hidden: &Hidden, effect: &str, amount: f64, aircraft: &Aircraft) -> Option<f64> {
    match (hidden.name, effect) {
        ("elevator rate limit", _) => Some(1.0 / amount),
        ("elevator stop", _) => Some(0.07 - amount),
        // By dynamic pressure, and by the square of airspeed.
        ("elastic elevator", _) => Some(amount * aircraft.density / 2.0),
        // Over dynamic pressure and area, and over the square of airspeed.
        ("thrust on the moment", _) => Some(2.0 * amount / (aircraft.density * aircraft.area)),
        ("flaps fade with airspeed" | "cubic lift", _) => Some(-amount),
        // The first term of the delay's series.
        ("downwash of the wing", "alphadot-moment") => Some(-amount * aircraft.tail_arm),
        // A share of the library's one, which is there or not.
        ("stall", _) => None,
        _ => Some(amount),
    }
}

/// The figures that are asked for: within 3 sd or 10 %, within 30 %, scatter over sd.
pub fn totals(all: &[&Compared]) -> String {
    let count = |is: &dyn Fn(&Compared) -> bool| all.iter().filter(|c| is(c)).count();
    let right = count(&Compared::is_right);
    let near = count(&|c| c.off() <= 0.3);
    let mut sds: Vec<f64> = all.iter().map(|c| c.sds().abs()).filter(|x| x.is_finite()).collect();
    sds.sort_by(f64::total_cmp);
    let middle = sds.get(sds.len() / 2).copied().unwrap_or(f64::NAN);
    // Half of a normal distribution lies within 0.674 sd.
    format!(
        "values: {right} of {} within 3 sd or 10 % (95 %), {near} within 30 % (all), scatter over sd {:.2}",
        all.len(),
        middle / 0.674
    )
}
