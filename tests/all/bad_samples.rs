//! Samples that have nothing to do with the signal: found, counted, told, and without effect on results.

use crate::campaign::{Campaign, write_log_seen};
use koehler::table::read_dataset;

/// The second flight with one sample of y that reads 20 deg, in the middle of a maneuver.
fn with_a_spike() -> Campaign {
    with_wrong(&[20.0])
}

/// The same with so many samples in a row, at 40 Hz.
fn with_wrong(wrong: &[f64]) -> Campaign {
    let c = Campaign::new();
    let mut left = wrong.iter();
    write_log_seen(&c.path("logs/flight-2.mcap"), 1, 4, |t, y| {
        let now = if t > 26.0 { left.next() } else { None };
        now.copied().unwrap_or(y)
    });
    c
}

/// The gain and its sd in every maneuver.
fn gains(c: &Campaign) -> Vec<(f64, f64)> {
    let table = read_dataset(&c.path("out"), "estimates").expect("estimates");
    let [value, sd] = ["value", "sd"].map(|name| table.f64(name).expect("numbers"));
    let names = table.strings("parameter").expect("names");
    (0..table.rows()).filter(|&row| names[row] == "K").map(|row| (value[row], sd[row])).collect()
}

/// The sample is in its table with twenty neighbours on either side, and drawn on the page of its
/// flight alone.
fn seen_on_the_page(c: &Campaign) {
    let table = read_dataset(&c.path("out"), "left_out").expect("left_out");
    let (fates, values) = (table.strings("fate").expect("words"), table.f64("value").expect("SI"));
    let spikes: Vec<f64> =
        fates.iter().zip(values).filter(|(f, _)| **f == "spike").map(|(_, v)| *v).collect();
    assert_eq!((spikes.len(), table.rows()), (1, 41));
    assert!((spikes[0] - 20f64.to_radians()).abs() < 1e-9, "{spikes:?}");
    let page = |flight: &str| {
        let path = c.path(&format!("out/report/flights/{flight}.html"));
        std::fs::read_to_string(path).expect("a page")
    };
    assert!(page("flight-2").contains("1 spike (20.00 deg at 26.0"));
    assert!(!page("flight-1").contains("left-out-0"));
}

/// How many samples of y were dropped for this reason, over all flights.
fn dropped(c: &Campaign, column: &str) -> i64 {
    let table = read_dataset(&c.path("out"), "channels").expect("channels");
    let (signals, counts) = (table.strings("signal"), table.i64(column));
    let both = signals.expect("names").into_iter().zip(counts.expect("counts"));
    both.filter(|(signal, _)| *signal == "y").map(|(_, count)| count).sum()
}

#[test]
fn fault_one_wrong_sample_is_told_and_changes_no_estimate() {
    let clean = Campaign::new();
    clean.run().ended(0);
    let c = with_a_spike();
    let run = c.run().ended(0);
    for words in ["1 of its samples stands far out of both neighbours", "20.0 deg at 26.0"] {
        assert!(run.out.contains(words) || run.err.contains(words), "{}\n{}", run.out, run.err);
    }
    assert_eq!(dropped(&c, "dropped_spikes"), 1);
    seen_on_the_page(&c);
    let (without, with) = (gains(&clean), gains(&c));
    assert_eq!(without.len(), 12);
    for ((a, sd), (b, _)) in without.iter().zip(&with) {
        assert!((a - b).abs() < 0.2 * sd, "{a} {b} +- {sd}");
    }
    // The note has it as the log has it, whatever the map makes of it.
    c.edit("channels.toml", "field = \"angle\"", "field = \"angle\"\nsign = -1");
    let run = c.run();
    assert!(run.out.contains("20.0 deg at 26.0") || run.err.contains("20.0 deg at 26.0"));
    c.edit("channels.toml", "\nsign = -1", "");
    // Kept, it does.
    c.edit("channels.toml", "field = \"angle\"", "field = \"angle\"\nspikes = \"keep\"");
    c.run();
    assert_eq!(dropped(&c, "dropped_spikes"), 0);
    let off = |((a, sd), (b, _)): (&(f64, f64), &(f64, f64))| (a - b).abs() / sd;
    let most = without.iter().zip(&gains(&c)).map(off).fold(0.0, f64::max);
    assert!(most > 1.0, "{most}");
}

#[test]
fn fault_two_wrong_samples_in_a_row_are_told_and_change_no_estimate() {
    let clean = Campaign::new();
    clean.run().ended(0);
    let c = with_wrong(&[20.0, 18.0]);
    let run = c.run().ended(0);
    let words = "2 of its samples stand far out of their neighbours";
    assert!(run.out.contains(words) || run.err.contains(words), "{}\n{}", run.out, run.err);
    assert_eq!(dropped(&c, "dropped_spikes"), 2);
    for ((a, sd), (b, _)) in gains(&clean).iter().zip(&gains(&c)) {
        assert!((a - b).abs() < 0.3 * sd, "{a} {b} +- {sd}");
    }
    // Three are a pulse.
    let c = with_wrong(&[20.0, 18.0, 19.0]);
    c.run();
    assert_eq!(dropped(&c, "dropped_spikes"), 0);
}

#[test]
fn fault_samples_outside_their_range_are_dropped_and_counted() {
    let c = with_a_spike();
    c.edit(
        "channels.toml",
        "field = \"angle\"",
        "field = \"angle\"\nspikes = \"keep\"\nrange = [-0.2, 0.2]",
    );
    let run = c.run().ended(0);
    let words = "outside its range, dropped";
    assert!(run.out.contains(words) || run.err.contains(words), "{}\n{}", run.out, run.err);
    assert_eq!(dropped(&c, "dropped_out_of_range"), 1);
    c.edit("channels.toml", "[-0.2, 0.2]", "[0.2, -0.2]");
    let run = c.koehler("check", &[]).ended(2);
    assert!(run.err.contains("0.2 is not below -0.2"), "{}", run.err);
}
