//! Logs that are no files, cannot be read, or have names that are no flight ids: they cost their own
//! flight, by name, and no other.

use crate::campaign::{Campaign, Outcome};

fn reads(c: &Campaign, pattern: &str) -> Outcome {
    let text = std::fs::read_to_string(c.path("pipeline.toml")).expect("readable");
    let line = text.lines().find(|l| l.starts_with("logs")).expect("its logs").to_string();
    c.write("pipeline.toml", &text.replace(&line, &format!("logs = [\"{pattern}\"]")));
    c.run()
}

#[test]
fn a_name_that_recorders_write_becomes_the_id_of_a_flight() {
    let c = Campaign::new();
    let logs = c.path("logs");
    std::fs::rename(logs.join("flight-1.mcap"), logs.join("2024-05-06-10-00.mcap"))
        .expect("renamed");
    std::fs::rename(logs.join("flight-2.mcap"), logs.join("my flight (2).mcap")).expect("renamed");
    reads(&c, "logs/*.mcap").ended(0);
    for flight in ["flight-2024-05-06-10-00", "my-flight--2", "flight-3"] {
        assert!(c.path(&format!("out/signals/flight={flight}")).exists(), "{flight}");
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_a_folder_and_a_loop_of_links_cost_their_own_flights() {
    use std::os::unix::ffi::OsStrExt;
    let c = Campaign::new();
    let at = |name: &str| c.path("logs").join(name);
    let made = std::process::Command::new("mkfifo").arg(at("pipe.mcap")).status().expect("mkfifo");
    assert!(made.success());
    std::fs::create_dir(at("folder.mcap")).expect("made");
    std::os::unix::fs::symlink(at("b.mcap"), at("a.mcap")).expect("linked");
    std::os::unix::fs::symlink(at("a.mcap"), at("b.mcap")).expect("linked");
    let latin = std::ffi::OsStr::from_bytes(b"m\xfcller.mcap");
    std::fs::rename(at("flight-3.mcap"), c.path("logs").join(latin)).expect("renamed");
    let run = reads(&c, "logs/*.mcap").ended(1);
    let said = run.out.clone() + &run.err;
    for name in ["pipe.mcap is a pipe or a device", "folder.mcap is a folder", "a.mcap", "b.mcap"] {
        assert!(said.contains(name), "{name} is not in\n{said}");
    }
    for flight in ["flight-1", "flight-2", "m-ller"] {
        assert!(c.path(&format!("out/signals/flight={flight}")).exists(), "{flight}\n{said}");
    }
    // Looked at again, the same is said, and nothing waits for the pipe.
    c.koehler("status", &[]);
    c.koehler("check", &[]);
}

#[test]
fn the_memory_for_chunks_is_a_setting_of_the_pipeline_file() {
    let c = Campaign::new();
    let text = std::fs::read_to_string(c.path("pipeline.toml")).expect("readable");
    c.write("pipeline.toml", &format!("{text}\n[ingest]\nchunk_memory_mib = 1\n"));
    c.run().ended(0);
    c.edit("pipeline.toml", "chunk_memory_mib = 1", "chunk_memory_mib = 0");
    let run = c.koehler("check", &[]).ended(2);
    assert!(run.err.contains("chunks need some memory"), "{}", run.err);
}
