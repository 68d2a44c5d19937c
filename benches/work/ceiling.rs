//! The hand-written C program for the HFB-320 in, compiled by this machine's C compiler; what one
//! of its passes takes out.
//!
//! `sens.c` is looked for in `KOEHLER_CEILING`, or in `bench/ceiling` beside the data. A pass is
//! outputs, exact sensitivities, residuals, `R`, normal equations and solution, no set-up.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The compiled program.
pub struct Ceiling {
    folder: tempfile::TempDir,
    record: PathBuf,
}

/// How it is compiled.
pub const PLAIN: &[&str] = &["-O3", "-march=native", "-ffp-contract=fast"];
pub const AVX512: &[&str] = &["-mprefer-vector-width=512"];
pub const AVX2: &[&str] = &["-mno-avx512f", "-mprefer-vector-width=256"];
pub const FAST: &[&str] = &["-ffast-math"];

/// The folder of the program, said aloud where there is none.
fn folder(data: &Path) -> Option<PathBuf> {
    let beside = || data.parent().map(|p| p.join("bench/ceiling"));
    let folder = std::env::var_os("KOEHLER_CEILING").map(PathBuf::from).or_else(beside)?;
    if !folder.join("sens.c").is_file() {
        println!("no sens.c in KOEHLER_CEILING or beside the data: not held against C");
        return None;
    }
    Some(folder)
}

/// The text of the program.
pub fn source(data: &Path) -> Option<String> {
    std::fs::read_to_string(folder(data)?.join("sens.c")).ok()
}

impl Ceiling {
    /// None, said aloud, where there is no program, no record or no compiler.
    pub fn of(flags: &[&[&str]], data: &Path) -> Option<Ceiling> {
        Ceiling::made(&source(data)?, flags, data)
    }

    /// Another program that includes the `hfb.h` of the first, likewise.
    pub fn made(source: &str, flags: &[&[&str]], data: &Path) -> Option<Ceiling> {
        let record = data.join("hfb320/hfb320_1_10.asc");
        let include = folder(data)?;
        if !record.is_file() {
            println!("no record of the HFB-320 in the data: not held against C");
            return None;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("sens.c");
        std::fs::write(&file, source).expect("a file");
        let made = Command::new("cc")
            .args(flags.iter().copied().flatten())
            .args(["-DSEG=1", "-I"])
            .arg(include)
            .arg(file)
            .arg("-o")
            .arg(folder.path().join("sens"))
            .arg("-lm")
            .output();
        match made {
            Ok(out) if out.status.success() => Some(Ceiling { folder, record }),
            _ => {
                println!("no C compiler `cc` that takes {flags:?}: not held against C");
                None
            }
        }
    }

    /// Milliseconds of a pass through one segment, and of an iteration over ten: the least of its runs.
    pub fn run(&self) -> [f64; 2] {
        let out = Command::new(self.folder.path().join("sens"))
            .env("HFB", &self.record)
            .output()
            .expect("the program runs");
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        let least = |line: &str| -> f64 {
            let line = text.lines().find(|l| l.starts_with(line)).expect("its line");
            let (_, rest) = line.split_once("(min ").expect("its least time");
            rest.split([' ', ',']).next().and_then(|n| n.parse().ok()).expect("a number")
        };
        // The first is a start and five iterations: six passes.
        [least("P1") / 6.0, least("P2")]
    }
}

/// The middle of some numbers.
pub fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}
