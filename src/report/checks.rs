//! All tables in, what a reader wants to know first out: the counts at the top and the answers to "can I trust this?".
//!
//! A **problem** (`Level::Bad`) is printed by `koehler run` and makes its exit code 1, so it is one only where something asked for is not
//! there or a result stands on a sensor that is wrong, whatever the threshold: a channel that is dead, reversed, late, scaled or rejected
//! by the tenth; a flight without a maneuver that is used; an estimation that did not converge; a missing result; a diagnosis without a
//! verdict. What is a matter of degree (noise larger than predicted, samples at a stop, scatter, correlations, misfits, a model that
//! lacks something) is worth a look (`Level::Warn`): the numbers say so themselves, and a person has to judge.

use super::columns::Columns;
use super::format::{count, number};
use super::grid::Level;
use super::lines::EXCESS;
use super::maneuvers::{self, Match};
use super::{consistency, diagnosis, estimates, flights, lines, logs, uncertainty};
use serde::Serialize;

/// One number of the header.
#[derive(Debug, Serialize)]
pub struct Tile {
    pub value: String,
    pub label: String,
    pub level: Option<Level>,
}

/// One checked question, with its answer.
#[derive(Debug, Serialize)]
pub struct Check {
    pub level: Level,
    pub mark: &'static str,
    pub word: &'static str,
    pub text: String,
    /// The section with the details.
    pub link: &'static str,
}

/// The tables that the header and the checks look at.
#[derive(Clone, Copy)]
pub struct Facts<'a> {
    pub flights: &'a [String],
    pub segments: Option<&'a Columns>,
    pub estimates: Option<&'a Columns>,
    pub correlations: Option<&'a Columns>,
    pub repeats: Option<&'a Columns>,
    pub fits: Option<&'a Columns>,
    pub channels: Option<&'a Columns>,
    pub consistency: Option<&'a Columns>,
    pub findings: Option<&'a Columns>,
    pub notes: Option<&'a Columns>,
    pub responses: Option<&'a Columns>,
    pub matches: &'a [Match],
}

/// Flights, maneuvers found and used, estimations converged, lines, notes.
pub fn tiles(facts: Facts, asked: impl Fn(&str) -> bool) -> Vec<Tile> {
    let tile = |value: String, label: &str, level| Tile { value, label: label.into(), level };
    let found = facts.segments.map_or(0, Columns::rows);
    let used = facts.responses.map_or(0, |r| r.rows_by(["segment"]).len());
    let (all, good) = estimates::counts(facts.estimates);
    let lines = facts.fits.map_or(0, Columns::rows);
    let remarks = facts.notes.map_or(0, Columns::rows);
    let noted = facts.notes.and_then(|n| logs::remarks(Some(n))).map(|(level, _)| level).filter(|l| *l != Level::Good);
    let tiles = [
        ("", tile(facts.flights.len().to_string(), if facts.flights.len() == 1 { "flight" } else { "flights" }, None)),
        ("estimates", tile(found.to_string(), "maneuvers found", (found == 0).then_some(Level::Bad))),
        ("estimates", tile(used.to_string(), "maneuvers estimated", (used == 0).then_some(Level::Bad))),
        ("estimates", tile(format!("{good} / {all}"), "estimates converged", (good < all || all == 0).then_some(Level::Bad))),
        ("fits", tile(lines.to_string(), "fitted lines", None)),
        ("", tile(remarks.to_string(), "notes", noted)),
    ];
    tiles.into_iter().filter(|(section, _)| asked(section)).map(|(_, tile)| tile).collect()
}

/// The checks, in the order of the processing.
pub fn checks(facts: Facts) -> Vec<Check> {
    let answers = [
        (logs::losses(facts.channels), "channels"),
        (consistency::summary(facts.consistency), "consistency"),
        (flights::summary(facts.segments, facts.flights), "flights"),
        (by_hand(facts.segments), "flights"),
        (estimates::convergence(facts.estimates), "estimates"),
        (maneuvers::summary(facts.matches), "maneuvers"),
        (estimates::colour(facts.estimates), "estimates"),
        (estimates::separation(facts.correlations), "estimates"),
        (uncertainty::honesty(facts.repeats), "uncertainty"),
        (scatter(facts.fits), "fits"),
        (few_points(facts.fits), "fits"),
        (diagnosis::summary(facts.findings), "diagnosis"),
        (logs::remarks(facts.notes), "notes"),
    ];
    answers.into_iter().filter_map(|(answer, link)| answer.map(|(level, text)| check(level, text, link))).collect()
}

/// The sentences of those that are problems.
pub fn problems(checks: &[Check]) -> Vec<String> {
    checks.iter().filter(|check| check.level == Level::Bad).map(|check| check.text.clone()).collect()
}

fn check(level: Level, text: String, link: &'static str) -> Check {
    let (mark, word) = match level {
        Level::Good => ("✓", "good"),
        Level::Info | Level::Dim => ("·", "note"),
        Level::Warn => ("!", "look"),
        Level::Bad => ("✗", "problem"),
    };
    Check { level, mark, word, text, link }
}

/// Maneuvers that were left out, by hand or by the score.
fn by_hand(segments: Option<&Columns>) -> Option<(Level, String)> {
    let segments = segments?;
    let out = (0..segments.rows()).filter(|&row| !flights::included(segments, row)).count();
    (out > 0).then(|| (Level::Info, format!("{} found but left out; the reasons are in the table.", count(out, "maneuver"))))
}

/// Scatter between maneuvers beyond what the estimates' own sd explain.
fn scatter(fits: Option<&Columns>) -> Option<(Level, String)> {
    let fits = fits.filter(|f| f.rows() > 0)?;
    let excess = |row: &usize| lines::reduced_chi2(fits, *row) > EXCESS;
    let names: Vec<String> = (0..fits.rows())
        .filter(excess)
        .map(|r| format!("{} ({})", fits.text("parameter", r), number(lines::reduced_chi2(fits, r), 2)))
        .collect();
    Some(if names.is_empty() {
        (
            Level::Good,
            format!("The points scatter about their lines as their standard deviations say (reduced chi-square below {EXCESS})."),
        )
    } else {
        let text = format!(
            "Points scatter more than their standard deviations explain (reduced chi-square above {EXCESS}): {}.",
            estimates::few(&names)
        );
        (Level::Warn, text + " The bands include this scatter; ask what the model lacks.")
    })
}

/// Lines through few points.
fn few_points(fits: Option<&Columns>) -> Option<(Level, String)> {
    let fits = fits?;
    let names: Vec<String> = (0..fits.rows()).filter(|&r| fits.number("n", r) < 5.0).map(|r| fits.text("parameter", r)).collect();
    (!names.is_empty()).then(|| {
        (Level::Warn, format!("Lines through fewer than 5 points, so with wide and uncertain bands: {}.", estimates::few(&names)))
    })
}
