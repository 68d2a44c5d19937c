//! The maneuvers of a flight, or its grid and what drives a model, come in; the stretches of the
//! flight that an estimate sees, with their names, go out.

use super::records::Window;
use super::settings::{LABELS, Settings, Used};
use crate::error::Result;
use crate::table::Table;
use indexmap::IndexMap;
use std::ops::Range;

/// A stretch of flight and what is known of it.
pub struct Stretch {
    /// Segment id, and those of maneuvers that overlap with it and are one with it.
    pub names: Vec<String>,
    /// From when to when its steps are flown, s; all of a whole record.
    pub steps: [f64; 2],
    /// The steps with the time before and behind them.
    pub window: Window,
    /// Rows of the samples that it may use; what lies around them is not there for it.
    pub rows: Range<usize>,
    pub labels: IndexMap<String, String>,
}

fn of_flight(flight: &str) -> IndexMap<String, String> {
    IndexMap::from([("flight".to_string(), flight.to_string())])
}

/// The included maneuvers of the input, in order of time, on the grid `t` of a flight. No sample is in two
/// windows: data that count twice would pass for twice the knowledge.
pub fn maneuvers(
    settings: &Settings,
    input: &Used,
    (flight, t): (&str, &[f64]),
    segments: &Table,
) -> Result<Vec<Stretch>> {
    let (names, kinds, found_in) =
        (segments.strings("segment")?, segments.strings("kind")?, segments.strings("input")?);
    let (starts, ends, included) =
        (segments.f64("t_start_s")?, segments.f64("t_end_s")?, segments.bools("included")?);
    let polarity = segments.i64("polarity")?;
    let of_ours = |i: usize| input.names().iter().any(|name| name == found_in[i]);
    let of_kind =
        |i: usize| settings.kinds.is_empty() || settings.kinds.iter().any(|kind| kind == kinds[i]);
    let overlap = |i: usize, k: usize| starts[i] < ends[k] && starts[k] < ends[i];
    let alone = |i: usize| !(0..names.len()).any(|k| !of_ours(k) && overlap(i, k));
    let wanted =
        |i: &usize| included[*i] && of_ours(*i) && of_kind(*i) && (!settings.alone || alone(*i));
    let window = |i: usize| Window {
        from: starts[i] - settings.pre_s,
        to: ends[i] + settings.post_s,
        preroll: settings.preroll_s,
        settle: settings.settle_s,
    };
    // (last maneuver so far, stretch): in order of time, so that an overlap is one with the stretch
    // before
    let mut used: Vec<(usize, Stretch)> = Vec::new();
    for i in (0..names.len()).filter(wanted) {
        if let Some((last, stretch)) = used.last_mut().filter(|(last, _)| overlap(*last, i)) {
            stretch.window.to = stretch.window.to.max(window(i).to);
            stretch.steps[1] = stretch.steps[1].max(ends[i]);
            stretch.names.push(names[i].to_string());
            *last = if ends[i] > ends[*last] { i } else { *last };
            continue;
        }
        let values = [kinds[i].to_string(), found_in[i].to_string(), polarity[i].to_string()];
        let labels = of_flight(flight)
            .into_iter()
            .chain(LABELS.iter().map(ToString::to_string).zip(values))
            .collect();
        let names = vec![names[i].to_string()];
        let steps = [starts[i], ends[i]];
        used.push((i, Stretch { names, steps, window: window(i), rows: 0..t.len(), labels }));
    }
    let mut stretches: Vec<Stretch> = used.into_iter().map(|(_, stretch)| stretch).collect();
    for k in 1..stretches.len() {
        let [before, after] = [k - 1, k].map(|k| (stretches[k].steps, stretches[k].window));
        if before.1.to > after.1.from {
            // In the middle of what both would have, but never among the steps; between two points of the grid.
            let middle = 0.5 * (before.1.to + after.1.from);
            let cut = between(t, middle.max(before.0[1]).min(after.0[0]));
            stretches[k - 1].window.to = cut;
            stretches[k].window.from = cut;
        }
    }
    Ok(stretches)
}

/// The middle of the grid's step in which `at` is.
fn between(t: &[f64], at: f64) -> f64 {
    let (Some(&t0), Some(&t1)) = (t.first(), t.get(1)) else { return at };
    t0 + (((at - t0) / (t1 - t0)).floor() + 0.5) * (t1 - t0)
}

/// What is between two gaps of the inputs is of use where it lasts so long, s, ...
const SHORTEST: f64 = 1.0;
/// ... and holds so many samples: a model begins anew behind a gap, with initial states of its own.
const FEWEST: usize = 10;

/// What can be used of a flight's whole record.
pub struct Whole {
    pub stretches: Vec<Stretch>,
    /// What was lost; none where every input has a value at every sample.
    pub lost: Option<Lost>,
}

/// What a whole record lost because inputs have no value there.
pub struct Lost {
    /// Samples of the grid that are not used.
    pub samples: usize,
    /// More than the ends by less than what would be of use.
    pub matters: bool,
    pub text: String,
}

/// The flight's whole record as far as all inputs of the model have values, in equal pieces where
/// that is asked for. Names are numbered where there are several.
pub fn whole(settings: &Settings, flight: &str, t: &[f64], inputs: &[(&str, &[f64])]) -> Whole {
    let there = |k: usize| inputs.iter().all(|(_, values)| values[k].is_finite());
    let parts = runs(t.len(), there);
    let complete = parts.iter().map(Range::len).sum::<usize>() == t.len();
    let lasts = |rows: &Range<usize>| t[rows.end - 1] - t[rows.start];
    let of_use = |rows: &Range<usize>| rows.len() >= FEWEST && lasts(rows) >= SHORTEST;
    let (used, short): (Vec<_>, Vec<_>) =
        parts.into_iter().partition(|rows| complete || of_use(rows));
    let windows: Vec<Vec<Window>> =
        used.iter().map(|rows| pieces(t[rows.start], t[rows.end - 1], settings)).collect();
    let several = windows.iter().map(Vec::len).sum::<usize>() > 1;
    let name = |i: usize| if several { format!("{flight}-{i:03}") } else { flight.to_string() };
    let (mut stretches, mut words) = (Vec::new(), Vec::new());
    for (rows, windows) in used.iter().zip(windows) {
        let first = stretches.len() + 1;
        stretches.extend(windows.into_iter().enumerate().map(|(i, window)| Stretch {
            names: vec![name(first + i)],
            steps: [window.from, window.to],
            window,
            rows: rows.clone(),
            labels: of_flight(flight),
        }));
        let last = stretches.len();
        let to = if last > first { format!(" to {}", name(last)) } else { String::new() };
        words.push(format!("{} as {}{to}", span(t, rows), name(first)));
    }
    let lost = (!complete).then(|| {
        let kept: f64 = used.iter().map(lasts).sum();
        let gone = t[t.len() - 1] - t[0] - kept;
        Lost {
            samples: t.len() - used.iter().map(Range::len).sum::<usize>(),
            matters: used.len() != 1 || gone > SHORTEST,
            text: lost(t, inputs, gone, (&words, &short)),
        }
    });
    Whole { stretches, lost }
}

/// What was lost of a record, in words: how much and why, what is used, what is too short.
fn lost(
    t: &[f64],
    inputs: &[(&str, &[f64])],
    gone: f64,
    (used, short): (&[String], &[Range<usize>]),
) -> String {
    let masked = |(name, values): &(&str, &[f64])| {
        let n = values.iter().filter(|v| !v.is_finite()).count();
        (n > 0).then(|| format!("`{name}` at {n}"))
    };
    let why: Vec<String> = inputs.iter().filter_map(masked).collect();
    let mut text = format!(
        "{gone:.2} s of {:.2} s are not used, because inputs have no value ({} of {} samples); ",
        t[t.len() - 1] - t[0],
        why.join(", "),
        t.len()
    );
    text += &match used {
        [] => "nothing is left to use".to_string(),
        used => format!("used: {}", used.join(", ")),
    };
    if !short.is_empty() {
        let short: Vec<String> = short.iter().map(|rows| span(t, rows)).collect();
        text += &format!(
            "; shorter than {SHORTEST} s or {FEWEST} samples, so of no use: {}",
            short.join(", ")
        );
    }
    text
}

fn span(t: &[f64], rows: &Range<usize>) -> String {
    format!("{:.2} s to {:.2} s", t[rows.start], t[rows.end - 1])
}

/// Where something holds, of `0..n`.
fn runs(n: usize, holds: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut begin = 0;
    while begin < n {
        let end = (begin..n).find(|k| holds(*k) != holds(begin)).unwrap_or(n);
        if holds(begin) {
            runs.push(begin..end);
        }
        begin = end;
    }
    runs
}

/// A stretch of a record, or its equal pieces.
fn pieces(from: f64, to: f64, settings: &Settings) -> Vec<Window> {
    let longest = settings.window_s;
    let n = if longest > 0.0 { ((to - from) / longest).ceil().max(1.0) as usize } else { 1 };
    let at = |i: usize| from + (to - from) * i as f64 / n as f64;
    let (preroll, settle) = (settings.preroll_s, settings.settle_s);
    (0..n).map(|i| Window { from: at(i), to: at(i + 1), preroll, settle }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(longest: f64) -> Settings {
        toml::from_str(&format!("model = \"m\"\nwindow_s = {longest:?}")).expect("settings")
    }

    fn names(whole: &Whole) -> Vec<&str> {
        whole.stretches.iter().map(|s| s.names[0].as_str()).collect()
    }

    /// 43 s at 10 Hz from 2 s on; the input has no value from a sample to before another.
    fn record(longest: f64, gone: &[[usize; 2]]) -> Whole {
        let t: Vec<f64> = (0..431).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        let mut u = vec![1.0; 431];
        gone.iter().for_each(|[from, to]| u[*from..*to].fill(f64::NAN));
        whole(&settings(longest), "f", &t, &[("u", &u)])
    }

    /// Maneuvers of 3 s every 8 s, with 3 s before and 6 s behind them: the windows meet in the middle of
    /// what both would have, and where the next one begins at once, between the steps.
    #[test]
    fn no_sample_is_in_two_windows() {
        let settings: Settings =
            toml::from_str("model = \"m\"\ninput = \"u\"\npre_s = 3.0\npost_s = 6.0")
                .expect("settings");
        let table = Table::build("segments")
            .repeat("flight", "f")
            .strings("segment", ["f.01", "f.02", "f.03"])
            .repeat("kind", "3211")
            .repeat("input", "u")
            .f64("t_start_s", [10.0, 18.0, 21.0])
            .f64("t_end_s", [13.0, 21.0, 24.0])
            .f64("unit_time_s", [0.5; 3])
            .f64("amplitude", [1.0; 3])
            .i64("polarity", [1; 3])
            .f64("score", [1.0; 3])
            .bools("included", [true; 3])
            .opt_strings("reason", [None::<&str>; 3])
            .finish()
            .expect("segments");
        let t: Vec<f64> = (0..500).map(|k| 0.1 * f64::from(k)).collect();
        let input = settings.input.as_ref().expect("an input");
        let all = maneuvers(&settings, input, ("f", &t), &table).expect("stretches");
        let ends: Vec<f64> = all.iter().flat_map(|s| [s.window.from, s.window.to]).collect();
        let wanted = [7.0, 17.05, 17.05, 21.05, 21.05, 30.0];
        assert!(ends.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{ends:?}");
        assert_eq!(all[1].steps, [18.0, 21.0]);
    }

    #[test]
    fn a_record_is_cut_into_equal_stretches_that_cover_it() {
        let one = record(0.0, &[]);
        let window = one.stretches[0].window;
        assert_eq!((names(&one), window.from, window.to), (vec!["f"], 2.0, 45.0));
        let cut = record(20.0, &[]);
        assert_eq!(names(&cut), ["f-001", "f-002", "f-003"]);
        let windows: Vec<Window> = cut.stretches.iter().map(|s| s.window).collect();
        assert_eq!((windows[0].from, windows[2].to), (2.0, 45.0));
        assert!(windows.windows(2).all(|w| w[0].to == w[1].from));
        assert!(windows.iter().all(|w| (w.to - w.from - 43.0 / 3.0).abs() < 1e-12));
        assert!(one.lost.is_none() && cut.lost.is_none());
    }

    #[test]
    fn a_record_is_cut_to_where_its_inputs_are() {
        let cut = record(0.0, &[[0, 3], [429, 431]]);
        let (stretch, lost) = (&cut.stretches[0], cut.lost.expect("something was lost"));
        assert_eq!((stretch.names[0].as_str(), stretch.rows.clone()), ("f", 3..429));
        assert!(
            (stretch.window.from - 2.3).abs() < 1e-9 && (stretch.window.to - 44.8).abs() < 1e-9
        );
        assert_eq!((lost.samples, lost.matters), (5, false));
        assert_eq!(
            lost.text,
            "0.50 s of 43.00 s are not used, because inputs have no value (`u` at 5 of 431 samples); used: 2.30 s to 44.80 s as f"
        );
        assert!(record(0.0, &[[0, 20]]).lost.expect("lost").matters);
    }

    #[test]
    fn a_gap_parts_a_record_and_what_is_too_short_is_left_out() {
        let cut = record(0.0, &[[100, 120], [125, 130]]);
        assert_eq!(names(&cut), ["f-001", "f-002"]);
        assert_eq!(
            (cut.stretches[0].rows.clone(), cut.stretches[1].rows.clone()),
            (0..100, 130..431)
        );
        let lost = cut.lost.expect("lost");
        assert_eq!((lost.samples, lost.matters), (30, true));
        assert_eq!(
            lost.text,
            "3.10 s of 43.00 s are not used, because inputs have no value (`u` at 25 of 431 samples); \
             used: 2.00 s to 11.90 s as f-001, 15.00 s to 45.00 s as f-002; \
             shorter than 1 s or 10 samples, so of no use: 14.00 s to 14.40 s"
        );
        let pieces = record(20.0, &[[100, 130]]);
        assert_eq!(names(&pieces), ["f-001", "f-002", "f-003"]);
        assert!(pieces.lost.expect("lost").text.ends_with("15.00 s to 45.00 s as f-002 to f-003"));
    }

    #[test]
    fn a_record_without_an_input_leaves_nothing() {
        let none = record(0.0, &[[0, 431]]);
        assert!(none.stretches.is_empty());
        assert!(none.lost.expect("lost").text.ends_with("nothing is left to use"));
    }
}
