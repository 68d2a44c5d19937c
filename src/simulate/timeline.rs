//! A flight of the campaign file in; its timeline out: when each maneuver is flown, and every input
//! of the truth model over time.

use super::atmosphere::{FOOT, KNOT, true_airspeed};
use super::input::{Shape, amplitude};
use super::random::Stream;
use super::settings::{Flight, Settings, Timing};
use crate::math::interpolate::held;
use indexmap::IndexMap;
use serde::Serialize;

/// A maneuver with its place in a flight. Times are seconds since the start of the flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Placed {
    /// Name in `[maneuvers]`.
    pub maneuver: String,
    pub input: String,
    pub kind: String,
    /// First step (on the truth grid) and return to zero.
    pub t_start_s: f64,
    pub t_end_s: f64,
    /// Time unit of a multistep.
    pub unit_time_s: Option<f64>,
    /// Largest absolute value of its signal, in the input's unit.
    pub amplitude: f64,
    /// Sign of its signal where it first leaves 0.
    pub polarity: i8,
    /// Commanded calibrated airspeed; 0 in a flight without test points.
    pub speed_kt: f64,
    /// Commanded pressure altitude; nothing where the flight has none.
    pub altitude_ft: Option<f64>,
    /// While this lasts, the loops that fly between test points let go. Maneuvers flown together
    /// have the same one.
    pub hold_s: [f64; 2],
}

/// A piecewise linear command; NaN where it has no point.
#[derive(Debug, Clone, PartialEq)]
struct Profile {
    t: Vec<f64>,
    value: Vec<f64>,
}

impl Profile {
    fn at(&self, t: f64) -> f64 {
        held(&self.t, &self.value, t)
    }

    fn last(&self) -> f64 {
        self.value.last().copied().unwrap_or_default()
    }

    /// Holds the last value until `t`, then goes to `value` at `rate`; returns the time at which it
    /// is there.
    fn go(&mut self, t: f64, value: f64, rate: f64) -> f64 {
        let last = self.last();
        if last == value {
            return t;
        }
        let there = t + (value - last).abs() / rate;
        self.t.extend([t, there]);
        self.value.extend([last, value]);
        there
    }
}

/// The timeline of one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    pub flight: String,
    /// Grid spacing, s, and number of grid points.
    pub dt: f64,
    pub n: usize,
    /// The maneuvers in the order of time.
    pub maneuvers: Vec<Placed>,
    /// Calibrated airspeed, kt, and pressure altitude, ft.
    speed: Profile,
    altitude: Profile,
}

impl Timeline {
    /// Places the maneuvers of a flight. Names in `flight` that are not in `shapes` are passed over
    /// (the check of the file reports them).
    pub fn new(
        settings: &Settings,
        shapes: &IndexMap<String, Shape>,
        id: &str,
        flight: &Flight,
    ) -> Timeline {
        let timing = flight.timing.as_ref().unwrap_or(&settings.timing);
        let points = points(flight);
        let airborne = !points.is_empty();
        let (speed, altitude) = points.first().map_or((0.0, flight.altitude_ft), |p| (p.0, p.1));
        let altitude: Vec<f64> = altitude.into_iter().collect();
        let mut timeline = Timeline {
            flight: id.to_string(),
            dt: 1.0 / settings.rate_hz,
            n: 0,
            maneuvers: Vec::new(),
            speed: Profile { t: vec![0.0], value: vec![speed] },
            altitude: Profile { t: vec![0.0; altitude.len()], value: altitude },
        };
        let mut t: f64 = 0.0;
        for (speed, altitude, names) in points {
            let there = timeline.speed.go(t, speed, timing.speed_rate_kt_s);
            let altitude = altitude.unwrap_or(timeline.altitude.last());
            t = there.max(timeline.altitude.go(t, altitude, timing.altitude_rate_ft_s));
            t += timing.settle_s;
            for (i, name) in names.iter().enumerate() {
                t += if i == 0 { 0.0 } else { timing.recover_s };
                t = timeline.place(settings, shapes, name, t + timing.hold_before_s, timing);
            }
        }
        for event in &flight.events {
            t = t.max(timeline.place(settings, shapes, &event.maneuver, event.at_s, timing));
        }
        timeline.maneuvers.sort_by(|a, b| a.t_start_s.total_cmp(&b.t_start_s));
        let end = flight.duration_s.filter(|_| !airborne).unwrap_or(t + timing.end_s);
        timeline.n = ((end / timeline.dt).ceil() as usize).saturating_add(1);
        timeline
    }

    /// Files a maneuver whose first step is at `t`, with all that are flown together with it, and
    /// returns the end of their hold.
    fn place(
        &mut self,
        settings: &Settings,
        shapes: &IndexMap<String, Shape>,
        name: &str,
        t: f64,
        timing: &Timing,
    ) -> f64 {
        let companions = settings.maneuvers.get(name).into_iter().flat_map(|m| &m.with);
        let together = std::iter::once((name, 0.0))
            .chain(companions.map(|c| (c.maneuver.as_str(), c.after_s)));
        let on_grid = |t: f64| (t / self.dt).round() * self.dt;
        let known = |(name, after): (&str, f64)| {
            let (m, shape) = (settings.maneuvers.get(name)?, shapes.get(name)?);
            let start = on_grid(t + after);
            Some((name.to_string(), m, start, start + shape.duration(), shape.polarity()))
        };
        let known: Vec<_> = together.filter_map(known).collect();
        let Some(end) = known.iter().map(|k| k.3).reduce(f64::max) else { return t };
        let hold = [on_grid(t) - timing.hold_before_s, end + timing.hold_after_s];
        for (maneuver, m, start, end, polarity) in known {
            self.maneuvers.push(Placed {
                maneuver,
                input: m.input.clone(),
                kind: m.kind.clone(),
                t_start_s: start,
                t_end_s: end,
                unit_time_s: m.unit_time_s,
                amplitude: amplitude(m),
                polarity,
                speed_kt: self.speed.at(start),
                altitude_ft: Some(self.altitude.at(start)).filter(|h| h.is_finite()),
                hold_s: hold,
            });
        }
        hold[1]
    }

    /// Duration of the flight, s.
    pub fn duration(&self) -> f64 {
        self.n.saturating_sub(1) as f64 * self.dt
    }

    /// The signal of the truth model's input `name` on the grid, `[n]`; `None` when nothing drives
    /// it.
    pub fn signal(
        &self,
        settings: &Settings,
        shapes: &IndexMap<String, Shape>,
        flight: &Flight,
        name: &str,
    ) -> Option<Vec<f64>> {
        let drive = &settings.drive;
        let is = |role: &Option<String>| role.as_deref() == Some(name);
        let grid = |f: &dyn Fn(f64) -> f64| (0..self.n).map(|k| f(k as f64 * self.dt)).collect();
        if is(&drive.speed) {
            Some(self.true_speed())
        } else if is(&drive.altitude) {
            Some(grid(&|t| self.altitude.at(t) * FOOT))
        } else if is(&drive.hold) {
            Some(grid(&|t| {
                f64::from(self.maneuvers.iter().any(|m| (m.hold_s[0]..m.hold_s[1]).contains(&t)))
            }))
        } else if is(&drive.turbulence) {
            Some(vec![flight.turbulence; self.n])
        } else if drive.noise.iter().any(|n| n == name) {
            Some(self.noise(settings.seed, flight.turbulence, name))
        } else if let Some(value) = flight.constant.get(name).or(drive.constant.get(name)) {
            Some(vec![*value; self.n])
        } else if settings.maneuvers.values().any(|m| m.input == name) {
            Some(self.maneuver_input(shapes, name))
        } else {
            None
        }
    }

    /// True airspeed command, m/s: the calibrated airspeed at the commanded altitude of the moment.
    fn true_speed(&self) -> Vec<f64> {
        let mut last = (f64::NAN, f64::NAN, f64::NAN);
        let mut at = |t: f64| {
            let (cas, h) = (self.speed.at(t) * KNOT, self.altitude.at(t) * FOOT);
            if (cas, h) != (last.0, last.1) {
                // Who stands still does so at any altitude, and where none is given.
                last = (cas, h, if cas == 0.0 { 0.0 } else { true_airspeed(cas, h) });
            }
            last.2
        };
        (0..self.n).map(|k| at(k as f64 * self.dt)).collect()
    }

    /// White noise of unit spectral density: independent values with variance 1/dt. The first one
    /// is 0: the flight starts trimmed.
    fn noise(&self, seed: u64, turbulence: f64, name: &str) -> Vec<f64> {
        if turbulence == 0.0 {
            return vec![0.0; self.n];
        }
        let mut stream = Stream::new(seed, &["turbulence", &self.flight, name]);
        let scale = 1.0 / self.dt.sqrt();
        (0..self.n).map(|k| if k == 0 { 0.0 } else { scale * stream.normal() }).collect()
    }

    fn maneuver_input(&self, shapes: &IndexMap<String, Shape>, name: &str) -> Vec<f64> {
        let mut signal = vec![0.0; self.n];
        for m in self.maneuvers.iter().filter(|m| m.input == name) {
            let Some(shape) = shapes.get(&m.maneuver) else { continue };
            let (from, to) =
                ((m.t_start_s / self.dt) as usize, (m.t_end_s / self.dt).ceil() as usize + 1);
            for (k, value) in
                signal.iter_mut().enumerate().take(to + 1).skip(from.saturating_sub(1))
            {
                *value += shape.value(k as f64 * self.dt - m.t_start_s);
            }
        }
        signal
    }
}

/// Speed, altitude and maneuvers of the test points, in order.
fn points(flight: &Flight) -> Vec<(f64, Option<f64>, &[String])> {
    let each = flight.speeds_kt.iter().map(|v| (*v, flight.altitude_ft, flight.at_each.as_slice()));
    let single = flight
        .points
        .iter()
        .map(|p| (p.speed_kt, p.altitude_ft.or(flight.altitude_ft), p.maneuvers.as_slice()));
    each.chain(single).collect()
}

#[cfg(test)]
#[path = "timeline_tests.rs"]
mod tests;
