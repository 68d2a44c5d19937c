//! Labels of maneuvers and settings in; which maneuvers are held out, and the rule in words, out.

use super::Settings;
use crate::estimate::Segment;

/// How the held-out maneuvers were chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    pub held_out: Vec<bool>,
    pub words: String,
}

/// Chooses by the settings, or by the fixed rule: every `hold_every`-th maneuver of each input, in the order given.
pub fn held_out(segments: &[Segment], names: &[String], settings: &Settings) -> Rule {
    if !settings.held_out.is_empty() {
        let held_out = names.iter().map(|name| settings.held_out.contains(name)).collect();
        return Rule { held_out, words: "chosen by the settings".into() };
    }
    let every = settings.hold_every.max(2);
    let mut counts: Vec<(String, usize)> = Vec::new();
    let mut hold = |segment: &Segment| {
        let input = segment.labels.get("input").cloned().unwrap_or_default();
        let at = counts.iter().position(|(name, _)| *name == input).unwrap_or(counts.len());
        if at == counts.len() {
            counts.push((input, 0));
        }
        counts[at].1 += 1;
        counts[at].1.is_multiple_of(every)
    };
    let held_out: Vec<bool> = segments.iter().map(&mut hold).collect();
    Rule { held_out, words: format!("every {every}th maneuver of each input, in the order of flights and time") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_third_maneuver_of_each_input_is_held_out() {
        let with = |input: &str| Segment { labels: [("input".to_string(), input.to_string())].into(), ..Segment::default() };
        let segments = ["a", "a", "b", "a", "b", "b", "a"].map(with);
        let names: Vec<String> = (0..7).map(|i| format!("s{i}")).collect();
        let held = held_out(&segments, &names, &Settings::default()).held_out;
        assert_eq!(held, [false, false, false, true, false, true, false]);
        let settings = Settings { held_out: vec!["s6".into()], ..Settings::default() };
        assert_eq!(held_out(&segments, &names, &settings).held_out.iter().filter(|h| **h).count(), 1);
    }
}
