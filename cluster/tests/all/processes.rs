//! A scheduler and workers as processes of their own: a campaign comes in; they work until they are
//! dropped.

use crate::campaign::{Campaign, program};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A process with the first line that it said.
pub struct Process {
    pub child: Child,
    pub said: String,
}

impl Process {
    /// Starts a command and waits for its first line.
    pub fn start(command: &mut Command) -> Process {
        let mut child = command.stdout(Stdio::piped()).spawn().expect("started");
        let mut lines = BufReader::new(child.stdout.take().expect("piped"));
        let mut said = String::new();
        lines.read_line(&mut said).expect("readable");
        assert!(!said.is_empty(), "{command:?} said nothing");
        // Whatever else it says is read, so that it never waits.
        std::thread::spawn(move || std::io::copy(&mut lines, &mut std::io::sink()));
        Process { child, said: said.trim().to_string() }
    }

    /// Processor time so far, of all its threads.
    pub fn cpu(&self) -> Duration {
        let path = format!("/proc/{}/stat", self.child.id());
        let Ok(text) = std::fs::read_to_string(path) else { return Duration::ZERO };
        let after = text.rsplit_once(") ").map_or("", |(_, after)| after);
        let ticks = |i: usize| after.split(' ').nth(i).and_then(|t| t.parse::<u64>().ok());
        let ticks = ticks(11).unwrap_or_default() + ticks(12).unwrap_or_default();
        Duration::from_millis(ticks * 10)
    }

    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A scheduler with workers of one thread each.
pub struct Cluster {
    pub workers: Vec<Process>,
    pub address: String,
    _scheduler: Process,
}

impl Cluster {
    /// Workers that see a campaign.
    pub fn start(campaign: &Campaign, workers: usize) -> Cluster {
        Cluster::with(campaign, workers, &[])
    }

    /// The same with more arguments for all.
    pub fn with(campaign: &Campaign, workers: usize, args: &[&str]) -> Cluster {
        Cluster::below(&campaign.path(""), workers, args)
    }

    /// A worker that sees a folder of a campaign alone.
    pub fn start_below(campaign: &Campaign, folder: &str) -> Cluster {
        Cluster::below(&campaign.path(folder), 1, &[])
    }

    fn below(folder: &Path, workers: usize, args: &[&str]) -> Cluster {
        let mut scheduler = program();
        scheduler.args(["scheduler", "--listen", "127.0.0.1:0"]).args(args);
        let scheduler = Process::start(&mut scheduler);
        let address = scheduler.said.rsplit(' ').next().expect("an address").to_string();
        let start = |_| Process::start(worker(folder, &address).args(args));
        Cluster { workers: (0..workers).map(start).collect(), address, _scheduler: scheduler }
    }
}

/// A worker of one thread.
pub fn worker(folder: &Path, scheduler: &str) -> Command {
    let mut command = program();
    command.args(["worker", scheduler, "--jobs", "1", "--out"]).arg(folder);
    command
}
