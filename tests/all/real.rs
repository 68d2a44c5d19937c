//! Diagnoses of real flights: does the program name what a model lacks that is known to lack it?

use crate::flightdata::{copy, data, koehler};
use koehler::table::{Table, read_dataset};
use std::path::Path;

/// Runs `koehler diagnose`, whose exit code tells what it found: 0 nothing, 3 something.
fn diagnose(folder: &Path, data: &Path, args: &[&str]) -> Option<i32> {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    let output = command.current_dir(folder).env("KOEHLER_DATA", data).arg("diagnose").args(args).output().expect("started");
    println!("{}", String::from_utf8_lossy(&output.stdout));
    output.status.code()
}

/// Verdict, and the candidates named.
fn findings(out: &Path) -> (String, Vec<String>) {
    let table: Table = read_dataset(out, "findings").expect("findings");
    let (verdicts, candidates) = (table.strings("verdict").expect("column"), table.strings("candidate").expect("column"));
    (verdicts[0].to_string(), candidates.iter().map(|c| c.to_string()).filter(|c| !c.is_empty()).collect())
}

#[test]
fn recovery_of_the_stall_of_the_attas() {
    let Some(data) = data("attas/fAttas_qst01.asc") else { return };
    let folder = copy("attas-real");
    koehler(folder.path(), &data, &["import", "import-stall.toml"]);
    let code = diagnose(folder.path(), &data, &["stall.toml"]);
    let (verdict, named) = findings(&folder.path().join("out/stall"));
    println!("{verdict}, {named:?}");
    assert_eq!(code, Some(3));
    assert!(named.iter().any(|name| name.starts_with("stall-separation")), "{verdict}, {named:?}");
}
