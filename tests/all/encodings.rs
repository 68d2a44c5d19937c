//! The same messages in JSON, ROS 2 and protobuf, written by other programs
//! (`scripts/encoding_logs.py`): the same signals, value for value.

use koehler::config;
use koehler::log::inspect::survey;
use koehler::log::{ChannelMap, FlightLog, read_flight};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn log(encoding: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/logs").join(format!("{encoding}.mcap"))
}

/// Every field that any message of the JSON log has, with its topic.
fn all_fields() -> BTreeSet<(String, String)> {
    let numbers = |value: &serde_json::Value| {
        fn walk(value: &serde_json::Value, path: String, out: &mut Vec<String>) {
            let below =
                |name: &str| if path.is_empty() { name.into() } else { format!("{path}.{name}") };
            match value {
                serde_json::Value::Object(map) => {
                    map.iter().for_each(|(k, v)| walk(v, below(k), out))
                }
                serde_json::Value::Array(list) => {
                    list.iter().enumerate().for_each(|(i, v)| walk(v, below(&i.to_string()), out));
                }
                serde_json::Value::String(_) => {}
                _ => out.push(path),
            }
        }
        let mut out = Vec::new();
        walk(value, String::new(), &mut out);
        out
    };
    let bytes = std::fs::read(log("json")).expect("a log of the project");
    let mut fields = BTreeSet::new();
    for message in mcap::MessageStream::new(&bytes).expect("a sound log") {
        let message = message.expect("a sound message");
        // Python writes NaN and Infinity, which are no JSON.
        let text = String::from_utf8_lossy(&message.data)
            .replace("-Infinity", "0")
            .replace("Infinity", "0");
        let value = serde_json::from_str(&text.replace("NaN", "0")).expect("JSON");
        fields
            .extend(numbers(&value).into_iter().map(|path| (message.channel.topic.clone(), path)));
    }
    fields
}

fn read(encoding: &str, map: &str) -> FlightLog {
    let (map, doc) = config::parse::<ChannelMap>("channels.toml", map).expect("a sound map");
    read_flight(&log(encoding), &map, &doc).unwrap_or_else(|e| panic!("{encoding}: {e}"))
}

#[test]
fn logs_of_other_writers_give_the_signals_of_the_same_content_in_json() {
    let fields = all_fields();
    assert_eq!(fields.len(), 44, "{fields:?}");
    let signal = |(i, (topic, field)): (usize, &(String, String))| {
        let time = if topic == "/imu" { "header.stamp" } else { "publish" };
        format!(
            "[signal.s{i}]\ntopic = \"{topic}\"\nfield = \"{field}\"\nunit = \"1\"\ntime = \"{time}\"\n"
        )
    };
    let map: String = fields.iter().enumerate().map(signal).collect();
    let json = read("json", &map);
    let samples: u64 = json.signals.values().map(|s| s.account.count).sum();
    assert!(samples > 8000, "{samples}");
    assert!(json.signals.values().any(|s| s.account.dropped_nan == 3));
    assert!(json.signals.values().any(|s| s.account.dropped_unreadable == 150));
    for encoding in ["ros2", "protobuf"] {
        let other = read(encoding, &map);
        assert_eq!(other.start_ns, json.start_ns);
        for ((topic, field), (a, b)) in
            fields.iter().zip(json.signals.values().zip(other.signals.values()))
        {
            assert_eq!(a.series, b.series, "{encoding} {topic} {field}");
            assert_eq!(a.account, b.account, "{encoding} {topic} {field}");
        }
        assert_eq!(other.notes, json.notes, "{encoding}");
    }
}

#[test]
fn a_look_at_a_log_counts_the_same_in_every_encoding() {
    let [json, ros2, protobuf] =
        ["json", "ros2", "protobuf"].map(|e| survey(&log(e)).unwrap_or_else(|e| panic!("{e}")));
    let fields = all_fields();
    for other in [&ros2, &protobuf] {
        assert_eq!(
            (other.messages, other.start_ns, &other.notes),
            (json.messages, json.start_ns, &json.notes)
        );
        for (a, b) in json.topics.iter().zip(&other.topics) {
            assert_eq!((&a.topic, a.messages, a.gaps), (&b.topic, b.messages, b.gaps));
            // An empty text counts as a missing number in JSON; other encodings know texts.
            let numbers = |path: &str| fields.contains(&(a.topic.clone(), path.to_string()));
            for field in a.fields.iter().filter(|f| numbers(&f.info.path)) {
                let same = b.fields.iter().find(|f| f.info.path == field.info.path);
                let same =
                    same.unwrap_or_else(|| panic!("{} {}", b.message_encoding, field.info.path));
                let counts = |f: &koehler::log::inspect::FieldSurvey| {
                    (f.count, f.nan, f.unreadable, f.min, f.max)
                };
                assert_eq!(
                    counts(field),
                    counts(same),
                    "{} {}",
                    b.message_encoding,
                    field.info.path
                );
            }
        }
    }
}
