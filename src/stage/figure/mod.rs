//! Tables come in, the points, lines and bands of a figure go out.

mod config;

use super::{Campaign, Inputs, Key, Note, Output, Read, Severity, Stage, Unit, slice_of};
use crate::error::{Errors, Result};
use crate::math::distribution::INTERVAL_95;
use crate::table::{Kind, Table, Want};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};

pub use config::Settings;
use config::{NAME, Reference, SIGNALS, Series};

pub const STAGE: Stage = Stage {
    name: NAME,
    about: "draw figures",
    key: Some(Key::of::<Vec<Settings>>()),
    check: config::check,
    units: |campaign| Unit::entries(all(campaign).iter().map(|figure| figure.name.clone())),
    writes: &["figures"],
    reads,
    slice: |campaign, unit| json!({ "figure": all(campaign).get(unit.index).map(slice_of), "reads": format!("{:?}", reads(campaign, unit)) }),
    run,
    ..Stage::PLAIN
};

fn all(campaign: &Campaign) -> &[Settings] {
    campaign.told.get::<Vec<Settings>>(NAME).map(Vec::as_slice).unwrap_or_default()
}

/// Where maneuvers begin and end.
const SEGMENTS: &str = "segments";
/// Time before the first step and after the last that is drawn of a maneuver, s.
const MARGINS_S: [f64; 2] = [1.0, 2.0];

/// The names of the tables that a figure is drawn from, each once.
fn tables(campaign: &Campaign, figure: &Settings) -> Vec<&'static str> {
    let names = campaign.stages.iter().flat_map(|s| s.writes).copied();
    let drawn = |name: &str| figure.series.iter().any(|s| s.table == name);
    let asked = figure.series.iter().any(|s| s.during.is_some());
    let mut used: Vec<&str> =
        names.filter(|name| drawn(name) || asked && *name == SEGMENTS).collect();
    used.sort_unstable();
    used.dedup();
    used
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let Some(figure) = all(campaign).get(unit.index) else { return Vec::new() };
    let of = |table: &'static str| {
        let parts = campaign.parts(table).into_iter();
        parts.map(move |part| Read { table, part, optional: true })
    };
    tables(campaign, figure).into_iter().flat_map(of).collect()
}

/// One curve or cloud of points.
struct Drawn {
    label: String,
    /// `points`, `line`, `strips` or `reference`.
    kind: &'static str,
    /// x, y and both ends.
    rows: Vec<[f64; 4]>,
}

/// All of a figure.
#[derive(Default)]
struct Figure {
    drawn: Vec<Drawn>,
    x_unit: String,
    y_unit: String,
    /// Units of rows that are not those of their axis, with these.
    mixed: BTreeSet<[String; 2]>,
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(settings) = all(campaign).get(unit.index) else { return Ok(Output::default()) };
    let (mut figure, mut notes) = (Figure::default(), Vec::new());
    for series in &settings.series {
        let parts = tables(campaign, settings).into_iter().find(|name| *name == series.table);
        let names = columns(series);
        let want = match series.table == SIGNALS {
            true => Want::default(),
            false => Want { own: Some(&names), columns: Some(&names), ..Want::default() },
        };
        let parts = parts.map(|name| inputs.all_with(name, want)).transpose()?.unwrap_or_default();
        let before = figure.drawn.len();
        if !parts.is_empty() {
            let table = Table::concat(&series.table, &parts)?;
            drop(parts);
            let rows = match series.table == SIGNALS {
                true => Rows::by_signal(series, &table)?,
                false => Rows::of(series, &table)?,
            };
            let during = series.during.as_ref();
            match during.map(|segment| Span::of(segment, inputs)).transpose()? {
                Some(None) => {}
                during => figure.add(series, &rows, during.flatten().as_ref()),
            }
        }
        // Where nothing is to be shaded, nothing is missing.
        if figure.drawn.len() == before && !series.strips {
            notes.push(nothing(settings, series));
        }
    }
    let span = figure.span();
    let reference = |one: &Reference| Drawn {
        label: one.label.clone(),
        kind: "reference",
        rows: match one.line {
            // A line without anything to compare it with has no ends.
            Some(_) if span[0].is_nan() => Vec::new(),
            Some(line) => {
                span.map(|x| [x, line.slope * x + line.intercept, f64::NAN, f64::NAN]).to_vec()
            }
            None => one.points.iter().map(|[x, y]| [*x, *y, f64::NAN, f64::NAN]).collect(),
        },
    };
    figure.drawn.extend(settings.reference.iter().map(reference));
    notes.extend(figure.mixed.iter().map(|units| mixed(settings, units)));
    let table = figure.table(settings, unit.index)?;
    Ok(Output { tables: vec![("figures", table)], files: Vec::new(), notes })
}

fn mixed(settings: &Settings, [axis, unit]: &[String; 2]) -> Note {
    let what = format!(
        "an axis in {axis} has rows in {unit}: choose those of one unit (`where`), or draw two figures"
    );
    note(settings, Severity::Warning, &what)
}

fn nothing(settings: &Settings, series: &Series) -> Note {
    let rows: Vec<String> = series
        .rows
        .iter()
        .map(|(name, used)| format!("{name} = {}", used.names().join(" or ")))
        .collect();
    let of = if rows.is_empty() { String::new() } else { format!(" with {}", rows.join(", ")) };
    let during = series.during.iter().map(|segment| format!(" during {segment}"));
    let of = of + &during.collect::<String>();
    let what = format!("the table `{}` has no rows{of} to draw", series.table);
    note(settings, Severity::Missing, &what)
}

fn note(settings: &Settings, severity: Severity, what: &str) -> Note {
    Note {
        flight: String::new(),
        stage: NAME.to_string(),
        severity,
        subject: settings.name.clone(),
        count: 1,
        text: format!("{}: {what}", settings.name),
    }
}

/// The time of a maneuver with what is drawn before and after it.
struct Span {
    flight: String,
    /// s
    t: [f64; 2],
}

impl Span {
    /// That of a maneuver; none where there is none of this name.
    fn of(segment: &str, inputs: &Inputs) -> Result<Option<Span>> {
        for table in inputs.all(SEGMENTS)? {
            let Some(row) = table.strings("segment")?.iter().position(|s| *s == segment) else {
                continue;
            };
            let at = |column: &str| table.f64(column).map(|values| values[row]);
            let t = [at("t_start_s")? - MARGINS_S[0], at("t_end_s")? + MARGINS_S[1]];
            return Ok(Some(Span { flight: table.strings("flight")?[row].to_string(), t }));
        }
        Ok(None)
    }

    fn holds(&self, table: &Rows, row: usize) -> bool {
        let t = table.number(TIME, row);
        self.flight == table.text(FLIGHT, row) && (self.t[0]..=self.t[1]).contains(&t)
    }
}

const TIME: &str = "t_s";
const FLIGHT: &str = "flight";

/// Columns that tell the units of others, where a table has them.
const UNITS: [&str; 2] = ["unit", "unit_x"];

/// The names of the columns that a series asks of its table, and those that tell units.
fn columns(series: &Series) -> Vec<String> {
    let drawn = [&series.x, &series.y].into_iter().chain(&series.sd);
    let drawn = drawn.chain(series.ends.iter().flatten());
    let told = series.rows.keys().chain(&series.colour).cloned();
    let during = [TIME, FLIGHT].into_iter().filter(|_| series.during.is_some());
    let more = during.chain(UNITS).map(String::from);
    drawn.cloned().chain(told).chain(more).collect()
}

/// The columns of a table that a series is about.
struct Rows {
    n: usize,
    numbers: BTreeMap<String, Vec<f64>>,
    texts: BTreeMap<String, Vec<String>>,
    units: BTreeMap<String, String>,
}

impl Rows {
    /// A row per segment, its columns the signals that the series asks for.
    fn by_signal(series: &Series, table: &Table) -> Result<Rows> {
        let (flights, segments) = (table.strings("flight")?, table.strings("segment")?);
        let (signals, values) = (table.strings("signal")?, table.f64("value")?);
        let units = table.strings("unit")?;
        let key = |k: usize| (flights[k], segments[k]);
        let mut all: Vec<(&str, &str)> = (0..table.rows()).map(key).collect();
        all.dedup();
        let place: BTreeMap<(&str, &str), usize> =
            all.iter().enumerate().map(|(i, key)| (*key, i)).collect();
        let text = |of: fn(&(&str, &str)) -> String| all.iter().map(of).collect::<Vec<_>>();
        let mut rows = Rows {
            n: all.len(),
            numbers: BTreeMap::new(),
            texts: BTreeMap::from([
                ("flight".to_string(), text(|key| key.0.to_string())),
                ("segment".to_string(), text(|key| key.1.to_string())),
            ]),
            units: BTreeMap::new(),
        };
        for k in 0..table.rows() {
            if [&series.x, &series.y].iter().any(|name| *name == signals[k]) {
                let column = rows.numbers.entry(signals[k].to_string());
                column.or_insert_with(|| vec![f64::NAN; all.len()])[place[&key(k)]] = values[k];
                rows.units.insert(signals[k].to_string(), units[k].to_string());
            }
        }
        Ok(rows)
    }

    fn of(series: &Series, table: &Table) -> Result<Rows> {
        let mut rows = Rows {
            n: table.rows(),
            numbers: BTreeMap::new(),
            texts: BTreeMap::new(),
            units: BTreeMap::new(),
        };
        let there = |name: &String| !UNITS.contains(&name.as_str()) || table.has(name);
        for name in columns(series).into_iter().filter(there) {
            let column = table.column(&name)?;
            rows.units.insert(name.clone(), column.unit.clone());
            match column.kind {
                Kind::F64 => drop(rows.numbers.insert(name.clone(), table.f64(&name)?.to_vec())),
                Kind::I64 => {
                    let values = table.opt_i64(&name)?.into_iter();
                    let values = values.map(|v| v.map_or(f64::NAN, |v| v as f64)).collect();
                    rows.numbers.insert(name.clone(), values);
                }
                Kind::String => {
                    let values = table.opt_strings(&name)?.into_iter();
                    let values = values.map(|v| v.unwrap_or_default().to_string()).collect();
                    rows.texts.insert(name.clone(), values);
                }
                Kind::Bool => {
                    let values = table.bools(&name)?.into_iter().map(|v| f64::from(u8::from(v)));
                    rows.numbers.insert(name.clone(), values.collect());
                }
            }
        }
        Ok(rows)
    }

    fn number(&self, name: &str, row: usize) -> f64 {
        self.numbers.get(name).and_then(|values| values.get(row)).copied().unwrap_or(f64::NAN)
    }

    fn text(&self, name: &str, row: usize) -> String {
        self.texts.get(name).and_then(|values| values.get(row)).cloned().unwrap_or_default()
    }

    fn unit(&self, name: &str) -> &str {
        self.units.get(name).map_or("", String::as_str)
    }
}

impl Figure {
    fn add(&mut self, series: &Series, table: &Rows, during: Option<&Span>) {
        let wanted = |row: &usize| {
            series.rows.iter().all(|(name, used)| used.names().contains(&table.text(name, *row)))
                && during.is_none_or(|span| span.holds(table, *row))
        };
        let value = |name: &String, row| table.number(name, row);
        let mut groups: Vec<(String, Vec<[f64; 4]>)> = Vec::new();
        for row in (0..table.n).filter(wanted) {
            let (x, y) = (value(&series.x, row), value(&series.y, row));
            if !x.is_finite() || !y.is_finite() {
                continue;
            }
            let ends = match (&series.sd, &series.ends) {
                (Some(sd), _) => {
                    let half = INTERVAL_95 * value(sd, row);
                    [y - half, y + half]
                }
                (None, Some([lower, upper])) => [value(lower, row), value(upper, row)],
                (None, None) => [f64::NAN; 2],
            };
            let label = match (&series.label, &series.colour) {
                (Some(label), None) => label.clone(),
                (Some(label), Some(colour)) => format!("{label}, {}", table.text(colour, row)),
                (None, Some(colour)) => table.text(colour, row),
                (None, None) => series.y.clone(),
            };
            self.units(series, table, row);
            let rows = [x, y, ends[0], ends[1]];
            match groups.iter_mut().find(|(name, _)| *name == label) {
                Some((_, of)) => of.push(rows),
                None => groups.push((label, vec![rows])),
            }
        }
        let kind = match (series.strips, series.joined) {
            (true, _) => "strips",
            (false, true) => "line",
            (false, false) => "points",
        };
        self.drawn.extend(groups.into_iter().map(|(label, rows)| Drawn { label, kind, rows }));
    }

    /// Takes the axes' units from the first rows that have them: a column is in its own unit, or in
    /// that of the row.
    fn units(&mut self, series: &Series, table: &Rows, row: usize) {
        let of = |name: &String, own: &str| match table.unit(name) {
            "SI" | "" => table.text(own, row),
            unit => unit.to_string(),
        };
        let of = |name: &String, own: &str| match of(name, own) {
            unit if unit == "-" => String::new(),
            unit => unit,
        };
        let y = if series.strips { String::new() } else { of(&series.y, "unit") };
        for (axis, unit) in [(&mut self.x_unit, of(&series.x, "unit_x")), (&mut self.y_unit, y)] {
            if axis.is_empty() {
                *axis = unit;
            } else if !unit.is_empty() && unit != *axis {
                self.mixed.insert([axis.clone(), unit]);
            }
        }
    }

    /// Least and largest abscissa.
    fn span(&self) -> [f64; 2] {
        let x = || self.drawn.iter().flat_map(|d| &d.rows).map(|row| row[0]);
        [x().fold(f64::NAN, f64::min), x().fold(f64::NAN, f64::max)]
    }

    fn table(&self, settings: &Settings, place: usize) -> Result<Table> {
        let rows: Vec<(usize, &Drawn, &[f64; 4])> = self
            .drawn
            .iter()
            .enumerate()
            .flat_map(|(i, d)| d.rows.iter().map(move |row| (i, d, row)))
            .collect();
        let of = |k: usize| rows.iter().map(|row| row.2[k]).collect::<Vec<f64>>();
        let first = settings.series.first();
        let title = |given: &Option<String>, column: Option<&String>| {
            given.clone().or(column.cloned()).unwrap_or_default()
        };
        let x_title = title(&settings.x_title, first.map(|s| &s.x));
        let y_title = title(&settings.y_title, first.map(|s| &s.y));
        Table::build("figures")
            .i64("number", vec![place as i64 + 1; rows.len()])
            .repeat("figure", &settings.name)
            .repeat("title", &settings.title)
            .i64("series", rows.iter().map(|row| row.0 as i64 + 1).collect::<Vec<_>>())
            .strings("label", rows.iter().map(|row| &row.1.label))
            .strings("kind", rows.iter().map(|row| row.1.kind))
            .f64("x", of(0))
            .f64("y", of(1))
            .f64("lower", of(2))
            .f64("upper", of(3))
            .repeat("x_title", &x_title)
            .repeat("x_unit", &self.x_unit)
            .repeat("y_title", &y_title)
            .repeat("y_unit", &self.y_unit)
            .finish()
    }
}
