//! A path that is to be written in; whether it may be written over, or what stands there, out.
//!
//! The one place that decides this: a file that a command reads is never written over, a file or
//! folder that the program did not make only with `--force`.

use crate::error::{Error, Place, Result};
use std::path::Path;

/// The folder in an output folder that says that it is one of ours; hidden, it also holds what a
/// run remembers.
pub const MARK: &str = ".koehler";

/// What to do about a file or folder of others.
const HELP: &str = "choose another --out, or write over it with --force";

/// Whether the file `path` may be written: there is none, it is ours, or `force` says so. `inputs`
/// are the files that are read; `foreign` says what a file that is not ours is.
///
/// # Errors
/// It is one of the inputs, under whatever name (never written over); it is a folder; it is foreign.
pub fn file(
    path: &Path,
    inputs: &[&Path],
    force: bool,
    foreign: impl Fn(&Path) -> Option<String>,
) -> Result<()> {
    let refused = |what: String| Error::at(Place::file(path.to_string_lossy()), what);
    if let Some(input) = inputs.iter().find(|input| same(path, input)) {
        let what = format!("this would be written over its own input {}", input.display());
        return Err(refused(what).help("choose another output: an input is never written over"));
    }
    if path.is_dir() {
        return Err(refused("a file is to be written, and there is a folder".into())
            .help("choose another output"));
    }
    // A link to nowhere is somebody's as well.
    if force || path.symlink_metadata().is_err() {
        return Ok(());
    }
    match foreign(path) {
        Some(what) => {
            Err(refused(format!("the file is there and is not ours: it is {what}")).help(HELP))
        }
        None => Ok(()),
    }
}

/// Whether results may be written into the folder `path`: there is none, it is empty or ours, or
/// `force` says so.
///
/// # Errors
/// It is a file; it has files of others.
pub fn folder(path: &Path, force: bool) -> Result<()> {
    let refused = |what: String| Error::at(Place::file(path.to_string_lossy()), what);
    if path.exists() && !path.is_dir() {
        return Err(
            refused("a folder is wanted, and there is a file".into()).help("choose another --out")
        );
    }
    match foreign(path) {
        Some(name) if !force => Err(refused(format!(
            "the folder is there and is no output folder of ours: it has \"{name}\""
        ))
        .help("files of the same names as results would be removed; choose another --out, or take it with --force")),
        _ => Ok(()),
    }
}

/// Marks a folder as ours.
///
/// # Errors
/// It cannot be made.
pub fn mark(path: &Path) -> Result<()> {
    let mark = path.join(MARK);
    std::fs::create_dir_all(&mark).map_err(|e| {
        Error::at(Place::file(mark.to_string_lossy()), format!("cannot make the folder: {e}"))
    })
}

/// The first entry of a folder that is not ours. Output folders stand in one another (`out/` and
/// `out/<name>/`), so that a folder of nothing else is ours too; hidden files are nobody's results.
fn foreign(folder: &Path) -> Option<String> {
    if folder.join(MARK).is_dir() || of_a_study(folder) {
        return None;
    }
    let is_ours = |name: &String| {
        let path = folder.join(name);
        name.starts_with('.') || (path.is_dir() && !path.is_symlink() && foreign(&path).is_none())
    };
    names(folder).into_iter().find(|name| !is_ours(name))
}

/// Whether a folder holds a study of designs and nothing else: earlier programs did not mark these.
fn of_a_study(folder: &Path) -> bool {
    let names = names(folder);
    names.iter().any(|name| name == "figures.html")
        && names.iter().all(|name| ["designs", "figures.html"].contains(&name.as_str()))
}

/// Names in a folder, in order; none where there is no such folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Whether two paths lead to one file, over links of either kind.
fn same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(one), Ok(other)) => one == other || hard_linked(&one, &other),
        _ => false,
    }
}

#[cfg(unix)]
fn hard_linked(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (a.metadata(), b.metadata()) {
        (Ok(one), Ok(other)) => (one.dev(), one.ino()) == (other.dev(), other.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn hard_linked(_a: &Path, _b: &Path) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_ours_stand_in_one_another_and_one_foreign_file_is_told() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| dir.path().join(name);
        let put = |name: &str| {
            std::fs::create_dir_all(at(name).parent().expect("a parent")).expect("made");
            std::fs::write(at(name), b"x").expect("written");
        };
        assert!(folder(&at("out"), false).is_ok(), "not there");
        mark(&at("out/other")).expect("marked");
        put("out/other/signals/part-0.parquet");
        put("out/study/designs/part-0.parquet");
        put("out/study/figures.html");
        put("out/.gitignore");
        assert!(folder(&at("out"), false).is_ok(), "only folders of ours");
        put("out/signals/part-0.parquet");
        let e = folder(&at("out"), false).expect_err("foreign").to_string();
        assert!(
            e.contains("no output folder of ours: it has \"signals\"") && e.contains("--force"),
            "{e}"
        );
        assert!(folder(&at("out"), true).is_ok(), "forced");
        mark(&at("out")).expect("marked");
        assert!(folder(&at("out"), false).is_ok(), "marked");
        let e = folder(&at("out/.gitignore"), true).expect_err("a file").to_string();
        assert!(e.contains("a folder is wanted, and there is a file"), "{e}");
    }

    #[test]
    fn an_input_is_known_under_every_name_and_never_written_over() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("in.csv"), b"x").expect("written");
        std::fs::create_dir(at("sub")).expect("made");
        let mut all = vec![at("in.csv"), at("sub/../in.csv")];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("in.csv"), at("soft")).expect("linked");
            std::fs::hard_link(at("in.csv"), at("hard")).expect("linked");
            all.extend([at("soft"), at("hard")]);
        }
        for path in all {
            let e = file(&path, &[&at("in.csv")], true, |_| None).expect_err("refused");
            assert!(e.what.contains("over its own input"), "{e}");
        }
        let foreign = |_: &Path| Some("text".to_string());
        let e = file(&at("in.csv"), &[], false, foreign).expect_err("refused").to_string();
        assert!(e.contains("in.csv: the file is there and is not ours: it is text"), "{e}");
        assert!(file(&at("in.csv"), &[], true, foreign).is_ok());
        assert!(file(&at("new"), &[], false, foreign).is_ok());
        assert!(file(&at("sub"), &[], true, foreign).is_err());
    }
}
