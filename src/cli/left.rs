//! How much of some work is done and for how long it has run come in; how long it will still take, and
//! times in words, go out.

use std::time::Duration;

/// Before so much time has passed, or so small a share is done, nobody knows.
pub const SOON: Duration = Duration::from_secs(3);
const LITTLE: f64 = 0.02;

/// How long work will still take whose `share` (0 to 1) took `passed`, if it goes on as it did; none where that
/// is not known yet, or nothing is left.
pub fn left(share: f64, passed: Duration) -> Option<Duration> {
    let known = passed >= SOON && (LITTLE..1.0).contains(&share);
    known.then(|| passed.mul_f64((1.0 - share) / share))
}

/// That in words: `, about 3 min left`; empty where it is not known.
pub fn words(share: f64, passed: Duration) -> String {
    left(share, passed).map_or(String::new(), |left| format!(", about {} left", rough(left)))
}

/// A time that has passed: `45 s`, `1 min 20 s`, `2 h 5 min`.
pub fn spoken(time: Duration) -> String {
    match time.as_secs() {
        s @ 0..60 => format!("{s} s"),
        s @ 60..3600 => format!("{} min {} s", s / 60, s % 60),
        s => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

/// A time that is guessed, with as many digits as a guess has.
fn rough(time: Duration) -> String {
    match time.as_secs() {
        s @ 0..55 => format!("{} s", s.div_ceil(5).max(1) * 5),
        s @ 55..3570 => format!("{} min", (s + 30) / 60),
        s => format!("{} h {} min", s / 3600, s % 3600 / 600 * 10),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn s(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn what_is_left_follows_from_what_is_done() {
        assert_eq!(left(0.25, s(60)), Some(s(180)));
        assert_eq!(words(0.25, s(60)), ", about 3 min left");
        assert_eq!(words(0.5, s(20)), ", about 20 s left");
        assert_eq!(words(0.1, s(3600)), ", about 9 h 0 min left");
        for (share, passed) in [(0.0, s(60)), (0.01, s(60)), (1.0, s(60)), (0.5, s(1))] {
            assert_eq!(words(share, passed), "", "{share} {passed:?}");
        }
    }

    #[test]
    fn times_are_in_words() {
        let all = [0, 59, 80, 3600, 7500].map(|seconds| spoken(s(seconds)));
        assert_eq!(all, ["0 s", "59 s", "1 min 20 s", "1 h 0 min", "2 h 5 min"]);
    }
}
