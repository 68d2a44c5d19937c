//! One maneuver: its steps, its size and its time, and how sure it is.

use super::kind::Kind;

/// One level of a maneuver. Times are those where the signal is half way between neighbouring
/// levels, s. Of a sweep: what lies on one side of trim, with the level of its turning point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    pub start: f64,
    pub end: f64,
    /// Deviation from the local trim, in the channel's SI unit.
    pub level: f64,
    /// Time from 20 to 80% of the edge at its start and of that at its end, s; NaN where edges are not
    /// measured (sweeps, and what is given by hand).
    pub rises: (f64, f64),
}

/// Edges that are not measured.
pub const NO_RISES: (f64, f64) = (f64::NAN, f64::NAN);

/// A maneuver found on an input channel, or included by hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Maneuver {
    pub kind: Kind,
    /// Half-way time of the first edge, s; of a sweep, when it leaves trim.
    pub t_start: f64,
    /// Half-way time of the last edge, s; of a sweep, when it is back.
    pub t_end: f64,
    /// When the signal leaves the trim, s: at or before `t_start`.
    pub onset: f64,
    /// Duration of the pattern's unit, s, by least squares over the steps; of a multistep the
    /// shortest step; of a sweep a quarter of its period, which is the time from trim to the first
    /// turning point.
    pub unit_time: f64,
    /// Mean absolute deviation of the levels from trim, in the channel's SI unit.
    pub amplitude: f64,
    /// +1 or -1: the sign of the first step.
    pub polarity: f64,
    /// Level of the signal in the quiet window before the maneuver, in the channel's SI unit.
    pub trim: f64,
    pub steps: Vec<Step>,
    /// 0 to 1: regular timing, consistent levels, sharp edges, small noise, quiet before and after.
    /// 0 for an interval given by hand, which nothing was found out about.
    pub score: f64,
    /// False for a maneuver excluded by hand.
    pub included: bool,
    /// The reason of the hand edit; empty without one.
    pub reason: String,
}

impl Maneuver {
    /// The window of `length_s` seconds before the signal leaves trim, for trim conditions:
    /// `(from, to)` in s.
    pub fn pre_window(&self, length_s: f64) -> (f64, f64) {
        (self.onset - length_s, self.onset)
    }
}
