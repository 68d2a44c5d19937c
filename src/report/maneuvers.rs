//! `responses`, `segments` and `samples` in, the time histories of every maneuver and the table of
//! how well each one fits out.

use super::columns::Columns;
use super::flights;
use super::format::{count, display_unit, number, plain, short, shorts, thin, times};
use super::grid::{Cell, Grid, Level, Row};
use super::section::{Body, Given, Section};
use crate::error::Result;
use crate::signal::robust::noise_sd;
use serde::Serialize;
use std::collections::BTreeMap;

pub const SECTION: Section = Section {
    id: "maneuvers",
    heading: "Measured and modelled, maneuver by maneuver",
    tables: &["responses", "segments", "samples", "estimates", "residuals"],
    build,
};

fn build(given: &Given) -> Result<Option<Body>> {
    let sources = Sources {
        responses: given.get("responses"),
        segments: given.get("segments"),
        samples: given.get("samples"),
        estimates: given.get("estimates"),
        residuals: given.get("residuals"),
        inputs: &given.input.inputs,
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
    pub t: Vec<Option<f64>>,
    pub measured: Vec<Option<f64>>,
    pub modelled: Vec<Option<f64>>,
    /// The free simulation, where `modelled` is predicted sample by sample; empty elsewhere.
    pub simulated: Vec<Option<f64>>,
}

#[derive(Debug, Serialize)]
pub struct Input {
    pub name: String,
    pub unit: String,
    pub t: Vec<Option<f64>>,
    pub value: Vec<Option<f64>>,
}

/// The text around the plot (template).
#[derive(Debug, Default, Serialize)]
pub struct Maneuvers {
    pub missing: Option<String>,
    /// How the drawn samples relate to the recorded ones.
    pub shown: String,
    pub table: Grid,
}

/// What the checks say about the match of one output of one maneuver.
#[derive(Debug, Clone)]
pub struct Match {
    pub name: String,
    /// Residual r.m.s. over the standard deviation of the measured output.
    pub misfit: f64,
}

/// The tables the time histories come from.
pub struct Sources<'a> {
    pub responses: Option<&'a Columns>,
    pub segments: Option<&'a Columns>,
    pub samples: Option<&'a Columns>,
    pub estimates: Option<&'a Columns>,
    pub residuals: Option<&'a Columns>,
    /// Sample columns that drive each model.
    pub inputs: &'a BTreeMap<String, Vec<String>>,
}

/// Numbers drawn in all maneuvers together, at most about: keeps the page below some 10 MB however
/// large the campaign is.
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
    let limit = (BUDGET / (3 * groups.len().max(1))).clamp(150, 1200);
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

/// The match of every output of every maneuver, in the order of `responses`.
pub fn matches(responses: Option<&Columns>) -> Vec<Match> {
    let Some(responses) = responses else { return Vec::new() };
    let mut all = Vec::new();
    for ([_, group, segment], rows) in responses.groups(["model", "group", "segment"]) {
        let each = by_output(responses, &rows).into_iter();
        all.extend(each.map(|(output, rows)| Match {
            misfit: misfit(responses, &rows).part,
            name: format!("{output} of {}", name(&group, &segment)),
        }));
    }
    all
}

/// How far one output of one maneuver is from what was measured.
struct Misfit {
    n: usize,
    rms: f64,
    /// r.m.s. without the sensor's noise, over the standard deviation of what was measured.
    part: f64,
}

fn misfit(responses: &Columns, rows: &[usize]) -> Misfit {
    let [measured, modelled] = ["measured", "modelled"].map(|c| pick(responses.column(c), rows));
    misfit_of(&measured, &modelled)
}

fn misfit_of(measured: &[f64], modelled: &[f64]) -> Misfit {
    let both = measured.iter().zip(modelled).map(|(z, y)| (*z, *y));
    let pairs: Vec<(f64, f64)> = both.filter(|(z, y)| z.is_finite() && y.is_finite()).collect();
    let n = pairs.len() as f64;
    let mean = pairs.iter().map(|(z, _)| z).sum::<f64>() / n;
    let rms = (pairs.iter().map(|(z, y)| (z - y) * (z - y)).sum::<f64>() / n).sqrt();
    let variation = (pairs.iter().map(|(z, _)| (z - mean) * (z - mean)).sum::<f64>() / n).sqrt();
    // A model cannot follow noise, and an output that was not excited is hardly more than that.
    // What is known of the noise from n samples has a standard error of some 1.6/sqrt(n) of it.
    let noise = noise_sd(measured) * (1.0 + 3.2 / n.sqrt());
    let beyond = (rms * rms - noise * noise).max(0.0).sqrt();
    Misfit { n: pairs.len(), rms, part: beyond / variation }
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
        let drawn = |v: &[f64]| shorts(pick(v, &keep), factor);
        Output {
            name,
            unit,
            t: times(&pick(&t, &keep)),
            measured: drawn(&measured),
            modelled: drawn(&modelled),
            simulated: if free { drawn(&simulated) } else { Vec::new() },
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
                t: times(&pick(&t, &keep)),
                value: shorts(pick(&value, &keep), factor),
            })
        };
        names.iter().filter_map(curve).collect()
    }

    /// A row of the table of matches.
    fn row(&self, key: &Key, output: &str, rows: &[usize], picked: &str) -> Row {
        let found = misfit(self.responses, rows);
        let residual = self.residual(key, output);
        let unit = residual.map_or(String::new(), |(table, row)| table.unit_in("unit", row));
        let [model, group, segment] = key;
        let cells = vec![
            model.as_str().into(),
            name(group, segment).into(),
            output.into(),
            found.n.to_string().into(),
            Cell::new(number(found.rms, 3)).under(unit),
            Cell::new(plain(100.0 * found.part, 1)).level_if(found.part > POOR, Level::Warn),
            number(residual.map_or(f64::NAN, |(table, row)| table.number("colour", row)), 3).into(),
        ];
        Row { pick: Some(picked.into()), cells, level: None }
    }
}

fn pick(values: &[f64], rows: &[usize]) -> Vec<f64> {
    rows.iter().map(|&i| values.get(i).copied().unwrap_or(f64::NAN)).collect()
}

/// A residual that is larger, beyond the sensor's noise, than this part of the measured variation
/// is a poor match.
pub const POOR: f64 = 0.25;

/// The sentence of the checks about the match of the time histories.
pub fn summary(matches: &[Match]) -> Option<(Level, String)> {
    let worst = matches
        .iter()
        .filter(|m| m.misfit.is_finite())
        .max_by(|a, b| a.misfit.total_cmp(&b.misfit))?;
    let poor = matches.iter().filter(|m| m.misfit > POOR).count();
    let worst = format!("the worst is {} with {:.1}%", worst.name, 100.0 * worst.misfit);
    Some(if poor == 0 {
        (
            Level::Good,
            format!(
                "Beyond the sensors' noise, modelled and measured outputs differ by less than {:.0}% of the measured variation; {worst}.",
                100.0 * POOR
            ),
        )
    } else {
        (
            Level::Warn,
            format!(
                "{} differ from the measured, beyond the sensor's noise, by more than {:.0}% of its variation; {worst}.",
                count(poor, "modelled output"),
                100.0 * POOR
            ),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn noise_is_no_misfit_and_an_offset_is_one() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
        let curve = |size: f64| (0..400).map(move |i| size * (0.05 * i as f64).sin());
        for size in [0.0, 0.5, 3.0] {
            let modelled: Vec<f64> = curve(size).collect();
            let measured: Vec<f64> = modelled.iter().map(|y| y + noise()).collect();
            let right = misfit_of(&measured, &modelled);
            assert!(right.part < POOR && (right.rms - 1.0).abs() < 0.1, "{size}: {}", right.part);
            let aside: Vec<f64> = modelled.iter().map(|y| y + 1.0).collect();
            assert!(misfit_of(&measured, &aside).part > POOR, "{size}");
        }
    }
}
