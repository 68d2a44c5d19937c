//! A MATLAB 5 MAT file in; the rows of topics that are columns of its numeric matrices out.

use super::level5::{Matrix, variables};
use super::rows::{Columns, Read, Values, Wanted, gather};
use super::settings::{Column, Import};
use crate::config::Doc;
use crate::error::{Error, Errors, Place};

/// Is this a MAT file of level 5?
pub fn is_mat(bytes: &[u8]) -> bool {
    bytes.len() >= 128 && bytes.starts_with(b"MATLAB 5.0 MAT-file")
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
    let mut matrices = Matrices { all, variable, skip: settings.header_lines, named };
    gather(settings, doc, file, &mut matrices)
}

/// The matrices of a file as columns.
struct Matrices<'a> {
    all: Vec<Matrix>,
    variable: Option<String>,
    /// Rows before the data.
    skip: usize,
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
                &matrix.values[..]
            }
            Column::Number(n) => {
                let named = wanted.matrix.map(self.named).or_else(|| self.variable.clone());
                let matrix = self.find(named.as_deref())?;
                let column = n.checked_sub(1).filter(|n| *n < matrix.columns).ok_or_else(|| {
                    let (name, has) = (&matrix.name, matrix.columns);
                    format!("column {n} is wanted, matrix {name} has {has}")
                })?;
                let from = column * matrix.rows;
                matrix.values.get(from..from + matrix.rows).unwrap_or_default()
            }
        };
        Ok(Values::Numbers(values.get(self.skip..).unwrap_or_default().to_vec()))
    }
}

impl Matrices<'_> {
    /// The variable `name`, or the only numeric matrix without one.
    fn find(&self, name: Option<&str>) -> Result<&Matrix, String> {
        let names: Vec<String> =
            (self.all.iter()).map(|m| format!("{} ({} x {})", m.name, m.rows, m.columns)).collect();
        let has = if names.is_empty() { "no numeric matrix".to_string() } else { names.join(", ") };
        let mut fitting = self.all.iter().filter(|m| name.is_none_or(|name| m.name == name));
        match (fitting.next(), fitting.next(), name) {
            (Some(one), None, _) => Ok(one),
            (Some(_), Some(_), None) => Err(format!(
                "the file has several matrices, name one as `matrix`, or one for all as `variable`: {has}"
            )),
            (Some(_), Some(_), Some(name)) => {
                Err(format!("there are two matrices \"{name}\"; the file has {has}"))
            }
            (None, _, Some(name)) => {
                Err(format!("there is no matrix \"{name}\"; the file has {has}"))
            }
            (None, _, None) => Err("the file has no numeric matrix".into()),
        }
    }
}
