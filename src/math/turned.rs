//! Rows in, columns out; and the other way.

use super::pool;
use std::ops::Range;

/// Rows `[sample][direction]` into the rows `to` of columns, those of the directions wanted; zeros where
/// there are no directions.
pub fn columns_of(g: &[f64], wanted: &[usize], to: Range<usize>, columns: &mut [Vec<f64>]) {
    let directions = g.len().checked_div(to.len()).unwrap_or(0);
    if directions == 0 {
        columns.iter_mut().take(wanted.len()).for_each(|column| column[to.clone()].fill(0.0));
    }
    // Samples in pieces that stay in the cache while every column takes its own.
    for (piece, rows) in g.chunks(PIECE * directions.max(1)).enumerate() {
        let from = to.start + piece * PIECE;
        for (&k, column) in wanted.iter().zip(columns.iter_mut()) {
            let row = rows.chunks_exact(directions.max(1));
            column[from..to.end].iter_mut().zip(row).for_each(|(x, row)| *x = row[k]);
        }
    }
}

/// Samples that are turned at a time.
const PIECE: usize = 64;

/// Columns as rows `[sample][column]`.
pub fn rows_of(columns: &[Vec<f64>]) -> Vec<f64> {
    let (n, samples) = (columns.len(), columns.first().map_or(0, Vec::len));
    let mut rows = pool::take(n * samples);
    for (piece, rows) in rows.chunks_mut(PIECE * n.max(1)).enumerate() {
        for (k, column) in columns.iter().enumerate() {
            let of = rows.chunks_exact_mut(n);
            of.zip(&column[piece * PIECE..]).for_each(|(row, x)| row[k] = *x);
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns_and_columns_rows() {
        for samples in [0, 1, 63, 64, 65, 200] {
            let rows: Vec<f64> = (0..3 * samples).map(|k| k as f64).collect();
            let mut columns = vec![vec![-1.0; samples + 2]; 3];
            columns_of(&rows, &[2, 0], 1..samples + 1, &mut columns);
            for k in 0..samples {
                assert_eq!((columns[0][k + 1], columns[1][k + 1]), (rows[3 * k + 2], rows[3 * k]));
            }
            assert!(columns[..2].iter().all(|x| x[0] == -1.0 && x[samples + 1] == -1.0));
            assert!(columns[2].iter().all(|x| *x == -1.0));
            let mut columns = vec![vec![0.0; samples]; 3];
            columns_of(&rows, &[0, 1, 2], 0..samples, &mut columns);
            assert_eq!(rows_of(&columns), rows);
        }
    }
}
