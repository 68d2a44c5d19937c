//! The mistakes that the parts of a plan found come in; each of them once, with all its places, goes
//! out.

use crate::config::list;
use crate::error::{Error, Errors, Place};
use std::path::{Component, Path, PathBuf};

/// Says every mistake once. Several sections may name one file, one file may be read for several
/// purposes, and one wrong name is missed wherever it is used: what is said in the same words is one
/// mistake, at the place where it is met first; its other places stand in the help. What is said of
/// one place for several reasons is one mistake, too: the help has the lines of all of them.
pub fn once(errors: Errors) -> Errors {
    let mut all: Vec<(Error, Vec<String>)> = Vec::new();
    for mut error in errors.0 {
        error.place = error.place.map(|p| Place { file: plain(&p.file), ..p });
        let there = |(e, _): &&mut (Error, Vec<String>)| {
            e.what == error.what && e.place.is_some() && e.place == error.place
        };
        if let Some((first, _)) = all.iter_mut().find(there) {
            first.help = both(first.help.take(), error.help);
            continue;
        }
        let same =
            |(e, _): &&mut (Error, Vec<String>)| e.what == error.what && e.help == error.help;
        match (all.iter_mut().find(same), &error.place) {
            (Some((first, others)), Some(place)) => {
                let place_text = place.to_string();
                if first.place.as_ref() != Some(place) && !others.contains(&place_text) {
                    others.push(place_text);
                }
            }
            (Some(_), None) => (),
            (None, _) => all.push((error, Vec::new())),
        }
    }
    Errors(all.into_iter().map(|(error, others)| with(error, &others)).collect())
}

/// The lines of one help, and of the other what it does not have.
fn both(one: Option<String>, other: Option<String>) -> Option<String> {
    let (one, other) = (one.unwrap_or_default(), other.unwrap_or_default());
    let mut lines: Vec<&str> = one.lines().collect();
    for line in other.lines() {
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    (!lines.is_empty()).then(|| lines.join("\n"))
}

/// The mistake with its other places.
fn with(error: Error, others: &[String]) -> Error {
    if others.is_empty() {
        return error;
    }
    let also = format!("the same at {}", list(others));
    let help = match &error.help {
        Some(help) => format!("{help}\n    {also}"),
        None => also,
    };
    error.help(help)
}

/// A path without `.` and without `folder/..`, so that a file has one name.
fn plain(path: &str) -> String {
    let mut plain = PathBuf::new();
    for part in Path::new(path).components() {
        let last = plain.components().next_back();
        match part {
            Component::CurDir => (),
            Component::ParentDir if matches!(last, Some(Component::Normal(_))) => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    plain.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistake_is_said_once_with_all_its_places() {
        let at = |file: &str, line: usize, what: &str| {
            Error::at(Place { file: file.to_string(), line, column: 1 }, what)
        };
        let errors = Errors(vec![
            at("a/./m.toml", 3, "no S").help("add S"),
            at("a/m.toml", 3, "no S").help("add S"),
            at("a/b/../n.toml", 5, "no S").help("add S"),
            at("../n.toml", 5, "no S"),
            at("a/n.toml", 5, "no S").help("add S"),
            Error::new("no T"),
            Error::new("no T"),
            at("<embedded>", 9, "no T"),
            at("c.toml", 2, "in kg").help("correct it\n    x wants it"),
            at("c.toml", 2, "in kg").help("correct it\n    y wants it"),
        ]);
        assert_eq!(
            once(errors).to_string(),
            "a/m.toml:3:1: no S\n    add S\n    the same at a/n.toml:5:1\n../n.toml:5:1: no S\nno T\n    the same at <embedded>:9:1\nc.toml:2:1: in kg\n    correct it\n    x wants it\n    y wants it"
        );
    }
}
