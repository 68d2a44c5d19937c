//! What the engine says of its own work comes in; lines on standard error go out.

use log::{LevelFilter, Log, Metadata, Record};

struct Lines;

impl Log for Lines {
    fn enabled(&self, _: &Metadata) -> bool {
        true
    }

    fn log(&self, record: &Record) {
        eprintln!("{}: {}: {}", record.level(), record.target(), record.args());
    }

    fn flush(&self) {}
}

/// Errors are said, and where `verbose` everything else that is not for its developers.
pub fn begin(verbose: bool) {
    let level = if verbose { LevelFilter::Info } else { LevelFilter::Error };
    if log::set_logger(&Lines).is_ok() {
        log::set_max_level(level);
    }
}
