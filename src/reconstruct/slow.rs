//! Measured channels in; the same without the air data of an aircraft that stands or rolls slowly,
//! and a note of it, out.

use super::path::FlightPath;
use super::settings::Settings;
use super::signals::Logged;
use crate::model::Model;

/// Masks the air data while the aircraft stands or rolls slowly, by its measured airspeed.
pub fn slow(model: &Model, measured: &mut [Logged], settings: &Settings, path: &mut FlightPath) {
    let Some((t, v)) =
        measured.iter().find(|m| model.outputs[m.output].name == "V").map(|m| (m.t, m.z.clone()))
    else {
        return;
    };
    let mut sorted: Vec<f64> = v.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(limit) = sorted.get(sorted.len() * 9 / 10).map(|usual| settings.slow * usual) else {
        return;
    };
    // a sample counts by the last airspeed before it
    let first = v.iter().copied().find(|v| v.is_finite()).unwrap_or(f64::NAN);
    let mut last = first;
    let mut hold = |v: &f64| {
        last = if v.is_finite() { *v } else { last };
        last
    };
    let held: Vec<f64> = v.iter().map(&mut hold).collect();
    let slow = |now: f64| {
        *t.partition_point(|&x| x <= now).checked_sub(1).map_or(&first, |k| &held[k]) < limit
    };
    let mut names = Vec::new();
    for channel in
        measured.iter_mut().filter(|m| settings.air_data.contains(&model.outputs[m.output].name))
    {
        let out: Vec<usize> = (0..channel.t.len())
            .filter(|&k| channel.z[k].is_finite() && slow(channel.t[k]))
            .collect();
        if out.is_empty() {
            continue;
        }
        let z = channel.z.to_mut();
        out.iter().for_each(|&k| z[k] = f64::NAN);
        names.push(format!("{} ({} samples)", model.outputs[channel.output].name, out.len()));
    }
    if !names.is_empty() {
        let text = format!(
            "slower than {limit:.1} m/s, where air data mean nothing: not used there: {}",
            names.join(", ")
        );
        path.notes.push(text.into());
    }
}
