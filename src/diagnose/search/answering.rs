//! A fit in; what its outputs still answer to, beyond what noise of the inputs makes of it, out.

use crate::diagnose::base::found::Found;
use crate::diagnose::base::frozen::{frozen, theta_at};
use crate::diagnose::base::stand::Stand;
use crate::diagnose::base::training::Task;
use crate::diagnose::residual::evaluation::Evaluation;
use crate::diagnose::residual::located::{At, Located, locate};
use crate::diagnose::settings::Settings;
use crate::estimate::Case;
use std::cell::OnceCell;

/// Draws of the noise, each with both signs: what goes with its first power cancels, and the mean of
/// four adds a quarter to the variance of what is taken away.
const DRAWS: u64 = 4;

/// Every pair of output and source.
pub fn answering(stand: &Stand, found: &Found, settings: &Settings) -> Vec<Located> {
    let case = found.case();
    let theta = (0..case.records.len()).map(|s| found.theta(s)).collect();
    let made = OnceCell::new();
    let noisier = || -> &[At] { made.get_or_init(|| noisier(stand, found, settings)) };
    locate(&At { case, theta }, &found.noise, &found.places, &noisier, settings)
}

/// The fit where inputs have as much noise again: one step from where it is.
fn noisier(stand: &Stand, found: &Found, settings: &Settings) -> Vec<At> {
    found.case().noisier(DRAWS).filter_map(|case| stepped(case, stand, found, settings)).collect()
}

fn stepped(case: Case, stand: &Stand, found: &Found, settings: &Settings) -> Option<At> {
    let (noise, places, thresholds) = (&found.noise, &found.places, &settings.thresholds);
    let (segments, free) = (&places.training[..], &found.free[..]);
    let task = Task { case: &case, noise, segments, free, thresholds };
    let at = Evaluation::new(&case, &found.fit.theta, segments);
    let (theta, _) = task.stepped(&at)?;
    drop(at);
    let held_out = frozen(&case, noise, places, &theta, (&stand.nulls, thresholds));
    let of = |s: usize| theta_at(places, &held_out, &theta, s);
    let theta = (0..case.records.len()).map(of).collect();
    Some(At { case, theta })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::base::found::at_first;
    use crate::diagnose::effect::Context;
    use crate::diagnose::subject::Subject;
    use crate::diagnose::tests::{campaign, model};
    use crate::estimate;
    use crate::simulate::Stream;

    /// What residuals answer to with the noise of the record of the control in view, and without.
    fn answers(moment: &str, seed: u64) -> [Vec<Located>; 2] {
        let square = "M_2 = { unit = \"1/(s^2 rad)\", start = -60.0 }";
        let (truth, base) = (model(square, moment, "alpha"), model("", "", "alpha"));
        let mut segments = campaign(&truth, seed, 0.0);
        for (s, segment) in segments.iter_mut().enumerate() {
            let mut stream = Stream::new(seed, &["record", &s.to_string()]);
            segment
                .record
                .inputs
                .iter_mut()
                .step_by(2)
                .for_each(|de| *de += 1.2e-2 * stream.normal());
        }
        let (method, settings) = (estimate::Settings::default(), Settings::default());
        let subject = Subject {
            model: &base,
            segments: &segments,
            held_out: &[false, false, true].repeat(3),
            method: &method,
            context: &Context::default(),
            settings: &settings,
        };
        let stand = Stand::first(&base, &method, settings.base);
        let found = at_first(&stand, &subject).expect("settings").expect("a fit");
        let (case, places) = (found.case(), &found.places);
        let theta = (0..case.records.len()).map(|s| found.theta(s)).collect();
        let without = locate(&At { case, theta }, &found.noise, places, &|| &[], &settings);
        let real = |of: Vec<Located>| of.into_iter().filter(Located::is_real).collect();
        [real(answering(&stand, &found, &settings)), real(without)]
    }

    #[test]
    fn residuals_do_not_answer_to_noise_of_a_record() {
        let all: Vec<[usize; 2]> = (0..8).map(|seed| answers("", seed).map(|a| a.len())).collect();
        let of = |k: usize| all.iter().filter(|a| a[k] > 0).count();
        println!("{all:?}");
        assert!(of(0) <= 1 && of(1) >= of(0) + 3, "{all:?}");
        // What does act is seen all the same.
        for seed in 0..3 {
            let [with, _] = answers("+ M_2*de*de", seed);
            assert!(!with.is_empty(), "{seed}");
        }
    }
}
