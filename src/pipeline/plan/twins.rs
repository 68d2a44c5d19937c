//! The logs of a campaign in; those that are another flight's, byte for byte, out.
//!
//! A copy under another name would count twice, and one of a flight that is held out would be estimated from.

use super::logs::FlightLog;
use crate::pipeline::memo::Memo;
use std::collections::BTreeMap;

/// Flights whose logs are those of earlier ones, with these. Only logs of one size are read. One that cannot
/// be read is nobody's.
pub fn twins(logs: &[FlightLog], memo: &Memo) -> BTreeMap<String, String> {
    let mut sizes: BTreeMap<u64, Vec<&FlightLog>> = BTreeMap::new();
    for log in logs {
        let about = log.path.metadata().ok().filter(|about| about.is_file() && about.len() > 0);
        about.into_iter().for_each(|about| sizes.entry(about.len()).or_default().push(log));
    }
    let mut all = BTreeMap::new();
    for alike in sizes.into_values().filter(|alike| alike.len() > 1) {
        let mut first: BTreeMap<String, &str> = BTreeMap::new();
        for log in alike {
            let Ok(Some(hash)) = memo.hash(&log.path) else { continue };
            match first.get(&hash) {
                Some(other) => drop(all.insert(log.flight.clone(), other.to_string())),
                None => drop(first.insert(hash, &log.flight)),
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_copy_of_a_log_is_found_and_one_of_the_same_size_is_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let log = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("written");
            FlightLog { flight: name.to_string(), path, missing: None }
        };
        let logs =
            [log("a", b"one"), log("b", b"two"), log("c", b"one"), log("d", b""), log("e", b"")];
        let found = twins(&logs, &Memo::default());
        assert_eq!(found.into_iter().collect::<Vec<_>>(), [("c".to_string(), "a".to_string())]);
    }
}
