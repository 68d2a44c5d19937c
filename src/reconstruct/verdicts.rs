//! What a channel shows of itself, against the others and against its predicted noise, in; the
//! lines of the consistency table with their verdicts out.

use super::consistency::Row;
use super::health::Health;
use super::pairs::{Comparison, Which};
use super::smoother::Innovation;
use crate::math::distribution::INTERVAL_95;
use crate::noise::Modelled;

/// Below this correlation with what the others say, a channel's sign is reversed.
const REVERSED: f64 = -0.8;
/// Below this it goes against the others: a reversed sign, seen through noise, or another one's.
const OPPOSED: f64 = -0.5;
/// A delay is told from this size on, s, where it is known; a scale from this deviation on.
const DELAY: f64 = 0.01;
const SCALE: f64 = 0.05;
/// A clock that is later by this in one half of the flight than in the other jumps, s.
const JUMP: f64 = 0.03;
/// Rejected samples above this share are outliers that a reader must know of.
const REJECTED: f64 = 0.01;
/// Correlation of neighbouring innovations from which a channel was filtered.
const FILTERED: f64 = 0.9;

impl Comparison {
    pub fn reversed(&self) -> bool {
        self.correlation < REVERSED && self.scale[0] < 0.0
    }

    /// Its lines of the table.
    pub fn rows(&self, channel: &str) -> Vec<Row> {
        let row = |check, value, [low, high]: [f64; 2], unit: &str, verdict, text: String| Row {
            channel: channel.to_string(),
            check,
            value,
            low,
            high,
            unit: unit.to_string(),
            verdict,
            text,
        };
        let verdict = match self.correlation {
            _ if self.reversed() => "sign reversed",
            r if r < OPPOSED => "opposed",
            _ => "good",
        };
        let cut = self.cut.map_or(String::new(), |n| format!("; {}", Modelled::cut_words(n)));
        let text = format!(
            "measured against what the other sensors say of it, trend removed: correlation {:.3}, {:.2e} left{}{cut}",
            self.correlation,
            self.left,
            match verdict {
                "opposed" => ": its sign, or that of one it is held against?",
                _ => "",
            }
        );
        let mut rows = vec![row("sign", self.correlation, [OPPOSED, 1.0], "-", verdict, text)];
        if self.reversed() {
            return rows;
        }
        let [k, sd] = self.scale;
        if sd < SCALE / 3.0 && matches!(self.which, Which::Output(_)) {
            let limit = SCALE.max(3.0 * sd);
            let verdict = if (k - 1.0).abs() > limit { "scaled" } else { "good" };
            let why = match verdict {
                "scaled" if channel == "V" => equivalent(k),
                _ => String::new(),
            };
            let text = format!(
                "measured change per reconstructed change {k:.4} +- {:.4} (95%){why}",
                INTERVAL_95 * sd
            );
            rows.push(row("scale", k, [1.0 - limit, 1.0 + limit], "-", verdict, text));
        }
        let [tau, sd] = self.delay;
        if sd < DELAY {
            let limit = DELAY.max(3.0 * sd);
            let verdict = if tau.abs() <= limit {
                "good"
            } else if tau > 0.0 {
                "late"
            } else {
                "early"
            };
            let why = match verdict {
                "early" => ": no sensor is ahead of the motion, so what it is held against is late",
                _ => "",
            };
            let text = format!(
                "measured behind reconstructed by {tau:.4} +- {:.4} s (95%){why}",
                INTERVAL_95 * sd
            );
            rows.push(row("time skew", tau, [-limit, limit], "s", verdict, text));
        }
        let [jump, sd] = self.jump;
        if sd < JUMP {
            let limit = JUMP.max(4.0 * sd);
            let verdict = if jump.abs() > limit { "clock jumps" } else { "good" };
            let text = format!(
                "{jump:.4} +- {:.4} s (95%) later in the second half of the flight than in the first",
                INTERVAL_95 * sd
            );
            rows.push(row("clock", jump, [-limit, limit], "s", verdict, text));
        }
        rows
    }
}

/// Where an equivalent airspeed is this share of the true one, in words; nothing where no aircraft is.
fn equivalent(k: f64) -> String {
    // ICAO standard atmosphere below 11 km: sigma = (1 - h/44331 m)^4.2559; EAS = TAS sqrt(sigma)
    let height = 44331.0 * (1.0 - libm::pow(k * k, 1.0 / 4.2559));
    match height {
        h if (300.0..11_000.0).contains(&h) => format!(
            "; an indicated or equivalent airspeed would be so at {:.0} m in standard air, and a true one is wanted",
            (h / 100.0).round() * 100.0
        ),
        _ => String::new(),
    }
}

/// An airspeed is off from this share on.
const LEVEL: f64 = 0.02;

/// The line of a channel's level against what all others say of it, `k` times too much with its standard
/// deviation, and what gusts `pull` it; not finite where they cannot be asked.
pub fn level_row(channel: &str, [k, sd]: [f64; 2], pull: f64) -> Row {
    if !(sd < LEVEL / 2.0) {
        return level_unknown(channel, [k, sd], 0.0);
    }
    let sd = sd.hypot(pull);
    let limit = LEVEL.max(4.0 * sd);
    let verdict = if (k - 1.0).abs() > limit { "scaled" } else { "good" };
    if verdict == "good" && !(sd < LEVEL / 2.0) {
        return level_unknown(channel, [k, sd], pull);
    }
    let why = match verdict {
        "scaled" => {
            "; wind and biases of accelerometers take that up, and are wrong: another unit, or an error of position?"
        }
        _ => "",
    };
    let text = format!(
        "reads {k:.4} +- {:.4} (95%) times what all others say{why}{}",
        INTERVAL_95 * sd,
        if verdict == "scaled" { equivalent(k) } else { String::new() }
    );
    let row = Row::of(channel, "level", k, "-", (verdict, text));
    Row { low: 1.0 - limit, high: 1.0 + limit, ..row }
}

/// The line of a level that the others do not tell.
fn level_unknown(channel: &str, [k, sd]: [f64; 2], pull: f64) -> Row {
    let why = match k.is_finite() && sd.is_finite() {
        true if pull > 0.5 * sd => format!(
            "in these gusts the other sensors tell its level to +- {:.2} (95%) only, {k:.3}",
            INTERVAL_95 * sd
        ),
        true => format!(
            "the other sensors tell its level to +- {:.2} (95%) only: ground speed in turns would",
            INTERVAL_95 * sd
        ),
        false => "its level could not be asked for: the filter with its scale free does not end"
            .to_string(),
    };
    let text =
        format!("{why}; an error in it is taken up by the wind and by biases of accelerometers");
    Row::of(channel, "level", k, "-", ("not compared", text))
}

/// The line of a channel that was not compared with the others.
pub fn not_compared(channel: &str) -> Row {
    Row {
        channel: channel.to_string(),
        check: "sign",
        value: f64::NAN,
        low: OPPOSED,
        high: 1.0,
        unit: "-".to_string(),
        verdict: "not compared",
        text: "the other sensors do not tell what it does, even where it moves most: its sign, scale and delay are not known"
            .to_string(),
    }
}

/// Lines about the signal by itself; one that need not move (a temperature) may stand still.
pub fn health_rows(channel: &str, health: &Health, moves: bool) -> Vec<Row> {
    let row = |check, value, high, unit: &str, verdict, text| Row {
        channel: channel.to_string(),
        check,
        value,
        low: 0.0,
        high,
        unit: unit.to_string(),
        verdict,
        text,
    };
    let verdict = if !moves {
        "good"
    } else if health.dead {
        "dead"
    } else if health.frozen_s > 0.0 {
        "frozen"
    } else {
        "good"
    };
    let text = if health.dead {
        "the value never changes".to_string()
    } else {
        format!(
            "stands still in {} stretches of together {:.1} s",
            health.frozen.len(),
            health.frozen_s
        )
    };
    let stops = if health.saturated > 0 { "saturated" } else { "good" };
    let gaps = if health.gaps > 0 || health.masked > 0 { "gaps" } else { "good" };
    vec![
        row("standing still", health.frozen_s, 0.0, "s", verdict, text),
        row(
            "stops",
            health.saturated as f64,
            0.0,
            "-",
            stops,
            format!("{} samples at the largest or least value", health.saturated),
        ),
        row(
            "gaps",
            health.longest_gap,
            5.0 * health.spacing,
            "s",
            gaps,
            format!(
                "{} gaps, the longest {:.2} s; {} samples are not numbers",
                health.gaps, health.longest_gap, health.masked
            ),
        ),
    ]
}

/// The share of samples that were rejected.
fn rejected(innovation: &Innovation) -> f64 {
    innovation.rejected as f64 / (innovation.count + innovation.rejected).max(1) as f64
}

fn rejection(innovation: &Innovation) -> String {
    format!(
        "{} of {} samples rejected",
        innovation.rejected,
        innovation.count + innovation.rejected
    )
}

/// How many samples were rejected, in words, where they are more than a few.
pub fn outliers(innovation: &Innovation) -> Option<String> {
    (rejected(innovation) > REJECTED).then(|| rejection(innovation))
}

/// Whether neighbouring innovations are so much alike that the channel has no white noise worth the
/// name.
pub fn filtered(innovation: &Innovation) -> bool {
    innovation.count >= 50 && innovation.lagged[0] > FILTERED * innovation.square
}

/// Lines about a channel's innovations; `sd` of its noise as found or given, `fast` as its fast
/// part alone.
pub fn innovation_rows(
    channel: &str,
    unit: &str,
    innovation: &Innovation,
    (sd, fast, given): (f64, f64, bool),
) -> Vec<Row> {
    let row = |check, value, low, high, unit: &str, verdict, text| Row {
        channel: channel.to_string(),
        check,
        value,
        low,
        high,
        unit: unit.to_string(),
        verdict,
        text,
    };
    let n = innovation.count as f64;
    if innovation.count < 50 {
        return vec![row(
            "innovation size",
            f64::NAN,
            f64::NAN,
            f64::NAN,
            "-",
            "not used",
            "too few samples were used".to_string(),
        )];
    }
    let size = innovation.square / n;
    let rho: Vec<f64> = innovation.lagged.iter().map(|c| c / innovation.square).collect();
    // variance of the mean of squares of a Gaussian sequence with these autocorrelations
    let wide = (2.0 / n * (1.0 + 2.0 * rho.iter().map(|r| r * r).sum::<f64>())).sqrt();
    let limit = (3.0 * wide).max(0.1);
    let verdict = if size > 1.0 + limit {
        "too large"
    } else if size < 1.0 - limit {
        "too small"
    } else {
        "good"
    };
    let band = (1.96 / n.sqrt()).max(0.2);
    let coloured = if rho[0].abs() > band { "coloured" } else { "good" };
    let noisy = if sd > 2.0 * fast && !given { "slow errors" } else { "good" };
    let by = if given { "was given" } else { "the path needs it" };
    vec![
        row(
            "innovation size",
            size,
            1.0 - limit,
            1.0 + limit,
            "-",
            verdict,
            format!(
                "mean square of innovations over their predicted variance, {} samples",
                innovation.count
            ),
        ),
        row(
            "whiteness",
            rho[0],
            -band,
            band,
            "-",
            coloured,
            "correlation of neighbouring innovations".to_string(),
        ),
        row(
            "rejected",
            rejected(innovation),
            0.0,
            REJECTED,
            "-",
            if outliers(innovation).is_some() { "outliers" } else { "good" },
            rejection(innovation),
        ),
        row(
            "noise",
            sd,
            0.0,
            2.0 * fast,
            unit,
            noisy,
            format!("standard deviation as {by}; its fast part {fast:.2e}"),
        ),
    ]
}

/// An inertial sensor that needs this many times its noise has errors of its own, or is held against something
/// wrong.
const NEEDED: f64 = 2.0;

/// The line about how noisy an inertial sensor has to be for the path to fit the measurements: what
/// contradicts them (an airspeed in another unit, a sign, an arm) ends there. `sd` of a sample as the path needs
/// it, or as it was given, and of its fast part.
pub fn needed_row(channel: &str, unit: &str, (sd, fast, given): (f64, f64, bool)) -> Row {
    let needs = sd > NEEDED * fast && !given;
    let by = if given { "was given" } else { "the path needs it" };
    let why = match needs {
        true => {
            ": it, or what it is held against, has slow errors, or another sign, unit, scale or place than is said"
        }
        false => "",
    };
    let text = format!("standard deviation of a sample as {by}; its fast part {fast:.2e}{why}");
    let verdict = if needs { "needs noise" } else { "good" };
    let row = Row::of(channel, "noise", sd, unit, (verdict, text));
    Row { low: 0.0, high: NEEDED * fast, ..row }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_that_the_others_contradict_needs_much_noise() {
        let of = |sd: f64, given: bool| needed_row("az", "m/s^2", (sd, 0.05, given)).verdict;
        assert_eq!(of(0.09, false), "good");
        assert_eq!(of(0.15, false), "needs noise");
        assert_eq!(of(0.15, true), "good");
    }

    #[test]
    fn an_equivalent_airspeed_is_told_by_the_height_that_it_would_mean() {
        // standard air at 3000 m: 0.9093 kg/m^3 of 1.2250
        let k = (0.9093f64 / 1.2250).sqrt();
        assert!(equivalent(k).contains("at 3000 m"), "{}", equivalent(k));
        assert_eq!((equivalent(1.1), equivalent(0.995), equivalent(0.3)), Default::default());
    }

    #[test]
    fn an_airspeed_in_knots_is_told_and_one_that_nobody_knows_is_not() {
        let of = |k: f64, sd: f64| level_row("V", [k, sd], 0.0).verdict;
        assert_eq!((of(0.514, 1e-3), of(1.03, 2e-4)), ("scaled", "scaled"));
        assert_eq!((of(1.01, 2e-4), of(1.03, 8e-3)), ("good", "good"));
        assert_eq!((of(0.5, 0.1), of(f64::NAN, f64::NAN)), ("not compared", "not compared"));
        let in_gusts = |k: f64, pull: f64| level_row("V", [k, 4e-3], pull);
        let row = in_gusts(1.021, 0.016);
        assert!(row.text.starts_with("in these gusts"), "{}", row.text);
        assert_eq!((row.verdict, in_gusts(0.514, 0.016).verdict), ("not compared", "scaled"));
        assert_eq!(in_gusts(1.012, 0.008).verdict, "good");
    }
}
