//! Labels of maneuvers and settings in; which maneuvers are held out, and the rule in words, out.
//! Few long records are cut into blocks of time first.

use super::settings::Settings;
use crate::estimate::{Segment, Stretch};

/// How the held-out maneuvers were chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    pub held_out: Vec<bool>,
    pub words: String,
    /// Names in the settings that no maneuver and no flight has.
    pub unknown: Vec<String>,
}

/// Chooses by the settings, or by the fixed rule: every `hold_every`-th maneuver of each input, in
/// the order given.
pub fn held_out(segments: &[Segment], names: &[String], settings: &Settings) -> Rule {
    if !settings.held_out.is_empty() {
        // A maneuver by its name, or with all others of its flight.
        let is_meant = |(segment, name): (&Segment, &String), meant: &String| {
            name == meant || segment.labels.get("flight") == Some(meant)
        };
        let all = || segments.iter().zip(names);
        let held_out =
            all().map(|one| settings.held_out.iter().any(|meant| is_meant(one, meant))).collect();
        let unknown = settings.held_out.iter();
        let unknown =
            unknown.filter(|meant| !all().any(|one| is_meant(one, meant))).cloned().collect();
        return Rule { held_out, words: "chosen by the settings".into(), unknown };
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
    let which = match every {
        2 => "second".to_string(),
        3 => "third".to_string(),
        _ => format!("{every}th"),
    };
    let words = format!("every {which} maneuver of each input, in the order of flights and time");
    Rule { held_out, words, unknown: Vec::new() }
}

/// Segments and their names as they are, or, where there are fewer than `hold_every`, cut into
/// blocks of equal time (of at least `block_s`), so that some can be held out. The model runs
/// through a record from its beginning all the same, once for each block, so that what is slow in
/// it stays visible: start values come from the blocks of the training.
pub fn cut(
    segments: Vec<Segment>,
    names: Vec<String>,
    settings: &Settings,
) -> (Vec<Segment>, Vec<String>) {
    if segments.len() >= settings.hold_every.max(2) || !settings.held_out.is_empty() {
        return (segments, names);
    }
    let (mut blocks, mut block_names) = (Vec::new(), Vec::new());
    for (segment, name) in segments.into_iter().zip(names) {
        let (record, dt) = (&segment.record, segment.record.dt);
        let steps = record.n.saturating_sub(record.start + 1);
        let most = (steps as f64 * dt / settings.block_s.max(dt)).floor() as usize;
        let count = most.clamp(1, settings.thresholds.blocks);
        // half a step before a point of the grid: rounding never moves a sample into another block
        let edge = |i: usize| record.t0 + ((record.start + i * steps / count) as f64 - 0.5) * dt;
        let stretch = |i: usize| Stretch {
            of: name.clone(),
            from: edge(i),
            to: if i + 1 == count { f64::INFINITY } else { edge(i + 1) },
        };
        if count == 1 {
            block_names.push(name);
            blocks.push(segment);
            continue;
        }
        blocks.extend((0..count).map(|i| Segment { stretch: Some(stretch(i)), ..segment.clone() }));
        block_names.extend((1..=count).map(|i| format!("{name}/{i}")));
    }
    (blocks, block_names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{Channel, Record};

    #[test]
    fn one_long_record_is_cut_into_blocks_that_cover_it() {
        let t: Vec<f64> = (0..=400).map(|k| 5.0 + 0.1 * f64::from(k)).collect();
        let channel = Channel { output: 0, t: t.clone().into(), z: t.clone().into() };
        let record = Record {
            t0: 5.0,
            dt: 0.1,
            n: 401,
            inputs: t.clone().into(),
            channels: vec![channel],
            ..Record::default()
        };
        let (blocks, names) = cut(
            vec![Segment::from(record)],
            vec!["f".into()],
            &Settings { block_s: 10.0, ..Settings::default() },
        );
        assert_eq!(names, ["f/1", "f/2", "f/3", "f/4"]);
        let samples: Vec<f64> =
            blocks.iter().flat_map(|b| b.scored().channels[0].z.to_vec()).collect();
        assert_eq!(samples, t);
        for b in blocks {
            let r = b.scored();
            assert!(r.channels[0].t.iter().all(|t| r.weights(*t).is_some()), "{} {}", r.start, r.n);
            assert_eq!(r.inputs.len(), r.n);
        }
    }

    #[test]
    fn every_third_maneuver_of_each_input_is_held_out() {
        let with = |input: &str| Segment {
            labels: [("input".to_string(), input.to_string())].into(),
            ..Segment::default()
        };
        let segments = ["a", "a", "b", "a", "b", "b", "a"].map(with);
        let names: Vec<String> = (0..7).map(|i| format!("s{i}")).collect();
        let held = held_out(&segments, &names, &Settings::default()).held_out;
        assert_eq!(held, [false, false, false, true, false, true, false]);
        let settings =
            Settings { held_out: vec!["s6".into(), "s06".into()], ..Settings::default() };
        let rule = held_out(&segments, &names, &settings);
        let of_flight: Vec<Segment> = ["f", "f", "g"]
            .map(|flight| Segment {
                labels: [("flight".to_string(), flight.to_string())].into(),
                ..Segment::default()
            })
            .to_vec();
        let whole = Settings { held_out: vec!["f".into()], ..Settings::default() };
        let whole = held_out(&of_flight, &names[..3], &whole);
        assert_eq!((&whole.held_out[..], whole.unknown.len()), (&[true, true, false][..], 0));
        assert_eq!(
            (rule.held_out.iter().filter(|h| **h).count(), &rule.unknown[..]),
            (1, &["s06".to_string()][..])
        );
    }
}
