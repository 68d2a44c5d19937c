//! Reads the sources as text: modules import only floors below their own, files inside a module do
//! not import each other in circles, and every file opens with what comes in and goes out.

pub mod circles;

use crate::closure::shared::{code, imports};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn sources() -> Vec<(String, String)> {
    fn walk(dir: &Path, out: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(dir).expect("readable folder") {
            let path = entry.expect("readable entry").path();
            if path.is_dir() {
                walk(&path, out);
            } else if path.extension().is_some_and(|e| e == "rs") {
                out.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    walk(&root, &mut paths);
    paths.sort();
    let relative = |path: &PathBuf| {
        path.strip_prefix(&root).expect("inside src").to_string_lossy().replace('\\', "/")
    };
    paths
        .iter()
        .map(|path| (relative(path), std::fs::read_to_string(path).expect("readable source")))
        .collect()
}

/// Floor of each module: the row of the table in the documentation of `lib.rs`, counted from the
/// bottom floor.
fn floors() -> BTreeMap<String, usize> {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs"))
        .expect("lib.rs");
    let rows = text.lines().filter_map(|line| line.strip_prefix("//! | `"));
    let mut floors = BTreeMap::new();
    for (floor, row) in rows.enumerate() {
        let names = row.split('|').next().unwrap_or_default();
        floors.extend(
            names.split(',').map(|name| (name.trim().trim_matches('`').to_string(), floor)),
        );
    }
    floors
}

#[test]
fn imports_are_found_in_every_spelling() {
    let text = "use crate::{error::{Error, Result}, units, table::Table};\nlet x = crate::model::Tape; // crate::cli\n#[cfg(test)]\nuse crate::stage;\n";
    assert_eq!(imports(&code(text)), ["error", "units", "table", "model"]);
}

#[test]
fn a_module_imports_only_floors_below_its_own() {
    let floors = floors();
    assert!(floors.len() >= 15, "the table of floors in lib.rs was not understood: {floors:?}");
    let mut wrong = Vec::new();
    for (file, text) in sources() {
        let module = file.split('/').next().unwrap_or_default().trim_end_matches(".rs").to_string();
        if ["lib", "main"].contains(&module.as_str()) || file.ends_with("tests.rs") {
            continue;
        }
        let Some(own) = floors.get(&module) else {
            wrong.push(format!("{file}: module `{module}` has no floor in lib.rs"));
            continue;
        };
        for import in imports(&code(&text)) {
            match floors.get(&import) {
                Some(other) if import == module || other < own => {}
                Some(_) => {
                    wrong.push(format!("{file} imports `{import}`, which is not below `{module}`"))
                }
                // A macro or item of lib.rs would be named here: the crate root is above every
                // floor.
                None => {
                    wrong.push(format!("{file} imports `{import}`, which has no floor in lib.rs"))
                }
            }
        }
    }
    assert!(wrong.is_empty(), "upward imports:\n{}", wrong.join("\n"));
}

/// Circles of files that are there still. This list only shrinks: a circle that is not in it fails,
/// and so does one that is gone.
const CIRCLES: [&[&str]; 3] = [
    &["log/agree.rs", "log/flight.rs", "log/signal.rs"],
    &["model/amend.rs", "model/compile.rs", "model/mod.rs"],
    &["table/build.rs", "table/mod.rs"],
];

#[test]
fn files_do_not_import_each_other_in_circles() {
    let sources = sources();
    let imports =
        circles::Imports::read(sources.iter().map(|(file, text)| (file.as_str(), text.as_str())));
    let found = imports.circles();
    let is_listed =
        |circle: &&Vec<String>| CIRCLES.iter().any(|listed| circle.iter().eq(listed.iter()));
    let shown = |circle: &Vec<String>| {
        format!("{}\n{}", circle.join(", "), imports.inside(circle).join("\n"))
    };
    let new: Vec<String> = found.iter().filter(|circle| !is_listed(circle)).map(shown).collect();
    assert!(
        new.is_empty(),
        "circles (file <- what it takes from where); move what both need into a file of its own:\n{}",
        new.join("\n")
    );
    let gone: Vec<_> = CIRCLES
        .iter()
        .filter(|listed| !found.iter().any(|circle| circle.iter().eq(listed.iter())))
        .collect();
    assert!(gone.is_empty(), "no circles any more; take them out of the list: {gone:?}");
}

#[test]
fn every_file_opens_with_its_sentence() {
    // A file of tests belongs to the module that names it.
    let files = || sources().into_iter().filter(|(file, _)| !file.ends_with("tests.rs"));
    let named = |wrong: fn(&str) -> bool| {
        files().filter(|(_, text)| wrong(text)).map(|(file, _)| file).collect::<Vec<_>>()
    };
    let silent = named(|text| !text.starts_with("//! "));
    assert!(silent.is_empty(), "files that do not say what comes in and what goes out: {silent:?}");
    let unfinished = named(|text| text.starts_with("//! (to come)"));
    assert!(unfinished.is_empty(), "files without a sentence yet: {unfinished:?}");
}

/// Files that may call the thread pool themselves, and why. All other work goes through the engine.
const THREADS: [(&str, &str); 41] = [
    ("engine/threads.rs", "the engine of this process"),
    ("cli/words.rs", "the number of threads that a user asks for"),
    ("cli/flights.rs", "files of flights, of which the last words of a run tell"),
    ("least_squares/problem.rs", "sums of a problem that belongs to one unit of a diagnosis"),
    ("estimate/colour.rs", "series of residuals of one estimate, once at its end"),
    ("estimate/influential.rs", "segments of one estimate, once at its end"),
    ("estimate/neighbours.rs", "segments of one estimate, each alone"),
    ("estimate/noisy_starts.rs", "segments of one estimate, once at its end"),
    ("estimate/together.rs", "segments of one estimate, once at its end"),
    ("estimate/profile.rs", "the two sides of an interval of one estimate"),
    ("stage/estimate/mod.rs", "groups of maneuvers of one estimate, whose sums go to the engine"),
    ("stage/inputs.rs", "files of one table, which one unit reads"),
    ("stage/validate/mod.rs", "runs of one maneuver, whose sums go to the engine"),
    ("log/flight.rs", "signals of one log"),
    ("log/listing.rs", "parts of one log"),
    ("log/inspect.rs", "chunks of one log"),
    ("log/parts.rs", "chunks of one log"),
    ("reconstruct/consistency.rs", "stretches of one flight"),
    ("reconstruct/output_error.rs", "windows of one flight"),
    ("reconstruct/smoothed.rs", "suspects of one flight"),
    ("reconstruct/stretches.rs", "stretches of one flight"),
    ("reconstruct/stuck.rs", "outputs of one flight"),
    ("diagnose/base/frozen.rs", "maneuvers of one diagnosis"),
    ("diagnose/base/spread.rs", "maneuvers of one diagnosis"),
    ("diagnose/base/training.rs", "maneuvers of one diagnosis"),
    ("diagnose/effect/bind.rs", "effects that a model may lack"),
    ("diagnose/gap/comparison.rs", "a base before and after of one diagnosis"),
    ("diagnose/gap/coefficient.rs", "maneuvers of one diagnosis"),
    ("diagnose/residual/absorbed.rs", "maneuvers of one diagnosis"),
    ("diagnose/residual/colour.rs", "maneuvers of one diagnosis"),
    ("diagnose/residual/evaluation.rs", "maneuvers of one diagnosis"),
    ("diagnose/residual/sums.rs", "maneuvers of one diagnosis"),
    ("diagnose/search/fits.rs", "candidates of one round of a diagnosis"),
    ("diagnose/search/probes.rs", "candidates of one round of a diagnosis"),
    ("diagnose/search/refit.rs", "candidates of one round of a diagnosis"),
    ("diagnose/search/screen.rs", "candidates of one round of a diagnosis"),
    ("diagnose/search/stability.rs", "other choices of the maneuvers of one diagnosis"),
    ("diagnose/search/surrogate.rs", "series of chance of one round of a diagnosis"),
    (
        "pipeline/assess.rs",
        "hashes of what units read, and a look at logs, which decide what is run at all",
    ),
    ("pipeline/records.rs", "lines of one file of records, before work starts and at its end"),
    ("pipeline/plan/summaries.rs", "a look at the logs before work starts"),
];

/// Whole flights that are not handed to the engine.
const FLIGHTS: [(&str, &str); 2] = [
    ("simulate/campaign.rs", "a simulated campaign is written where its file is"),
    ("design/work.rs", "designs and recordings of a study, which are simulated where its file is"),
];

#[test]
fn threads_are_called_where_the_list_says() {
    let listed: Vec<&str> = THREADS.iter().chain(&FLIGHTS).map(|(file, _)| *file).collect();
    let calls = |text: &str| code(text).contains("rayon::");
    let found: Vec<String> =
        sources().into_iter().filter(|(_, text)| calls(text)).map(|(file, _)| file).collect();
    let of_tests = |file: &&String| !file.contains("/tests") && !file.ends_with("tests.rs");
    let new: Vec<&String> =
        found.iter().filter(of_tests).filter(|f| !listed.contains(&f.as_str())).collect();
    assert!(new.is_empty(), "let the engine do it (src/engine/mod.rs), or say why not: {new:?}");
    let gone: Vec<&&str> = listed.iter().filter(|l| !found.iter().any(|f| f == **l)).collect();
    assert!(gone.is_empty(), "take them out of the list: {gone:?}");
}
