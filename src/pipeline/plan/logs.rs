//! The patterns of the pipeline file come in, the logs of the flights go out: those that are there
//! and those to be simulated.

use crate::config::Doc;
use crate::error::{Error, Errors, Result};
use crate::pipeline::settings::Settings;
use crate::pipeline::simulate::Simulation;
use crate::table::{check_flight, flight_id};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The log of one flight.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlightLog {
    pub flight: String,
    pub path: PathBuf,
    /// The mistake of the pipeline file, where it names a log that is not there while others are: one of this
    /// flight alone.
    pub missing: Option<Error>,
}

/// The logs that a simulation would make.
pub enum Made<'a> {
    By(Option<&'a Simulation>),
    /// Its file has mistakes: a log that is not there may be one of them.
    Unsure,
}

/// The logs in alphabetical order of the flights; one that is named and not there is among them, so that its
/// flight is missed and the others go on.
///
/// # Errors
/// None of the files that are named is there, a pattern that finds nothing, two logs with one name, a name
/// that is no flight id.
pub fn find(
    settings: &Settings,
    doc: &Doc,
    folder: &Path,
    made: Made,
) -> std::result::Result<Vec<FlightLog>, Errors> {
    let mut errors = Errors::default();
    let mut found: BTreeMap<String, FlightLog> = BTreeMap::new();
    let to_simulate: Option<Vec<(String, PathBuf)>> = match made {
        Made::By(simulation) => Some(simulation.map(Simulation::logs).unwrap_or_default()),
        Made::Unsure => None,
    };
    for (i, pattern) in settings.logs.iter().enumerate() {
        let key = format!("logs.{i}");
        for Named { path, missing } in errors
            .take(matches(doc, &key, folder, pattern, to_simulate.as_deref()))
            .unwrap_or_default()
        {
            let flight = flight_of(&path);
            if let Err(e) = check_flight(&flight) {
                let what = format!("the log {} names no flight: {}", path.display(), e.what);
                errors.push(doc.error(&key, what).help(e.help.unwrap_or_default()));
            }
            match found.get(&flight) {
                Some(other) if other.path != path => {
                    let what = format!(
                        "two logs are of flight {flight}: {} and {}",
                        other.path.display(),
                        path.display()
                    );
                    errors.push(
                        doc.error(&key, what)
                            .help("rename one: the file's name, with \"flight-\" in front of a digit and \"-\" for what is no letter, digit, '.', '_' or '-', is the flight's id"),
                    );
                }
                _ => {
                    found.insert(flight.clone(), FlightLog { flight, path, missing });
                }
            }
        }
    }
    if settings.logs.is_empty() {
        errors.push(
            doc.error("logs", "no logs are named").help("for example: logs = [\"logs/*.mcap\"]"),
        );
    }
    let logs: Vec<FlightLog> = found.into_values().collect();
    // Where there is none at all, that is no flight's.
    if logs.iter().all(|log| log.missing.is_some()) {
        errors.0.extend(missing(&logs).0);
    }
    errors.or(logs)
}

/// The mistakes of logs that are named and not there.
pub fn missing(logs: &[FlightLog]) -> Errors {
    Errors(logs.iter().filter_map(|log| log.missing.clone()).collect())
}

/// A log that a pattern stands for.
struct Named {
    path: PathBuf,
    missing: Option<Error>,
}

/// The id of a log's flight: the file's name, made an id where it is none (recorders like to call
/// files `2024-05-06-10-00`).
fn flight_of(path: &Path) -> String {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    if check_flight(&name).is_ok() { name.into_owned() } else { flight_id(&name) }
}

/// The files of a pattern's folder whose names are no text, which patterns pass over.
fn no_text(pattern: &glob::Pattern) -> Vec<PathBuf> {
    let folder = Path::new(pattern.as_str()).parent().map(Path::to_path_buf);
    let entries = folder.and_then(|folder| {
        let plain = folder.to_string_lossy().replace("[[]", "[").replace("[]]", "]");
        std::fs::read_dir(plain.replace("[*]", "*").replace("[?]", "?")).ok()
    });
    let strange = |path: &PathBuf| {
        path.file_name().is_some_and(|n| n.to_str().is_none())
            && pattern.matches(&path.to_string_lossy())
    };
    entries.into_iter().flatten().flatten().map(|e| e.path()).filter(strange).collect()
}

/// The logs that one pattern stands for, simulated ones included; where it is not known which are
/// simulated, there may be none. A name is that of a log that may be missing.
fn matches(
    doc: &Doc,
    key: &str,
    folder: &Path,
    pattern: &str,
    to_simulate: Option<&[(String, PathBuf)]>,
) -> Result<Vec<Named>> {
    let said = pattern;
    let (folder, pattern) = match pattern.strip_prefix('$').and_then(|rest| rest.split_once('/')) {
        None if Path::new(pattern).is_absolute() => (PathBuf::new(), pattern),
        None => (folder.to_path_buf(), pattern),
        Some((name, tail)) => match std::env::var_os(name) {
            Some(root) => (PathBuf::from(root), tail),
            None => {
                let error = doc.error(key, format!("\"{pattern}\": ${name} is not set"));
                return Err(error.help(format!("set {name} to the folder that holds {tail}")));
            }
        },
    };
    let full = folder.join(pattern);
    let text = full.to_string_lossy().into_owned();
    let is_pattern = pattern.contains(['*', '?', '[']);
    let bad = |e: &dyn std::fmt::Display| {
        doc.error(key, format!("\"{pattern}\" cannot be looked up: {e}"))
    };
    // The folder itself may contain characters that mean something in a pattern.
    let escaped = format!("{}{}", folder_pattern(&folder), pattern);
    let compiled = glob::Pattern::new(&escaped).map_err(|e| bad(&e))?;
    let mut paths: Vec<PathBuf> = if is_pattern {
        glob::glob(&escaped)
            .map_err(|e| bad(&e))?
            .collect::<std::result::Result<_, _>>()
            .map_err(|e| bad(&e))?
    } else if full.symlink_metadata().is_ok() {
        // What is there and no file is told when it is read.
        vec![full.clone()]
    } else {
        Vec::new()
    };
    if is_pattern {
        paths.extend(no_text(&compiled));
    }
    let simulated = to_simulate
        .into_iter()
        .flatten()
        .map(|(_, path)| path)
        .filter(|p| if is_pattern { compiled.matches_path(p) } else { **p == full });
    paths.extend(simulated.cloned());
    paths.sort();
    paths.dedup();
    let there = |path| Named { path, missing: None };
    if !paths.is_empty() || to_simulate.is_none() {
        return Ok(paths.into_iter().map(there).collect());
    }
    let help = "paths are relative to the folder of the pipeline file; `koehler import` and `koehler simulate` make logs";
    match is_pattern {
        true => Err(doc.error(key, format!("no log matches {text}")).help(help)),
        // It gets into tables, which do not depend on where a campaign lies.
        false => {
            let missing = doc.error(key, format!("there is no log {said}")).help(help);
            Ok(vec![Named { path: full, missing: Some(missing) }])
        }
    }
}

fn folder_pattern(folder: &Path) -> String {
    let text = glob::Pattern::escape(&folder.to_string_lossy());
    if text.is_empty() || text.ends_with('/') { text } else { format!("{text}/") }
}
