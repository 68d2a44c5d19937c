//! Points of curves, and predictions beside them, come in; as tables, out.

use super::compared::{Against, Row};
use super::config::Config;
use super::points::Point;
use crate::error::Result;
use crate::table::{Builder, Table};

type Named = Vec<(&'static str, Table)>;

/// The tables of all curves of a `[[curve]]`; `drawn`: group, conditions in words, point.
pub fn all(
    config: &Config,
    drawn: &[(String, String, Point)],
    against: &[Against],
) -> Result<Named> {
    let rows: Vec<(&Against, &Row)> =
        against.iter().flat_map(|one| one.rows.iter().map(move |row| (one, row))).collect();
    let ranges: Vec<(&Against, &[f64; 2])> = against
        .iter()
        .flat_map(|one| one.unpredicted.iter().map(move |range| (one, range)))
        .collect();
    Ok(vec![
        ("curves", curves(config, drawn)?),
        ("predictions", predictions(config, &rows)?),
        ("unpredicted", unpredicted(config, &ranges)?),
    ])
}

/// The columns that say what a row is about.
fn about<'r>(
    table: &str,
    config: &Config,
    rows: impl Iterator<Item = (&'r str, usize, &'r str)>,
) -> Builder {
    let rows: Vec<_> = rows.collect();
    let outputs = &config.model.outputs;
    Table::build(table)
        .repeat("curve", &config.settings.name())
        .repeat("model", &config.settings.estimate)
        .strings("group", rows.iter().map(|(group, ..)| *group))
        .strings("equation", rows.iter().map(|(_, equation, _)| &outputs[*equation].name))
        .strings("unit", rows.iter().map(|(_, equation, _)| &outputs[*equation].unit))
        .strings("at", rows.iter().map(|(.., label)| *label))
        .repeat("input", &config.settings.along)
        .repeat("unit_x", config.unit_along())
}

fn curves(config: &Config, drawn: &[(String, String, Point)]) -> Result<Table> {
    let number = |of: &dyn Fn(&Point) -> f64| drawn.iter().map(|d| of(&d.2)).collect::<Vec<f64>>();
    let rows = drawn.iter().map(|(group, label, p)| (group.as_str(), p.equation, label.as_str()));
    about("curves", config, rows)
        .f64("x", number(&|p| p.x))
        .f64("value", number(&|p| p.value))
        .f64("sd", number(&|p| p.sd))
        .f64("sd_total", number(&|p| p.sd_total))
        .f64("lower", number(&|p| p.pointwise()[0]))
        .f64("upper", number(&|p| p.pointwise()[1]))
        .f64("simultaneous_lower", number(&|p| p.simultaneous()[0]))
        .f64("simultaneous_upper", number(&|p| p.simultaneous()[1]))
        .finish()
}

fn predictions(config: &Config, all: &[(&Against, &Row)]) -> Result<Table> {
    let number =
        |of: &dyn Fn(&Row) -> f64| all.iter().map(|(_, row)| of(row)).collect::<Vec<f64>>();
    let flags =
        |of: &dyn Fn(&Row) -> bool| all.iter().map(|(_, row)| of(row)).collect::<Vec<bool>>();
    let rows = all.iter().map(|(of, _)| (of.group.as_str(), of.equation, of.label.as_str()));
    about("predictions", config, rows)
        .f64("x", number(&|row| row.point.x))
        .f64("predicted", number(&|row| row.predicted))
        .f64("value", number(&|row| row.point.value))
        .f64("sd", number(&|row| row.point.sd))
        .f64("sd_total", number(&|row| row.point.sd_total))
        .f64("simultaneous_lower", number(&|row| row.point.simultaneous()[0]))
        .f64("simultaneous_upper", number(&|row| row.point.simultaneous()[1]))
        .f64("difference", number(&|row| row.point.value - row.predicted))
        .bools("beyond", flags(&Row::is_beyond))
        .bools("flown", flags(&|row| row.flown))
        .finish()
}

fn unpredicted(config: &Config, all: &[(&Against, &[f64; 2])]) -> Result<Table> {
    let rows = all.iter().map(|(of, _)| (of.group.as_str(), of.equation, of.label.as_str()));
    about("unpredicted", config, rows)
        .f64("from", all.iter().map(|(_, range)| range[0]).collect::<Vec<f64>>())
        .f64("to", all.iter().map(|(_, range)| range[1]).collect::<Vec<f64>>())
        .finish()
}
