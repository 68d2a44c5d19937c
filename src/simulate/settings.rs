//! The campaign file `campaign.toml`: which flights are flown, which inputs are given, what the
//! sensors do to the truth.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A simulated flight-test campaign: a truth model, the flights it flies and the recorder that
/// listens.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// One line that says what the campaign is.
    pub title: String,
    /// Where the campaign comes from.
    #[serde(default)]
    pub source: String,
    /// Seed of the truth: turbulence. Every random stream is derived from a seed and the names of
    /// flight and signal.
    pub seed: u64,
    /// Seed of the recorder: sensor noise, sampling jitter, lost messages. The same truth can be
    /// recorded again with another one. Without it, `seed` is used.
    #[serde(default)]
    pub sensor_seed: Option<u64>,
    /// Model file of the truth, relative to this file.
    pub truth: String,
    /// Files with values of constants, relative to this file; a later one overrides an earlier one.
    #[serde(default)]
    pub constants: Vec<String>,
    /// Folder for the logs, relative to this file.
    #[serde(default = "default_logs")]
    pub logs: String,
    /// Folder for what only tests may read (true coefficients, true maneuver times, true sensor
    /// errors), relative to this file.
    #[serde(default = "default_truth_folder")]
    pub truth_folder: String,
    /// Rate of the grid on which the truth is computed, Hz. The integration takes smaller steps
    /// where the model needs them.
    #[serde(default = "default_rate")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub rate_hz: f64,
    /// Time of the first sample of the first flight, seconds since 1970-01-01 UTC; each further
    /// flight is a day later.
    pub start_unix_s: u64,
    /// Which input of the truth model does what.
    pub drive: Drive,
    /// How long things take.
    #[serde(default)]
    pub timing: Timing,
    /// The maneuvers that flights refer to by name.
    #[serde(default)]
    pub maneuvers: IndexMap<String, Maneuver>,
    /// The flights, by id: each becomes `<logs>/<id>.mcap`.
    pub flights: IndexMap<String, Flight>,
    /// What the recorder writes, by topic.
    pub topics: IndexMap<String, Topic>,
}

fn default_logs() -> String {
    "logs".to_string()
}

fn default_truth_folder() -> String {
    "truth".to_string()
}

fn default_rate() -> f64 {
    200.0
}

/// Which input of the truth model does what. Every input must be driven: named here, in `constant`,
/// or by a maneuver.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Drive {
    /// Input that receives the commanded true airspeed, m/s (from the calibrated airspeed of the
    /// test points, ISA; 0 in a flight without test points).
    #[serde(default)]
    pub speed: Option<String>,
    /// Input that receives the commanded altitude, m.
    #[serde(default)]
    pub altitude: Option<String>,
    /// Input that is 1 around a maneuver (loops that fly between test points let go) and 0
    /// otherwise.
    #[serde(default)]
    pub hold: Option<String>,
    /// Inputs that receive white noise with a two-sided spectral density of 1 unit^2/Hz (each its
    /// own stream), for shaping filters. Zero in flights without turbulence.
    #[serde(default)]
    pub noise: Vec<String>,
    /// Input that receives the intensity of the turbulence, m/s.
    #[serde(default)]
    pub turbulence: Option<String>,
    /// Inputs held at a value (SI), for example wind; a flight may give another one.
    #[serde(default)]
    pub constant: IndexMap<String, f64>,
}

/// How long things take between and around maneuvers.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// Rate of the commanded airspeed between test points, kt/s.
    #[serde(default = "default_speed_rate")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub speed_rate_kt_s: f64,
    /// Rate of the commanded altitude between test points, ft/s.
    #[serde(default = "default_climb_rate")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub altitude_rate_ft_s: f64,
    /// Time for the flight to settle once the commands of a test point are reached, s.
    #[serde(default = "default_settle")]
    pub settle_s: f64,
    /// `hold` begins this long before a maneuver's first step, s.
    #[serde(default = "default_hold")]
    pub hold_before_s: f64,
    /// `hold` ends this long after a maneuver's last step, s.
    #[serde(default = "default_hold")]
    pub hold_after_s: f64,
    /// Recovery between the end of one hold and the begin of the next at the same test point, s.
    #[serde(default = "default_recover")]
    pub recover_s: f64,
    /// Flight time after the last maneuver's hold, s.
    #[serde(default = "default_end")]
    pub end_s: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Timing {
            speed_rate_kt_s: default_speed_rate(),
            altitude_rate_ft_s: default_climb_rate(),
            settle_s: default_settle(),
            hold_before_s: default_hold(),
            hold_after_s: default_hold(),
            recover_s: default_recover(),
            end_s: default_end(),
        }
    }
}

fn default_speed_rate() -> f64 {
    1.0
}

fn default_climb_rate() -> f64 {
    15.0
}

fn default_settle() -> f64 {
    40.0
}

fn default_hold() -> f64 {
    3.0
}

fn default_recover() -> f64 {
    20.0
}

fn default_end() -> f64 {
    10.0
}

/// One input signal given to the aircraft.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Maneuver {
    /// Input of the truth model; it is 0 between maneuvers.
    pub input: String,
    /// A multistep by its digits (`"3211"`, `"2211"`, `"211"`: steps of so many time units with
    /// alternating sign), `"doublet"` (`"11"`), `"step"` (`"1"`: out and back), `"multisine"`,
    /// `"profile"` (straight lines between points), or `"sweep"` (a slow triangle from 0 to the
    /// amplitude, to the other side, and back to 0).
    pub kind: String,
    /// Time unit of a multistep, s.
    #[serde(default)]
    pub unit_time_s: Option<f64>,
    /// Amplitude in the input's (SI) unit: height of the steps, largest absolute value of the
    /// multisine or the sweep. A profile has none.
    #[serde(default)]
    pub amplitude: Option<f64>,
    /// Height of each step of a multistep in the input's (SI) unit, one for each digit, instead of
    /// `amplitude`; signs alternate by themselves.
    #[serde(default)]
    pub amplitudes: Option<Vec<f64>>,
    /// Sign of the first step: 1 or -1. A profile is multiplied by it.
    #[serde(default = "default_polarity")]
    pub polarity: i8,
    /// Duration of one edge of a multistep, s (a ramp that begins at the nominal time); 0 is one
    /// grid step.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub edge_s: f64,
    /// Length of a multisine, s; its frequencies are multiples of 1/length.
    #[serde(default)]
    pub duration_s: Option<f64>,
    /// Lowest and highest frequency of a multisine, Hz.
    #[serde(default)]
    pub band_hz: Option<[f64; 2]>,
    /// Time of one cycle of a sweep, s.
    #[serde(default)]
    pub period_s: Option<f64>,
    /// Cycles of a sweep; 1 unless given.
    #[serde(default)]
    pub cycles: Option<u32>,
    /// Times of the points of a profile since its first one, s: they begin at 0 and ascend.
    #[serde(default)]
    pub times_s: Option<Vec<f64>>,
    /// Values of a profile at these times, in the input's (SI) unit; before the first and from the
    /// last on the input is 0.
    #[serde(default)]
    pub values: Option<Vec<f64>>,
    /// Other maneuvers flown at the same time, inside one hold: several inputs at once, or one
    /// input again.
    #[serde(default)]
    pub with: Vec<Companion>,
}

/// A maneuver flown together with another one.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Companion {
    /// Name of the maneuver; it must not bring others itself.
    pub maneuver: String,
    /// Its first step comes this long after the first step of the maneuver it goes with, s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub after_s: f64,
}

fn default_polarity() -> i8 {
    1
}

/// One flight: starts trimmed at its first test point and goes through the test points in order. A
/// flight without test points (a test on the ground) has `events`, or `duration_s`, alone: its
/// commanded airspeed is 0, and it starts in the steady condition of the truth model for that.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Flight {
    /// Pressure altitude of the test points that have none of their own, ft. A flight without test
    /// points needs it where `altitude` of `[drive]` names an input.
    #[serde(default)]
    pub altitude_ft: Option<f64>,
    /// Calibrated airspeeds of the test points in the order flown, kt. Either this with `at_each`,
    /// or `points`.
    #[serde(default)]
    #[schemars(inner(range(min = 1)))]
    pub speeds_kt: Vec<f64>,
    /// Names of the maneuvers flown at each of `speeds_kt`, in order.
    #[serde(default)]
    pub at_each: Vec<String>,
    /// Test points one by one.
    #[serde(default)]
    pub points: Vec<Point>,
    /// Maneuvers at given times of the flight, beside those of the test points.
    #[serde(default)]
    pub events: Vec<Event>,
    /// Length of a flight without test points, s; unless given, it ends `end_s` of its timing after
    /// the last hold.
    #[serde(default)]
    pub duration_s: Option<f64>,
    /// Intensity of the turbulence, m/s; 0 is calm air.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub turbulence: f64,
    /// Values of constant inputs for this flight (SI), by name.
    #[serde(default)]
    pub constant: IndexMap<String, f64>,
    /// This flight's own timing.
    #[serde(default)]
    pub timing: Option<Timing>,
}

/// One test point.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Calibrated airspeed, kt.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub speed_kt: f64,
    /// Pressure altitude, ft; without it, the flight's.
    #[serde(default)]
    pub altitude_ft: Option<f64>,
    /// Names of the maneuvers flown here, in order; none is allowed.
    #[serde(default)]
    pub maneuvers: Vec<String>,
}

/// A maneuver at a given time.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// Time of the first step since the start of the flight, s.
    pub at_s: f64,
    /// Name of the maneuver.
    pub maneuver: String,
}

/// One topic of the log: fields that are sampled together.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Topic {
    /// Messages per second.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub rate_hz: f64,
    /// Besides, a message whenever the true signal of a field begins or ends a change: straight lines
    /// between messages are then what a command was, and its steps are known to a grid step of the
    /// truth. Without jitter.
    #[serde(default)]
    pub on_change: bool,
    /// Standard deviation of the sampling time about its nominal value, s (normal, cut at 0.4 of
    /// the period). Stamps are right: they show the jittered time.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub jitter_s: f64,
    /// The recorder logs a message this long after its publish time, s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub latency_s: f64,
    /// Mean of an exponentially distributed further latency, s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub latency_jitter_s: f64,
    /// Name of a field with the publish time in seconds since 1970; without it, only the message
    /// envelope has the time.
    #[serde(default)]
    pub time_field: Option<String>,
    /// Probability that a message is lost.
    #[serde(default)]
    #[schemars(range(min = 0, max = 1))]
    pub lost: f64,
    /// Probability that a message is written twice.
    #[serde(default)]
    #[schemars(range(min = 0, max = 1))]
    pub repeated: f64,
    /// Stretches without messages.
    #[serde(default)]
    pub gaps: Vec<Gap>,
    /// The fields, by name.
    pub fields: IndexMap<String, Sensor>,
}

/// A stretch of one flight without messages.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gap {
    /// Id of the flight.
    pub flight: String,
    /// Begin, s since the start of the flight.
    pub from_s: f64,
    /// End, s since the start of the flight.
    pub to_s: f64,
}

/// What a sensor does to one truth signal: `scale * lagged(value(t - delay)) + bias + noise`,
/// rounded to the resolution. Noise, bias and resolution are in the log's unit.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Output or input of the truth model.
    pub truth: String,
    /// Unit in the log.
    pub unit: String,
    /// -1 where the recorder's sign convention is the opposite one.
    #[serde(default = "default_scale")]
    pub sign: f64,
    /// Standard deviation of white noise.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub noise: f64,
    /// Constant error.
    #[serde(default)]
    pub bias: f64,
    /// Standard deviation of a further constant error drawn once per flight.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub bias_sd: f64,
    /// Scale factor.
    #[serde(default = "default_scale")]
    pub scale: f64,
    /// Standard deviation of the scale factor, drawn once per flight.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub scale_sd: f64,
    /// Time constant of a first-order lag, s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub lag_s: f64,
    /// The value is this old at its publish time, s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub delay_s: f64,
    /// Step of the digital value; 0 is full precision.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub resolution: f64,
}

fn default_scale() -> f64 {
    1.0
}
