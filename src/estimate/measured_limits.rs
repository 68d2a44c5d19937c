//! A case in; how large the limits of its states would have to be for the motion that was measured to reach them, out.

use super::case::Case;
use super::sizes::Measured;
use super::watched::{Seen, Watch, parameters, watched};
use crate::dynamics::Channel;
use crate::math::median;

/// A rate is the slope of a line through so many samples: their noise would be the largest rate of two.
const SAMPLES: usize = 5;

impl Case {
    /// The limits of which all parameters are free and common to the segments, from what was measured of their
    /// states: the median over the segments (one condition each, as a rule) of what was measured over the limit as it
    /// starts, where most of it was measured.
    pub fn measured_limits(&self) -> Vec<Measured> {
        let (model, watches) = watched(&self.model);
        let free: Vec<Option<Vec<usize>>> = watches.iter().map(|w| self.places(w)).collect();
        if free.iter().all(Option::is_none) {
            return Vec::new();
        }
        let Ok(seen) = self.seen_all(&model, &watches, &self.layout.start) else {
            return Vec::new();
        };
        let of = |(w, watch): (usize, &Watch)| {
            let places = free[w].clone()?;
            let ratio = |(s, all): (usize, &Vec<Seen>)| self.ratio(watch, &all[w], s);
            let ratios: Vec<f64> = seen.iter().enumerate().filter_map(ratio).collect();
            (!ratios.is_empty()).then(|| Measured { places, size: median(&ratios) })
        };
        watches.iter().enumerate().filter_map(of).collect()
    }

    /// The places of a limit's parameters; none where it has none, or one is not free and common.
    fn places(&self, watch: &Watch) -> Option<Vec<usize>> {
        let place = |name: &String| {
            let common =
                |u: &super::Unknown| u.name == *name && u.segment.is_none() && u.group.is_none();
            self.unknowns.iter().position(common)
        };
        let places: Vec<usize> =
            parameters(&self.model, &[watch.bound]).iter().map(place).collect::<Option<_>>()?;
        (!places.is_empty()).then_some(places)
    }

    /// What a segment has measured most towards a limit, over the limit there.
    fn ratio(&self, watch: &Watch, seen: &Seen, s: usize) -> Option<f64> {
        let (channel, record) = (self.measured_of(watch.state, s)?, &self.records[s]);
        let points = match watch.limit {
            "rate_max" => slopes(channel),
            _ => channel.t.iter().copied().zip(channel.z.iter().copied()).collect(),
        };
        let towards = |(t, z): (f64, f64)| (t, watch.towards(z));
        let finite = points.into_iter().map(towards).filter(|(_, z)| z.is_finite());
        let (t, most) = finite.reduce(|best, one| if one.1 > best.1 { one } else { best })?;
        let k = ((t - record.t0) / record.dt).round() - record.start as f64;
        let bound = watch.towards(*seen.bound.get(k.max(0.0) as usize)?);
        Some(most / bound).filter(|ratio| ratio.is_finite() && *ratio > 0.0)
    }
}

/// Slopes of lines through neighbouring samples, at their mean times.
fn slopes(channel: &Channel) -> Vec<(f64, f64)> {
    let both = channel.t.windows(SAMPLES).zip(channel.z.windows(SAMPLES));
    let slope = |(t, z): (&[f64], &[f64])| {
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let (tm, zm) = (mean(t), mean(z));
        let both = t.iter().zip(z).map(|(t, z)| (t - tm) * (z - zm)).sum::<f64>();
        (tm, both / t.iter().map(|t| (t - tm) * (t - tm)).sum::<f64>())
    };
    both.map(slope).collect()
}
