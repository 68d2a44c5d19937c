//! Body rates and attitude as they were measured, in; whether each gyro turns about its own axis, by as much
//! as the attitude and at the same time, out.
//!
//! Turns by the attitude, `a`, and by the gyros, `g` (`turns`). Each `a` must go with the gyro of its own axis,
//! and with no other one as well; angles must change by as much as the gyros say (an angle in degrees that is
//! said to be in radians changes 57 times as far); neither may be late, and no bias may drift (`gyros`). It
//! needs no other sensor and no model of the flight, so a gyro is told here where everything that is integrated
//! from it would contradict innocent sensors.

use super::consistency::Row;
use super::gyros::{LATE, Skew, drift, late, skew};
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::turns::{FEWEST, GYROS, Step, all, angles, runs, turns};
use crate::math::products::dot;
use crate::model::Model;

/// A gyro that goes so well with another axis, and so badly with its own, is exchanged.
const ANOTHER: f64 = 0.9;
const OWN: f64 = 0.7;
/// Angles and gyros that go so well with each other and differ by such a ratio are in different units.
const ALIKE: f64 = 0.9;
const UNITS: [f64; 2] = [0.2, 5.0];
pub const ANGLES: [&str; 3] = ["phi", "theta", "psi"];

/// What was found.
#[derive(Debug, Default)]
pub struct Axes {
    pub rows: Vec<Row>,
    /// Gyros without which there is no path, by their places among the inputs, and why.
    pub unfit: Option<(Vec<usize>, String)>,
    /// The attitude is late by this, s.
    pub late: Option<f64>,
}
/// Holds the gyros against the attitude; nothing where one of the six is not measured, or hardly moves.
pub fn axes(model: &Model, driving: &[Series], measured: &[Logged], settings: &Settings) -> Axes {
    let place = |name: &str| model.inputs.iter().position(|input| input.name == name);
    let gyro = |name: &str| driving.get(place(name)?).copied();
    let angle = |name: &str| {
        let at = model.output(name)?;
        measured.iter().find(|m| m.output == at).map(|m| (m.t, &m.z[..]))
    };
    let (Some(gyros), Some(attitude)) = (all(GYROS.map(gyro)), all(ANGLES.map(angle))) else {
        return Axes::default();
    };
    let runs = runs(gyros, attitude);
    let turns = turns(&runs);
    if turns.len() < FEWEST {
        return Axes::default();
    }
    let places = |of: &[usize]| of.iter().filter_map(|&i| place(GYROS[i])).collect();
    let units = units(&runs);
    if !units.is_empty() {
        let words: Vec<String> = units.iter().map(|(_, text)| text.clone()).collect();
        let these: Vec<usize> = units.iter().map(|(axis, _)| *axis).collect();
        let row =
            |(axis, text)| Row::of(GYROS[axis], "axis", f64::NAN, "-", ("another unit", text));
        return Axes {
            rows: units.into_iter().map(row).collect(),
            unfit: Some((places(&these), words.join("; "))),
            late: None,
        };
    }
    let pair = exchanged(&turns);
    let mut found = Axes::default();
    for axis in 0..3 {
        let verdict =
            if pair.is_some_and(|pair| pair.contains(&axis)) { "exchanged" } else { "good" };
        found.rows.push(turning(axis, &turns, verdict));
    }
    found.unfit = pair.map(|pair| {
        let [i, j] = pair.map(|axis| GYROS[axis]);
        let why = "each turns as the other one's axis does, by the attitude";
        (places(&pair), format!("{i} and {j} are exchanged: {why}"))
    });
    if pair.is_none() {
        let skews: Vec<Skew> = (0..3).filter_map(|axis| skew(axis, &runs)).collect();
        // how late they are is estimated where that is asked for
        let is_asked = ANGLES.iter().any(|angle| settings.late.iter().any(|late| late == angle));
        found.late = late(&skews).filter(|_| !is_asked);
        found.rows.extend(skews.iter().map(Skew::row));
        found.rows.extend(skews.iter().filter_map(Skew::scale_row));
        for angle in ANGLES.iter().filter(|_| found.late.is_some()) {
            let tau = found.late.unwrap_or_default();
            let text = format!("behind all gyros by {tau:.4} s");
            let row = Row::of(angle, "time skew", tau, "s", ("late", text));
            found.rows.push(Row { low: -LATE, high: LATE, ..row });
        }
        let may = |axis: usize| {
            settings.walk.contains_key(&format!("b_{}", GYROS[axis].trim_end_matches("_imu")))
        };
        found.rows.extend((0..3).filter_map(|axis| drift(axis, &runs, may(axis))));
    }
    found
}

/// Two gyros that turn about each other's axes.
fn exchanged(turns: &[[[f64; 3]; 2]]) -> Option<[usize; 2]> {
    let goes = |i: usize, j: usize| goes(turns, i, j).abs();
    let is_exchanged = |&[i, j]: &[usize; 2]| {
        goes(i, j).min(goes(j, i)) > ANOTHER && goes(i, i).max(goes(j, j)) < OWN
    };
    [[0, 1], [0, 2], [1, 2]].into_iter().find(is_exchanged)
}

/// The line of a gyro's axis.
fn turning(axis: usize, turns: &[[[f64; 3]; 2]], verdict: &'static str) -> Row {
    let own = goes(turns, axis, axis);
    let others: Vec<String> = (0..3)
        .filter(|j| *j != axis)
        .map(|j| format!("about that of {} {:.3}", GYROS[j], goes(turns, j, axis)))
        .collect();
    let text = format!(
        "correlation of its turns with those of the attitude about its axis {own:.3}; {}",
        others.join(", ")
    );
    Row::of(GYROS[axis], "axis", own, "-", (verdict, text))
}

/// Axes whose angle changes by far more, or less, than the gyros say, in words. The angle of one that is in
/// another unit stands in what is said of the next.
fn units(runs: &[Vec<Step>]) -> Vec<(usize, String)> {
    let rates = angles(runs);
    let column = |by: usize, axis: usize| rates.iter().map(|r| r[by][axis]).collect::<Vec<f64>>();
    let mut out = Vec::new();
    for axis in 0..3 {
        let [angle, gyro] = [column(0, axis), column(1, axis)];
        let ratio = dot(&angle, &gyro) / dot(&gyro, &gyro);
        if correlation(&angle, &gyro).abs() > ALIKE && !(UNITS[0]..UNITS[1]).contains(&ratio.abs())
        {
            out.push((
                axis,
                format!(
                    "{} changes {ratio:.3} times as far as {} says: one of them is in another unit (180/pi is 57.3)",
                    ANGLES[axis], GYROS[axis]
                ),
            ));
        }
    }
    out
}

/// How well turns by the attitude about axis `i` go with those by gyro `j`.
fn goes(turns: &[[[f64; 3]; 2]], i: usize, j: usize) -> f64 {
    let of = |which: usize, axis: usize| turns.iter().map(|t| t[which][axis]).collect::<Vec<f64>>();
    correlation(&of(0, i), &of(1, j))
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum()
    };
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::super::turns::turned;
    use super::*;

    /// Gyros and attitude of a flight that rolls, pitches and yaws: gyros behind by `late`, with a bias `b(t)`;
    /// the pitch angle `theta` times as large.
    fn flown(late: f64, b: impl Fn(f64) -> f64, theta: f64) -> Vec<Vec<Step>> {
        let attitude = |t: f64| {
            [
                0.3 * libm::sin(0.9 * t),
                0.05 + 0.1 * libm::sin(1.3 * t + 0.5),
                0.2 * libm::sin(0.4 * t) + 0.02 * t,
            ]
        };
        let rate = |t: f64| turned(attitude(t - 1e-4), attitude(t + 1e-4)).map(|a| a / 2e-4);
        let t: Vec<f64> = (0..12000).map(|k| 0.01 * f64::from(k)).collect();
        let slow: Vec<f64> = (0..3000).map(|k| 0.04 * f64::from(k)).collect();
        let gyro = |i: usize| t.iter().map(|t| rate(t - late)[i] + b(*t)).collect::<Vec<f64>>();
        let scale = |i: usize| if i == 1 { theta } else { 1.0 };
        let angle =
            |i: usize| slow.iter().map(|t| scale(i) * attitude(*t)[i]).collect::<Vec<f64>>();
        let (gyros, angles) = ([gyro(0), gyro(1), gyro(2)], [angle(0), angle(1), angle(2)]);
        runs(
            gyros.each_ref().map(|y| (&t[..], &y[..])),
            angles.each_ref().map(|y| (&slow[..], &y[..])),
        )
    }

    #[test]
    fn each_gyro_goes_with_its_own_axis_at_its_time() {
        let runs = flown(0.0, |_| 0.002, 1.0);
        let turns = turns(&runs);
        assert!(units(&runs).is_empty() && exchanged(&turns).is_none());
        for i in 0..3 {
            for j in 0..3 {
                let goes = goes(&turns, i, j);
                assert!(if i == j { goes > 0.999 } else { goes.abs() < 0.7 }, "{i} {j} {goes}");
            }
            let row = skew(i, &runs).expect("it is known").row();
            assert!(row.verdict == "good" && row.value.abs() < 2e-3, "{row:?}");
            let row = drift(i, &runs, false).expect("it is known");
            assert!(row.verdict == "good" && row.value.abs() < 1e-3, "{row:?}");
        }
    }

    #[test]
    fn fault_a_late_gyro_is_late_and_an_early_one_has_a_late_attitude() {
        let skews = |late: f64| -> Vec<Skew> {
            let runs = flown(late, |_| 0.0, 1.0);
            (0..3).map(|axis| skew(axis, &runs).expect("it is known")).collect()
        };
        for one in skews(0.05) {
            let row = one.row();
            assert!(row.verdict == "late" && (row.value - 0.05).abs() < 3e-3, "{row:?}");
        }
        assert_eq!(late(&skews(0.05)), None);
        for one in skews(-0.05) {
            let row = one.row();
            assert!(row.verdict == "good" && row.text.ends_with("attitude is late"), "{row:?}");
        }
        let tau = late(&skews(-0.05)).expect("the attitude is late");
        assert!((tau - 0.05).abs() < 3e-3, "{tau}");
    }

    #[test]
    fn fault_a_bias_that_drifts_is_told_where_it_is_taken_for_constant() {
        // half a degree per second a minute
        let runs = flown(0.0, |t| 0.5_f64.to_radians() / 60.0 * t, 1.0);
        let row = drift(1, &runs, false).expect("it is known");
        assert!(row.verdict == "drifts" && (row.value - 0.0145).abs() < 1e-3, "{row:?}");
        assert_eq!(drift(1, &runs, true).expect("it is known").verdict, "good");
    }

    #[test]
    fn fault_an_angle_in_degrees_that_is_said_to_be_in_radians_is_named() {
        let of = units(&flown(0.0, |_| 0.0, 1.0_f64.to_degrees()));
        assert_eq!(of.first().map(|of| of.0), Some(1), "{of:?}");
        assert!(of[0].1.starts_with("theta changes 57.") && of.len() == 1, "{of:?}");
    }
}
