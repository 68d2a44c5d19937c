//! A MATLAB 5 MAT file in; the rows of topics that are columns of its numeric matrices out.

use super::level5::{Matrix, Variables, variables};
use super::rows::{Columns, Read, Wanted, gather};
use super::settings::{Along, Column, Import};
use super::values::Values;
use crate::config::Doc;
use crate::error::{Error, Errors, Place};

/// How a MAT file of level 5 begins.
pub const MAGIC: &[u8] = b"MATLAB 5.0 MAT-file";

/// Is this a MAT file of level 5?
pub fn is_mat(bytes: &[u8]) -> bool {
    bytes.len() >= 128 && bytes.starts_with(MAGIC)
}

/// Is this what newer versions of MATLAB write with -v7.3?
pub fn is_hdf(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MATLAB 7.3 MAT-file")
}

/// Reads the columns that the description names; `variable` is the matrix that columns with a number
/// alone are of, `named` makes the name of a matrix from that in the description.
///
/// # Errors
/// What is wrong with the file, or which variables it has instead; columns of different lengths.
pub fn read(
    settings: &Import,
    doc: &Doc,
    (file, bytes): (&str, &[u8]),
    named: &dyn Fn(&str) -> String,
) -> Result<Read, Errors> {
    let all = variables(bytes).map_err(|e| Error::at(Place::file(file), e))?;
    let variable = settings.variable.as_deref().map(named);
    let (skip, signals) = (settings.header_lines, settings.signals);
    let mut matrices = Matrices { all, variable, skip, signals, named };
    gather(settings, doc, file, &mut matrices)
}

/// The matrices of a file as columns.
struct Matrices<'a> {
    all: Variables,
    variable: Option<String>,
    /// Values before the data.
    skip: usize,
    signals: Along,
    named: &'a dyn Fn(&str) -> String,
}

impl Columns for Matrices<'_> {
    fn column(&mut self, wanted: Wanted) -> Result<Values, String> {
        let values = match wanted.column {
            Column::Name(name) => {
                let matrix = self.find(Some(&(self.named)(name)))?;
                if matrix.rows != 1 && matrix.columns != 1 {
                    return Err(format!(
                        "{} is a matrix of {} x {}: say which column is meant by matrix = \"{}\", column = 1",
                        matrix.name, matrix.rows, matrix.columns, matrix.name
                    ));
                }
                matrix.values.clone()
            }
            Column::Number(n) => {
                let named = wanted.matrix.map(self.named).or_else(|| self.variable.clone());
                let matrix = self.find(named.as_deref())?;
                signal(matrix, self.signals, *n)?
            }
        };
        Ok(values.every(self.skip, 1, usize::MAX))
    }
}

/// Column or row `n` (from 1) of a matrix.
fn signal(matrix: &Matrix, signals: Along, n: usize) -> Result<Values, String> {
    let (word, has) = match signals {
        Along::Columns => ("column", matrix.columns),
        Along::Rows => ("row", matrix.rows),
    };
    let at = n.checked_sub(1).filter(|n| *n < has);
    let at = at.ok_or_else(|| format!("{word} {n} is wanted, matrix {} has {has}", matrix.name))?;
    let (first, step, count) = match signals {
        Along::Columns => (at * matrix.rows, 1, matrix.rows),
        Along::Rows => (at, matrix.rows.max(1), matrix.columns),
    };
    Ok(matrix.values.every(first, step, count))
}

impl Matrices<'_> {
    /// The variable `name`, or the only numeric matrix without one.
    fn find(&self, name: Option<&str>) -> Result<&Matrix, String> {
        let Variables { matrices, others } = &self.all;
        let names = matrices.iter().map(|m| format!("{} ({} x {})", m.name, m.rows, m.columns));
        let others = others.iter().map(|(name, what)| format!("{name} ({what})"));
        let all: Vec<String> = names.chain(others).collect();
        let has = if all.is_empty() { "nothing".to_string() } else { all.join(", ") };
        let mut fitting = matrices.iter().filter(|m| name.is_none_or(|name| m.name == name));
        match (fitting.next(), fitting.next(), name) {
            (Some(one), None, _) => Ok(one),
            (Some(_), Some(_), None) => Err(format!(
                "the file has several matrices, name one as `matrix`, or one for all as `variable`: {has}"
            )),
            (Some(_), Some(_), Some(name)) => {
                Err(format!("there are two matrices \"{name}\"; the file has {has}"))
            }
            (None, _, Some(name)) => {
                Err(format!("there is no numeric matrix \"{name}\"; the file has {has}"))
            }
            (None, _, None) => Err(format!("the file has no numeric matrix; it has {has}")),
        }
    }
}
