//! What a diagnosis found in; a box of at most five lines with one figure and one value per
//! parameter out.

use super::columns::Columns;
use super::diagnosis;
use super::format::{brief, number};
use super::grid::Level;
use super::overlays::{Overlay, overlays};
use super::place::On;
use super::section::{Body, Given, Section};
use super::used::{self, Added};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "verdict",
    heading: "Verdict of the diagnosis",
    on: On::Index,
    tables: &["findings", "candidates", "held_out", "overlays", "recommended"],
    build,
};

/// One diagnosis.
#[derive(Debug, Serialize)]
struct Verdict {
    level: Level,
    lines: Vec<Line>,
    figure: Option<Figure>,
}

#[derive(Debug, PartialEq, Serialize)]
struct Line {
    label: String,
    text: String,
}

#[derive(Debug, Serialize)]
struct Figure {
    index: usize,
    caption: String,
}

#[derive(Serialize)]
struct Shown {
    verdicts: Vec<Verdict>,
    evidence: &'static str,
}

/// Lines of a box.
const LINES: usize = 5;
/// Outputs of the figure: those that what was added moved most.
const OUTPUTS: usize = 3;

fn build(given: &Given) -> Result<Option<Body>> {
    let Some(findings) = given.get("findings").filter(|t| t.rows() > 0) else { return Ok(None) };
    let added = used::added(given.get("recommended"));
    let overlays = overlays(given.get("overlays"));
    let (mut verdicts, mut figures) = (Vec::new(), Vec::new());
    for verdict in diagnosis::verdicts(findings) {
        let rows: Vec<usize> = (0..findings.rows())
            .filter(|&r| findings.text("diagnosis", r) == verdict.name)
            .collect();
        let leading = leading(findings, &rows);
        let block = leading.and_then(|row| block(given.get("held_out"), findings, row));
        let figure = block.and_then(|(segment, gain)| {
            let overlay =
                overlays.iter().find(|o| o.diagnosis == verdict.name && o.segment == segment)?;
            figures.push(most_moved(overlay));
            let caption = format!(
                "{segment} was held out: of all such blocks it gains most ({}).",
                number(gain, 3)
            );
            Some(Figure { index: figures.len() - 1, caption })
        });
        let mut lines = vec![Line {
            label: format!("{}: {}.", verdict.name, verdict.verdict),
            text: String::new(),
        }];
        match leading {
            Some(row) => lines.extend(found(given, findings, &rows, row, &added)),
            None => {
                lines[0].text = brief(verdict.text.split(" Data first:").next().unwrap_or_default())
            }
        }
        lines.truncate(LINES);
        verdicts.push(Verdict { level: verdict.level, lines, figure });
    }
    let evidence = diagnosis::SECTION.heading;
    Body::new(include_str!("html/verdict.html"), Shown { verdicts, evidence })
        .plot("verdicts", &figures)
        .map(Some)
}

/// The effect that was added and gains most on held-out maneuvers.
fn leading(findings: &Columns, rows: &[usize]) -> Option<usize> {
    let gain = |row: usize| findings.number("held_out_realised", row);
    let added = rows.iter().copied().filter(|&r| findings.text("role", r) == "added");
    added.max_by(|&a, &b| gain(a).total_cmp(&gain(b)))
}

/// The held-out block with the largest realised gain of an effect, and that gain.
fn block(held_out: Option<&Columns>, findings: &Columns, row: usize) -> Option<(String, f64)> {
    let table = held_out?;
    let key = ["diagnosis", "round", "candidate"].map(|c| findings.text(c, row));
    let ours = |r: &usize| {
        table.text("set", *r) == "held out"
            && ["diagnosis", "round", "candidate"].map(|c| table.text(c, *r)) == key
    };
    let gain = |r: usize| table.number("realised", r);
    let best = (0..table.rows())
        .filter(ours)
        .filter(|&r| gain(r).is_finite())
        .max_by(|&a, &b| gain(a).total_cmp(&gain(b)))?;
    Some((table.text("segment", best), gain(best)))
}

/// What a diagnosis added: the effect that gains most, its value to use, its gain, and what else
/// there is.
fn found(
    given: &Given,
    findings: &Columns,
    rows: &[usize],
    row: usize,
    added: &[Added],
) -> Vec<Line> {
    let line = |label: &str, text: String| Line { label: label.into(), text };
    let (name, candidate) = (findings.text("diagnosis", row), findings.text("candidate", row));
    let sentence = |row: usize| {
        let key = ["diagnosis", "round", "candidate"].map(|c| findings.text(c, row));
        let of = |t: &Columns| {
            (0..t.rows())
                .find(|&r| ["diagnosis", "round", "candidate"].map(|c| t.text(c, r)) == key)
        };
        let table = given.get("candidates").and_then(|t| Some(t.text("sentence", of(t)?)));
        brief(table.unwrap_or_else(|| findings.text("candidate", row)).trim_end_matches('.'))
    };
    let verdict = findings.text("verdict", row);
    let nothing = verdict.starts_with("nothing missing");
    let lacks = match nothing {
        true => "Noise:",
        false if verdict.starts_with("located") => "Made smaller by:",
        false => "The model lacks:",
    };
    let mut lines = vec![line(lacks, format!("{}.", sentence(row)))];
    let mine: Vec<&Added> =
        added.iter().filter(|a| a.diagnosis == name && a.candidate == candidate).collect();
    if let Some(first) = mine.iter().find(|a| a.is_determined()).or(mine.first()) {
        let values: Vec<String> = mine.iter().map(|a| a.words()).collect();
        lines.push(line("Use:", format!("{} ({}).", values.join(", "), first.source)));
    }
    let of = |column: &str| number(findings.number(column, row), 3);
    let gains = [of("held_out_realised"), of("held_out_predicted"), of("gain"), of("limit")];
    let [realised, predicted, gain, null] = gains;
    let gains = format!(
        "{realised} in log-likelihood on held-out maneuvers, {predicted} predicted; {gain} on the others (null maximum, 99%: {null})."
    );
    lines.push(line("Gain:", gains));
    let others: Vec<String> = rows
        .iter()
        .filter(|&&r| r != row && findings.text("role", r) == "added")
        .map(|&r| sentence(r))
        .collect();
    let alike = rows.iter().filter(|&&r| findings.text("role", r) == "alike").count();
    let mut rest = others;
    if alike > 0 {
        rest.push(format!("{alike} that are not distinguishable from what was added"));
    }
    if !nothing && findings.flag("complete", row) == Some(false) {
        rest.push("something that is left unexplained".into());
    }
    if !rest.is_empty() {
        lines.push(line("Besides:", format!("{}.", brief(&rest.join("; ")))));
    }
    lines
}

/// The outputs of an overlay that moved most, in their order.
fn most_moved(overlay: &Overlay) -> Overlay {
    let mut order: Vec<usize> = (0..overlay.outputs.len()).collect();
    order.sort_by(|&a, &b| overlay.outputs[b].moved().total_cmp(&overlay.outputs[a].moved()));
    order.truncate(OUTPUTS);
    order.sort_unstable();
    Overlay {
        outputs: order.into_iter().map(|i| overlay.outputs[i].clone()).collect(),
        ..overlay.clone()
    }
}
