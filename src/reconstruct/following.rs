//! A channel and what all others say of it in; how far its changes follow theirs out.

use super::pairs::Pair;

/// Changes are over this time, s.
const LAG: f64 = 1.0;

/// Indices of samples `LAG` apart between `from` and `to`.
pub fn lagged(t: &[f64], [from, to]: [f64; 2]) -> impl Iterator<Item = (usize, usize)> {
    let (a, b) = (t.partition_point(|x| *x < from), t.partition_point(|x| *x <= to));
    (a..b).filter_map(move |i| {
        let j = i + t[i..b].partition_point(|x| *x < t[i] + LAG);
        (j < b).then_some((i, j))
    })
}

/// Values without their mean and their trend.
fn detrended(t: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    let n = values.len() as f64;
    let (mt, mv) = (t.iter().sum::<f64>() / n, values.iter().sum::<f64>() / n);
    let tt: f64 = t.iter().map(|t| (t - mt) * (t - mt)).sum();
    let tv: f64 = t.iter().zip(&values).map(|(t, v)| (t - mt) * (v - mv)).sum();
    let slope = if tt > 0.0 { tv / tt } else { 0.0 };
    values.iter_mut().zip(t).for_each(|(v, t)| *v -= mv + slope * (t - mt));
    values
}

/// How changes of what was measured follow those of what all others say, without mean and trend of both: what
/// the others say drifts.
pub struct Following {
    n: f64,
    /// Means of products.
    zz: f64,
    zy: f64,
    yy: f64,
    /// What has to do with itself no longer, counted in `LAG`.
    span: f64,
}

impl Following {
    /// The changes of one part that lie between two times; none of what does not move.
    pub fn of([t, z, y, _]: &Pair, between: [f64; 2]) -> Option<Following> {
        let pairs: Vec<(usize, usize)> = lagged(t, between).collect();
        let (&(first, _), &(_, last)) = (pairs.first()?, pairs.last()?);
        let at: Vec<f64> = pairs.iter().map(|&(i, _)| t[i] - t[first]).collect();
        let changes =
            |of: &[f64]| detrended(&at, pairs.iter().map(|&(i, j)| of[j] - of[i]).collect());
        let (dz, dy) = (changes(z), changes(y));
        let n = pairs.len() as f64;
        let mean = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / n;
        let (zz, zy, yy) = (mean(&dz, &dz), mean(&dz, &dy), mean(&dy, &dy));
        let following = Following { n, zz, zy, yy, span: ((t[last] - t[first]) / LAG).max(1.0) };
        (following.n > 3.0 && following.yy > 0.0).then_some(following)
    }

    /// The share of what the others say that was measured.
    pub fn k(&self) -> f64 {
        self.zy / self.yy
    }

    /// Root mean square of what the others say.
    pub fn moves(&self) -> f64 {
        self.yy.sqrt()
    }

    /// And of what they leave.
    pub fn left(&self) -> f64 {
        (self.zz - self.k() * self.zy).max(0.0).sqrt()
    }

    /// Of `k`: what is left is as many independent values as there are `LAG`s.
    pub fn sd(&self) -> f64 {
        self.left() / self.moves() / self.span.sqrt()
    }
}
