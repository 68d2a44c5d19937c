//! The names and places in a description in; the files that are there out.

use super::settings::{ALL, Import};
use crate::config::Doc;
use crate::error::{Error, Errors};
use std::path::{Path, PathBuf};

/// One file to import.
pub struct Source {
    name: Option<String>,
    pub path: PathBuf,
}

impl Source {
    /// A text of the description with the name of the file in its place.
    pub fn named(&self, text: &str) -> String {
        named(self.name.as_deref(), text)
    }
}

fn named(name: Option<&str>, text: &str) -> String {
    name.map_or_else(|| text.to_string(), |name| text.replace("{name}", name))
}

/// Finds the files of a description that stands in `folder`.
///
/// # Errors
/// Every name without a file, with the places where it was looked for.
pub fn find(settings: &Import, doc: &Doc, folder: &Path) -> Result<Vec<Source>, Errors> {
    if settings.names.iter().any(|name| name == ALL) {
        return Ok(every(settings, doc, folder)?);
    }
    let names: Vec<Option<&str>> = if settings.names.is_empty() {
        vec![None]
    } else {
        settings.names.iter().map(|n| Some(n.as_str())).collect()
    };
    let mut errors = Errors::default();
    let found =
        names.iter().filter_map(|name| errors.take(one(settings, doc, folder, *name))).collect();
    errors.or(found)
}

/// The place that an entry of `input` means, or why there is none.
fn place(folder: &Path, input: &str) -> Result<PathBuf, String> {
    let Some(rest) = input.strip_prefix('$') else { return Ok(folder.join(input)) };
    let (name, tail) = rest.split_once('/').unwrap_or((rest, ""));
    std::env::var_os(name)
        .map(|root| Path::new(&root).join(tail))
        .ok_or_else(|| format!("{input} (${name} is not set)"))
}

fn nothing(settings: &Import, doc: &Doc, looked: &[String]) -> Error {
    doc.error("input", format!("no input file found; looked for {}", looked.join(", "))).help(
        if settings.source.is_empty() {
            "put the file at one of these places"
        } else {
            &settings.source
        },
    )
}

fn one(settings: &Import, doc: &Doc, folder: &Path, name: Option<&str>) -> Result<Source, Error> {
    let mut looked = Vec::new();
    for input in &settings.input {
        match place(folder, &named(name, input)) {
            Ok(path) if path.is_file() => {
                return Ok(Source { name: name.map(str::to_string), path });
            }
            Ok(path) => looked.push(path.display().to_string()),
            Err(why) => looked.push(why),
        }
    }
    Err(nothing(settings, doc, &looked))
}

/// Every file that fits the first place that has any, in the order of their names.
fn every(settings: &Import, doc: &Doc, folder: &Path) -> Result<Vec<Source>, Error> {
    let mut looked = Vec::new();
    for input in &settings.input {
        let place = match place(folder, input) {
            Ok(place) => place.to_string_lossy().into_owned(),
            Err(why) => {
                looked.push(why);
                continue;
            }
        };
        // Whether there is one `{name}` has been checked.
        let Some((before, after)) = place.split_once("{name}") else { continue };
        let pattern = [&glob::Pattern::escape(before), "*", &glob::Pattern::escape(after)].concat();
        let options =
            glob::MatchOptions { require_literal_leading_dot: true, ..glob::MatchOptions::new() };
        let found = glob::glob_with(&pattern, options)
            .map_err(|e| doc.error("input", format!("\"{input}\" is no pattern: {e}")))?;
        let mut all: Vec<Source> = Vec::new();
        for path in found.filter_map(Result::ok).filter(|path| path.is_file()) {
            let text = path.to_string_lossy();
            // A glob may give the same path in other words ("./a" as "a").
            let name = text.strip_suffix(after).map(|text| {
                let from = before.rfind('/').map_or(0, |i| i + 1);
                let begin = before.get(from..).unwrap_or_default();
                let last = text.rsplit('/').next().unwrap_or_default();
                last.strip_prefix(begin).unwrap_or(last).to_string()
            });
            let name = name.ok_or_else(|| {
                doc.error("input", format!("the name of {} is not found in it", path.display()))
            })?;
            all.push(Source { name: Some(name), path });
        }
        if !all.is_empty() {
            all.sort_by(|a, b| a.name.cmp(&b.name));
            return Ok(all);
        }
        looked.push(place.replace("{name}", ALL));
    }
    Err(nothing(settings, doc, &looked))
}
