//! Public flight records beside the project, and shipped pipelines copied to where a test can run
//! them.

use std::path::{Path, PathBuf};

/// Whether slow tests are asked for; a printed reason where not.
pub fn slow() -> bool {
    let slow = std::env::var("KOEHLER_SLOW").as_deref() == Ok("1");
    if !slow {
        println!("skipped: set KOEHLER_SLOW=1 (some minutes in release mode)");
    }
    slow
}

/// The recordings that slow tests are judged by: `KOEHLER_SEEDS=20` says how many, `20-39` which.
pub fn seeds() -> std::ops::Range<u64> {
    let said = std::env::var("KOEHLER_SEEDS").unwrap_or_else(|_| "100".into());
    let number = |text: &str| -> u64 {
        text.parse().unwrap_or_else(|_| panic!("KOEHLER_SEEDS is 20 or 20-39, not {said:?}"))
    };
    match said.split_once('-') {
        Some((first, last)) => number(first)..number(last) + 1,
        None => 0..number(&said),
    }
}

/// The folder of the public data if it holds `file`; a printed reason where not.
pub fn data(file: &str) -> Option<PathBuf> {
    let named = std::env::var_os("KOEHLER_DATA").map(PathBuf::from);
    let above =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("shared/data"));
    let found = named.into_iter().chain(above).find(|folder| folder.join(file).is_file());
    if found.is_none() {
        eprintln!("skipped: no {file} in $KOEHLER_DATA or in shared/data above the project");
    }
    found.map(|folder| folder.canonicalize().expect("a path"))
}

/// The configuration files of a shipped pipeline in a folder of their own.
pub fn copy(pipeline: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines").join(pipeline);
    for entry in std::fs::read_dir(from).expect("the folder of the pipeline") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|e| e == "toml") {
            std::fs::copy(&path, folder.path().join(path.file_name().expect("a name")))
                .expect("copied");
        }
    }
    folder
}

/// Runs the program, which has to succeed.
pub fn koehler(folder: &Path, data: &Path, args: &[&str]) {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    let output =
        command.current_dir(folder).env("KOEHLER_DATA", data).args(args).output().expect("started");
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The parts of a shipped pipeline's README that are results: they are what was computed, or are
/// written where `UPDATE_DOCS` is set. Each stands between its marker, which says by what it is
/// written, and the next end.
pub fn in_the_readme(pipeline: &str, by: &str, parts: &[(&str, String)]) {
    const END: &str = "<!-- until here -->\n";
    static ONE_AT_A_TIME: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _alone = ONE_AT_A_TIME.lock();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines").join(pipeline);
    let path = folder.join("README.md");
    let text = std::fs::read_to_string(&path).expect("the README");
    let mut wanted = text.clone();
    for (name, part) in parts {
        let start = format!("<!-- {name}: written by {by} -->\n");
        let (before, rest) = wanted.split_once(&start).unwrap_or_else(|| panic!("{start}"));
        let (_, after) = rest.split_once(END).expect("its end");
        wanted = format!("{before}{start}{part}{END}{after}");
    }
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, &wanted).expect("written");
    } else {
        assert!(text == wanted, "pipelines/{pipeline}/README.md is behind its results: {by}");
    }
}
