//! The tables of a diagnosis come in; its verdict as a box of five lines at most goes out, with the
//! one value that is to be used.

use super::words::End;
use crate::error::Result;
use crate::math::distribution::INTERVAL_95;
use crate::pipeline::{Plan, Store};
use crate::stage::Part;
use crate::table::Table;

/// Columns of a line of the box, at most.
const WIDTH: usize = 110;

/// A part of a table, where there is one.
///
/// # Errors
/// It cannot be read.
pub fn part(store: &Store, table: &str, number: usize) -> Result<Option<Table>> {
    let part = Part::Number(number);
    if store.path(&part.path(table)).exists() {
        store.table(table, &part).map(Some)
    } else {
        Ok(None)
    }
}

/// The box of diagnosis `i` of a plan, where it has been made.
///
/// # Errors
/// A table cannot be read, or lacks a column.
pub fn of(store: &Store, plan: &Plan, i: usize) -> Result<Option<Vec<String>>> {
    let Some(findings) = part(store, "findings", i)? else { return Ok(None) };
    // Values come from the estimate with what was added, where there is one.
    let again = plan.campaign.estimates.len() + i;
    let recommended = [again, i]
        .into_iter()
        .find_map(|n| part(store, "recommended", n).transpose())
        .transpose()?;
    lines(&crate::stage::diagnose::all(&plan.campaign)[i].name(), &findings, recommended.as_ref())
        .map(Some)
}

/// How a diagnosis with these findings ends.
///
/// # Errors
/// The table lacks a column.
pub fn end(findings: &Table) -> Result<End> {
    Ok(match findings.strings("verdict")?.first().copied().unwrap_or_default() {
        verdict if verdict.starts_with("nothing missing") => End::Complete,
        "no verdict" => End::Partial,
        _ => End::Found,
    })
}

/// Whether the estimate with what was added converged, in words.
///
/// # Errors
/// The table lacks a column.
pub fn again(next: &str, estimates: &Table) -> Result<String> {
    let (groups, stops) = (estimates.strings("group")?, estimates.strings("stop")?);
    let mut each: Vec<(&str, &str)> = groups.into_iter().zip(stops).collect();
    each.dedup();
    let others: Vec<&(&str, &str)> = each.iter().filter(|(_, stop)| *stop != "converged").collect();
    Ok(match (others.first(), each.len()) {
        (None, _) => {
            format!("estimated with it: {next}, in the tables of estimates and in the report")
        }
        (Some((_, stop)), 1) => format!("not estimated with it: {next} ended with \"{stop}\""),
        (Some((_, stop)), n) if others.len() < n => {
            format!(
                "estimated with it: {next}; {} of {n} estimates did not converge (\"{stop}\")",
                others.len()
            )
        }
        (Some((_, stop)), n) => format!(
            "not estimated with it: none of the {n} estimates of {next} converged (\"{stop}\")"
        ),
    })
}

/// The box.
///
/// # Errors
/// A table lacks a column.
fn lines(name: &str, findings: &Table, recommended: Option<&Table>) -> Result<Vec<String>> {
    let verdict = findings.strings("verdict")?.first().copied().unwrap_or_default().to_uppercase();
    let complete = findings.bools("complete")?.first().copied().unwrap_or(true);
    let is_named = matches!(verdict.as_str(), "NAMED" | "ONE OF THESE");
    let incomplete = if is_named && !complete { ", and it is not all" } else { "" };
    let mut inside = if is_named || verdict.ends_with("RECORDS") {
        named(findings, recommended)?
    } else {
        Vec::new()
    };
    if inside.is_empty() {
        inside.extend(findings.strings("text")?.first().map(|text| first_sentence(text)));
    }
    let head = format!("{name}: {verdict}{incomplete}");
    let inside: Vec<String> = inside.iter().map(|line| shortened(line, WIDTH)).collect();
    let width = inside
        .iter()
        .map(|line| line.chars().count())
        .chain([head.chars().count() + 2])
        .max()
        .unwrap_or(0);
    let rule = |text: &str| format!("+-{text}{}-+", "-".repeat(width - text.chars().count()));
    let row = |line: &String| format!("| {line}{} |", " ".repeat(width - line.chars().count()));
    Ok(std::iter::once(rule(&format!(" {head} ")))
        .chain(inside.iter().map(row))
        .chain([rule("")])
        .collect())
}

/// The effect of most evidence, its values with the one to be used, and what else there is.
fn named(findings: &Table, recommended: Option<&Table>) -> Result<Vec<String>> {
    let (candidates, roles) = (findings.opt_strings("candidate")?, findings.opt_strings("role")?);
    let (gains, held_out) = (findings.f64("gain")?, findings.f64("held_out_realised")?);
    let texts = findings.strings("text")?;
    let of = |i: usize, role: &str| roles[i] == Some(role) && candidates[i].is_some();
    let added: Vec<usize> = (0..findings.rows()).filter(|&i| of(i, "added")).collect();
    let evidence = |i: usize| gains[i] + held_out[i];
    let Some(&best) = added.iter().max_by(|a, b| evidence(**a).total_cmp(&evidence(**b))) else {
        return Ok(Vec::new());
    };
    let candidate = candidates[best].unwrap_or_default();
    let alike = (0..findings.rows()).filter(|&i| of(i, "alike")).count();
    let others = added
        .iter()
        .filter(|i| **i != best)
        .filter_map(|&i| candidates[i])
        .collect::<Vec<_>>()
        .join(", ");
    let others = if others.is_empty() { others } else { format!("and {others}") };
    let alike = if alike > 0 {
        format!("{alike} that the flights do not tell from these")
    } else {
        String::new()
    };
    let rest: Vec<String> = [others, alike].into_iter().filter(|text| !text.is_empty()).collect();
    let sentence = texts[best].split(": ").next().unwrap_or_default().to_string();
    let values = recommended.map(|table| to_use(table, candidate)).transpose()?.unwrap_or_default();
    let values = in_two(&values, if rest.is_empty() { WIDTH } else { usize::MAX });
    Ok(std::iter::once(sentence)
        .chain(values)
        .chain((!rest.is_empty()).then(|| rest.join("; ")))
        .collect())
}

/// One line, or two where it is longer than `most`.
fn in_two(text: &str, most: usize) -> Vec<String> {
    let head: String = text.chars().take(most).collect();
    match head.rsplit_once(", ").filter(|_| head.len() < text.len()) {
        _ if text.is_empty() => Vec::new(),
        Some((first, _)) => vec![format!("{first},"), format!("    {}", &text[first.len() + 2..])],
        None => vec![text.to_string()],
    }
}

/// `use (95%, estimate over all maneuvers): C_m_eta_lag = 0.283 +- 0.010 1/rad`
fn to_use(table: &Table, candidate: &str) -> Result<String> {
    let (candidates, parameters, units) =
        (table.strings("candidate")?, table.strings("parameter")?, table.strings("unit")?);
    let (values, sds, sources) = (table.f64("value")?, table.f64("sd")?, table.strings("source")?);
    let of = table.opt_strings("of")?;
    let mine: Vec<usize> = (0..candidates.len()).filter(|&i| candidates[i] == candidate).collect();
    let value = |&i: &usize| {
        let unit = if units[i] == "-" { String::new() } else { format!(" {}", units[i]) };
        let digits = crate::math::digits;
        let name = match of[i] {
            Some(of) => format!("{} in {of}", parameters[i]),
            None => parameters[i].to_string(),
        };
        match sds[i].is_finite() {
            true => {
                format!("{name} = {} +- {}{unit}", digits(values[i]), digits(INTERVAL_95 * sds[i]))
            }
            false => {
                format!("{name} not determined (best at {}{unit})", digits(values[i]))
            }
        }
    };
    let source =
        mine.iter().find(|&&i| sds[i].is_finite()).or(mine.first()).map_or("", |&i| sources[i]);
    Ok(format!("use (95%, {source}): {}", mine.iter().map(value).collect::<Vec<_>>().join(", ")))
}

fn first_sentence(text: &str) -> String {
    text.split_once(". ").map_or(text, |(first, _)| first).trim_end_matches('.').to_string()
}

/// At most so many characters, cut between words.
fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_string();
    }
    let head: String = text.chars().take(most - 4).collect();
    format!("{} ...", head.rsplit_once(' ').map_or(head.as_str(), |(head, _)| head))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(verdict: &str, rows: &[(&str, &str, f64)]) -> Table {
        let n = rows.len() + 1;
        let all = |of: &dyn Fn(&(&str, &str, f64)) -> String| -> Vec<Option<String>> {
            std::iter::once(None).chain(rows.iter().map(|r| Some(of(r)))).collect()
        };
        let number =
            || std::iter::once(f64::NAN).chain(rows.iter().map(|r| r.2)).collect::<Vec<f64>>();
        let texts = std::iter::once(
            "Nothing is missing that these flights could show. More words.".to_string(),
        );
        let texts = texts.chain(rows.iter().map(|r| {
            format!(
                "{} is {}: x = 1; gains.",
                r.0,
                "far more than fits into a line of it ".repeat(5)
            )
        }));
        Table::build("findings")
            .repeat("diagnosis", "d")
            .repeat("model", "m")
            .i64("number", (0..n as i64).collect::<Vec<_>>())
            .repeat("verdict", verdict)
            .bools("complete", vec![true; n])
            .opt_i64("round", vec![None; n])
            .opt_strings("candidate", all(&|r| r.0.to_string()))
            .opt_strings("effect", all(&|r| r.0.to_string()))
            .opt_strings("family", all(&|_| "sensor".to_string()))
            .opt_strings("role", all(&|r| r.1.to_string()))
            .f64("gain", number())
            .f64("limit", number())
            .f64("held_out_predicted", number())
            .f64("held_out_realised", number())
            .opt_i64("chosen", vec![None; n])
            .opt_i64("votes", vec![None; n])
            .strings("text", texts)
            .repeat("held_out", "every third")
            .finish()
            .expect("findings")
    }

    fn recommended() -> Table {
        Table::build("recommended")
            .repeat("diagnosis", "d")
            .strings("candidate", ["one", "two", "two"])
            .strings("parameter", ["a", "b", "c"])
            .opt_strings("of", [None::<String>, None, None])
            .strings("unit", ["-", "m", "-"])
            .f64("value", vec![1.0, 8.4, 0.25])
            .f64("sd", vec![0.1, 0.2, f64::NAN])
            .repeat("source", "estimate over all maneuvers")
            .f64("fitted", vec![1.0, 8.5, 0.25])
            .f64("fitted_sd", vec![0.1, 0.2, f64::NAN])
            .finish()
            .expect("recommended")
    }

    #[test]
    fn the_verdict_is_a_box_of_five_lines_at_most_with_the_value_to_use() {
        let rows = [("one", "added", 10.0), ("like-one", "alike", 9.0), ("two", "added", 500.0)];
        let lines =
            lines("d", &findings("one of these", &rows), Some(&recommended())).expect("lines");
        assert_eq!(lines.len(), 5, "{lines:#?}");
        assert!(
            lines[0].contains("d: ONE OF THESE") && lines[1].contains("two is far"),
            "{lines:#?}"
        );
        let values = "use (95%, estimate over all maneuvers): b = 8.40 +- 0.392 m, c not determined (best at 0.250)";
        assert!(lines[2].contains(values), "{lines:#?}");
        assert_eq!(
            in_two("use (x): a = 1, b = 2, c = 3", 20),
            ["use (x): a = 1,", "    b = 2, c = 3"]
        );
        assert!(in_two("", 20).is_empty() && in_two("short", 20) == ["short"]);
        assert!(lines[3].contains("and one; 1 that the flights do not tell"), "{lines:#?}");
        assert!(
            lines.iter().all(|line| line.chars().count() == lines[0].chars().count()),
            "{lines:#?}"
        );
        let nothing = super::lines("d", &findings("nothing missing", &[]), None).expect("lines");
        assert_eq!(nothing.len(), 3);
        assert!(
            nothing[1].contains("Nothing is missing that these flights could show |"),
            "{nothing:#?}"
        );
    }
}
