//! A number of flights comes in; a campaign of so many short flights of the Citation goes out,
//! simulated once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

const PIPELINE: &str = r#"
title    = "Short flights of the Citation"
aircraft = "aircraft.toml"
channels = "channels.toml"
logs     = ["logs/*.mcap"]

[reconstruct.method]
by = "smoother"

[derive]
rate_hz = 200.0
smooth  = { az = 0.1, qdot = 0.1 }
interpolation = { servo_current_e = "cubic", servo_current_a = "cubic" }
model   = "derived.model.toml"

[[segment.input]]
name   = "elevator"
signal = "command_e"

[[estimate]]
name   = "elevator"
model  = "elevator.model.toml"
input  = "elevator"
kinds  = ["3211"]
pre_s  = 1.0
post_s = 2.0
interpolation = "cubic"

[estimate.method]
initial = ["delta_e"]
tries   = { F_c = [30.0] }

[[fit]]
estimate   = "elevator"
parameters = ["C_h_delta", "C_h_alpha"]
against    = "alpha"

[report]
"#;

/// The command under test.
pub fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_koehler-cluster"))
}

/// A campaign in a folder of its own.
pub struct Campaign {
    pub folder: TempDir,
}

impl Campaign {
    /// Flights of two maneuvers each.
    pub fn of(flights: usize) -> Campaign {
        let folder = tempfile::tempdir().expect("a folder");
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pipelines/citation");
        for entry in std::fs::read_dir(&shipped).expect("readable") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|e| e == "toml") {
                let name = path.file_name().expect("a name");
                std::fs::copy(&path, folder.path().join(name)).expect("copied");
            }
        }
        let campaign = Campaign { folder };
        campaign.write("pipeline.toml", PIPELINE);
        campaign.write("campaign.toml", &flown(&campaign.read("campaign.toml"), flights));
        let mut simulate = program();
        simulate.current_dir(campaign.path("")).args(["simulate", "campaign.toml", "-q"]);
        assert!(simulate.status().expect("started").success());
        campaign
    }

    pub fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    pub fn write(&self, relative: &str, text: &str) {
        std::fs::write(self.path(relative), text).expect("written");
    }

    fn read(&self, relative: &str) -> String {
        std::fs::read_to_string(self.path(relative)).expect("readable")
    }

    /// `koehler run` into a folder of this name. The pipeline has its whole path: workers name files
    /// by theirs in errors.
    pub fn run(&self, out: &str, args: &[&str]) -> Command {
        let mut command = program();
        command.arg("run").arg(self.path("pipeline.toml")).args(["--out", out]).args(args);
        command.current_dir(self.path(""));
        command
    }

    /// What a run by one thread of one process leaves, and how it ends.
    pub fn alone(&self) -> (BTreeMap<PathBuf, Vec<u8>>, Option<i32>) {
        let ended = self.run("alone", &["--jobs", "1", "-q"]).status().expect("started");
        (left(&self.path("alone")), ended.code())
    }
}

/// The shipped campaign with other flights.
fn flown(text: &str, flights: usize) -> String {
    let (before, rest) = text.split_once("# lateral inputs of both").expect("flights");
    let (_, after) = rest.split_once("# --- the recorder").expect("a recorder");
    let flight = |i: usize| {
        format!(
            "[flights.f{i:02}]\naltitude_ft = 17000.0\nspeeds_kt = [{}.0, {}.0]\nat_each = [\"longitudinal\"]\n\n",
            150 + 3 * (i % 12),
            190 + 2 * (i % 12)
        )
    };
    let flights: String = (1..=flights).map(flight).collect();
    format!("{before}{flights}# --- the recorder{after}")
}

/// All that a run left, by path, without lock, memory and the log with its times.
pub fn left(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(folder: &Path, root: &Path, all: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.strip_prefix(root).expect("below").to_path_buf();
            if path.is_dir() {
                walk(&path, root, all);
            } else if !["lock", "memo.json", "log.txt"]
                .contains(&name.file_name().and_then(|n| n.to_str()).unwrap_or_default())
            {
                all.insert(name, std::fs::read(&path).expect("readable"));
            }
        }
    }
    let mut all = BTreeMap::new();
    walk(folder, folder, &mut all);
    all
}

/// Fails with the names of files that are not the same.
pub fn assert_same(ours: &BTreeMap<PathBuf, Vec<u8>>, theirs: &BTreeMap<PathBuf, Vec<u8>>) {
    assert!(ours.len() > 10, "{:?}", ours.keys());
    assert_eq!(ours.keys().collect::<Vec<_>>(), theirs.keys().collect::<Vec<_>>());
    let differ: Vec<_> = ours.iter().filter(|(path, bytes)| theirs[*path] != **bytes).collect();
    assert!(differ.is_empty(), "{:?}", differ.iter().map(|(path, _)| path).collect::<Vec<_>>());
}
