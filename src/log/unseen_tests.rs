//! Logs without checksums, or without a count of their own messages, in; the warnings that what is wrong with them
//! may not be seen, out.

use super::tests::{one_signal, raw, read, regular};
use super::{Note, Severity};
use std::path::Path;

const COUNT: u64 = 100;

/// Writes a log with these options.
fn write(path: &Path, options: mcap::WriteOptions) {
    let file = std::fs::File::create(path).expect("a file");
    let options = options.compression_threads(0);
    let mut w = options.create(std::io::BufWriter::new(file)).expect("a log");
    let channel_id = w.add_channel(0, "/t", "json", &Default::default()).expect("a channel");
    for (i, (_, log_time, publish_time, text)) in regular(COUNT).into_iter().enumerate() {
        let sequence = i as u32;
        let header = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
        w.write_to_known_channel(&header, text.as_bytes()).expect("written");
    }
    w.finish().expect("finished");
}

/// What is said of a log of which every message is there; all of it is shown at the end of a run, as warnings are.
fn said(path: &Path) -> Vec<String> {
    let flight = read(path, &one_signal("log")).expect("read");
    assert_eq!(flight.signals["x"].series.value.len() as u64, COUNT);
    let is_shown = |n: &Note| n.severity == Severity::Warning && n.count > 0;
    assert!(flight.notes.iter().all(is_shown), "{:?}", flight.notes);
    flight.notes.into_iter().map(|n| n.text).collect()
}

#[test]
fn fault_what_has_no_checksum_is_said_to_have_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let of = |options: mcap::WriteOptions| {
        write(&path, options);
        said(&path)
    };
    let plain = mcap::WriteOptions::new;
    assert_eq!(of(plain()), Vec::<String>::new());
    assert_eq!(
        of(plain().calculate_chunk_crcs(false)),
        [
            "1 of 1 chunks have no checksum: damage in them may not be seen; have the recorder write checksums (CRC)"
        ]
    );
    let summary = of(plain().calculate_summary_section_crc(false));
    assert!(
        summary.len() == 1 && summary[0].starts_with("the summary has no checksum"),
        "{summary:?}"
    );
    let loose = || plain().use_chunks(false);
    assert_eq!(of(loose()), Vec::<String>::new());
    let data = of(loose().calculate_data_section_crc(false));
    let wanted = "messages outside chunks have no checksum";
    assert!(data.len() == 1 && data[0].starts_with(wanted), "{data:?}");
}

#[test]
fn fault_a_log_without_a_count_of_its_own_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    write(&path, mcap::WriteOptions::new().emit_statistics(false));
    assert_eq!(
        said(&path),
        [
            "the log has no count of its messages by channel: whether all that were recorded are there cannot be told"
        ]
    );
}

/// At the end of a run notes of one text are one line, with the number of flights: it must not hang on what else
/// is wrong with a log.
#[test]
fn fault_a_lost_count_is_told_in_the_same_words_whatever_the_damage() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    raw(&path, "json", &regular(2000), 4000);
    let bytes = std::fs::read(&path).expect("readable");
    let counts = (0..bytes.len()).rev().find(|k| bytes[*k..].starts_with(&[0x0b, 56, 0, 0]));
    let counts = counts.expect("a count") + 9;
    // cut off within a chunk; the count and the footer damaged; the count damaged
    let cut = bytes[..bytes.len() / 2].to_vec();
    let mut footer = bytes.clone();
    let at = footer.len() - 28;
    footer[at] ^= 1;
    footer[counts..counts + 20].fill(0xff);
    let mut count = bytes.clone();
    count[counts..counts + 20].fill(0xff);
    let lost = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("written");
        let flight = read(&path, &one_signal("log")).expect("read");
        let is_lost = |n: &Note| n.severity == Severity::Warning && n.text.contains("own count");
        let notes = flight.notes.into_iter().filter(is_lost);
        notes.map(|n| n.text).collect::<Vec<String>>()
    };
    let wanted = "the log's own count of its messages is lost: whether all that were recorded are there cannot be told";
    for damaged in [cut, footer, count] {
        assert_eq!(lost(&damaged), [wanted]);
    }
    assert_eq!(lost(&bytes), Vec::<String>::new());
}
