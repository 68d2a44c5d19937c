//! A flight whose airspeed is measured and its noise levels in; how many times too much the airspeed
//! reads, by all other sensors, out.
//!
//! Left out and compared like other channels an airspeed tells little: in steady flight it does not
//! move, and its level is taken up by the wind and by biases of accelerometers, which are then wrong with
//! small standard deviations. Ground speed in turns tells it, and `a_y = V r` does. So it is
//! asked for by one more filter with the scale `k` free, `z = k V`, linearised about its own path. Gusts pull it
//! (`pulled`), by what counts as a further standard deviation.

use super::consistency::Row;
use super::pulled::pulled;
use super::settings::Settings;
use super::smoother::Smoother;
use super::smoother::flight::Flight;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::verdicts;
use crate::error::Result;
use crate::model::extend::output_scale;

/// The output that is airspeed.
const AIRSPEED: &str = "V";
/// Standard deviation of its scale at the start: metres per second for knots is a half.
const SCALE: f64 = 0.5;
/// Runs that are linearised about the one before.
const PASSES: usize = 2;

/// The line of the airspeed's level; none where it is not measured.
///
/// # Errors
/// The name of the scale is taken.
pub fn level(
    kinematics: &Kinematics,
    flight: &Flight,
    levels: &Levels,
    part: [f64; 2],
    settings: &Settings,
) -> Result<Option<Row>> {
    let Some(output) = kinematics.model.output(AIRSPEED) else { return Ok(None) };
    let is_used = |k: &usize| flight.channels[*k].output == output && levels.r[*k].is_finite();
    let Some(channel) = (0..levels.r.len()).find(is_used) else { return Ok(None) };
    let (model, scale) = kinematics.model.with_scale(AIRSPEED)?;
    let free = kinematics.free.iter().copied().chain([scale]).collect();
    let scaled = Kinematics::new(&model, free)?;
    let Some(place) = scaled.place(&output_scale(AIRSPEED)) else { return Ok(None) };
    let mut with = Levels::guess(&scaled, flight, &settings.walk, &settings.sd);
    with.begin(&scaled, levels, &kinematics.free);
    with.start_sd[place] = SCALE;
    let smoother = Smoother::new(&scaled, flight, settings.gate);
    let x = smoother.begin(&with, part, None);
    let (about, _) = smoother.about(&with, part, &x, PASSES);
    let found = smoother.parameters(about.as_ref(), &with, part, &x);
    let size = found.p.len() / scaled.size();
    let sd = |found: &[f64]| found[place * size + place].max(0.0).sqrt();
    let told = if found.finite { [found.x[place], sd(&found.p)] } else { [f64::NAN; 2] };
    let (sum, count) = flight.channels[channel]
        .z
        .iter()
        .filter(|z| z.is_finite())
        .fold((0.0, 0.0), |(sum, count), z| (sum + z, count + 1.0));
    let pull = pulled(kinematics, flight, levels, (part, sum / f64::max(count, 1.0)));
    Ok(Some(verdicts::level_row(AIRSPEED, told, pull)))
}
