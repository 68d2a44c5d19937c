//! Faults of the machine come in (a folder that may not be written, a full disk, another run at the
//! same time, a kill at any moment); one clear message goes out, and the next run gives the same
//! bytes as if nothing had been.

use crate::campaign::Campaign;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Every file below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let (mut all, mut folders) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() { folders.push(path) } else { all.push(path) }
        }
    }
    all
}

/// The results of a campaign, by path; hidden files are the program's own notes, and its log has
/// times.
fn results(c: &Campaign) -> BTreeMap<PathBuf, Vec<u8>> {
    let out = c.path("out");
    let relative = |path: PathBuf| path.strip_prefix(&out).expect("below").to_path_buf();
    let hidden = |path: &Path| path.iter().any(|part| part.to_string_lossy().starts_with('.'));
    let named = files(&out).into_iter().map(|path| (relative(path.clone()), path));
    let shown = named.filter(|(name, _)| !hidden(name) && name != Path::new("log.txt"));
    shown.map(|(name, path)| (name, std::fs::read(path).expect("readable"))).collect()
}

fn unfinished(folder: &Path) -> Vec<PathBuf> {
    let begun = |path: &PathBuf| {
        path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(".unfinished-"))
    };
    files(folder).into_iter().filter(begun).collect()
}

/// The results are those wanted, file by file.
fn same(c: &Campaign, wanted: &BTreeMap<PathBuf, Vec<u8>>, when: &str) {
    let found = results(c);
    let names = |all: &BTreeMap<PathBuf, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(wanted), "{when}");
    let other: Vec<_> = found.iter().filter(|(name, bytes)| wanted[*name] != **bytes).collect();
    assert!(other.is_empty(), "{when}: {:?}", other.iter().map(|f| f.0).collect::<Vec<_>>());
    assert_eq!(unfinished(&c.path("out")), Vec::<PathBuf>::new(), "{when}");
}

fn started(c: &Campaign) -> Child {
    Command::new(env!("CARGO_BIN_EXE_koehler"))
        .current_dir(c.folder.path())
        .args(["run", "pipeline.toml"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started")
}

#[test]
fn fault_an_output_folder_that_may_not_be_written_is_named() {
    let c = Campaign::new();
    c.write("out", "a file where the folder should be");
    let run = c.run().ended(2);
    assert!(run.err.contains("out"), "{}", run.err);
    std::fs::remove_file(c.path("out")).expect("removed");
    std::fs::create_dir(c.path("out")).expect("made");
    let mut may = std::fs::metadata(c.path("out")).expect("there").permissions();
    may.set_readonly(true);
    std::fs::set_permissions(c.path("out"), may).expect("set");
    if std::fs::write(c.path("out/probe"), "").is_ok() {
        eprintln!("skipped: this user may write in a folder that is read-only");
        return;
    }
    let run = c.run().ended(2);
    assert!(run.err.contains("out") && run.err.contains("denied"), "{}", run.err);
}

/// A small disk that is taken away when this is dropped.
struct Disk(PathBuf);

impl Disk {
    /// None where this user may not mount one.
    fn of(folder: &Path, size: &str) -> Option<Disk> {
        std::fs::create_dir_all(folder).expect("made");
        let size = format!("size={size}");
        let arguments = ["-t", "tmpfs", "-o", &size, "tmpfs"];
        let run = Command::new("mount").args(arguments).arg(folder).output().ok()?;
        run.status.success().then(|| Disk(folder.to_path_buf()))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn fault_a_full_disk_is_said_and_leaves_nothing_half_written() {
    let c = Campaign::new();
    c.run().ended(0);
    let wanted = results(&c);
    std::fs::remove_dir_all(c.path("out")).expect("removed");
    for size in ["16k", "100k", "400k"] {
        let Some(disk) = Disk::of(&c.path("out"), size) else {
            eprintln!("skipped: this user may not mount a small disk");
            return;
        };
        let run = c.run();
        assert!(run.code > 0 && run.err.contains("No space left"), "{size}: {run:?}");
        assert_eq!(unfinished(&c.path("out")), Vec::<PathBuf>::new(), "{size}");
        drop(disk);
    }
    c.run().ended(0);
    same(&c, &wanted, "with room again");
}

#[test]
fn fault_two_runs_at_once_give_the_bytes_of_one() {
    let c = Campaign::new();
    c.run().ended(0);
    let wanted = results(&c);
    for round in 0..3 {
        std::fs::remove_dir_all(c.path("out")).expect("removed");
        let both = [started(&c), started(&c)];
        let ends = both.map(|run| run.wait_with_output().expect("ended"));
        let codes = ends.each_ref().map(|end| end.status.code());
        assert!(codes.contains(&Some(0)), "{ends:?}");
        let said = ends.each_ref().map(|end| String::from_utf8_lossy(&end.stderr).into_owned());
        assert!(said.iter().all(|text| !text.contains("panicked")), "{said:?}");
        c.run().ended(0);
        same(&c, &wanted, &format!("round {round}"));
    }
}

#[test]
fn fault_a_run_that_is_killed_is_made_good_by_the_next() {
    let c = Campaign::new();
    let clock = Instant::now();
    c.run().ended(0);
    let whole = clock.elapsed();
    let wanted = results(&c);
    let slow = std::env::var_os("KOEHLER_SLOW").is_some();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(20);
    let mut killed = 0;
    for kill in 0..if slow { 200 } else { 20 } {
        // Every other run begins with what the one before has left.
        if kill % 2 == 0 {
            std::fs::remove_dir_all(c.path("out")).expect("removed");
        } else {
            std::fs::remove_dir_all(c.path("out/signals")).expect("removed");
        }
        let mut run = started(&c);
        let share = rng.random_range(0.02..0.98);
        std::thread::sleep(Duration::from_secs_f64(share * whole.as_secs_f64()));
        run.kill().expect("killed");
        killed += u64::from(!run.wait().expect("ended").success());
        c.run().ended(0);
        same(&c, &wanted, &format!("kill {kill} at {share:.2} of a run"));
    }
    assert!(killed > 5, "{killed} runs were killed before their end");
}
