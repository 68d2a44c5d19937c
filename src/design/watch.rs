//! Which true signals are watched, and how far they may go, in; both by the name of the excursion out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Outputs or inputs of the truth model whose largest departure from their value before the first
/// step, until the end of what is estimated from, is told.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Watch {
    /// Airspeed, m/s.
    pub airspeed: Option<String>,
    /// Pitch attitude, rad.
    pub pitch: Option<String>,
    /// Bank angle, rad.
    pub bank: Option<String>,
    /// Load factor.
    pub load_factor: Option<String>,
    /// Angle of attack, rad.
    pub alpha: Option<String>,
    /// Current of the servo, A.
    pub current: Option<String>,
}

/// Largest excursions, SI, of the signals of `[watch]`.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Airspeed, m/s.
    pub airspeed: Option<f64>,
    /// Pitch attitude, rad.
    pub pitch: Option<f64>,
    /// Bank angle, rad.
    pub bank: Option<f64>,
    /// Load factor.
    pub load_factor: Option<f64>,
    /// Angle of attack, rad.
    pub alpha: Option<f64>,
    /// Current of the servo, A.
    pub current: Option<f64>,
}

/// Excursions by name: the signal, and the limit.
pub fn watched<'a>(
    watch: &'a Watch,
    limits: &Limits,
) -> [(&'static str, Option<&'a str>, Option<f64>); 6] {
    [
        ("airspeed", watch.airspeed.as_deref(), limits.airspeed),
        ("pitch", watch.pitch.as_deref(), limits.pitch),
        ("bank", watch.bank.as_deref(), limits.bank),
        ("load_factor", watch.load_factor.as_deref(), limits.load_factor),
        ("alpha", watch.alpha.as_deref(), limits.alpha),
        ("current", watch.current.as_deref(), limits.current),
    ]
}
