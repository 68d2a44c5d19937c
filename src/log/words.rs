//! A name that is not there and the names that are in; the part of an error message that says what
//! was there out.

use crate::config;

/// The nearest names (at most three), or all where none is near.
pub(super) fn near(name: &str, known: &[&str]) -> String {
    let ranked = ranked(name, known);
    let close: Vec<&str> = ranked.iter().filter(|r| r.1 > 0.7).take(3).map(|r| r.0).collect();
    all(if close.is_empty() { known } else { &close })
}

/// All names, the nearest first.
pub(super) fn nearest_first(name: &str, known: &[&str]) -> String {
    let names: Vec<&str> = ranked(name, known).iter().map(|r| r.0).collect();
    all(&names)
}

/// Names are compared and told as far as this, in characters: a damaged log may have any.
const LONGEST: usize = 200;

/// The beginning of a name that is too long to be told.
fn short(name: &str) -> &str {
    name.char_indices().nth(LONGEST).map_or(name, |(end, _)| &name[..end])
}

fn all(names: &[&str]) -> String {
    let names: Vec<&str> = names.iter().map(|name| short(name)).collect();
    if names.is_empty() { "nothing".into() } else { config::quoted(&names) }
}

fn ranked<'a>(name: &str, known: &[&'a str]) -> Vec<(&'a str, f64)> {
    // "/airdata" and "/Air_Data" are the same words.
    let plain = |s: &str| {
        short(s).chars().filter(|c| c.is_alphanumeric()).collect::<String>().to_lowercase()
    };
    let name = plain(name);
    let mut ranked: Vec<(&str, f64)> = known
        .iter()
        .map(|k| (*k, strsim::normalized_damerau_levenshtein(&name, &plain(k))))
        .collect();
    // Stable: names that are equally near stay in the log's order.
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    ranked
}
