//! Where a state is on a limit in a segment in; what was measured there, piece by piece, out.

use super::case::Case;
use crate::dynamics::Channel;

/// What is said of one stretch on a limit is said of pieces of at most so many seconds.
const PIECE_S: f64 = 2.0;
/// A mean of fewer samples is no point.
const SAMPLES: usize = 5;

/// A piece of a stretch on a limit.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// Place of the segment among those used.
    pub place: usize,
    /// Begin and length, s.
    pub t: f64,
    pub seconds: f64,
    /// Samples of the output that has the state's name, and their mean.
    pub count: usize,
    pub measured: f64,
    /// Mean of the limit.
    pub modelled: f64,
    /// Per input asked for its mean, and its change from begin to end.
    pub inputs: Vec<[f64; 2]>,
}

/// A state and a limit of it along a segment.
pub struct Along<'a> {
    pub state: usize,
    pub place: usize,
    /// Whether it is on the limit, and the limit, at every grid point behind the start.
    pub active: &'a [bool],
    pub bound: &'a [f64],
    /// Inputs (indices) that are asked for.
    pub inputs: &'a [usize],
}

impl Case {
    /// Input `j` at grid point `k` behind the start of segment `s`.
    pub fn driven(&self, s: usize, k: usize, j: usize) -> f64 {
        let (record, nu) = (&self.records[s], self.model.inputs.len());
        record.inputs.get((record.start + k) * nu + j).copied().unwrap_or(f64::NAN)
    }

    /// The stretches on a limit, in pieces; none of a state that no output of its name measures.
    pub fn plateaus(&self, along: &Along) -> Vec<Piece> {
        let Some(channel) = self.measured_of(along.state, along.place) else { return Vec::new() };
        let (n, dt) = (along.active.len(), self.records[along.place].dt);
        let (mut all, mut begin) = (Vec::new(), 0);
        while begin < n {
            let on = along.active[begin];
            let end = (begin..n).find(|k| along.active[*k] != on).unwrap_or(n);
            let points = end - begin;
            let count =
                if on { (points as f64 * dt / PIECE_S).ceil().max(1.0) as usize } else { 0 };
            for piece in 0..count {
                let [from, to] = [piece, piece + 1].map(|i| begin + points * i / count);
                all.extend(self.piece(along, channel, from, to));
            }
            begin = end;
        }
        all
    }

    /// What was measured of a state in a segment: the output that has its name.
    pub fn measured_of(&self, state: usize, s: usize) -> Option<&Channel> {
        let output = self.model.output(&self.model.states[state].quantity.name)?;
        self.records[s].channels.iter().find(|c| c.output == output)
    }

    /// Grid points `from` to before `to` on a limit; none where hardly a sample was measured there.
    fn piece(&self, along: &Along, channel: &Channel, from: usize, to: usize) -> Option<Piece> {
        let (record, s) = (&self.records[along.place], along.place);
        let last = to.checked_sub(1).filter(|last| *last >= from)?;
        let time = |k: usize| record.t0 + (record.start + k) as f64 * record.dt;
        let within = time(from)..=time(last);
        let samples = channel.t.iter().zip(&channel.z);
        let inside = samples.filter(|(t, z)| within.contains(t) && z.is_finite());
        let (sum, count) = inside.fold((0.0, 0), |(sum, count), (_, z)| (sum + z, count + 1));
        let points = (to - from) as f64;
        let input = |j: &usize| {
            let mean = (from..to).map(|k| self.driven(s, k, *j)).sum::<f64>() / points;
            [mean, self.driven(s, last, *j) - self.driven(s, from, *j)]
        };
        (count >= SAMPLES).then(|| Piece {
            place: s,
            t: time(from),
            seconds: time(last) - time(from),
            count,
            measured: sum / count as f64,
            modelled: along.bound[from..to].iter().sum::<f64>() / points,
            inputs: along.inputs.iter().map(input).collect(),
        })
    }
}
