//! `responses`, `segments` and `samples` in, the time histories of every maneuver and the table of
//! how well each one fits out.

use super::columns::Columns;
use super::flights;
use super::format::{display_unit, number, plain, short, thin};
use super::grid::{Cell, Grid, Level, Row};
use super::packed::Packed;
use super::place::On;
use super::room::Room;
use super::section::{Body, Given, Section};
use crate::error::Result;
use crate::signal::adequacy::Adequacy;
use serde::Serialize;
use std::collections::BTreeMap;

pub const SECTION: Section = Section {
    id: "maneuvers",
    heading: "Measured and modelled, maneuver by maneuver",
    on: On::Flights,
    tables: &["responses", "segments", "samples", "estimates", "residuals", "adequacy"],
    build,
};

fn build(given: &Given) -> Result<Option<Body>> {
    let sources = Sources {
        responses: given.get("responses"),
        segments: given.get("segments"),
        samples: given.get("samples"),
        estimates: given.get("estimates"),
        residuals: given.get("residuals"),
        adequacy: given.get("adequacy"),
        inputs: &given.input.inputs,
        room: given.room(),
    };
    let (section, histories) = maneuvers(&sources);
    Body::new(include_str!("html/maneuvers.html"), section).plot("maneuvers", &histories).map(Some)
}

/// What one maneuver's plot is drawn from (JSON). Times are seconds of the flight.
#[derive(Debug, Serialize)]
pub struct Maneuver {
    pub label: String,
    pub caption: String,
    pub start: Option<f64>,
    pub end: Option<f64>,
    pub outputs: Vec<Output>,
    pub inputs: Vec<Input>,
}

#[derive(Debug, Serialize)]
pub struct Output {
    pub name: String,
    pub unit: String,
    pub t: Packed,
    pub measured: Packed,
    pub modelled: Packed,
    /// The free simulation, where `modelled` is predicted sample by sample; empty elsewhere.
    pub simulated: Packed,
}

#[derive(Debug, Serialize)]
pub struct Input {
    pub name: String,
    pub unit: String,
    pub t: Packed,
    pub value: Packed,
}

/// The text around the plot (template).
#[derive(Debug, Default, Serialize)]
pub struct Maneuvers {
    pub missing: Option<String>,
    /// How the drawn samples relate to the recorded ones.
    pub shown: String,
    pub table: Grid,
}

/// The tables the time histories come from.
pub struct Sources<'a> {
    pub responses: Option<&'a Columns>,
    pub segments: Option<&'a Columns>,
    pub samples: Option<&'a Columns>,
    pub estimates: Option<&'a Columns>,
    pub residuals: Option<&'a Columns>,
    pub adequacy: Option<&'a Columns>,
    /// Sample columns that drive each model.
    pub inputs: &'a BTreeMap<String, Vec<String>>,
    pub room: Room,
}

/// Numbers drawn in all maneuvers of the one page together, at most about: keeps it below some 10 MB
/// however large the campaign is.
const BUDGET: usize = 600_000;
/// Seconds of inputs drawn before and after a maneuver's own span when the responses do not say
/// more.
const MARGIN: f64 = 1.0;

/// What is looked up for every maneuver.
struct Lookup<'a> {
    from: &'a Sources<'a>,
    responses: &'a Columns,
    segments: BTreeMap<[String; 1], Vec<usize>>,
    samples: BTreeMap<[String; 1], Vec<usize>>,
    estimates: BTreeMap<[String; 2], Vec<usize>>,
    residuals: BTreeMap<[String; 3], Vec<usize>>,
    /// Samples drawn per curve, at most about.
    limit: usize,
}

/// Model, group and segment of a maneuver.
type Key = [String; 3];

/// Time histories in the order of `responses`, and their table.
fn maneuvers(from: &Sources) -> (Maneuvers, Vec<Maneuver>) {
    let Some(responses) = from.responses.filter(|r| r.rows() > 0) else {
        let missing = Some("No time history: no maneuver has been estimated.".into());
        return (Maneuvers { missing, ..Maneuvers::default() }, Vec::new());
    };
    let groups = responses.groups(["model", "group", "segment"]);
    let limit = limit(from, responses, &groups);
    let look = Lookup {
        from,
        responses,
        segments: from.segments.map(|t| t.rows_by(["segment"])).unwrap_or_default(),
        samples: from.samples.map(|t| t.rows_by(["flight"])).unwrap_or_default(),
        estimates: from.estimates.map(|t| t.rows_by(["model", "group"])).unwrap_or_default(),
        residuals: from
            .residuals
            .map(|t| t.rows_by(["model", "group", "output"]))
            .unwrap_or_default(),
        limit,
    };
    let columns = [
        "model",
        "maneuver",
        "output",
        "#samples",
        "#residual r.m.s.",
        "#beyond noise, part of measured variation|%",
        "#colour",
    ];
    let mut table = Grid::new(columns);
    let (mut all, mut thinned) = (Vec::new(), false);
    for (key, rows) in &groups {
        let pick = format!("m{}", all.len());
        let (maneuver, was_thinned) = look.maneuver(key, rows);
        thinned |= was_thinned;
        for (output, rows) in by_output(responses, rows) {
            table.rows.push(look.row(key, &output, &rows, &pick));
        }
        all.push(maneuver);
    }
    let note = "Click a row to see its time history. The r.m.s. is over all samples. Colour is the residuals' variance at frequency zero \
                over their variance: 1 is white.";
    table.note = Some(note.into());
    let shown = if thinned {
        format!(
            "Long records are thinned for display to about {limit} samples a curve, extremes kept; no number on this page is."
        )
    } else {
        "Every sample is drawn.".into()
    };
    (Maneuvers { missing: None, shown, table }, all)
}

/// Samples drawn per curve, at most about: all of them where the page has room.
fn limit(from: &Sources, responses: &Columns, groups: &[(Key, Vec<usize>)]) -> usize {
    if from.room.is_all() {
        return (BUDGET / (3 * groups.len().max(1))).clamp(150, 1200);
    }
    // A sample of an output is three numbers, and every other one of an input two.
    let numbers = |(key, rows): &(Key, Vec<usize>)| {
        let inputs = from.inputs.get(&key[0]).map_or(1, |names| names.len().max(1));
        3 * by_output(responses, rows).len() + inputs
    };
    from.room.samples(usize::MAX, 5, groups.iter().map(numbers).sum())
}

fn by_output(responses: &Columns, rows: &[usize]) -> Vec<(String, Vec<usize>)> {
    let mut outputs: Vec<(String, Vec<usize>)> = Vec::new();
    for &row in rows {
        let name = responses.text("output", row);
        match outputs.iter_mut().find(|(n, _)| *n == name) {
            Some((_, rows)) => rows.push(row),
            None => outputs.push((name, vec![row])),
        }
    }
    outputs
}

/// How a maneuver is called: by its segment, and by its group where that is another name.
pub fn name(group: &str, segment: &str) -> String {
    match (group, segment) {
        (group, "") => group.into(),
        (group, segment) if group == segment || group.is_empty() => segment.into(),
        (group, segment) => format!("{group} / {segment}"),
    }
}

impl Lookup<'_> {
    fn maneuver(&self, key: &Key, rows: &[usize]) -> (Maneuver, bool) {
        let [model, group, segment] = key;
        let row = self.segments.get(std::slice::from_ref(segment)).and_then(|rows| rows.first());
        let found = self.from.segments.zip(row.copied());
        let text = |name: &str| found.map_or(String::new(), |(s, row)| s.text(name, row));
        let [start, end] = ["t_start_s", "t_end_s"]
            .map(|name| found.map_or(f64::NAN, |(s, row)| s.number(name, row)));
        let mut span = (start - MARGIN, end + MARGIN);
        let mut thinned = false;
        let mut outputs = Vec::new();
        for (name, rows) in by_output(self.responses, rows) {
            let t = pick(self.responses.column("t_s"), &rows);
            span = (
                t.iter().copied().fold(span.0, f64::min),
                t.iter().copied().fold(span.1, f64::max),
            );
            let output = self.output(key, name, &rows);
            thinned |= output.t.len() < rows.len();
            outputs.push(output);
        }
        let mut names = self.from.inputs.get(model).cloned().unwrap_or_default();
        if names.is_empty() {
            names.push(text("input"));
        }
        let flight = Some(text("flight"))
            .filter(|f| !f.is_empty())
            .or_else(|| self.record_of(segment))
            .unwrap_or_default();
        let inputs = self.inputs(&flight, span, &names);
        let label = [model.as_str(), &name(group, segment), &text("kind")]
            .into_iter()
            .filter(|s| !s.is_empty())
            .collect::<Vec<_>>()
            .join(" / ");
        let caption = self.stop(key).map_or(label.clone(), |stop| format!("{label}: {stop}"));
        (
            Maneuver { label, caption, start: short(start), end: short(end), outputs, inputs },
            thinned,
        )
    }

    /// The flight whose record (or a piece of it) is the segment.
    fn record_of(&self, segment: &str) -> Option<String> {
        self.samples.keys().flatten().find(|flight| flights::is_record(segment, flight)).cloned()
    }

    fn output(&self, key: &Key, name: String, rows: &[usize]) -> Output {
        let [t, measured, modelled, simulated] = ["t_s", "measured", "modelled", "simulated"]
            .map(|c| pick(self.responses.column(c), rows));
        let free = simulated.iter().any(|y| y.is_finite());
        let keep = thin(t.len(), &[&measured, &modelled], self.limit);
        let (factor, unit) = display_unit(
            &self
                .residual(key, &name)
                .map_or(String::new(), |(table, row)| table.unit_in("unit", row)),
        );
        let drawn = |v: &[f64]| Packed::of(pick(v, &keep), factor);
        Output {
            name,
            unit,
            t: Packed::of(pick(&t, &keep), 1.0),
            measured: drawn(&measured),
            modelled: drawn(&modelled),
            simulated: if free { drawn(&simulated) } else { Packed::default() },
        }
    }

    /// The row of `residuals` about one output of one segment, or of the whole group.
    fn residual(&self, key: &Key, output: &str) -> Option<(&Columns, usize)> {
        let [model, group, segment] = key;
        let table = self.from.residuals?;
        let rows = self.residuals.get(&[model.clone(), group.clone(), output.to_string()])?;
        let row =
            rows.iter().find(|&&row| table.text("segment", row) == *segment).or(rows.first())?;
        Some((table, *row))
    }

    /// Why the iteration of this maneuver's estimate ended.
    fn stop(&self, key: &Key) -> Option<String> {
        let [model, group, _] = key;
        let row = self.estimates.get(&[model.clone(), group.clone()])?.first()?;
        Some(self.from.estimates?.text("stop", *row))
    }

    /// Samples of a flight between two times; a flight's rows are sorted by time.
    fn inputs(&self, flight: &str, span: (f64, f64), names: &[String]) -> Vec<Input> {
        let (Some(samples), Some(rows)) =
            (self.from.samples, self.samples.get(&[flight.to_string()]))
        else {
            return Vec::new();
        };
        let time = |row: &usize| samples.number("t_s", *row);
        let rows = &rows[rows.partition_point(|row| time(row) < span.0)
            ..rows.partition_point(|row| time(row) <= span.1)];
        let t = pick(samples.column("t_s"), rows);
        let curve = |name: &String| {
            let value = pick(samples.column(name), rows);
            if !value.iter().any(|v| v.is_finite()) {
                return None;
            }
            let keep = thin(t.len(), &[&value], self.limit / 2);
            let (factor, unit) = display_unit(samples.unit(name));
            Some(Input {
                name: name.clone(),
                unit,
                t: Packed::of(pick(&t, &keep), 1.0),
                value: Packed::of(pick(&value, &keep), factor),
            })
        };
        names.iter().filter_map(curve).collect()
    }

    /// What is left of an output in a maneuver. What a filter predicts from the samples before
    /// follows them, right or wrong: there it is the noise that the filter takes the sensor to have.
    fn left(&self, key: &Key, output: &str, rows: &[usize]) -> Adequacy {
        let column = |name: &str| pick(self.responses.column(name), rows);
        let found = Adequacy::of(&column("measured"), &column("modelled"));
        let filtered = column("simulated").iter().any(|y| y.is_finite());
        let noise = || {
            let table = self.from.adequacy?;
            let mine =
                |r: &usize| table.text("model", *r) == key[0] && table.text("output", *r) == output;
            (0..table.rows()).find(mine).map(|r| table.number("left", r))
        };
        filtered.then(noise).flatten().map_or(found, |sd| found.with_noise(sd))
    }

    fn rms(&self, rows: &[usize]) -> f64 {
        let [z, y] = ["measured", "modelled"].map(|c| pick(self.responses.column(c), rows));
        let squares = z.iter().zip(&y).map(|(z, y)| (z - y) * (z - y)).filter(|e| e.is_finite());
        (squares.clone().sum::<f64>() / squares.count() as f64).sqrt()
    }

    /// A row of the table of matches.
    fn row(&self, key: &Key, output: &str, rows: &[usize], picked: &str) -> Row {
        let found = self.left(key, output, rows);
        let rms = self.rms(rows);
        let residual = self.residual(key, output);
        let unit = residual.map_or(String::new(), |(table, row)| table.unit_in("unit", row));
        let [model, group, segment] = key;
        let cells = vec![
            model.as_str().into(),
            name(group, segment).into(),
            output.into(),
            found.samples().to_string().into(),
            Cell::new(number(rms, 3)).under(unit),
            Cell::new(plain(100.0 * found.share(), 1)).level_if(found.is_poor(), Level::Warn),
            number(residual.map_or(f64::NAN, |(table, row)| table.number("colour", row)), 3).into(),
        ];
        Row { pick: Some(picked.into()), cells, level: None }
    }
}

fn pick(values: &[f64], rows: &[usize]) -> Vec<f64> {
    rows.iter().map(|&i| values.get(i).copied().unwrap_or(f64::NAN)).collect()
}
