//! All tables in, what a reader wants to know first out: the counts at the top and the answers to
//! "can I trust this?".
//!
//! A **problem** (`Level::Bad`) is printed by `koehler run` and makes its exit code 1, so it is one
//! only where something asked for is not there or a result stands on a sensor that is wrong,
//! whatever the threshold: a channel that is dead, reversed, late, scaled, rejected by the tenth,
//! or still for a tenth of a maneuver; a flight without a maneuver that is used; an estimation that did
//! not converge; a missing result; a validated maneuver outside its tolerances; a diagnosis without
//! a verdict. What is a matter of degree (noise larger than predicted, samples at a stop, scatter,
//! correlations, an estimate that leaves more than noise, a model that lacks something) is worth a look (`Level::Warn`): the numbers
//! say so themselves, and a person has to judge.

use super::columns::Columns;
use super::format::{count, few, number};
use super::grid::Level;
use super::lines::EXCESS;
use super::place::{Form, On};
use super::section::{Body, Given, Section};
use super::{
    adequacy, consistency, diagnosis, doubts, estimates, flights, lines, logs, repeats, signs,
    still, tolerances,
};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;

pub const SECTION: Section = Section {
    id: "checks",
    heading: "Can these results be trusted?",
    on: On::Both,
    tables: &[
        "notes",
        "channels",
        "consistency",
        "segments",
        "estimates",
        "doubts",
        "adequacy",
        "correlations",
        "responses",
        "repeats",
        "fits",
        "points",
        "tolerances",
        "findings",
    ],
    build,
};

/// Tables of which the page of a flight says nothing here: their own sections are about the campaign. A
/// page that read them would be made again whenever any flight moves a line.
pub const OF_THE_CAMPAIGN: [&str; 4] = ["fits", "points", "repeats", "findings"];

/// The section that leads to the pages of the flights.
pub const LIST: &str = "list";

/// One number of the header.
#[derive(Debug, Serialize)]
pub struct Tile {
    pub value: String,
    pub label: String,
    pub level: Option<Level>,
}

/// One checked question, with its answer.
#[derive(Debug, Clone, Serialize)]
pub struct Check {
    pub level: Level,
    pub mark: &'static str,
    pub word: &'static str,
    pub text: String,
    /// Where the details are; none where the page has no place for them.
    pub link: Option<Link>,
}

/// A place on the page.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Link {
    /// The section or, in it, what has this `id`.
    pub id: &'static str,
    /// Heading of the section.
    pub heading: &'static str,
}

#[derive(Serialize)]
struct Shown {
    checks: Vec<Check>,
}

fn build(given: &Given) -> Result<Option<Body>> {
    Ok(Some(Body::new(include_str!("html/checks.html"), Shown { checks: answers(given) })))
}

/// Flights, maneuvers found and used, estimations converged, lines, notes: what the campaign asks
/// for.
pub fn tiles(given: &Given) -> Vec<Tile> {
    let tile = |value: String, label: &str, level| Tile { value, label: label.into(), level };
    let asked = |table: &str| !given.input.unasked.contains(&table);
    let flights = match &given.input.form {
        // Those without a row in any table, too.
        Form::Index(all) => all.len(),
        _ => given.flights.len(),
    };
    let mut tiles =
        vec![tile(flights.to_string(), if flights == 1 { "flight" } else { "flights" }, None)];
    if let Form::Flight(_) = given.input.form {
        tiles.clear();
    }
    let found = given.get("segments").map_or(0, Columns::rows);
    let used = flights::used(given.get("responses"), given.get("segments"));
    // Records that are estimated as they are need no maneuvers.
    if asked("segments") && (asked("estimates") || found > 0) {
        tiles.push(tile(
            found.to_string(),
            "maneuvers found",
            (found == 0 && used.records == 0).then_some(Level::Bad),
        ));
    }
    if asked("estimates") {
        if used.maneuvers > 0 || used.records == 0 {
            tiles.push(tile(
                used.maneuvers.to_string(),
                "maneuvers estimated",
                (used.maneuvers == 0).then_some(Level::Bad),
            ));
        }
        if used.records > 0 {
            let label = if used.records == 1 {
                "record estimated as one segment"
            } else {
                "records estimated as they are"
            };
            tiles.push(tile(used.records.to_string(), label, None));
        }
        let (all, good) = estimates::counts(given.get("estimates"));
        tiles.push(tile(
            format!("{good} / {all}"),
            "estimates converged",
            (good < all || all == 0).then_some(Level::Bad),
        ));
    }
    // Lines are through the maneuvers of all flights.
    if asked("fits") && !matches!(given.input.form, Form::Flight(_)) {
        tiles.push(tile(
            given.get("fits").map_or(0, Columns::rows).to_string(),
            "fitted lines",
            None,
        ));
    }
    let notes = given.get("notes");
    let noted = logs::remarks(notes).map(|(level, _)| level).filter(|l| *l != Level::Good);
    tiles.push(tile(notes.map_or(0, Columns::rows).to_string(), "notes", noted));
    tiles
}

/// The checks, in the order of the processing.
pub fn answers(given: &Given) -> Vec<Check> {
    let get = |table: &str| given.get(table);
    let answers = [
        (logs::losses(get("channels")), "channels", "channels"),
        (consistency::summary(get("consistency")), "consistency", "consistency"),
        (
            still::summary(get("channels"), get("consistency"), get("segments"), get("responses")),
            "channels",
            "channels",
        ),
        (flights::summary(get("segments"), get("responses"), &given.ids()), "flights", "segments"),
        (by_hand(get("segments")), "flights", "segments"),
        (estimates::convergence(get("estimates")), "estimates", "estimates"),
        (signs::summary(get("estimates")), "estimates", "estimates"),
        (doubts::summary(get("doubts")), "uncertainty", "doubts"),
        (adequacy::summary(get("adequacy")), "matches", "matches"),
        (estimates::colour(get("estimates")), "estimates", "estimates"),
        (estimates::separation(get("correlations")), "correlations", "correlations"),
        (repeats::honesty(get("repeats")), "uncertainty", "repeats"),
        (scatter(get("fits"), get("points")), "fits", "fits"),
        (few_points(get("fits")), "fits", "fits"),
        (tolerances::summary(get("tolerances")), "validation", "tolerances"),
        (diagnosis::summary(get("findings"), get("estimates")), "verdict", "verdict"),
        (logs::remarks(get("notes")), "notes", "notes"),
    ];
    let of = |id: &str| given.sections.iter().find(|s| s.id == id);
    let link = |section: &str, id| {
        let section = of(section).filter(|s| given.input.asks_for(s))?;
        // What stands on the pages of the flights is found by their list.
        Some(match given.input.form.shows(section.on) {
            true => Link { id, heading: section.heading },
            false => of(LIST).map(|list| Link { id: LIST, heading: list.heading })?,
        })
    };
    // The page of a flight answers for the flight.
    let is_asked = |section: &str| match given.input.form {
        Form::Flight(_) => of(section).is_none_or(|s| given.input.form.shows(s.on)),
        _ => true,
    };
    // A check without a finding has nothing to show.
    let found = |id: &str| id != "verdict" || get("findings").is_some_and(|t| t.rows() > 0);
    let check = |(answer, section, id): (Option<(Level, String)>, &str, &'static str)| {
        answer.map(|(level, text)| check(level, text, link(section, id).filter(|_| found(id))))
    };
    answers.into_iter().filter(|(_, section, _)| is_asked(section)).filter_map(check).collect()
}

/// The sentences of those that are problems.
pub fn problems(checks: &[Check]) -> Vec<String> {
    checks
        .iter()
        .filter(|check| check.level == Level::Bad)
        .map(|check| check.text.clone())
        .collect()
}

/// The sentences that are worth a look and that no note of a stage says.
pub fn looks(tables: &BTreeMap<String, Columns>) -> Vec<String> {
    let get = |table: &str| tables.get(table);
    let answers = [
        consistency::summary(get("consistency")),
        signs::summary(get("estimates")),
        estimates::colour(get("estimates")),
        scatter(get("fits"), get("points")),
    ];
    let is_look = |(level, text): (Level, String)| (level == Level::Warn).then_some(text);
    answers.into_iter().flatten().filter_map(is_look).collect()
}

fn check(level: Level, text: String, link: Option<Link>) -> Check {
    let mark = match level {
        Level::Good => "✓",
        Level::Info | Level::Dim => "·",
        Level::Warn => "!",
        Level::Bad => "✗",
    };
    Check { level, mark, word: word(level), text, link }
}

/// What a level is called.
pub fn word(level: Level) -> &'static str {
    match level {
        Level::Good => "good",
        Level::Info | Level::Dim => "note",
        Level::Warn => "look",
        Level::Bad => "problem",
    }
}

/// Maneuvers that were left out, by hand or by the score.
fn by_hand(segments: Option<&Columns>) -> Option<(Level, String)> {
    let segments = segments?;
    let out = (0..segments.rows()).filter(|&row| !flights::included(segments, row)).count();
    (out > 0).then(|| {
        (
            Level::Info,
            format!("{} found but left out; the reasons are in the table.", count(out, "maneuver")),
        )
    })
}

/// Scatter between maneuvers beyond what the estimates' own sd explain.
fn scatter(fits: Option<&Columns>, points: Option<&Columns>) -> Option<(Level, String)> {
    let fits = fits.filter(|f| f.rows() > 0)?;
    let excess = |row: &usize| lines::reduced_chi2(fits, *row) > EXCESS;
    let names: Vec<String> = (0..fits.rows())
        .filter(excess)
        .map(|r| {
            let furthest = points.and_then(|points| lines::furthest(fits, r, points));
            let furthest = furthest.map_or(String::new(), |name| format!(", {name} furthest"));
            let chi2 = number(lines::reduced_chi2(fits, r), 2);
            format!("{} ({chi2}{furthest})", fits.text("parameter", r))
        })
        .collect();
    Some(if names.is_empty() {
        (
            Level::Good,
            format!(
                "The points scatter about their lines as their standard deviations say (reduced chi-square below {EXCESS})."
            ),
        )
    } else {
        let text = format!(
            "Points scatter more than their standard deviations explain (reduced chi-square above {EXCESS}): {}.",
            few(&names)
        );
        (Level::Warn, text + " The bands include this scatter; ask what the model lacks.")
    })
}

/// Lines through few points.
fn few_points(fits: Option<&Columns>) -> Option<(Level, String)> {
    let fits = fits?;
    let names: Vec<String> = (0..fits.rows())
        .filter(|&r| fits.number("n", r) < 5.0)
        .map(|r| fits.text("parameter", r))
        .collect();
    (!names.is_empty()).then(|| {
        (
            Level::Warn,
            format!(
                "Lines through fewer than 5 points, so with wide and uncertain bands: {}.",
                few(&names)
            ),
        )
    })
}
