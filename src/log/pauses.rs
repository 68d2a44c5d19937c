//! The signals of a flight in; what is to be said of the times without samples, out.
//!
//! Where every topic is silent for a second and more the recorder was paused, as between test points:
//! that is said once. A gap of some of the signals is a loss, and a warning.

use super::Note;

/// Silence of all topics is a pause from so many seconds on.
const PAUSE: f64 = 1.0;
/// A gap is longer than so many usual spacings, and this, s (`Spacing`).
const SPACINGS: f64 = 3.0;
const SHORTEST: f64 = 0.005;

/// Times in seconds are not more exact.
const ROUNDING: f64 = 1e-9;

/// A signal as it was recorded.
pub(super) struct Recorded<'a> {
    pub name: &'a str,
    pub topic: &'a str,
    pub field: &'a str,
    pub rate_hz: f64,
    pub t_s: &'a [f64],
}

/// A time without samples, s.
type Gap = (f64, f64);

/// Notes on gaps: one on all pauses of the recorder, and one for each signal that has others.
pub(super) fn notes(signals: &[Recorded]) -> Vec<Note> {
    let mut pauses: Vec<Gap> = Vec::new();
    let mut notes = Vec::new();
    for signal in signals {
        let mut lost: Vec<Gap> = Vec::new();
        for gap in gaps(signal) {
            match is_pause(gap, limit(signal), signals) {
                true => pauses.push(gap),
                false => lost.push(gap),
            }
        }
        let longest = lost.iter().map(|(from, to)| to - from).fold(0.0, f64::max);
        if lost.is_empty() {
            continue;
        }
        let text = format!(
            "{} {}: {} gaps, the longest {longest:.3} s at a usual spacing of {:.4} s",
            signal.topic,
            signal.field,
            lost.len(),
            1.0 / signal.rate_hz
        );
        notes.push(Note::warning(signal.name, lost.len() as u64, text));
    }
    notes.extend(paused(pauses));
    notes
}

/// The gaps of a signal.
fn gaps(signal: &Recorded) -> Vec<Gap> {
    let limit = limit(signal);
    let steps = signal.t_s.windows(2).map(|w| (w[0], w[1]));
    steps.filter(|(from, to)| to - from > limit + ROUNDING).collect()
}

fn limit(signal: &Recorded) -> f64 {
    (SPACINGS / signal.rate_hz).max(SHORTEST)
}

/// Whether no signal has a sample inside a gap, and several topics would have had some.
/// `slack`: how much longer than the silence the gap is, on both sides.
fn is_pause((from, to): Gap, slack: f64, signals: &[Recorded]) -> bool {
    let mut silent: Vec<&str> = Vec::new();
    for signal in signals {
        let t = signal.t_s;
        let usual = limit(signal) + slack;
        let (a, b) = (from + usual, to - usual);
        if t.is_empty() || !(a < b) {
            continue;
        }
        if t.partition_point(|t| *t <= a) < t.partition_point(|t| *t < b) {
            return false;
        }
        if !silent.contains(&signal.topic) {
            silent.push(signal.topic);
        }
    }
    to - from >= PAUSE && silent.len() > 1
}

/// The pauses of all signals are one where they overlap.
fn paused(mut pauses: Vec<Gap>) -> Option<Note> {
    pauses.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut joined: Vec<Gap> = Vec::new();
    for (from, to) in pauses {
        match joined.last_mut().filter(|last| from < last.1) {
            Some(last) => last.1 = last.1.max(to),
            None => joined.push((from, to)),
        }
    }
    let longest = joined.iter().map(|(from, to)| to - from).fold(0.0, f64::max);
    let text = format!(
        "there is nothing at {} places, {longest:.1} s at the longest: the recorder was paused, or what it wrote is lost or was dropped (other notes say so)",
        joined.len()
    );
    (!joined.is_empty()).then(|| Note::info("file", joined.len() as u64, text))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(rate_hz: f64, silent: &[Gap]) -> Vec<f64> {
        let all = (0..(60.0 * rate_hz) as usize).map(|k| k as f64 / rate_hz);
        all.filter(|t| silent.iter().all(|(from, to)| t < from || t > to)).collect()
    }

    #[test]
    fn silence_of_all_topics_is_a_pause_and_that_of_one_a_loss() {
        let pause = (20.0, 40.0);
        let (q, alpha) = (times(100.0, &[pause, (50.0, 50.5)]), times(20.0, &[pause]));
        // The slow one is too slow to tell.
        let (fuel, tas) = (times(0.1, &[]), times(20.0, &[]));
        let of = |name: &'static str, topic: &'static str, rate_hz: f64, t_s| Recorded {
            name,
            topic,
            field: "x",
            rate_hz,
            t_s,
        };
        let mut signals = vec![
            of("q", "/imu", 100.0, &q[..]),
            of("alpha", "/air", 20.0, &alpha),
            of("fuel", "/slow", 0.1, &fuel),
        ];
        let found = notes(&signals);
        let texts: Vec<(&str, u64)> = found.iter().map(|n| (n.subject.as_str(), n.count)).collect();
        assert_eq!(texts, [("q", 1), ("file", 1)], "{found:?}");
        signals.push(of("tas", "/other", 20.0, &tas));
        let found = notes(&signals);
        assert!(found.iter().all(|n| n.subject != "file") && found.len() == 2, "{found:?}");
    }
}
