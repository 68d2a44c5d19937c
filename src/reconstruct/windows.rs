//! Gap-free stretches of a flight cut into overlapping windows.

use crate::signal::resample::Grid;

/// Grid points `begin..end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    pub begin: usize,
    pub end: usize,
}

/// Windows of about `length` s, neighbours overlapping by `overlap` s, none across a gap of an
/// input. Within a gap-free stretch all windows have the same length; a stretch shorter than a
/// second has none.
pub fn cut(columns: &[Vec<f64>], grid: &Grid, length: f64, overlap: f64) -> Vec<Window> {
    let good = |k: usize| columns.iter().all(|c| c[k].is_finite());
    let mut out = Vec::new();
    let mut begin = 0;
    while begin < grid.n {
        if !good(begin) {
            begin += 1;
            continue;
        }
        let end = (begin..grid.n).find(|&k| !good(k)).unwrap_or(grid.n);
        let duration = (end - begin) as f64 * grid.dt;
        if duration >= 1.0 {
            let count = ((duration - overlap) / (length - overlap).max(grid.dt)).ceil().max(1.0);
            let each = (duration + (count - 1.0) * overlap) / count;
            for i in 0..count as usize {
                let from = begin + ((i as f64 * (each - overlap)) / grid.dt).round() as usize;
                let to = if i + 1 == count as usize {
                    end
                } else {
                    from + (each / grid.dt).round() as usize
                };
                out.push(Window { begin: from, end: to.min(end) });
            }
        }
        begin = end;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_cover_stretches_and_stop_at_gaps() {
        let grid = Grid { t0: 0.0, dt: 0.1, n: 2000 };
        let mut column = vec![1.0; 2000];
        column[900..950].fill(f64::NAN);
        let windows = cut(&[column], &grid, 30.0, 6.0);
        assert_eq!(windows.first().unwrap().begin, 0);
        assert_eq!(windows.last().unwrap().end, 2000);
        assert!(windows.iter().all(|w| w.end <= 900 || w.begin >= 950));
        assert!(windows.iter().all(|w| (w.end - w.begin) as f64 * 0.1 <= 30.1));
        let pairs: Vec<_> = windows.windows(2).filter(|p| p[0].end != 900).collect();
        assert!(
            pairs.iter().all(|p| (p[0].end as i64 - p[1].begin as i64 - 60).abs() <= 1),
            "{windows:?}"
        );
    }
}
