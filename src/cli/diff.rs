//! The verb diff: two output folders come in; what their results differ in goes out, in words or as
//! JSON, and as the exit code.

use super::args::Form;
use super::summary::{count, number};
use super::words::{End, document, say, warn};
use crate::error::{Error, Errors, Place, Result};
use crate::guard::MARK;
use crate::pipeline::{self, Difference, Kind, Side, Store, named};
use std::path::{Path, PathBuf};

/// `koehler diff`
pub fn diff(first: &Path, second: &Path, form: Form) -> std::result::Result<End, Errors> {
    let mut errors = Errors::default();
    let folders = [first, second].map(|run| errors.take(folder(run)).unwrap_or_default());
    errors.or(())?;
    let [first, second] = &folders;
    let compared = pipeline::diff(first, second)?;
    tell_left_out(&compared.left_out.iter().cloned().collect::<Vec<_>>());
    let end = if compared.differences.is_empty() { End::Complete } else { End::Partial };
    if form.json {
        document(&compared)?;
        return Ok(end);
    }
    compared.differences.iter().for_each(|d| say(&line(d, first, second)));
    let both = format!("{} and verdicts that both have", count(compared.both, "value"));
    say(&match compared.differences.len() {
        0 => format!("no differences; compared were {both}"),
        n => format!("{}; compared were {both}", count(n, "difference")),
    });
    Ok(end)
}

/// Says which files of tables were left out, where some were.
pub(super) fn tell_left_out(files: &[String]) {
    if !files.is_empty() {
        let files = named(files);
        warn(&format!(
            "left out, because no record of a run names it: {files} (a run removes such files)"
        ));
    }
}

/// The output folder that is meant: itself, or that of a pipeline file.
pub(super) fn folder(run: &Path) -> Result<PathBuf> {
    let folder = if run.is_file() { pipeline::out_folder(run) } else { run.to_path_buf() };
    if !folder.join(MARK).is_dir() {
        let place = Place::file(folder.to_string_lossy());
        return Err(Error::at(place, format!("this is no output folder: it has no {MARK}/"))
            .help("name a folder that a run wrote, or the pipeline file of that run"));
    }
    Store::look(&folder).map(|_| folder)
}

fn line(d: &Difference, first: &Path, second: &Path) -> String {
    let kind = match d.kind {
        Kind::Estimate => "estimate",
        Kind::Line => "line",
        Kind::Curve => "curve",
        Kind::Recommended => "recommended",
        Kind::Verdict => "verdict",
    };
    let name = format!("{kind} {}", d.of.join(", "));
    match (&d.first, &d.second) {
        (Some(a), Some(b)) => {
            let by = d.sds.map_or(String::new(), |sds| format!(" ({} sd)", number(sds)));
            format!("{name}: {} -> {}{by}", words(a), words(b))
        }
        (Some(a), None) => format!("{name}: only in {}: {}", first.display(), words(a)),
        (None, Some(b)) => format!("{name}: only in {}: {}", second.display(), words(b)),
        (None, None) => name,
    }
}

fn words(side: &Side) -> String {
    match side {
        Side::Quantity { value: None, .. } => "no value".to_string(),
        Side::Quantity { value: Some(value), sd, unit } => {
            let unit = if unit == "-" { String::new() } else { format!(" {unit}") };
            let sd = sd.map_or(" without sd".to_string(), |sd| format!(", sd {}", number(sd)));
            format!("{}{unit}{sd}", number(*value))
        }
        Side::Words(words) => words.clone(),
        Side::All { values } => count(*values, "row"),
    }
}
