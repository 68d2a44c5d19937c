//! Whole logs, sound and damaged, in; what must come out of them.

use super::*;
use crate::config;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const MS: u64 = 1_000_000;
pub(super) const START: u64 = 1_700_000_000_000_000_000;

/// A folder of test data that is not part of the project: `$KOEHLER_DATA`, or `shared/data` in a
/// folder above the project.
fn data(name: &str) -> Option<PathBuf> {
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared/data"));
    let found = std::env::var_os("KOEHLER_DATA")
        .map(PathBuf::from)
        .into_iter()
        .chain(above)
        .map(|d| d.join(name))
        .find(|p| p.exists());
    if found.is_none() {
        eprintln!("skipped: no {name} in $KOEHLER_DATA or in shared/data above the project");
    }
    found
}

/// Writes messages (topic, log time, publish time, text) as they are, in small chunks.
pub(super) fn raw(path: &Path, encoding: &str, messages: &[(&str, u64, u64, String)], chunk: u64) {
    let file = std::fs::File::create(path).unwrap();
    let options = mcap::WriteOptions::new().chunk_size(Some(chunk)).compression_threads(0);
    let mut w = options.create(std::io::BufWriter::new(file)).unwrap();
    for (i, (topic, log_time, publish_time, text)) in messages.iter().enumerate() {
        let channel_id = w.add_channel(0, topic, encoding, &BTreeMap::new()).unwrap();
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: i as u32,
            log_time: *log_time,
            publish_time: *publish_time,
        };
        w.write_to_known_channel(&header, text.as_bytes()).unwrap();
    }
    w.finish().unwrap();
}

pub(super) fn read(path: &Path, channels: &str) -> std::result::Result<FlightLog, String> {
    let (map, doc) =
        config::parse::<ChannelMap>("channels.toml", channels).map_err(|e| e.to_string())?;
    map.check(&doc).map_err(|e| e.to_string())?;
    read_flight(path, &map, &doc).map_err(|e| e.to_string())
}

pub(super) fn one_signal(time: &str) -> String {
    format!("[signal.x]\ntopic = \"/t\"\nfield = \"x\"\nunit = \"1\"\ntime = \"{time}\"\n")
}

/// `n` messages every 10 ms with x = 0, 1, 2, ...
pub(super) fn regular(n: u64) -> Vec<(&'static str, u64, u64, String)> {
    (0..n)
        .map(|i| {
            ("/t", START + i * 10 * MS, START + i * 10 * MS, format!("{{\"x\":{i},\"y\":0.5}}"))
        })
        .collect()
}

pub(super) fn texts(log: &FlightLog) -> Vec<&str> {
    log.notes.iter().map(|n| n.text.as_str()).collect()
}

#[test]
fn what_is_written_is_read_again_in_si_on_one_time_base() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut log = LogWriter::create(&path).unwrap();
    let air = log
        .add_topic(
            "/air",
            &[FieldSpec::new("tas", "kt", "True airspeed"), FieldSpec::new("alpha", "deg", "")],
        )
        .unwrap();
    let servo = log.add_topic("/surfaces", &[FieldSpec::new("elevator_deg", "deg", "")]).unwrap();
    let t: Vec<u64> = (0..1000).map(|i| START + i * 20 * MS).collect();
    let sent: Vec<u64> = t.iter().map(|t| t - 3 * MS).collect();
    let rows: Vec<f64> =
        (0..1000).flat_map(|i| [200.0 + f64::from(i), 0.1 * f64::from(i)]).collect();
    let late: Vec<u64> = t.iter().map(|t| t + 5 * MS).collect();
    let elevator: Vec<f64> = (0..1000).map(|i| f64::from(i % 7) - 3.0).collect();
    log.write_streams(&[
        Stream { topic: air, log_time_ns: &t, publish_time_ns: &sent, rows: &rows },
        Stream { topic: servo, log_time_ns: &late, publish_time_ns: &late, rows: &elevator },
    ])
    .unwrap();
    log.finish().unwrap();
    let map = r#"
[defaults]
time = "publish"
[signal.V]
topic = "/air"
field = "tas"
unit = "kt"
[signal.alpha]
topic = "/air"
field = "alpha"
unit = "deg"
scale = 2.0
offset = 0.25
delay = 0.1
time = "log"
[signal.delta_e]
topic = "/surfaces"
field = "elevator_deg"
unit = "deg"
sign = -1
"#;
    let flight = read(&path, map).unwrap();
    assert_eq!((flight.name.as_str(), flight.start_ns), ("a.mcap", START));
    assert_eq!(flight.signals.keys().collect::<Vec<_>>(), ["V", "alpha", "delta_e"]);
    assert!(flight.notes.is_empty(), "{:?}", flight.notes);
    let v = &flight.signals["V"];
    assert_eq!(v.series.t_s[..2], [-0.003, 0.017]);
    assert!((v.series.value[10] - 210.0 * 1852.0 / 3600.0).abs() < 1e-9);
    assert_eq!((v.account.count, v.account.gaps, v.account.rate_hz), (1000, 0, 50.0));
    let alpha = &flight.signals["alpha"].series;
    assert_eq!(alpha.t_s[..2], [-0.1, 0.02 - 0.1]);
    assert!((alpha.value[10] - (2.0 * 1f64.to_radians() + 0.25)).abs() < 1e-12);
    let e = &flight.signals["delta_e"];
    assert!(
        (e.account.max - 3f64.to_radians()).abs() < 1e-12
            && (e.series.value[0] - 3f64.to_radians()).abs() < 1e-12
    );
}

#[test]
fn duplicates_late_messages_nan_bursts_and_gaps_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut messages = regular(400);
    messages.remove(300);
    (310..330).rev().for_each(|i| drop(messages.remove(i)));
    for m in &mut messages[100..112] {
        m.3 = "{\"x\":NaN,\"y\":0.5}".into();
    }
    messages[120].3 = "{\"x\":\"off\",\"y\":0.5}".into();
    messages[121].3 = "{\"y\":0.5}".into();
    messages[122].3 = "{\"x\":1,".into();
    let twice = (messages[50].0, messages[50].1, messages[50].2, "{\"x\":-7}".to_string());
    messages.insert(51, twice);
    messages.swap(200, 201);
    raw(&path, "json", &messages, 2000);
    let flight = read(&path, &one_signal("log")).unwrap();
    let a = &flight.signals["x"].account;
    assert_eq!((a.messages, a.count), (380, 380 - 12 - 3 - 1));
    assert_eq!(
        (a.dropped_nan, a.dropped_unreadable, a.dropped_duplicate, a.reordered, a.clock_jumps),
        (12, 3, 1, 1, 0)
    );
    assert_eq!(a.gaps, 3, "{a:?}");
    assert!((a.longest_gap_s - 0.21).abs() < 1e-9, "{a:?}");
    let series = &flight.signals["x"].series;
    assert!(series.t_s.windows(2).all(|w| w[0] < w[1]));
    assert!(series.t_s.iter().zip(&series.value).all(|(t, x)| (t * 100.0 - x).abs() < 1e-6));
    assert_eq!(
        texts(&flight),
        [
            "/t x: 1 of 380 messages unreadable",
            "/t x: 2 of 380 messages have no field x, or no number in it",
            "/t x: 12 of 380 messages hold NaN, dropped",
            "/t x: 1 of 380 messages repeat a time stamp, dropped",
            "/t x: 1 of 380 messages out of order, sorted",
            "/t x: 3 gaps, the longest 0.210 s at a usual spacing of 0.0100 s",
        ]
    );
}

#[test]
fn fault_fuel_that_grows_in_flight_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    // every 100 ms; kg: it burns, and from 50 s on 200 kg more are there
    let fuel = |i: u64| 3000.0 - 0.04 * i as f64 + if i < 500 { 0.0 } else { 200.0 };
    let message = |i: u64| ("/t", START + i * 100 * MS, START, format!("{{\"x\":{}}}", fuel(i)));
    raw(&path, "json", &(0..1000).map(message).collect::<Vec<_>>(), 4000);
    let map = |more: &str| one_signal("log").replace("\"1\"", "\"kg\"") + more;
    let noted = |more: &str| {
        let flight = read(&path, &map(more)).unwrap();
        texts(&flight).into_iter().map(str::to_string).collect::<Vec<_>>()
    };
    assert_eq!(
        noted("trend = \"falls\"\n"),
        [
            "/t x: rises by 196.0000 kg from 45 to 55 s, but trend = \"falls\" says that it only falls; what follows from it is wrong in this flight \
          if the signal is (topic, field, unit and sign of the map; a tank that is not counted)"
        ]
    );
    assert!(noted("trend = \"rises\"\n")[0].starts_with("/t x: falls by "));
    assert!(noted("").is_empty());
    let wrong = read(&path, &map("trend = \"down\"\n")).unwrap_err();
    assert!(wrong.contains("channels.toml:6:9") && wrong.contains("falls"), "{wrong}");
}

#[test]
fn a_cut_off_file_yields_its_intact_part_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, cut) = (folder.path().join("a.mcap"), folder.path().join("cut.mcap"));
    raw(&whole, "json", &regular(5000), 4000);
    let bytes = std::fs::read(&whole).unwrap();
    let all = read(&whole, &one_signal("log")).unwrap();
    for share in [3, 5, 8] {
        std::fs::write(&cut, &bytes[..bytes.len() * share / 10]).unwrap();
        let flight = read(&cut, &one_signal("log")).unwrap();
        let n = flight.signals["x"].series.value.len();
        assert!(n > 500 && n < 5000, "{n}");
        assert_eq!(flight.signals["x"].series.value, all.signals["x"].series.value[..n]);
        assert!(texts(&flight)[0].contains("the file is cut off"), "{:?}", flight.notes);
    }
    std::fs::write(&cut, &bytes[..40]).unwrap();
    assert!(read(&cut, &one_signal("log")).unwrap_err().contains("holds no intact chunk"));
    std::fs::write(&cut, b"").unwrap();
    let e = read(&cut, &one_signal("log")).unwrap_err();
    assert!(e.starts_with(&format!("the log {} is empty (0 bytes)", cut.display())), "{e}");
    std::fs::write(&cut, b"time,x\n0,1\n").unwrap();
    assert!(read(&cut, &one_signal("log")).unwrap_err().contains("is not an MCAP file"));
    assert!(
        read(&folder.path().join("none.mcap"), &one_signal("log"))
            .unwrap_err()
            .contains("cannot read the log")
    );
}

#[test]
fn a_flipped_byte_costs_one_chunk_and_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    raw(&path, "json", &regular(5000), 4000);
    let mut bytes = std::fs::read(&path).unwrap();
    let log = LogFile::open(&path).unwrap();
    let at = log.offset(7) + 100;
    drop(log);
    bytes[at] ^= 0x10;
    std::fs::write(&path, &bytes).unwrap();
    let flight = read(&path, &one_signal("log")).unwrap();
    let (a, note) = (&flight.signals["x"].account, &flight.notes[0]);
    assert!(a.count < 5000 && a.count > 4500 && a.gaps == 1, "{a:?}");
    assert_eq!((note.subject.as_str(), note.count), ("file", 1));
    assert!(
        note.text.contains("1 of") && note.text.contains("chunks are damaged and left out"),
        "{}",
        note.text
    );
    let series = &flight.signals["x"].series;
    assert!(series.t_s.iter().zip(&series.value).all(|(t, x)| (t * 100.0 - x).abs() < 1e-6));
}

#[test]
fn no_flipped_byte_anywhere_panics_or_changes_a_value() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    raw(&path, "json", &regular(120), 1000);
    let bytes = std::fs::read(&path).unwrap();
    let value_of = |t: f64| libm::round(t * 100.0);
    // Inside a pool of one thread nothing waits for another thread to wake up, thousands of times.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x41;
            let broken = folder.path().join(format!("{at}.mcap"));
            std::fs::write(&broken, &damaged).unwrap();
            // Either an error, or what is read is right.
            if let Ok(flight) = read(&broken, &one_signal("log")) {
                let s = &flight.signals["x"].series;
                assert!(s.value.len() > 70, "byte {at}: {}", s.value.len());
                let zero = value_of((flight.start_ns as i64 - START as i64) as f64 / 1e9);
                assert!(
                    s.t_s.iter().zip(&s.value).all(|(t, x)| value_of(*t) + zero == *x),
                    "byte {at}"
                );
            }
            std::fs::remove_file(&broken).unwrap();
        }
    });
}

#[test]
fn mistakes_in_the_map_are_told_all_at_once_with_place_and_what_was_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight-03.mcap");
    let mut messages = regular(10);
    messages.push(("/air_data", START, START, "{\"alpha\":0.1,\"tas\":100}".into()));
    raw(&path, "json", &messages, 4000);
    let map = r#"[signal.V]
topic = "/airdata"
field = "tas"
unit = "m/s"
[signal.alpha]
topic = "/air_data"
field = "alhpa"
unit = "rad"
[signal.x]
topic = "/t"
field = "x"
unit = "1"
time = "header.stamp"
"#;
    let topic =
        "channels.toml:2:9: topic \"/airdata\" is not in flight-03.mcap; it has \"/air_data\"";
    assert_eq!(read(&path, map).unwrap_err(), topic);
    let expected = [
        "channels.toml:7:9: field \"alhpa\" is not in topic \"/air_data\" of flight-03.mcap; it has \"alpha\", \"tas\"",
        "channels.toml:13:8: the time stamp \"header.stamp\" of topic \"/t\" needs a time_unit: \"s\", \"ms\", \"us\" or \"ns\"",
    ];
    assert_eq!(
        read(&path, &map.replace("/airdata", "/air_data")).unwrap_err(),
        expected.join("\n")
    );
    let settings =
        read(&path, "[signal.x]\ntopic = \"/t\"\nfield = \"x\"\nunit = \"furlong\"\nsign = 2\nscale = 0\ntime_unit = \"min\"\n")
            .unwrap_err();
    assert_eq!(
        settings.lines().filter(|l| l.starts_with("channels.toml:")).count(),
        4,
        "{settings}"
    );
}

#[test]
fn header_stamps_of_every_kind_give_the_same_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let message = |i: u64| {
        let (ns, log) = (START + i * 10 * MS, START + i * 10 * MS + (i * 37 % 5) * MS);
        let (sec, nanosec) = (ns / 1_000_000_000, ns % 1_000_000_000);
        let text = format!(
            "{{\"stamp\":{{\"sec\":{sec},\"nanosec\":{nanosec}}},\"us\":{},\"s\":{}.{nanosec:09},\"x\":{i}}}",
            ns / 1000,
            sec
        );
        ("/t", log, 0, text)
    };
    raw(&path, "json", &(0..200).map(message).collect::<Vec<_>>(), 4000);
    let times = |time: &str, unit: &str| {
        read(&path, &(one_signal(time) + unit)).unwrap().signals["x"].series.t_s.clone()
    };
    let exact: Vec<f64> = (0..200).map(|i| f64::from(i) * 10.0 / 1e3).collect();
    assert_eq!(times("stamp", ""), exact);
    for (path, unit) in [("us", "time_unit = \"us\"\n"), ("s", "time_unit = \"s\"\n")] {
        assert!(times(path, unit).iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-6), "{path}");
    }
    let mut wild = (0..20).map(message).collect::<Vec<_>>();
    wild[3].3 = "{\"stamp\":{\"sec\":1e300,\"nanosec\":1e300},\"x\":3}".into();
    let other = folder.path().join("wild.mcap");
    raw(&other, "json", &wild, 4000);
    assert_eq!(
        read(&other, &one_signal("stamp")).unwrap().signals["x"].account.dropped_unreadable,
        1
    );
    let early =
        read(&path, &(one_signal("us") + "time_unit = \"us\"\ntime_zero = \"start\"\n")).unwrap();
    assert!((early.signals["x"].series.t_s[0] - START as f64 / 1e9).abs() < 1e-3);
    assert!(
        texts(&early)[0].contains("signals of other clocks are not aligned"),
        "{:?}",
        early.notes
    );
    let e = read(&path, &one_signal("publish")).unwrap_err();
    assert_eq!(
        e,
        "channels.toml:5:8: topic \"/t\" of a.mcap has no publish times (all are 0); use time = \"log\""
    );
}

#[test]
fn a_clock_of_its_own_and_its_jumps_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut messages = regular(200);
    for (i, m) in messages.iter_mut().enumerate() {
        m.2 = i as u64 * 10 * MS + if i < 100 { 1 } else { 60_000 * MS };
    }
    raw(&path, "json", &messages, 4000);
    let flight = read(&path, &one_signal("publish")).unwrap();
    assert_eq!(flight.signals["x"].account.clock_jumps, 1);
    assert!(
        texts(&flight).iter().any(|t| t.contains("signals of other clocks are not aligned")),
        "{:?}",
        flight.notes
    );
}

#[test]
fn unsupported_encodings_are_named_and_inspect_still_lists_the_topic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    raw(&path, "protobuf", &regular(10), 4000);
    let e = read(&path, &one_signal("log")).unwrap_err();
    assert!(e.starts_with("channels.toml:2:9: topic \"/t\" of a.mcap is encoded as protobuf with no schema, which cannot be decoded; supported: json"), "{e}");
    let text = inspect::survey(&path).unwrap().to_string();
    assert!(text.contains("/t  protobuf (no schema)  10 messages, 100 Hz, no gaps"), "{text}");
    assert!(text.contains("cannot be decoded"), "{text}");
}

#[test]
fn truth_a_real_ros2_recording_gives_what_another_reader_gives() {
    let Some(path) = data("logs/cub_stabilize_2025_11_13.mcap") else { return };
    let survey = inspect::survey(&path).unwrap();
    assert_eq!(survey.messages, 21258);
    let pose = survey.topics.iter().find(|t| t.topic == "/cub1/pose").unwrap();
    assert_eq!((pose.message_encoding.as_str(), pose.decodable), ("cdr", true));
    assert!(
        (pose.rate_hz - 99.5).abs() < 1.5 && (pose.longest_gap_s - 0.168).abs() < 0.002,
        "{pose:?}"
    );
    let map = "[signal.x]\ntopic = \"/cub1/pose\"\nfield = \"pose.position.x\"\nunit = \"m\"\ntime = \"header.stamp\"\n\
        [signal.w]\ntopic = \"/cub1/pose\"\nfield = \"pose.orientation.w\"\nunit = \"1\"\n\
        [signal.elevator]\ntopic = \"/cub1/joy_serial_status\"\nfield = \"data.1\"\nunit = \"1\"\n";
    let flight = read(&path, map).unwrap();
    // Messages 0, 10 000 and the last by the Python package mcap-ros2-support 0.6.0.
    let (x, w) = (&flight.signals["x"].series, &flight.signals["w"].series);
    let at = |values: &[f64]| [values[0], values[10_000], values[19_702]];
    assert_eq!(x.value.len(), 19_703);
    assert_eq!(at(&x.value), [5.77776611328125, -7.4418837890625, -6.70045556640625]);
    assert_eq!(at(&w.value), [0.6785335041264413, 0.39392209353188473, 0.3785369333396763]);
    let stamp = |ns: i64| (ns - flight.start_ns as i64) as f64 / 1e9;
    let stamps = [1763073169920561822, 1763073270809432694, 1763073367948418373].map(stamp);
    assert_eq!(at(&x.t_s), stamps);
    let elevator = &flight.signals["elevator"].series.value;
    assert_eq!((elevator[0], elevator[777]), (1318.0, 1179.0));
    // What a campaign begins with has what ROS prescribes a unit for, and is read as it stands.
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("campaign");
    let said = starter::run(std::slice::from_ref(&path), &out).unwrap();
    assert!(said.contains("7 whose units are known are signals"), "{said}");
    let map = std::fs::read_to_string(out.join("channels.toml")).unwrap();
    let flight = read(&path, &map).unwrap();
    assert_eq!(flight.signals.len(), 7);
    assert_eq!(at(&flight.signals["pose_position_x"].series.value), at(&x.value));
}

#[test]
fn truth_logs_of_another_simulator_are_read() {
    let Some(path) = data("jsbsim/logs/flight_01.mcap") else { return };
    let survey = inspect::survey(&path).unwrap();
    let rates: Vec<(String, f64)> =
        survey.topics.iter().map(|t| (t.topic.clone(), libm::round(t.rate_hz))).collect();
    let expected = [
        ("/air_data", 50.0),
        ("/attitude", 50.0),
        ("/engine", 20.0),
        ("/imu", 100.0),
        ("/mass", 1.0),
        ("/surfaces", 100.0),
    ];
    assert_eq!(rates, expected.map(|(t, r)| (t.to_string(), r)));
    assert!(survey.topics.iter().all(|t| t.decodable && !t.fields.is_empty()));
    // Every field of every topic, each once as a signal.
    let mut map = String::new();
    for (i, (t, f)) in
        survey.topics.iter().flat_map(|t| t.fields.iter().map(move |f| (t, f))).enumerate()
    {
        map += &format!(
            "[signal.s{i}]\ntopic = \"{}\"\nfield = \"{}\"\nunit = \"{}\"\n",
            t.topic, f.info.path, f.info.unit
        );
    }
    let flight = read(&path, &map).unwrap();
    for (s, f) in flight.signals.values().zip(survey.topics.iter().flat_map(|t| &t.fields)) {
        assert_eq!(s.account.count, f.count - s.account.dropped_duplicate);
        assert_eq!((s.account.min, s.account.max), (f.min, f.max));
    }
}

#[test]
fn the_starter_folder_is_accepted_but_for_the_open_entries() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("logs/a.mcap");
    let mut log = LogWriter::create(&path).unwrap();
    let air = log
        .add_topic(
            "/air",
            &[
                FieldSpec::new("tas", "kt", "True airspeed"),
                FieldSpec::new("alpha", "", ""),
                FieldSpec::new("odd \"name\"", "", ""),
            ],
        )
        .unwrap();
    for i in 0..100 {
        log.write(air, START + i * 20 * MS, START + i * 20 * MS, &[200.0, 3.0, 1.0]).unwrap();
    }
    log.finish().unwrap();
    let out = folder.path().join("campaign");
    let said = starter::run(std::slice::from_ref(&path), &out).unwrap();
    assert!(
        said.contains("Recognised by name: V, alpha_vane (of 3 fields)")
            && said.contains("the units marked \"?\" (1)"),
        "{said}"
    );
    let text = std::fs::read_to_string(out.join("channels.toml")).unwrap();
    // which of the times it took is said
    let said = "# The time of a sample: when the recorder received a message; the logs have no other publish times.\n[defaults]\ntime = \"log\"\n";
    assert!(text.contains(said), "{text}");
    let open = read(&path, &text).unwrap_err();
    assert_eq!(open.lines().filter(|l| l.starts_with("channels.toml:")).count(), 1, "{open}");
    // Completed, and with every commented field taken in, it reads the log.
    let all: String = text
        .replace("\"?\"", "\"1\"")
        .split_inclusive("---\n")
        .enumerate()
        .map(|(i, part)| {
            if i == 0 {
                part.to_string()
            } else {
                part.replace("# [", "[")
                    .replace("# topic", "topic")
                    .replace("# field", "field")
                    .replace("# unit", "unit")
                    .replace("# doc", "doc")
            }
        })
        .collect();
    let flight = read(&path, &all).unwrap();
    assert_eq!(flight.signals.len(), 3, "{all}");
    let pipeline = std::fs::read_to_string(out.join("pipeline.toml")).unwrap();
    let pipeline: toml::Table = pipeline.parse().unwrap();
    assert_eq!(pipeline["logs"].as_array().unwrap()[0].as_str(), Some("../logs/a.mcap"));
    assert_eq!(pipeline["derive"]["rate_hz"].as_float(), Some(50.0));
    assert!(starter::run(&[path], &out).unwrap_err().to_string().contains("is there already"));
}

/// A log whose schema says kt, deg, nothing and something unknown; and one without a schema.
fn stated(folder: &Path) -> PathBuf {
    let path = folder.join("stated.mcap");
    let mut log = LogWriter::create(&path).unwrap();
    let fields = [("tas", "knots"), ("alpha", "deg"), ("plain", ""), ("odd", "furlong")];
    let air =
        log.add_topic("/air", &fields.map(|(name, unit)| FieldSpec::new(name, unit, ""))).unwrap();
    for i in 0..100 {
        log.write(air, START + i * 20 * MS, START + i * 20 * MS, &[200.0, 3.0, 1.0, 2.0]).unwrap();
    }
    log.finish().unwrap();
    path
}

fn looked(path: &Path, channels: &str) -> Look {
    let (map, doc) = config::parse::<ChannelMap>("channels.toml", channels).unwrap();
    map.check(&doc).unwrap();
    look(path, &map, &doc).unwrap()
}

fn one(field: &str, unit: &str) -> String {
    format!("[signal.{field}]\ntopic = \"/air\"\nfield = \"{field}\"\nunit = {unit}\n")
}

#[test]
fn fault_a_unit_that_is_not_the_logs_is_refused_unless_it_says_despite() {
    let folder = tempfile::tempdir().unwrap();
    let path = stated(folder.path());
    // another scale, another dimension: refused when the flight is read, and when the summary is
    // looked at
    for (map, wanted) in [
        (
            one("tas", "\"m/s\""),
            "signal \"tas\" is read in \"m/s\", but field \"tas\" of topic \"/air\" is in \"knots\" by the schema of stated.mcap",
        ),
        (one("alpha", "\"K\""), "is in \"deg\", another quantity"),
        (one("tas", "\"m/s\"\ndespite = \"km/h\""), "despite = \"knots\""),
    ] {
        let e = read(&path, &map).unwrap_err();
        assert!(e.starts_with("channels.toml:4:8: ") && e.contains(wanted), "{e}");
        let look = looked(&path, &map);
        assert_eq!(
            look.mistakes.iter().map(|m| m.of("stated.mcap").to_string()).collect::<Vec<_>>(),
            [e]
        );
    }
    // synonyms, no statement, a wrong statement
    let good = [
        one("tas", "\"kt\""),
        one("alpha", "\"degrees\""),
        one("plain", "\"ft/min\""),
        one("odd", "\"m\"\ndespite = \"furlong\""),
    ];
    assert_eq!(looked(&path, &good.concat()), Look { summary: true, ..Look::default() });
    assert!(read(&path, &good.concat()).unwrap().notes.is_empty());
    let despite = read(&path, &one("tas", "\"m/s\"\ndespite = \"kt\"")).unwrap();
    assert_eq!(despite.signals["tas"].series.value[0], 200.0);
    // what cannot be compared is said
    let odd = looked(&path, &one("odd", "\"m\""));
    assert_eq!((odd.mistakes.len(), odd.remarks.len()), (0, 1));
    assert!(read(&path, &one("odd", "\"m\"")).unwrap().notes[0].text.contains("no known unit"));
    let (map, doc) =
        config::parse::<ChannelMap>("channels.toml", &one("tas", "\"kt\"\ndespite = \"kt\""))
            .unwrap();
    assert!(map.check(&doc).is_err());
}

#[test]
fn fault_a_look_at_the_summary_names_all_that_is_not_there_and_the_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let path = stated(folder.path());
    let map = "[defaults]\ntime = \"stamp\"\ntime_unit = \"s\"\n".to_string()
        + &one("tas", "\"m/s\"")
        + &one("alfa", "\"deg\"")
        + "[signal.q]\ntopic = \"/air_\"\nfield = \"q\"\nunit = \"deg/s\"\n";
    let look = looked(&path, &map);
    let said: Vec<String> = look.mistakes.iter().map(|m| m.of("stated.mcap").to_string()).collect();
    let wanted = ["\"knots\"", "it has \"alpha\"", "field \"stamp\"", "it has \"/air\""];
    assert!(
        said.len() == 4 && wanted.iter().all(|w| said.iter().any(|s| s.contains(w))),
        "{said:?}"
    );
    // a schema that does not name a field does not say that it is not there
    let bare = folder.path().join("bare.mcap");
    let mut messages = regular(50);
    messages[49].3 = "{\"x\":1,\"z\":2}".into();
    raw(&bare, "json", &messages, 300);
    let of = |field: &str| {
        looked(&bare, &one_signal("log").replace("\"x\"", &format!("\"{field}\""))).mistakes.len()
    };
    assert_eq!(["x", "y", "z", "w"].map(of), [0, 0, 0, 1]);
    // nor does a log that was cut off
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 40]).unwrap();
    assert_eq!(looked(&path, &map), Look::default());
}

#[test]
fn every_shipped_channel_map_is_sound() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let maps = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path().join("channels.toml"))
        .filter(|p| p.exists());
    let mut checked = 0;
    for path in maps {
        let (map, doc) = config::load::<ChannelMap>(&path).map_err(|e| e.to_string()).unwrap();
        map.check(&doc).map_err(|e| e.to_string()).unwrap();
        assert!(
            map.signal.values().all(|s| !s.doc.is_empty()),
            "{}: a signal without doc",
            path.display()
        );
        checked += 1;
    }
    assert!(checked > 0);
}

#[test]
fn text_columns_are_imported_with_their_units() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(
        at("a.csv"),
        "# a header\ntime,alpha,V\n0.00,1.5,100\n0.10,,101\n0.20,nan,102.25\n",
    )
    .unwrap();
    let description = r#"
input = ["nowhere.csv", "$KOEHLER_SURELY_NOT_SET/a.csv", "a.csv"]
output = "logs/a.mcap"
separator = "comma"
header_lines = 2
time = { column = "time", unit = "s", start_s = 1000 }
[[topic]]
name = "/air"
fields = [{ column = "V", name = "tas", unit = "kt", doc = "True airspeed" }, { column = 2, name = "alpha", unit = "deg" }]
"#;
    std::fs::write(at("import.toml"), description).unwrap();
    let done = import::run(&at("import.toml"), None, false).unwrap().0.remove(0);
    assert_eq!((done.rows, done.topics, done.fields), (3, 1, 2));
    let map = "[signal.V]\ntopic = \"/air\"\nfield = \"tas\"\nunit = \"m/s\"\ndespite = \"kt\"\n[signal.alpha]\ntopic = \"/air\"\nfield = \"alpha\"\nunit = \"deg\"\n";
    let flight = read(&done.output, map).unwrap();
    assert_eq!(flight.start_ns, 1_000_000_000_000);
    assert_eq!(
        flight.signals["V"].series,
        Series { t_s: vec![0.0, 0.1, 0.2], value: vec![100.0, 101.0, 102.25] }
    );
    assert_eq!(
        (flight.signals["alpha"].account.count, flight.signals["alpha"].account.dropped_nan),
        (1, 2)
    );

    std::fs::write(at("a.csv"), "x\ntime,alpha,V\n0.00,1.5,100\n0.1O,1,101\n0.20,2\n").unwrap();
    let e = import::run(&at("import.toml"), None, false).unwrap().1.to_string();
    assert!(
        e.contains("a.csv:4:1: column 1: \"0.1O\" is no number")
            && e.contains("a.csv:5:7: column 3 is wanted, the row has 2"),
        "{e}"
    );
    std::fs::write(
        at("import.toml"),
        description.replace("\"a.csv\"]", "\"b.csv\"]").replace("\"alpha\"", "\"tas\""),
    )
    .unwrap();
    let e = import::run(&at("import.toml"), None, false).unwrap_err().to_string();
    assert!(e.contains("topic \"/air\" has two fields \"tas\""), "{e}");
}

#[test]
fn truth_the_hfb320_record_is_imported_unchanged() {
    let Some(input) = data("hfb320/hfb320_1_10.asc") else { return };
    let folder = tempfile::tempdir().unwrap();
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/hfb320");
    // The description as shipped, but for the place of the data.
    let text = std::fs::read_to_string(pipeline.join("import.toml")).unwrap();
    let description = folder.path().join("import.toml");
    std::fs::write(&description, text.replace("data/hfb320_1_10.asc", &input.to_string_lossy()))
        .unwrap();
    let done = import::run(&description, None, false).unwrap().0.remove(0);
    assert_eq!((done.rows, done.fields), (601, 19));
    let channels = std::fs::read_to_string(pipeline.join("channels.toml")).unwrap();
    let flight = read(&done.output, &channels).unwrap();
    let columns = [
        "", "de", "qbar", "thrust", "V", "alpha", "theta", "q", "qdot", "ax", "az", "ay", "p", "r",
        "pdot", "rdot", "beta", "phi", "da", "dr",
    ];
    for (row, line) in std::fs::read_to_string(&input).unwrap().lines().enumerate() {
        let cells: Vec<f64> = line.split_whitespace().map(|c| c.parse().unwrap()).collect();
        for (value, name) in cells.iter().zip(columns).skip(1) {
            let series = &flight.signals[name].series;
            assert_eq!(
                (series.t_s[row], series.value[row]),
                (cells[0], *value),
                "{name} row {row}"
            );
        }
    }
}

#[test]
fn a_message_from_another_year_moves_no_other_sample() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut messages = regular(400);
    messages[200].1 -= 365 * 86_400_000 * MS;
    raw(&path, "json", &messages, 2000);
    let flight = read(&path, &one_signal("log")).unwrap();
    let x = &flight.signals["x"];
    assert_eq!((flight.start_ns, x.account.dropped_times, x.account.count), (START, 1, 399));
    assert!(x.series.t_s.iter().zip(&x.series.value).all(|(t, x)| (t * 100.0 - x).abs() < 1e-6));
    assert!(texts(&flight).iter().any(|text| text.contains("more than a day")));
}
