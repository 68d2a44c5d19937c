//! Samples of a signal, and which of them are left out, in; those with their neighbours out, so that
//! people can see what was taken for wrong.

use super::series::seconds;

/// What became of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    Kept,
    OutOfRange,
    Spike,
}

impl Fate {
    /// As tables have it.
    pub fn word(self) -> &'static str {
        match self {
            Fate::Kept => "kept",
            Fate::OutOfRange => "out of range",
            Fate::Spike => "spike",
        }
    }
}

/// A sample that is left out, or a neighbour of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Counts the places of a signal, from 0.
    pub place: usize,
    pub t_s: f64,
    /// SI.
    pub value: f64,
    pub fate: Fate,
}

/// Neighbours on either side. Samples nearer than twice that are one place.
const AROUND: usize = 20;
/// Places that come with their neighbours; of the others there are the samples left out alone.
const DRAWN: usize = 6;

/// What is left out of `samples` (stamps, ns, and SI), place by place.
pub(super) fn seen(samples: &[(i64, f64)], fates: &[Fate], delay: f64) -> Vec<Seen> {
    let out: Vec<usize> = (0..samples.len()).filter(|&k| fates[k] != Fate::Kept).collect();
    let mut all = Vec::new();
    for (place, near) in out.chunk_by(|a, b| b - a <= 2 * AROUND).enumerate() {
        let (first, last) = (near[0], near[near.len() - 1]);
        let around = first.saturating_sub(AROUND)..(last + AROUND + 1).min(samples.len());
        let taken = around.filter(|&k| place < DRAWN || fates[k] != Fate::Kept);
        all.extend(taken.map(|k| Seen {
            place,
            t_s: seconds(samples[k].0) - delay,
            value: samples[k].1,
            fate: fates[k],
        }));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_comes_with_its_neighbours_and_no_sample_twice() {
        let samples: Vec<(i64, f64)> = (0..500).map(|k| (k * 10_000_000, k as f64)).collect();
        let mut fates = vec![Fate::Kept; 500];
        fates[3] = Fate::Spike;
        fates[30] = Fate::OutOfRange;
        fates[300] = Fate::Spike;
        let all = seen(&samples, &fates, 0.5);
        // the first two are one place: from the first sample to the 51st
        assert_eq!(all.iter().filter(|s| s.place == 0).count(), 51);
        assert_eq!(all.iter().filter(|s| s.place == 1).count(), 41);
        assert!(all.windows(2).all(|two| two[0].t_s < two[1].t_s));
        let out: Vec<f64> = all.iter().filter(|s| s.fate != Fate::Kept).map(|s| s.value).collect();
        assert_eq!(out, [3.0, 30.0, 300.0]);
        assert!((all[3].t_s - (0.03 - 0.5)).abs() < 1e-12);
        // many places: the later ones without neighbours
        (0..10).for_each(|i| fates[i * 45] = Fate::Spike);
        let all = seen(&samples, &fates, 0.0);
        assert!(all.iter().filter(|s| s.place >= DRAWN).all(|s| s.fate == Fate::Spike));
        assert!(seen(&samples, &vec![Fate::Kept; 500], 0.0).is_empty());
    }
}
