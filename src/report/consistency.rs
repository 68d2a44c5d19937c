//! `consistency` in, one line per flight and channel with its verdicts, and what the checks say
//! about them, out.

use super::columns::Columns;
use super::format::{count, few, number};
use super::grid::{Cell, Grid, Level};
use super::paths;
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "consistency",
    heading: "Do the sensors agree?",
    on: On::Flights,
    tables: &["consistency", "pathmatch"],
    build,
};

#[derive(Serialize)]
struct Shown {
    consistency: Grid,
    /// There are measured channels to be drawn beside the flight path.
    compared: bool,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let paths = paths::paths(given.get("pathmatch"), given.room());
    let section =
        Shown { consistency: table(given.get("consistency")), compared: !paths.is_empty() };
    Body::new(include_str!("html/consistency.html"), section).plot("paths", &paths).map(Some)
}

/// Checks with a column of their own, and its heading.
const SHOWN: [(&str, &str); 10] = [
    ("axis", "#correlation|with its axis"),
    ("sign", "#correlation|with others"),
    ("scale", "#scale"),
    ("level", "#level"),
    ("time skew", "#behind by|s"),
    ("clock", "#its change|s"),
    ("innovation size", "#innovations²|/ predicted"),
    ("whiteness", "#correlation|of neighbours"),
    ("rejected", "#rejected|share"),
    ("noise", "#noise sd"),
];
/// Verdicts that are remarks, not faults.
const REMARKS: [&str; 8] = [
    "coloured",
    "slow errors",
    NEEDS_NOISE,
    "too small",
    "gaps",
    "significant",
    "not significant",
    NOT_COMPARED,
];
/// Of what the others do not tell.
const NOT_COMPARED: &str = "not compared";

/// Verdicts that are a matter of degree: worth a look.
const DEGREE: [&str; 6] = ["too large", "saturated", "outliers", "not used", "drifts", OPPOSED];
/// Of a channel that runs against what the others say of it, with little to tell its sign by.
const OPPOSED: &str = "opposed";
/// Of an inertial sensor that needs more noise than it shows, for the path to fit.
const NEEDS_NOISE: &str = "needs noise";
/// So many times what is much noise is worth a look in a single flight.
const GROSS: f64 = 10.0;
/// What it does in this share of the flights, and in several, is no matter of one flight's air.
const OFTEN: f64 = 0.75;
/// Verdicts that name the culprit: others of the flight may be held against it, and be wrong for that.
const CERTAIN: [&str; 8] = [
    "sign reversed",
    "exchanged",
    "another unit",
    "implausible",
    "dead",
    "frozen",
    "stuck",
    "saturated",
];
/// A channel of which more than this share is rejected does not fit with the others.
const MOST_REJECTED: f64 = 0.1;

/// One line per flight and channel.
pub fn table(table: Option<&Columns>) -> Grid {
    let Some(table) = table else {
        return Grid::missing("No consistency checks: the reconstruct stage has not run.");
    };
    let mut grid = Grid::new(
        ["flight", "channel", "verdict", "~what is wrong"].into_iter().chain(SHOWN.map(|s| s.1)),
    );
    for ([flight, channel], rows) in table.groups(["flight", "channel"]) {
        if rows.iter().all(|&row| table.text("check", row) == "sensor error") {
            continue;
        }
        let bad: Vec<usize> =
            rows.iter().copied().filter(|&row| table.text("verdict", row) != "good").collect();
        let words: Vec<String> = bad.iter().map(|&row| table.text("verdict", row)).collect();
        // remarks are told by their verdict
        let wrong = bad.iter().filter(|&&row| level(table, row) != Level::Info);
        let text: Vec<String> = wrong
            .map(|&row| format!("{}: {}", table.text("check", row), table.text("text", row)))
            .collect();
        let value = |check: &str| {
            rows.iter()
                .find(|&&row| table.text("check", row) == check)
                .map(|&row| table.number("value", row))
        };
        let mut cells: Vec<Cell> = [flight, channel].map(Cell::new).into();
        cells.push(if words.is_empty() { "good".to_string() } else { words.join(", ") }.into());
        cells.push(text.join("; ").into());
        let known = |check: &str| {
            value(check).filter(|v| v.is_finite()).map(|v| number(v, 3)).unwrap_or_default()
        };
        // Only the noise has the unit of its channel; the others stand in the heading.
        let unit = rows
            .iter()
            .find(|&&row| table.text("check", row) == "noise")
            .map(|&row| table.unit_in("unit", row));
        cells.extend(SHOWN.map(|(check, _)| match &unit {
            Some(unit) if check == "noise" => Cell::new(known(check)).under(unit),
            _ => Cell::new(known(check)),
        }));
        grid.push(cells);
        if let Some(last) = grid.rows.last_mut() {
            last.level = bad.iter().map(|&row| level(table, row)).max_by_key(weight);
        }
    }
    let note = "Every channel is left out in turn and compared with what all others say of it (correlation, scale, delay; trends \
                removed), and its innovations in the smoother with their predicted size. Each number with its limits is in the table \
                consistency.";
    grid.note = Some(note.into());
    grid.or_missing("Nothing was checked.")
}

/// How remarkable the verdict of a row is that is not good.
pub fn level(table: &Columns, row: usize) -> Level {
    let verdict = table.text("verdict", row);
    let value = table.number("value", row);
    let rejected = verdict == "outliers" && value > MOST_REJECTED;
    match verdict.as_str() {
        // What drives the path and stops takes the path with it.
        "saturated" if table.text("channel", row).ends_with("_imu") => Level::Bad,
        NEEDS_NOISE if is_gross(table, row) => Level::Warn,
        OPPOSED if needs_gross_noise(table, row) => Level::Bad,
        v if REMARKS.contains(&v) => Level::Info,
        v if DEGREE.contains(&v) && !rejected => Level::Warn,
        _ => Level::Bad,
    }
}

/// Whether a row tells of gross noise that the path needs.
fn is_gross(table: &Columns, row: usize) -> bool {
    table.text("verdict", row) == NEEDS_NOISE
        && table.number("value", row) > GROSS * table.number("high", row)
}

/// Whether the channel of a row needs gross noise in that flight: one that runs against the others, too, is wrong,
/// or what it is held against is.
fn needs_gross_noise(table: &Columns, row: usize) -> bool {
    let same = |other: &usize| {
        ["flight", "channel"].iter().all(|of| table.text(of, *other) == table.text(of, row))
    };
    (0..table.rows()).filter(same).any(|other| is_gross(table, other))
}

fn weight(level: &Level) -> usize {
    [Level::Info, Level::Warn, Level::Bad].iter().position(|l| l == level).unwrap_or(0)
}

/// The sentence of the checks.
pub fn summary(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table.filter(|t| t.rows() > 0)?;
    let names = |wanted: Level| -> Vec<String> {
        (0..table.rows())
            .filter(|&row| {
                table.text("check", row) != "sensor error" && table.text("verdict", row) != "good"
            })
            .filter(|&row| level(table, row) == wanted)
            .map(|row| {
                format!(
                    "{} {} ({})",
                    table.text("flight", row),
                    table.text("channel", row),
                    table.text("verdict", row)
                )
            })
            .collect()
    };
    let (bad, odd, remarks) = (names(Level::Bad), names(Level::Warn), names(Level::Info));
    let odd = [needs_noise(table), odd].concat();
    let unknown = |row: &usize| table.text("verdict", *row) == NOT_COMPARED;
    let unknown: Vec<String> = (0..table.rows())
        .filter(unknown)
        .map(|row| {
            let of = format!("{} {}", table.text("flight", row), table.text("channel", row));
            // What else is asked of the channel was compared.
            let is_level = table.text("check", row) == "level";
            if is_level { format!("the level of {of}") } else { of }
        })
        .collect();
    let agrees = match unknown.len() {
        0 => "Every channel agrees with what the other sensors say of it".to_string(),
        _ => format!(
            "Every channel that could be compared agrees with what the other sensors say of it; not compared: {}",
            few(&unknown)
        ),
    };
    let also =
        if odd.is_empty() { String::new() } else { format!(" Worth a look: {}.", few(&odd)) };
    Some(match (bad.as_slice(), odd.as_slice(), remarks.len() - unknown.len()) {
        ([], [], 0) => (Level::Good, format!("{agrees}.")),
        ([], [], n) => (Level::Info, format!("{agrees}; {}.", count(n, "remark"))),
        ([], odd, _) => {
            (Level::Warn, format!("No channel is wrong beyond doubt. Worth a look: {}.", few(odd)))
        }
        (bad, _, _) => (Level::Bad, format!("{}{also}", contradicted(bad, &odd))),
    })
}

/// Inertial sensors that need more noise than they show, in nearly all flights.
fn needs_noise(table: &Columns) -> Vec<String> {
    let noises = |rows: &[usize], verdict: Option<&str>| {
        let is = |row: &&usize| {
            table.text("check", **row) == "noise"
                && verdict.is_none_or(|verdict| table.text("verdict", **row) == verdict)
        };
        rows.iter().filter(is).count()
    };
    let often = |([channel], rows): ([String; 1], Vec<usize>)| {
        let (all, needs) = (noises(&rows, None), noises(&rows, Some(NEEDS_NOISE)));
        (needs > 1 && needs as f64 >= OFTEN * all as f64).then(|| {
            format!("{channel} (needs more than twice its noise in {needs} of {all} flights: it, or what it is held against, has another sign, unit, scale or place than is said)")
        })
    };
    table.groups(["channel"]).into_iter().filter_map(often).collect()
}

/// The sentences about channels that do not fit with the others. Where some have a fault that is certain
/// (one of `odd` may), they stand first, and of others of their flights it is said that they may follow.
fn contradicted(bad: &[String], odd: &[String]) -> String {
    let channel = |name: &str| name.split(' ').nth(1).unwrap_or_default().to_string();
    let is_certain = |name: &&String| CERTAIN.iter().any(|v| name.ends_with(&format!("({v})")));
    // The sensors of all flights are the same.
    let channels: Vec<String> =
        bad.iter().chain(odd).filter(is_certain).map(|name| channel(name)).collect();
    let certain = |name: &&String| is_certain(name) || channels.contains(&channel(name));
    let flight = |name: &str| name.split(' ').next().unwrap_or_default().to_string();
    let flights: Vec<String> =
        bad.iter().chain(odd).filter(certain).map(|name| flight(name)).collect();
    let (follow, first): (Vec<String>, Vec<String>) =
        bad.iter().cloned().partition(|name| !certain(&name) && flights.contains(&flight(name)));
    let (mut culprits, others): (Vec<String>, Vec<String>) =
        first.into_iter().partition(|name| certain(&name));
    culprits.extend(others);
    let not_fit = "Channels that do not fit with the others";
    let mut sentences = Vec::new();
    if !culprits.is_empty() {
        sentences.push(format!("{not_fit}: {}.", few(&culprits)));
    }
    // Without culprits among them it is one that is worth a look.
    let because = match culprits.is_empty() {
        true => format!("{not_fit}, perhaps because of one that is worth a look"),
        false => "What may follow from that".to_string(),
    };
    if !follow.is_empty() {
        sentences.push(format!("{because}: {}.", few(&follow)));
    }
    sentences.join(" ")
}
