//! `findings`, `candidates`, `held_out`, `gaps`, `closures`, `shifts` and `overlays` in; what a
//! reader should know of what the models lack, out.

use super::columns::Columns;
use super::format::{number, plus_minus};
use super::grid::{Cell, Grid, Level};
use super::overlays::{Overlay, overlays};
use super::place::On;
use super::section::{Body, Given, Section};
use super::{adequacy, again, gap, used};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "diagnosis",
    heading: "What the models lack: the evidence",
    on: On::Index,
    tables: &[
        "findings",
        "candidates",
        "imitations",
        "recommended",
        "held_out",
        "closures",
        "shifts",
        "gaps",
        "overlays",
        "driven",
        "relations",
        "equation_errors",
        "unexplained",
        "turbulence",
        "next_models",
        "estimates",
        "residuals",
        "samples",
    ],
    build,
};

fn build(given: &Given) -> Result<Option<Body>> {
    let (section, mut overlays) = diagnosis(|table| given.get(table));
    // They stand in the order of what changed most.
    let mut room = given.room().count(2, 4);
    overlays.retain(|overlay| {
        let samples = overlay.outputs.iter().map(|curve| curve.t.len()).sum();
        let fits = samples <= room;
        room -= if fits { samples } else { 0 };
        fits
    });
    let gaps = gap::figures(|table| given.get(table), given.room().rows);
    Body::new(include_str!("html/diagnosis.html"), section)
        .plot("overlays", &overlays)?
        .plot("gaps", &gaps)
        .map(Some)
}

/// The section of the page.
#[derive(Debug, Default, Serialize)]
pub struct Diagnosis {
    pub missing: Option<String>,
    pub verdicts: Vec<Verdict>,
    pub added: Grid,
    pub candidates: Grid,
    pub imitations: Grid,
    pub held_out: Grid,
    pub closures: Grid,
    pub shifts: Grid,
    pub gaps: Grid,
    pub equations: Grid,
    /// What is left of each output, and the densities of noise that were let drive the model.
    pub unexplained: Grid,
    pub turbulence: Grid,
    pub again: Grid,
    pub left: Grid,
    /// Whether there are overlays to draw.
    pub overlays: bool,
}

/// One diagnosis in words.
#[derive(Debug, Serialize)]
pub struct Verdict {
    pub name: String,
    pub verdict: String,
    pub level: Level,
    pub text: String,
    pub effects: Vec<String>,
    pub held_out: String,
}

/// Candidates shown per round that were not refitted.
const SHOWN: usize = 5;
/// Gaps below this many times the noise are not listed by regime.
const WIDE: f64 = 1.3;

/// The section and its overlays.
fn diagnosis<'a>(get: impl Fn(&str) -> Option<&'a Columns>) -> (Diagnosis, Vec<Overlay>) {
    let Some(findings) = get("findings").filter(|t| t.rows() > 0) else {
        let missing = "No model was diagnosed: `koehler diagnose`, or a [[diagnose]] section in the pipeline file, does it.";
        return (Diagnosis { missing: Some(missing.into()), ..Diagnosis::default() }, Vec::new());
    };
    let overlays = overlays(get("overlays"));
    let section = Diagnosis {
        missing: None,
        verdicts: verdicts(findings),
        added: used::table(get("recommended")),
        candidates: candidates(get("candidates")),
        imitations: imitations(get("imitations")),
        held_out: held_out(get("held_out")),
        closures: closures(get("closures")),
        shifts: shifts(get("shifts")),
        gaps: gaps(&get),
        equations: gap::equations(get("equation_errors"), get("relations")),
        unexplained: adequacy::unexplained(get("unexplained")),
        turbulence: adequacy::turbulence(get("turbulence")),
        again: again::parameters(get("next_models"), get("estimates")),
        left: again::residuals(get("next_models"), get("residuals")),
        overlays: !overlays.is_empty(),
    };
    (section, overlays)
}

fn level(verdict: &str) -> Level {
    match verdict {
        "nothing missing" => Level::Good,
        nothing if nothing.starts_with("nothing missing but") => Level::Info,
        "named" | "one of these" => Level::Info,
        "located but unexplained" => Level::Warn,
        _ => Level::Bad,
    }
}

pub fn verdicts(table: &Columns) -> Vec<Verdict> {
    let one = |([name], rows): ([String; 1], Vec<usize>)| {
        let first = rows.first().copied().unwrap_or_default();
        let verdict = table.text("verdict", first);
        let or = |row: usize| if table.text("role", row) == "alike" { "or: " } else { "" };
        let incomplete = table.flag("complete", first) == Some(false)
            && ["named", "one of these"].contains(&verdict.as_str());
        Verdict {
            name,
            level: level(&verdict),
            verdict: if incomplete { format!("{verdict}, incomplete") } else { verdict },
            text: table.text("text", first),
            effects: rows
                .iter()
                .skip(1)
                .map(|&row| format!("{}{}", or(row), table.text("text", row)))
                .collect(),
            held_out: table.text("held_out", first),
        }
    };
    table.groups(["diagnosis"]).into_iter().map(one).collect()
}

/// Refitted candidates of every round, and the best of the others.
fn candidates(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No candidates.") };
    let mut grid = Grid::new([
        "diagnosis",
        "#round",
        "candidate",
        "#screened",
        "#gain",
        "#evidence",
        "#null maximum",
        "verdict",
        "~why",
        "~says",
    ]);
    for ([name, round], mut rows) in table.groups(["diagnosis", "round"]) {
        let evidence = |row: usize| table.number("evidence", row);
        rows.sort_by(|&a, &b| {
            let key = |row: usize| {
                if evidence(row).is_finite() {
                    (true, evidence(row))
                } else {
                    (false, table.number("score", row))
                }
            };
            let (a, b) = (key(a), key(b));
            b.0.cmp(&a.0).then(b.1.total_cmp(&a.1))
        });
        let refitted = rows.iter().filter(|&&row| evidence(row).is_finite()).count();
        for &row in rows.iter().take(refitted + SHOWN) {
            let standing = table.text("standing", row);
            let figure = |column: &str| Cell::new(number(table.number(column, row), 4));
            let chosen = standing == "chosen";
            grid.push(vec![
                Cell::new(name.clone()),
                Cell::new(round.clone()),
                Cell::new(table.text("candidate", row)),
                figure("screened"),
                figure("gain"),
                figure("evidence"),
                figure("limit"),
                Cell::new(standing).level_if(chosen, Level::Good),
                Cell::new(table.text("why", row)),
                Cell::new(table.text("sentence", row)),
            ]);
        }
    }
    let note = "Gains are in log-likelihood, residuals whitened. The null maximum is what the best candidate of campaigns in which nothing is missing \
                exceeds in one of a hundred. All candidates are in the table candidates.";
    grid.note = Some(note.into());
    grid.or_missing("No candidates.")
}

/// What the first base imitates, and what its parameters take over.
fn imitations(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No candidate is imitated.") };
    let mut grid = Grid::new([
        "diagnosis",
        "candidate",
        "imitated by",
        "#shift per SI unit",
        "~what would tell",
    ]);
    for row in (0..table.rows()).filter(|&row| table.number("round", row) == 1.0) {
        grid.push(vec![
            Cell::new(table.text("diagnosis", row)),
            Cell::new(table.text("candidate", row)),
            Cell::new(table.text("parameter", row)),
            Cell::new(number(table.number("shift", row), 3)).under(table.unit_in("unit", row)),
            Cell::new(table.text("separate", row)),
        ]);
    }
    let note = "Effects that these flights cannot show beside the estimated parameters: were one there and left out, each parameter would be off by its shift \
                times the size of the effect.";
    grid.note = Some(note.into());
    grid.or_missing("No candidate is imitated.")
}

/// Predicted and realised gains of what was chosen, maneuver by maneuver.
fn held_out(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No candidate was refitted.") };
    let mut grid =
        Grid::new(["diagnosis", "#round", "candidate", "maneuver", "#predicted", "#realised"]);
    for row in (0..table.rows()).filter(|&r| {
        table.text("set", r) == "held out"
            && ["chosen", "alike"].contains(&&*table.text("standing", r))
    }) {
        let (predicted, realised) = (table.number("predicted", row), table.number("realised", row));
        let mut cells: Vec<Cell> = ["diagnosis", "round", "candidate", "segment"]
            .iter()
            .map(|c| Cell::new(table.text(c, row)))
            .collect();
        cells.push(Cell::new(number(predicted, 3)));
        cells.push(
            Cell::new(number(realised, 3)).level_if(predicted > 3.0 && realised < 0.0, Level::Bad),
        );
        grid.push(cells);
    }
    grid.note =
        Some("Derivatives frozen as the training maneuvers give them; only initial states and zero shifts are found again.".into());
    grid.or_missing("Nothing was added.")
}

fn closures(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("Nothing was held out.") };
    let columns = [
        "diagnosis",
        "set",
        "output",
        "#r.m.s. before",
        "#after",
        "#Theil before",
        "#after",
        "#χ² per sample before",
        "#after",
    ];
    let mut grid = Grid::new(columns);
    for row in (0..table.rows()).filter(|&r| table.text("segment", r).is_empty()) {
        let output = table.text("output", row);
        let figure = |column: &str| Cell::new(number(table.number(column, row), 3));
        let name = if output.is_empty() { "all (det R)".to_string() } else { output };
        grid.push(vec![
            Cell::new(table.text("diagnosis", row)),
            Cell::new(table.text("set", row)),
            Cell::new(name).under(table.unit_in("unit", row)),
            figure("rms_before"),
            figure("rms_after"),
            figure("theil_before"),
            figure("theil_after"),
            figure("chi2_before"),
            figure("chi2_after"),
        ]);
    }
    grid.note = Some("χ² is of residuals whitened by the noise that is left with what was added: 1 is nothing but noise.".into());
    grid.or_missing("Nothing was held out.")
}

fn shifts(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("Nothing was added.") };
    let mut grid = Grid::new(["diagnosis", "parameter", "#before", "#after", "#shift|sd"]);
    for row in 0..table.rows() {
        let shift = table.number("shift", row);
        grid.push(vec![
            Cell::new(table.text("diagnosis", row)),
            Cell::new(table.text("parameter", row)).under(table.unit_in("unit", row)),
            Cell::new(plus_minus(table.number("before", row), table.number("before_sd", row))),
            Cell::new(plus_minus(table.number("after", row), table.number("after_sd", row))),
            Cell::new(number(shift, 3)).level_if(shift.abs() > 3.0, Level::Warn),
        ]);
    }
    grid.or_missing("Nothing was added.")
}

/// Where the gap is widest: the whole of every output, and ranges that stand out of it.
fn gaps<'a>(get: impl Fn(&str) -> Option<&'a Columns>) -> Grid {
    let Some(table) = get("gaps") else { return Grid::missing("Nothing was compared.") };
    let mut grid =
        Grid::new(["diagnosis", "when", "output", "where", "#r.m.s. / noise", "#mean / noise"]);
    for ([name, when, output], rows) in table.groups(["diagnosis", "when", "output"]) {
        let all = rows.iter().copied().filter(|&r| table.text("segment", r).is_empty());
        let ratio = |r: usize| table.number("ratio", r);
        let whole = all.clone().find(|&r| table.text("by", r) == "all");
        let level = whole.map_or(1.0, ratio);
        let mut wide: Vec<usize> = all
            .filter(|&r| table.text("by", r) != "all" && ratio(r) > WIDE * level.max(1.0))
            .collect();
        wide.sort_by(|&a, &b| ratio(b).total_cmp(&ratio(a)));
        for row in whole.into_iter().chain(wide.into_iter().take(SHOWN)) {
            let place = gap::place(table, row, &get);
            grid.push(vec![
                Cell::new(name.clone()),
                Cell::new(when.clone()),
                Cell::new(output.clone()),
                Cell::new(place),
                Cell::new(number(ratio(row), 3)).level_if(ratio(row) > 2.0, Level::Warn),
                Cell::new(number(table.number("mean", row) / table.number("noise", row), 2)),
            ]);
        }
    }
    grid.note = Some(
        "The noise is read from the measurements alone, so 1 is a model as good as the sensor. Ranges are listed where they stand out.".into(),
    );
    grid.or_missing("Nothing was compared.")
}

/// The sentence of the checks; where models were estimated and none was diagnosed, how to have one.
pub fn summary(table: Option<&Columns>, estimates: Option<&Columns>) -> Option<(Level, String)> {
    let Some(table) = table.filter(|t| t.rows() > 0) else {
        let text = "No model was diagnosed: `koehler diagnose`, or a [[diagnose]] section in the pipeline file, does it.";
        return estimates.filter(|t| t.rows() > 0).map(|_| (Level::Info, text.to_string()));
    };
    let all = verdicts(table);
    let worst = all.iter().map(|v| v.level).max_by_key(|l| {
        [Level::Good, Level::Info, Level::Warn, Level::Bad].iter().position(|k| k == l)
    })?;
    let words: Vec<String> = all.iter().map(|v| format!("{}: {}", v.name, v.verdict)).collect();
    Some((worst, format!("Diagnosis of the models: {}.", words.join("; "))))
}
