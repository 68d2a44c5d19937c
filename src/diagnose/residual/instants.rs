//! A case in; which of its outputs are sampled at the same instants, and in which segments they
//! are, out.

use crate::estimate::Case;
use crate::math::median;

/// Times closer than this share of a spacing are one instant: times in logs are rounded.
const SAME: f64 = 1e-3;

/// Outputs that are sampled together.
#[derive(Debug, Clone, PartialEq)]
pub struct Set {
    /// Which of the scored outputs.
    pub outputs: Vec<usize>,
    /// Segments of the case, ascending, in which two of them or more are measured, all at the same
    /// instants.
    pub segments: Vec<usize>,
}

/// Sets of these outputs that are sampled together in most of these segments; each output is in
/// one.
pub fn together(case: &Case, segments: &[usize], outputs: &[usize]) -> Vec<Set> {
    let stamps = |s: usize, o: usize| {
        let channel = case.records[s].channels.iter().find(|c| c.output == case.outputs[o])?;
        (!channel.t.is_empty()).then_some(&channel.t[..])
    };
    let of = |outputs: &[usize]| {
        let all = |s: &usize| agree(outputs, &|o| stamps(*s, o));
        (0..case.records.len()).filter(all).collect()
    };
    let sets = grouped(segments, outputs, &stamps);
    sets.into_iter().map(|outputs| Set { segments: of(&outputs), outputs }).collect()
}

type Stamps<'a, 'c> = dyn Fn(usize, usize) -> Option<&'c [f64]> + 'a;

/// `stamps`: of a segment and an output.
fn grouped(segments: &[usize], outputs: &[usize], stamps: &Stamps) -> Vec<Vec<usize>> {
    let mostly = |a: usize, b: usize| {
        let both: Vec<bool> =
            segments.iter().filter_map(|&s| Some(same(stamps(s, a)?, stamps(s, b)?))).collect();
        2 * both.iter().filter(|same| **same).count() > both.len()
    };
    let mut sets: Vec<Vec<usize>> = Vec::new();
    for &o in outputs {
        match sets.iter_mut().find(|set| mostly(set[0], o)) {
            Some(set) => set.push(o),
            None => sets.push(vec![o]),
        }
    }
    sets
}

/// Whether those of the outputs that are measured have the same stamps; not where there is but one.
fn agree<'c>(outputs: &[usize], stamps: &dyn Fn(usize) -> Option<&'c [f64]>) -> bool {
    let measured: Vec<&[f64]> = outputs.iter().filter_map(|&o| stamps(o)).collect();
    measured.len() > 1 && measured.iter().all(|t| same(measured[0], t))
}

fn same(a: &[f64], b: &[f64]) -> bool {
    if a == b {
        return true;
    }
    let spacing = median(&a.windows(2).map(|w| w[1] - w[0]).collect::<Vec<_>>());
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME * spacing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_segments_decide_and_rounded_stamps_are_the_same() {
        let clock: Vec<f64> = (0..50).map(|k| 3.0 + 0.02 * f64::from(k)).collect();
        let rounded: Vec<f64> = clock.iter().map(|t| t + 1e-5).collect();
        let (short, late) = (&clock[1..], clock.iter().map(|t| t + 0.004).collect::<Vec<_>>());
        // Output 1 lost a sample in segment 0, output 2 has a clock of its own, output 3 is
        // measured in segment 3 alone.
        let stamps = |s: usize, o: usize| match (s, o) {
            (0, 1) => Some(short),
            (_, 1) => Some(&rounded[..]),
            (_, 2) => Some(&late[..]),
            (0..3, 3) => None,
            _ => Some(&clock[..]),
        };
        let sets = grouped(&[0, 1, 2, 3], &[0, 1, 2, 3], &stamps);
        assert_eq!(sets, [vec![0, 1, 3], vec![2]]);
        let agreeing: Vec<usize> = (0..4).filter(|&s| agree(&sets[0], &|o| stamps(s, o))).collect();
        assert_eq!(agreeing, [1, 2, 3]);
        assert!(!agree(&sets[1], &|o| stamps(1, o)));
    }
}
