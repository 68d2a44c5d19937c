//! `six_dof` in; one of its iterations by a program written by hand in C for this one model
//! (`six_dof.c`), compiled by this machine's C compiler and held against the estimator's, out.

use super::Work;
use super::ceiling::median;
use koehler::dynamics::Tier;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// How near to each other two iterations of the same problem are.
const SAME: f64 = 1e-6;
/// What rounding leaves of a step, as a share of the parameter.
const ROUNDING: f64 = 1e-10;

/// The compiled program and its data.
pub struct Hand {
    folder: tempfile::TempDir,
}

/// What it says: milliseconds of an iteration, cost before and after it, determinant of `R`
/// before it, and where it leads.
struct Said {
    ms: f64,
    costs: [f64; 2],
    det_r: f64,
    to: Vec<f64>,
}

impl Hand {
    /// None, said aloud, where there is no compiler.
    ///
    /// # Panics
    /// Where its iteration is not that of the estimator.
    pub fn of(flags: &[&[&str]], work: &Work) -> Option<Hand> {
        let folder = tempfile::tempdir().expect("a folder");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/work/six_dof.c");
        let made = Command::new("cc")
            .args(flags.iter().copied().flatten())
            .arg(source)
            .arg("-o")
            .arg(folder.path().join("six_dof"))
            .arg("-lm")
            .output();
        if !made.is_ok_and(|out| out.status.success()) {
            println!("no C compiler `cc` that takes {flags:?}: not held against C");
            return None;
        }
        let first = work.after(1, Tier::Auto);
        let mut starts: Vec<f64> = first.rows.iter().map(|row| row.start).collect();
        starts.truncate(work.directions());
        std::fs::write(folder.path().join("data"), data(work, &starts)).expect("a file");
        let hand = Hand { folder };
        let said = hand.say();
        let off = |a: f64, b: f64| (a / b - 1.0).abs();
        let lines = &first.iterations;
        assert!(off(said.det_r, lines[0].det_r) < SAME, "{} {}", said.det_r, lines[0].det_r);
        for (cost, line) in said.costs.iter().zip(lines) {
            assert!(off(*cost, line.cost) < SAME, "{cost} {}", line.cost);
        }
        assert_eq!(said.to.len(), first.rows.len());
        for (to, row) in said.to.iter().zip(&first.rows) {
            let (ours, theirs) = (row.value - row.start, to - row.start);
            let near = SAME * ours.abs() + ROUNDING * row.value.abs();
            assert!((ours - theirs).abs() <= near, "{}: {ours} {theirs}", row.name);
        }
        Some(hand)
    }

    /// Milliseconds of an iteration: the least of its runs.
    pub fn run(&self) -> f64 {
        self.say().ms
    }

    fn say(&self) -> Said {
        let out = Command::new(self.folder.path().join("six_dof"))
            .arg(self.folder.path().join("data"))
            .output()
            .expect("the program runs");
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        let numbers = |name: &str| -> Vec<f64> {
            let line = text.lines().find_map(|l| l.strip_prefix(name)).expect("its line");
            line.split_whitespace().map(|n| n.parse().expect("a number")).collect()
        };
        let cost = numbers("cost");
        Said { ms: numbers("ms")[0], costs: [cost[0], cost[2]], det_r: cost[1], to: numbers("to") }
    }

    /// Medians over so many blocks in turn: milliseconds of C, and times C each of `ours`, which
    /// gives milliseconds by a tier.
    pub fn beside(&self, blocks: usize, ours: impl Fn(Tier) -> f64) -> [f64; 3] {
        let block = |_| {
            let c = self.run();
            [c, ours(Tier::Interpreter) / c, ours(Tier::Native) / c]
        };
        let all: Vec<[f64; 3]> = (0..blocks).map(block).collect();
        [0, 1, 2].map(|column| median(all.iter().map(|block| block[column]).collect()))
    }
}

/// What the program reads: how many segments and the longest of them, the time between two samples,
/// parameters and starts of the states; of each segment how many samples, then inputs and outputs of each.
fn data(work: &Work, starts: &[f64]) -> String {
    let longest = work.records.iter().map(|r| r.n).max().unwrap_or_default();
    let mut text = format!("{} {longest} {:?}", work.records.len(), work.records[0].dt);
    let mut put = |numbers: &[f64]| {
        numbers.iter().for_each(|x| write!(text, " {x:?}").expect("room"));
        text.push('\n');
    };
    put(starts);
    for record in &work.records {
        put(&[record.n as f64]);
        let wide = record.inputs.len() / record.n;
        for k in 0..record.n {
            put(&record.inputs[k * wide..(k + 1) * wide]);
            put(&record.channels.iter().map(|c| c.z[k]).collect::<Vec<f64>>());
        }
    }
    text
}
