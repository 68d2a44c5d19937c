//! Topics that several channels write, and angles that go round, in; what is said of them, out.

use super::tests::{START, read, texts};
use std::collections::BTreeMap;
use std::path::Path;

/// Messages every 10 ms (which channel, angle), the channels being of one topic with these units.
fn written(path: &Path, units: &[&str], messages: &[(usize, f64)]) {
    let file = std::fs::File::create(path).expect("a file");
    let mut w = mcap::Writer::new(std::io::BufWriter::new(file)).expect("a log");
    let channels: Vec<u16> = units
        .iter()
        .enumerate()
        .map(|(i, unit)| {
            let schema = format!(
                "{{\"type\":\"object\",\"properties\":{{\"x\":{{\"type\":\"number\",\"unit\":\"{unit}\"}}}}}}"
            );
            let schema = w.add_schema("angle", "jsonschema", schema.as_bytes()).expect("a schema");
            let of = BTreeMap::from([("source".to_string(), i.to_string())]);
            w.add_channel(schema, "/t", "json", &of).expect("a channel")
        })
        .collect();
    for (k, (of, x)) in messages.iter().enumerate() {
        let log_time = START + 10_000_000 * k as u64;
        let header = mcap::records::MessageHeader {
            channel_id: channels[*of],
            sequence: k as u32,
            log_time,
            publish_time: log_time,
        };
        w.write_to_known_channel(&header, format!("{{\"x\":{x}}}").as_bytes()).expect("written");
    }
    w.finish().expect("whole");
}

const MAP: &str = "[signal.x]\ntopic = \"/t\"\nfield = \"x\"\nunit = \"deg\"\ntime = \"log\"\n";

#[test]
fn fault_channels_of_one_topic_in_different_units_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    for units in [["deg", "rad"], ["rad", "deg"]] {
        written(&path, &units, &[(0, 1.0), (0, 1.5), (1, 0.03)]);
        let why = read(&path, MAP).expect_err("two units");
        let said =
            format!("is in \"{}\" and in \"{}\" by the schemas of a.mcap", units[0], units[1]);
        assert!(why.contains(&said), "{why}");
        // the advice does not go round in a circle: neither unit is recommended
        let advice = "give each channel a topic of its own in the log; only where all numbers are in \"deg\", and the schema that says \"rad\" is wrong, add despite = \"rad\"";
        assert!(why.contains(advice) && !why.contains("write unit"), "{why}");
        let other = MAP.replace("\"deg\"", "\"rad\"");
        let why = read(&path, &other).expect_err("two units");
        assert!(why.contains("add despite = \"deg\"") && !why.contains("write unit"), "{why}");
        read(&path, &(MAP.to_string() + "despite = \"rad\"\n")).expect("it is said");
    }
    // one that is not known does not hide one that is known to be another
    written(&path, &["furlong", "rad"], &[(0, 1.0), (0, 1.5), (1, 0.03)]);
    let why = read(&path, MAP).expect_err("another unit");
    assert!(why.contains("is in \"rad\" by the schema"), "{why}");
}

#[test]
fn fault_two_sources_by_turns_are_told_and_one_after_the_other_are_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let told = |messages: &[(usize, f64)]| {
        written(&path, &["deg", "deg"], messages);
        let log = read(&path, MAP).expect("read");
        texts(&log).iter().any(|text| text.contains("2 channels write to it by turns"))
    };
    let by_turns: Vec<(usize, f64)> = (0..40).map(|k| (k % 2, k as f64)).collect();
    let in_order: Vec<(usize, f64)> = (0..40).map(|k| (k / 20, k as f64)).collect();
    assert!(told(&by_turns) && !told(&in_order));
}

#[test]
fn a_heading_goes_on_beyond_north() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let heading = |k: usize| (0, (355.0 + 0.25 * k as f64) % 360.0);
    written(&path, &["deg"], &(0..40).map(heading).collect::<Vec<_>>());
    let log = read(&path, MAP).expect("read");
    let values = &log.signals["x"].series.value;
    assert!((values[39].to_degrees() - 364.75).abs() < 1e-9, "{values:?}");
    assert!(texts(&log).iter().any(|text| text.contains("a whole turn once")));
}

/// What is said of an angle, and its values in radians.
fn angle(unit: &str, angles: &[f64]) -> (Vec<String>, Vec<f64>) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let messages: Vec<(usize, f64)> = angles.iter().map(|x| (0, *x)).collect();
    written(&path, &[unit], &messages);
    let log = read(&path, &MAP.replace("\"deg\"", &format!("\"{unit}\""))).expect("read");
    (
        texts(&log).iter().map(|text| text.to_string()).collect(),
        log.signals["x"].series.value.clone(),
    )
}

#[test]
fn fault_degrees_declared_as_radians_keep_their_numbers_and_are_told_of() {
    let bank: Vec<f64> = (0..300).map(|k| 60.0 * libm::sin(0.125 * f64::from(k)) + 1.5).collect();
    let (said, values) = angle("rad", &bank);
    assert_eq!(values, bank);
    let wanted =
        ["/t x: runs from -58.", " rad, more than a turn, and steps by", "degrees declared as rad"];
    assert!(said.len() == 1 && wanted.iter().all(|w| said[0].contains(w)), "{said:?}");
}

#[test]
fn an_angle_that_goes_on_beyond_a_turn_already_is_left_as_it_is() {
    let on: Vec<f64> = (0..300).map(|k| 5.0 + 0.05 * f64::from(k)).collect();
    assert_eq!(angle("rad", &on), (Vec::new(), on));
    // from 355 to 365 degrees, to a little beyond a turn
    let near: Vec<f64> = (0..300).map(|k| 6.2 + 0.001 * f64::from(k)).collect();
    assert_eq!(angle("rad", &near), (Vec::new(), near));
}

#[test]
fn a_heading_that_covers_the_whole_turn_goes_on_beyond_it() {
    let heading: Vec<f64> = (0..800).map(|k| f64::from(k) % 360.5).collect();
    let (said, values) = angle("deg", &heading);
    assert!(said.iter().any(|text| text.contains("a whole turn 2 times")), "{said:?}");
    assert!(values.windows(2).all(|w| (w[1] - w[0]).abs() < 0.05));
}

#[test]
fn fault_a_step_of_nearly_a_turn_that_no_motion_explains_keeps_its_numbers_and_is_told_of() {
    let elevator =
        |k: i32| if (100..130).contains(&k) { 5.0 } else { 0.05 * libm::sin(0.1 * f64::from(k)) };
    let logged: Vec<f64> = (0..300).map(elevator).collect();
    let (said, values) = angle("rad", &logged);
    assert_eq!(values, logged);
    assert!(said.iter().any(|text| text.contains("nearly a whole turn 2 times")), "{said:?}");
}
