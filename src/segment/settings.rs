//! How maneuvers are found.

/// What is searched.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize, serde::Serialize, schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Seek {
    /// Steps to alternating sides of trim: 3211, 2211, 211, doublet, step and others.
    Multistep,
    /// Slow triangles: from trim to one side, to the other, and back, at one rate.
    Sweep,
}

/// How maneuvers are found. The defaults suit unit times of 0.25 s to some seconds.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// What is searched: "multistep", "sweep" or both; with nothing, all maneuvers are included by
    /// hand.
    pub seek: Vec<Seek>,
    /// Shortest step, s.
    pub min_step_s: f64,
    /// Longest step, s; a level held longer is a new trim, not a step.
    pub max_step_s: f64,
    /// Length of the quiet windows before and after a maneuver, s.
    pub quiet_s: f64,
    /// A maneuver begins where the signal leaves its quiet level by this many MAD standard
    /// deviations of the quiet window.
    pub threshold: f64,
    /// Smallest amplitude of a maneuver, in the channel's SI unit.
    pub min_amplitude: f64,
    /// Smallest amplitude of a maneuver as a share of the median amplitude of the record's
    /// maneuvers of two or more steps (of the largest step where there are none). Sweeps are not
    /// measured by it.
    pub relative_amplitude: f64,
    /// Most steps in one maneuver; more is an oscillation or a sweep.
    pub max_steps: usize,
    /// Largest rms deviation of the step durations from a pattern, in unit times, that still has
    /// the pattern's name.
    pub timing_tolerance: f64,
    /// Least score, 0 to 1.
    pub min_score: f64,
    /// Shortest period of a sweep, s: what is faster excites the aircraft.
    pub min_period_s: f64,
    /// Longest period of a sweep, s.
    pub max_period_s: f64,
    /// A gap between samples longer than this splits the record, s.
    pub max_gap_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            seek: vec![Seek::Multistep],
            min_step_s: 0.2,
            max_step_s: 20.0,
            quiet_s: 1.0,
            threshold: 5.0,
            min_amplitude: 0.0,
            relative_amplitude: 0.25,
            max_steps: 8,
            timing_tolerance: 0.3,
            min_score: 0.4,
            min_period_s: 8.0,
            max_period_s: 600.0,
            max_gap_s: 0.5,
        }
    }
}
