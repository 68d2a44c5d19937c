//! Small simulated campaigns whose record of the control has noise that did not happen.

use super::tests::{LIBRARY, campaign, held_against, model, told};
use super::*;
use crate::estimate;
use crate::simulate::Stream;

/// The verdict on the model that is the truth, where the record of the control has white noise of
/// this sd, rad.
fn noisy(sd: f64) -> Diagnosis {
    let plain = model("", "", "alpha");
    let mut segments = campaign(&plain, 5, 0.0);
    for (s, segment) in segments.iter_mut().enumerate() {
        let mut stream = Stream::new(5, &["record", &s.to_string()]);
        segment.record.inputs.iter_mut().step_by(2).for_each(|de| *de += sd * stream.normal());
    }
    let effects: Vec<&str> = LIBRARY.into_iter().chain(["surface-noise"]).collect();
    let (method, settings) = (estimate::Settings::default(), Settings::default());
    held_against(&effects, &plain, &segments, (&method, &settings))
}

#[test]
fn noise_of_a_record_is_nothing_that_the_model_lacks() {
    let d = noisy(0.0);
    assert_eq!(d.verdict, Verdict::NothingMissing, "{}", told(&d));
    let d = noisy(0.003);
    assert_eq!(d.verdict, Verdict::ButRecords, "{}", told(&d));
    assert_eq!(d.added[0].effect, "surface-noise", "{}", told(&d));
    assert!(d.is_named() && d.is_of_record(&d.added[0].name));
}
