//! The closing words of a run: its result and its tables come in, a page of text on the screen goes
//! out.

use super::flights::{self, read, tally};
use super::lacking;
use super::ran::Ran;
use super::verdict;
use super::words::say;
use crate::error::Result;
use crate::fit::half_95;
use crate::pipeline::{Plan, RunResult, Store};
use crate::signal::adequacy::{Leaves, is_far, words};
use crate::stage::{Note, Part, Severity};
use crate::table::Table;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Kinds of notes shown before the rest is left to the table.
const GROUPS_SHOWN: usize = 20;
/// What is read of how adequate an estimate is.
const LEFT: [&str; 7] = ["output", "leaves", "share", "flight", "variation", "left", "noise"];
/// Outputs named of which an estimate leaves more than noise.
const POOR: usize = 4;

/// Prints stages, flights, estimates, lines, notes, verdicts, and where the report is.
///
/// # Errors
/// A table cannot be read back.
pub fn print(plan: &Plan, store: &Store, out: &Path, ran: &Ran) -> Result<()> {
    let result = ran.result;
    stages(result, ran.seconds);
    ran.left_out.iter().for_each(|words| say(words));
    // Of what was left out nothing is known but what an earlier run made.
    if ran.left_out.is_empty() {
        table(&flights::HEAD, flights::rows(plan, store)?);
        estimates(plan, store)?;
        lines(plan, store)?;
    }
    if ran.left_out.is_empty() {
        lacking(plan, store)?;
    }
    notes(&result.notes);
    let diagnoses = crate::stage::diagnose::all(&plan.campaign).len();
    for i in (0..diagnoses).filter(|_| ran.left_out.is_empty()) {
        verdict::of(store, plan, i)?.into_iter().flatten().for_each(|line| say(&line));
    }
    if let Some(report) = ran.report(out) {
        say(&format!("\nreport: {report}"));
    }
    say(&format!("tables: {}", out.display()));
    Ok(())
}

fn lacking(plan: &Plan, store: &Store) -> Result<()> {
    let lines = lacking::lines(plan, store)?;
    if !lines.is_empty() {
        say("\noptional signals that logs lack, where stages miss something:");
    }
    lines.iter().for_each(|line| say(&format!("  {line}")));
    Ok(())
}

fn stages(result: &RunResult, seconds: &BTreeMap<&'static str, f64>) {
    if result.nothing_done() {
        return;
    }
    let rows = result.stages.iter().map(|s| {
        let count = |n: usize| if n == 0 { "-".to_string() } else { n.to_string() };
        let worked = s.ran + s.failed > 0;
        let time = seconds.get(s.name).filter(|_| worked).map(|s| format!("{s:.1}"));
        let time = time.unwrap_or_else(|| "-".into());
        [s.name.to_string(), count(s.ran), count(s.fresh), count(s.failed), count(s.blocked), time]
    });
    let head = ["stage", "run", "fresh", "failed", "not possible", "seconds"];
    table(&head, rows.map(|r| r.to_vec()).collect());
    for unit in &result.removed {
        say(&format!("removed: {unit}"));
    }
}

/// The estimates, those of amended models too, with the parts of their tables.
fn estimated(plan: &Plan) -> Vec<(String, Vec<Part>)> {
    let mut all: BTreeMap<usize, (String, BTreeSet<Part>)> = BTreeMap::new();
    let writers = plan.campaign.stages.iter().filter(|stage| stage.writes.contains(&"estimates"));
    for unit in writers.flat_map(|stage| (stage.units)(&plan.campaign)) {
        let Some(number) = unit.part.number() else { continue };
        let name = plan.campaign.estimates.get(number).map_or(unit.name, |config| config.name());
        all.entry(number).or_insert_with(|| (name, BTreeSet::new())).1.insert(unit.part);
    }
    all.into_values().map(|(name, parts)| (name, parts.into_iter().collect())).collect()
}

/// These columns of parts of a table one below the other, where there is any.
fn joined(store: &Store, table: &str, parts: &[Part], own: &[&str]) -> Result<Option<Table>> {
    let found: Vec<Table> = flights::parts(store, table, parts, own)?;
    if found.is_empty() { Ok(None) } else { Table::concat(table, &found).map(Some) }
}

fn estimates(plan: &Plan, store: &Store) -> Result<()> {
    let mut rows = Vec::new();
    for (name, parts) in estimated(plan) {
        let Some(t) = joined(store, "estimates", &parts, &["group", "stop"])? else { continue };
        let (groups, stops) = (t.strings("group")?, t.strings("stop")?);
        let mut each: Vec<(&str, &str)> = groups.into_iter().zip(stops).collect();
        each.dedup();
        let converged = each.iter().filter(|(_, stop)| *stop == "converged").count();
        let others: Vec<&str> =
            each.iter().map(|(_, stop)| *stop).filter(|stop| *stop != "converged").collect();
        rows.push(vec![
            name,
            each.len().to_string(),
            converged.to_string(),
            tally(&others).join(", "),
            match joined(store, "adequacy", &parts, &LEFT)? {
                Some(left) => poor(&left)?,
                None => String::new(),
            },
        ]);
    }
    if !rows.is_empty() {
        table(&["estimate", "runs", "converged", "others", "leaves more than noise of"], rows);
    }
    Ok(())
}

/// The outputs of which an estimate leaves more than noise, and how much of their variation, in the flight
/// where it is most: `p in flight-2 (68%), r in flight-1 (86%)`.
fn poor(left: &Table) -> Result<String> {
    let (outputs, leaves, shares) =
        (left.strings("output")?, left.strings("leaves")?, left.f64("share")?);
    let (flights, variations) = (left.strings("flight")?, left.f64("variation")?);
    let mut poor: Vec<usize> =
        (0..left.rows()).filter(|&i| leaves[i] == Leaves::More.as_str()).collect();
    // What was measured not to move has no share, and comes first.
    let share = |i: usize| if shares[i].is_nan() { f64::INFINITY } else { shares[i] };
    poor.sort_by(|&a, &b| share(b).total_cmp(&share(a)));
    let mut met = BTreeSet::new();
    poor.retain(|&i| met.insert(outputs[i]));
    let several = flights.iter().any(|flight| *flight != flights[0]);
    let one = |&i: &usize| {
        let of = if several { format!(" in {}", flights[i]) } else { String::new() };
        format!("{}{of} ({})", outputs[i], words(shares[i], variations[i]))
    };
    let more =
        if poor.len() > POOR { format!(", {} more", poor.len() - POOR) } else { String::new() };
    let (lefts, noises) = (left.f64("left")?, left.f64("noise")?);
    let is_little =
        |i: &usize| leaves[*i] == Leaves::Little.as_str() && is_far(lefts[*i], noises[*i]);
    let far = (0..left.rows()).filter(is_little).max_by(|a, b| shares[*a].total_cmp(&shares[*b]));
    let far = far.filter(|_| poor.is_empty());
    let far = far
        .map(|i| format!("(a little of {}, {:.0} times its noise)", one(&i), lefts[i] / noises[i]));
    let all: Vec<String> = poor.iter().take(POOR).map(one).chain(far).collect();
    Ok(all.join(", ") + &more)
}

fn lines(plan: &Plan, store: &Store) -> Result<()> {
    let mut rows = Vec::new();
    for i in 0..plan.campaign.fits.len() {
        let Some(t) = read(store, "fits", Part::Number(i))? else { continue };
        let (models, parameters, against) =
            (t.strings("model")?, t.strings("parameter")?, t.strings("against")?);
        let (slope, intercept) =
            ((t.f64("slope")?, t.f64("slope_sd")?), (t.f64("intercept")?, t.f64("intercept_sd")?));
        let (n, relative, poor) = (t.i64("n")?, t.f64("relative_sd")?, t.bools("poor")?);
        for k in 0..t.rows() {
            let value = |(value, sd): (&[f64], &[f64])| {
                format!("{} +- {}", number(value[k]), number(half_95(n[k] as f64) * sd[k]))
            };
            let name = format!("{}: {}", models[k], parameters[k]);
            rows.push(vec![
                name,
                against[k].to_string(),
                value(slope),
                value(intercept),
                n[k].to_string(),
                format!("{:.1}%{}", 100.0 * relative[k], if poor[k] { ", poor" } else { "" }),
            ]);
        }
    }
    if !rows.is_empty() {
        table(
            &["line", "against", "slope +- 95%", "intercept +- 95%", "points", "sd of one"],
            rows,
        );
    }
    Ok(())
}

/// Four significant digits.
pub fn number(value: f64) -> String {
    match value {
        v if !v.is_finite() => "-".to_string(),
        v if v == 0.0 || (1e-4..1e5).contains(&v.abs()) => {
            let before_point =
                if v == 0.0 { 1 } else { libm::floor(libm::log10(v.abs())) as i32 + 1 };
            format!("{v:.*}", (4 - before_point).max(0) as usize)
        }
        v => format!("{v:.3e}"),
    }
}

/// Prints what is likely to be a mistake, and what makes the exit code 1.
pub fn notes(notes: &[Note]) {
    notes_of(
        notes,
        &[
            (Severity::Missing, "missing"),
            (Severity::Problem, "problem"),
            (Severity::Warning, "warning"),
        ],
    );
}

/// Prints what makes the exit code 1.
pub fn failing(notes: &[Note]) {
    notes_of(notes, &[(Severity::Missing, "missing"), (Severity::Problem, "problem")]);
}

fn notes_of(notes: &[Note], kinds: &[(Severity, &str)]) {
    for &(severity, heading) in kinds {
        let groups = grouped(notes, severity);
        if groups.is_empty() {
            continue;
        }
        say(&format!("\n{heading}:"));
        groups.iter().take(GROUPS_SHOWN).for_each(|group| say(&format!("  {}", line(group))));
        let hidden = groups.len().saturating_sub(GROUPS_SHOWN);
        if hidden > 0 {
            say(&format!(
                "  and {} of note; all of them are in log.txt, and in the table `notes` of a whole run",
                count(hidden, "other kind")
            ));
        } else if groups.iter().any(|group| group.len() > 1) {
            say("  all of them are in log.txt, and in the table `notes` of a whole run");
        }
    }
}

/// Notes of one severity by stage and kind, in the order in which the kinds first come.
fn grouped(notes: &[Note], severity: Severity) -> Vec<Vec<&Note>> {
    let mut groups: Vec<((&str, String), Vec<&Note>)> = Vec::new();
    for note in notes.iter().filter(|n| n.severity == severity) {
        let key = (note.stage.as_str(), kind(note));
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, group)) => group.push(note),
            None => groups.push((key, vec![note])),
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}

/// What a note says without its numbers and names: notes of one kind differ in nothing else.
fn kind(note: &Note) -> String {
    let mut text = note.text.as_str();
    if let Some((_, rest)) = text.split_once(": ").filter(|_| text.starts_with('/')) {
        // topic and field of the log
        text = rest;
    }
    let part_of_word = |c: char| c.is_alphanumeric() || "_.-".contains(c);
    let mut kind = String::new();
    for piece in text.split_inclusive(|c: char| !part_of_word(c)) {
        let word = piece.trim_end_matches(|c: char| !part_of_word(c));
        let name = !word.is_empty() && [&note.subject, &note.flight].iter().any(|n| *n == word);
        kind += if name {
            "~"
        } else if word.contains(|c: char| c.is_ascii_digit()) {
            "#"
        } else {
            word
        };
        kind += &piece[word.len()..];
    }
    without_lists(&kind)
}

/// A kind without the parameters that move by so many sd, and without initial states of maneuvers: which they
/// are differs from one to the next.
fn without_lists(kind: &str) -> String {
    let words: Vec<&str> = kind.split_whitespace().collect();
    let (mut kept, mut k): (Vec<&str>, usize) = Default::default();
    while k < words.len() {
        match words[k..] {
            [_, "by", "#", sd, ..] if sd.starts_with("sd") => k += 4,
            [state, "of", _, ..] if state.ends_with("(#)") => k += 3,
            ["and", "#", others, ..] if others.starts_with("others") => k += 3,
            [word, ..] => {
                kept.push(word);
                k += 1;
            }
            [] => break,
        }
    }
    kept.join(" ")
}

/// One line for the notes of one kind: the one with the largest count stands for them.
fn line(group: &[&Note]) -> String {
    // the first of equals
    let Some(worst) = group.iter().rev().max_by_key(|n| n.count) else { return String::new() };
    let flight =
        if worst.flight.is_empty() { String::new() } else { format!("{}: ", worst.flight) };
    let mut flights: Vec<&str> = group.iter().map(|n| n.flight.as_str()).collect();
    flights.sort_unstable();
    flights.dedup();
    let more = match (group.len() - 1, flights.len()) {
        (0, _) => String::new(),
        (n, 1) => format!(" (and {n} more of this kind)"),
        (n, m) => format!(" (and {n} more of this kind; {m} flights)"),
    };
    format!("{}: {flight}{}{more}", worst.stage, worst.text.replace('\n', " "))
}

/// Prints columns, the first one flush left.
fn table(head: &[&str], rows: Vec<Vec<String>>) {
    let width = |i: usize| {
        rows.iter().map(|r| r[i].chars().count()).chain([head[i].len()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: Vec<&str>| {
        let padded = cells.iter().zip(&widths).enumerate();
        let text: Vec<String> = padded
            .map(|(i, (c, w))| if i == 0 { format!("{c:<w$}") } else { format!("{c:>w$}") })
            .collect();
        text.join("  ").trim_end().to_string()
    };
    say("");
    say(&line(head.to_vec()));
    for row in &rows {
        say(&line(row.iter().map(String::as_str).collect()));
    }
}

/// `3 flights`, `1 flight`
pub fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        for (value, text) in [
            (-0.37171, "-0.3717"),
            (12.3456, "12.35"),
            (0.0, "0.000"),
            (1.5e-7, "1.500e-7"),
            (f64::NAN, "-"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn notes_of_one_text_are_one_line_and_the_worst_stands_for_them() {
        let note = |severity, flight: &str, subject: &str, count, text: &str| Note {
            flight: flight.into(),
            stage: "ingest".into(),
            severity,
            subject: subject.into(),
            count,
            text: text.into(),
        };
        let gaps = |flight, subject, n: u64| {
            note(
                Severity::Warning,
                flight,
                subject,
                n,
                &format!("/air {subject}_deg: {n} gaps, the longest 0.3 s"),
            )
        };
        let notes = [
            gaps("flight-1", "x", 2),
            gaps("flight-1", "alpha", 37),
            note(
                Severity::Warning,
                "flight-1",
                "alpha",
                900,
                "alpha is dead: its value never changes",
            ),
            note(Severity::Warning, "flight-2", "x", 5, "x is dead: its value never changes"),
            gaps("flight-2", "x", 3),
            note(Severity::Missing, "flight-2", "x", 1, "x is dead: its value never changes"),
        ];
        let lines: Vec<String> =
            grouped(&notes, Severity::Warning).iter().map(|g| line(g)).collect();
        assert_eq!(
            lines,
            [
                "ingest: flight-1: /air alpha_deg: 37 gaps, the longest 0.3 s (and 2 more of this kind; 2 flights)",
                "ingest: flight-1: alpha is dead: its value never changes (and 1 more of this kind; 2 flights)",
            ]
        );
        assert_eq!(grouped(&notes, Severity::Missing).len(), 1);
        let moves = |subject: &str, of: &str| {
            let text = format!("{subject}: straight lines move {of}: record faster");
            note(Severity::Warning, "", subject, 1, &text)
        };
        let notes = [
            moves("f-1.01", "M_q by 1.3 sd, M_de by 0.5 sd"),
            moves(
                "f-1.02",
                "Z_a by 2.0 sd, M_q by 1.1 sd, M_de by 0.6 sd, Z_q by 0.5 sd and 3 others",
            ),
        ];
        assert_eq!(grouped(&notes, Severity::Warning).len(), 1);
        let alike = |of: &str| {
            note(Severity::Warning, "", "all", 1, &format!("all: {of} are not distinguishable"))
        };
        let notes = [
            alike("alpha(0) of f-1.01, q(0) of f-1.01"),
            alike("p(0) of f-2.01, phi(0) of f-2.01, beta(0) of f-2.01"),
            alike("M_q, M_de"),
        ];
        assert_eq!(grouped(&notes, Severity::Warning).len(), 2);
    }

    #[test]
    fn kinds_are_tallied() {
        assert_eq!(tally(&["3211", "211", "3211"]), ["1 x 211", "2 x 3211"]);
    }
}
