//! A campaign small enough to run in a second: a first-order system driven by 3211s, logged at two
//! rates, with a gain that is a straight line in the "airspeed" of the moment.

use koehler::log::{FieldSpec, LogWriter};
use std::path::{Path, PathBuf};
use std::process::Output;
use tempfile::TempDir;

/// Gain of the system at airspeed `v`, and its time constant.
pub const SLOPE: f64 = 0.02;
pub const INTERCEPT: f64 = 0.5;
pub const LAG: f64 = 0.4;
/// What an estimate says of that campaign's records, which are 1 ms apart.
pub const LATE: &str = "records look shifted in time against the others";

pub const CHANNELS: &str = r#"
[signal.u]
topic = "/drive"
field = "command"
unit = "deg"

[signal.y]
topic = "/sensor"
field = "angle"
unit = "deg"

[signal.V]
topic = "/air"
field = "speed"
unit = "m/s"
"#;

pub const MODEL: &str = r#"
title = "First-order system"

[inputs]
u = "rad"

[parameters]
K = { unit = "-", start = 1.0 }
T = { unit = "s", start = 0.3, min = 0.01 }
y_0 = { unit = "rad", start = 0.0, per = "segment" }

[states]
x = { unit = "rad", rate = "(K*u - x)/T", start = 0.0 }

[outputs]
y = { unit = "rad", value = "x + y_0" }
"#;

pub const PIPELINE: &str = r#"
title = "First-order campaign"
channels = "channels.toml"
logs = ["logs/*.mcap"]

[derive]
rate_hz = 100.0

[[segment.input]]
name = "drive"
signal = "u"

[[estimate]]
interpolation = "hold"
name = "lag"
model = "lag.model.toml"
input = "drive"
kinds = ["3211"]

[[fit]]
estimate = "lag"
parameters = ["K", "T"]
against = "V"

[report]
"#;

/// A campaign in a folder of its own.
pub struct Campaign {
    pub folder: TempDir,
}

impl Campaign {
    /// Three flights of four maneuvers.
    pub fn new() -> Campaign {
        let campaign = Campaign { folder: tempfile::tempdir().expect("a temporary folder") };
        campaign.write("channels.toml", CHANNELS);
        campaign.write("lag.model.toml", MODEL);
        campaign.write("pipeline.toml", PIPELINE);
        for flight in 0..3 {
            campaign.fly(&format!("flight-{}", flight + 1), flight, 4);
        }
        campaign
    }

    pub fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    pub fn write(&self, relative: &str, text: &str) {
        std::fs::write(self.path(relative), text).expect("written");
    }

    /// Replaces text in a file; the text must be there.
    pub fn edit(&self, relative: &str, old: &str, new: &str) {
        let text = std::fs::read_to_string(self.path(relative)).expect("readable");
        assert!(text.contains(old), "{relative} has no {old:?}");
        self.write(relative, &text.replace(old, new));
    }

    /// Writes the log of one flight with so many maneuvers.
    pub fn fly(&self, name: &str, seed: u64, maneuvers: usize) {
        write_log(&self.path(&format!("logs/{name}.mcap")), seed, maneuvers, |_| false);
    }

    /// `koehler VERB pipeline.toml ARGS` in the campaign's folder.
    pub fn koehler(&self, verb: &str, args: &[&str]) -> Outcome {
        self.command(verb, &[&["pipeline.toml"], args].concat())
    }

    /// `koehler VERB ARGS` in the campaign's folder.
    pub fn command(&self, verb: &str, args: &[&str]) -> Outcome {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
        let output =
            command.current_dir(self.folder.path()).arg(verb).args(args).output().expect("started");
        Outcome::of(output)
    }

    pub fn run(&self) -> Outcome {
        self.koehler("run", &[])
    }
}

/// What a command said and how it ended.
#[derive(Debug)]
pub struct Outcome {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Outcome {
    fn of(output: Output) -> Outcome {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        let code = output.status.code().expect("not killed");
        let outcome = Outcome { code, out: text(output.stdout), err: text(output.stderr) };
        assert!(!outcome.err.contains("panicked"), "{}", outcome.err);
        outcome
    }

    pub fn ended(self, code: i32) -> Outcome {
        assert_eq!(self.code, code, "stdout:\n{}\nstderr:\n{}", self.out, self.err);
        self
    }

    /// The run and fresh counts of a stage in the summary.
    pub fn stage(&self, name: &str) -> (usize, usize) {
        let line = self
            .out
            .lines()
            .find(|l| l.split_whitespace().next() == Some(name))
            .unwrap_or_else(|| panic!("no {name} in {}", self.out));
        let mut counts = line.split_whitespace().skip(1).map(|c| c.parse().unwrap_or(0));
        (counts.next().expect("a count"), counts.next().expect("a count"))
    }
}

/// Deterministic noise in -1..1.
fn noise(k: u64) -> f64 {
    let mut x = k.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x ^= x >> 29;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 32;
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Writes a log whose maneuvers begin every 20 s, each at its own speed. `lost` says at which times
/// nothing but NaN is logged in y.
pub fn write_log(path: &Path, seed: u64, maneuvers: usize, lost: impl Fn(f64) -> bool) {
    write_log_seen(path, seed, maneuvers, |t, y| if lost(t) { f64::NAN } else { y });
}

/// The same; `seen` makes what is logged in y of the time and what its sensor measures.
pub fn write_log_seen(
    path: &Path,
    seed: u64,
    maneuvers: usize,
    mut seen: impl FnMut(f64, f64) -> f64,
) {
    // However many flights there are, they fly alike: a gain that grew with their number would have the last ones
    // stand out of the noise more and more, and take longer.
    let speed = |i: usize| 60.0 + 15.0 * i as f64 + 4.0 * (seed % 30) as f64;
    let command = |t: f64| {
        let since = t - 20.0 * (t / 20.0).floor() - 5.0;
        let flown = ((t / 20.0) as usize) < maneuvers;
        match since {
            s if !flown || !(0.0..7.0).contains(&s) => 0.0,
            s if s < 3.0 => 2.0,
            s if s < 5.0 => -2.0,
            s if s < 6.0 => 2.0,
            _ => -2.0,
        }
    };
    let mut writer = LogWriter::create(path).expect("created");
    let field = |name: &str, unit: &str| [FieldSpec::new(name, unit, "")];
    let drive = writer.add_topic("/drive", &field("command", "deg")).expect("topic");
    let sensor = writer.add_topic("/sensor", &field("angle", "deg")).expect("topic");
    let air = writer.add_topic("/air", &field("speed", "m/s")).expect("topic");
    let zero = 1_700_000_000_000_000_000;
    let mut x = 0.0;
    // Steps of 1 ms, behind which the response is taken: it is logged 1 ms early, and estimates say so
    // (`LATE`). The drive is logged at 100 Hz, the sensor at 40 Hz, the airspeed at 10 Hz.
    for k in 0..(maneuvers.max(1) as u64 * 20_000) {
        let t = k as f64 * 1e-3;
        let v = speed((t / 20.0) as usize);
        x += 1e-3 * ((INTERCEPT + SLOPE * v) * command(t) - x) / LAG;
        let ns = zero + k * 1_000_000;
        if k % 10 == 0 {
            writer.write(drive, ns, ns, &[command(t)]).expect("written");
        }
        if k % 25 == 3 {
            let y = seen(t, x + 0.02 * noise(k + 1_000_003 * seed));
            writer.write(sensor, ns, ns, &[y]).expect("written");
        }
        if k % 100 == 7 {
            writer.write(air, ns, ns, &[v]).expect("written");
        }
    }
    writer.finish().expect("finished");
}
