//! Measured channels in; the same without the air data of an aircraft that stands or rolls slowly, and a note of it, out.

use super::survey::Logged;
use super::{FlightPath, Settings};
use crate::model::Model;

/// Masks the air data while the aircraft stands or rolls slowly, by its measured airspeed.
pub fn slow(model: &Model, measured: &mut [Logged], settings: &Settings, path: &mut FlightPath) {
    let Some((t, v)) = measured.iter().find(|m| model.outputs[m.output].name == "V").map(|m| (m.t.clone(), m.z.clone())) else {
        return;
    };
    let mut sorted: Vec<f64> = v.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(limit) = sorted.get(sorted.len() * 9 / 10).map(|usual| settings.slow * usual) else { return };
    // a sample counts by the last airspeed before it
    let slow = |now: f64| {
        let k = t.partition_point(|&x| x <= now);
        v[..k].iter().rev().find(|v| v.is_finite()).or(v.first()).is_some_and(|v| *v < limit)
    };
    let mut names = Vec::new();
    for channel in measured.iter_mut().filter(|m| settings.air_data.contains(&model.outputs[m.output].name)) {
        let mut masked = 0;
        for (_, z) in channel.t.iter().zip(&mut channel.z).filter(|(now, z)| z.is_finite() && slow(**now)) {
            *z = f64::NAN;
            masked += 1;
        }
        if masked > 0 {
            names.push(format!("{} ({masked} samples)", model.outputs[channel.output].name));
        }
    }
    if !names.is_empty() {
        path.notes.push(format!("slower than {limit:.1} m/s, where air data mean nothing: not used there: {}", names.join(", ")));
    }
}
