//! A file of predicted values (CSV: a wind tunnel's, for example) comes in; its rows in SI, or the mistakes, go out.
//!
//! ```text
//! # what it is and where it comes from
//! eta_k [deg], eta [deg], C_L_DLC [-], C_m_DLC [-]
//! 1, -20, -0.31, 0.12
//! ```
//!
//! The first line that is no comment names the columns with their units: the input along which the curve is drawn,
//! equations of the curve, and the conditions in which its curves differ. An empty cell predicts nothing.

use crate::config::{list, nearest};
use crate::error::{Error, Errors, Place};
use crate::units::Unit;
use std::collections::HashMap;

/// What is predicted.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    pub rows: Vec<Row>,
}

/// One row of the file, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its line in the file.
    line: usize,
    pub x: f64,
    /// Per condition of the file, by name.
    pub at: Vec<(String, f64)>,
    /// Per equation of the curve; NaN for what is not predicted.
    pub values: Vec<f64>,
}

/// What columns may be about, with the unit of each.
pub struct Wanted<'a> {
    pub along: (&'a str, &'a str),
    pub equations: Vec<(&'a str, &'a str)>,
    /// What tells one curve from another.
    pub conditions: Vec<(&'a str, &'a str)>,
}

/// What a column holds.
#[derive(Clone, Copy, PartialEq)]
enum Of {
    Along,
    Condition(usize),
    Equation(usize),
}

struct Column<'a> {
    name: &'a str,
    of: Of,
    unit: Unit,
}

/// Mistakes in rows that are shown before reading stops.
const SHOWN: usize = 10;

/// Reads the rows.
///
/// # Errors
/// Columns that nobody wants or that are missing, units, cells that are no numbers: all at once.
pub fn read(file: &str, text: &str, wanted: &Wanted) -> Result<Prediction, Errors> {
    let mut errors = Errors::default();
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    let header = reader.headers().cloned().map_err(|e| Errors::from(fault(file, &e)))?;
    let line = text.lines().position(|line| !line.is_empty() && !line.starts_with('#'));
    let line = line.map_or(1, |line| line + 1);
    let place = || Place { file: file.to_string(), line, column: 1 };
    let read = header
        .iter()
        .map(|cell| column(cell, wanted).map_err(|e| Error { place: Some(place()), ..e }));
    let columns: Vec<Option<Column>> = read.map(|column| errors.take(column)).collect();
    if errors.is_empty() {
        missing(&columns, wanted)
            .into_iter()
            .for_each(|e| errors.push(Error { place: Some(place()), ..e }));
    }
    errors.or(())?;
    let mut errors = Errors::default();
    let mut rows: Vec<Row> = Vec::new();
    for record in reader.records() {
        let row = record
            .map_err(|e| fault(file, &e))
            .and_then(|record| row(file, &record, &columns, wanted));
        rows.extend(errors.take(row));
        if errors.0.len() >= SHOWN {
            break;
        }
    }
    if errors.is_empty() && rows.is_empty() {
        errors.push(Error::at(Place::file(file), "there is no row below the names of the columns"));
    }
    twice(file, &rows, wanted).into_iter().for_each(|e| errors.push(e));
    errors.or(Prediction { rows })
}

/// Rows that predict an equation where another row does.
fn twice(file: &str, rows: &[Row], wanted: &Wanted) -> Vec<Error> {
    let mut first: HashMap<(usize, Vec<u64>), usize> = HashMap::new();
    let mut errors = Vec::new();
    for row in rows {
        let mut place = vec![row.x.to_bits()];
        place.extend(row.at.iter().map(|(_, value)| value.to_bits()));
        for (k, (name, _)) in wanted.equations.iter().enumerate() {
            if row.values[k].is_nan() {
                continue;
            }
            let before = *first.entry((k, place.clone())).or_insert(row.line);
            if before != row.line && errors.len() < SHOWN {
                let at = Place { file: file.to_string(), line: row.line, column: 1 };
                let what = format!("\"{name}\" is predicted here and in line {before}");
                errors.push(Error::at(at, what).help("leave one of the two cells empty"));
            }
        }
    }
    errors
}

fn fault(file: &str, error: &csv::Error) -> Error {
    match error.position() {
        Some(p) => Error::at(
            Place { file: file.to_string(), line: p.line() as usize, column: 1 },
            error.to_string(),
        ),
        None => Error::at(Place::file(file), error.to_string()),
    }
}

/// The column that `eta [deg]` heads.
fn column<'a>(cell: &str, wanted: &Wanted<'a>) -> Result<Column<'a>, Error> {
    let (name, unit) = match cell.strip_suffix(']').and_then(|cell| cell.rsplit_once('[')) {
        Some((name, unit)) => (name.trim(), unit.trim()),
        None => {
            let what = format!("column \"{cell}\" has no unit");
            return Err(Error::new(what).help("write the unit behind the name: eta [deg], C_L [-]"));
        }
    };
    let places = |of: fn(usize) -> Of, all: &[(&'a str, &'a str)]| {
        all.iter().enumerate().map(|(i, (name, unit))| (of(i), *name, *unit)).collect::<Vec<_>>()
    };
    let (along, along_unit) = wanted.along;
    let mut known = vec![(Of::Along, along, along_unit)];
    known.extend(places(Of::Condition, &wanted.conditions));
    known.extend(places(Of::Equation, &wanted.equations));
    let Some(&(of, name, model)) = known.iter().find(|(_, known, _)| *known == name) else {
        let names: Vec<&str> = known.iter().map(|(_, name, _)| *name).collect();
        let near = nearest(name, names.iter().copied());
        let near = near.map(|near| format!("did you mean \"{near}\"? ")).unwrap_or_default();
        let what =
            format!("column \"{name}\" is neither input, equation nor condition of the curve");
        return Err(Error::new(what).help(format!("{near}there are {}", list(&names))));
    };
    match Unit::parse(unit) {
        Err(what) => Err(Error::new(format!("column \"{name}\": {what}"))),
        Ok(_) if !crate::stage::check::agree(unit, model) => {
            let what = format!("column \"{name}\" is in {unit}, in the model it is in {model}");
            Err(Error::new(what).help("give a unit of the same dimension"))
        }
        Ok(unit) => Ok(Column { name, of, unit }),
    }
}

/// What a file cannot be without.
fn missing(columns: &[Option<Column>], wanted: &Wanted) -> Vec<Error> {
    let there = |of: Of| columns.iter().flatten().filter(|column| column.of == of).count();
    let mut errors = Vec::new();
    let mut absent = |what: String| errors.push(Error::new(what));
    if there(Of::Along) == 0 {
        absent(format!(
            "no column has the input \"{}\", along which the curve is drawn",
            wanted.along.0
        ));
    }
    if !columns.iter().flatten().any(|column| matches!(column.of, Of::Equation(_))) {
        let names: Vec<&str> = wanted.equations.iter().map(|(name, _)| *name).collect();
        absent(format!("no column has an equation of the curve: {}", list(&names)));
    }
    for (i, (name, _)) in wanted.conditions.iter().enumerate() {
        if there(Of::Condition(i)) == 0 {
            absent(format!("no column has \"{name}\", in which the curves differ"));
        }
    }
    for column in columns.iter().flatten() {
        if there(column.of) > 1 {
            absent(format!("there are two columns \"{}\"", column.name));
        }
    }
    errors.dedup();
    errors
}

fn row(
    file: &str,
    record: &csv::StringRecord,
    columns: &[Option<Column>],
    wanted: &Wanted,
) -> Result<Row, Error> {
    let line = record.position().map_or(0, |p| p.line() as usize);
    let at = |what: String| Error::at(Place { file: file.to_string(), line, column: 1 }, what);
    let values = vec![f64::NAN; wanted.equations.len()];
    let mut row = Row { line, x: f64::NAN, at: Vec::new(), values };
    if record.len() != columns.len() {
        return Err(at(format!(
            "{} cells are wanted, the row has {}",
            columns.len(),
            record.len()
        )));
    }
    for (column, cell) in columns.iter().zip(record.iter()) {
        let Some(Column { name, of, unit }) = column else { continue };
        let number = fast_float2::parse::<f64, _>(cell)
            .ok()
            .filter(|v| v.is_finite())
            .map(|v| unit.to_si(v));
        let value = match (number, of, cell.is_empty()) {
            (Some(value), ..) => value,
            (None, Of::Equation(_), true) => f64::NAN,
            _ => return Err(at(format!("\"{name}\": \"{cell}\" is no number"))),
        };
        match of {
            Of::Along => row.x = value,
            Of::Condition(_) => row.at.push((name.to_string(), value)),
            Of::Equation(k) => row.values[*k] = value,
        }
    }
    Ok(row)
}

impl Prediction {
    /// Where and what is predicted of an equation under the conditions that `is` takes, ascending.
    pub fn of(&self, equation: usize, is: impl Fn(&str, f64) -> bool) -> Vec<[f64; 2]> {
        let rows =
            self.rows.iter().filter(|row| row.at.iter().all(|(name, value)| is(name, *value)));
        let points = rows.map(|row| [row.x, row.values[equation]]);
        let mut points: Vec<[f64; 2]> = points.filter(|point| point[1].is_finite()).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted() -> Wanted<'static> {
        Wanted {
            along: ("eta", "rad"),
            equations: vec![("C_L_DLC", "-"), ("C_m_DLC", "-")],
            conditions: vec![("eta_k", "rad")],
        }
    }

    fn told(text: &str) -> String {
        read("tunnel.csv", text, &wanted()).expect_err("a mistake").to_string()
    }

    #[test]
    fn rows_are_read_in_si_and_an_empty_cell_predicts_nothing() {
        let text = "# a tunnel's\neta_k [deg], eta [deg], C_m_DLC [-], C_L_DLC [%]\n1, 10, , 12\n14, -10, 0.1, -12\n1, 0, 0, 0\n";
        let read = read("tunnel.csv", text, &wanted()).unwrap_or_else(|e| panic!("{e}"));
        let deg = std::f64::consts::PI / 180.0;
        let near = |value: f64, of: f64| (value - of * deg).abs() < 1e-12;
        assert_eq!(read.of(0, |_, value| near(value, 1.0)), [[0.0, 0.0], [10.0 * deg, 0.12]]);
        assert_eq!(read.of(1, |_, value| near(value, 1.0)), [[0.0, 0.0]]);
        assert_eq!(read.of(1, |_, value| near(value, 14.0)), [[-10.0 * deg, 0.1]]);
    }

    #[test]
    fn mistakes_are_told_with_their_line_all_at_once() {
        let text = told("# a tunnel's\neta_k [deg], eta, C_l_DLC [-], C_m_DLC [rad/s]\n");
        for part in [
            "tunnel.csv:2:1",
            "column \"eta\" has no unit",
            "did you mean \"C_L_DLC\"?",
            "\"C_m_DLC\" is in rad/s, in the model it is in -",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let text = told("eta [deg], C_L_DLC [-]\n1, 0.1\n");
        assert!(text.contains("no column has \"eta_k\", in which the curves differ"), "{text}");
        let text = told("eta_k [deg], eta [deg], C_L_DLC [-]\n1, two, 0.1\n1, 2\n");
        assert!(text.contains("tunnel.csv:2:1: \"eta\": \"two\" is no number"), "{text}");
        assert!(text.contains("tunnel.csv:3:1: 3 cells are wanted, the row has 2"), "{text}");
        assert!(told("eta_k [deg], eta [deg], C_L_DLC [-]\n").contains("there is no row"));
        let text = told(
            "eta_k [deg], eta [deg], C_L_DLC [-], C_m_DLC [-]\n1, 2, 0.1,\n1, 2, 0.2, 3\n1, 3, 0, 0\n",
        );
        assert!(
            text.contains("tunnel.csv:3:1: \"C_L_DLC\" is predicted here and in line 2"),
            "{text}"
        );
        assert_eq!(text.matches("predicted here").count(), 1, "{text}");
    }
}
