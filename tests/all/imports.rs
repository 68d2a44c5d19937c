//! Files of other programs become logs: every kind, several clocks, whole folders; and nothing is
//! written over that is not ours.

use crate::campaign::Campaign;
use crate::flightdata::data;
use koehler::log::import::run;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// A folder with an `import.toml`.
struct Import(TempDir);

impl Import {
    fn new(description: &str) -> Import {
        let import = Import(tempfile::tempdir().expect("a temporary folder"));
        import.put("import.toml", description);
        import
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::create_dir_all(self.at(name).parent().expect("a parent")).expect("made");
        std::fs::write(self.at(name), bytes).expect("written");
    }

    /// `koehler import import.toml ARGS`: exit code, standard output, standard error.
    fn koehler(&self, args: &[&str]) -> (i32, String, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_koehler"))
            .current_dir(self.0.path())
            .args(["import", "import.toml"])
            .args(args)
            .output()
            .expect("started");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        (output.status.code().expect("ended"), text(output.stdout), text(output.stderr))
    }

    fn fine(&self, args: &[&str]) -> String {
        let (code, out, err) = self.koehler(args);
        assert_eq!(code, 0, "{err}");
        out + &err
    }

    fn refused(&self, args: &[&str], words: &[&str]) {
        let (code, _, err) = self.koehler(args);
        assert_eq!(code, 2, "{err}");
        for word in words {
            assert!(err.contains(word), "{word:?} is not in\n{err}");
        }
    }

    /// The messages of a topic: stamp in ns, and text.
    fn messages(&self, log: &str, topic: &str) -> Vec<(u64, String)> {
        let bytes = std::fs::read(self.at(log)).expect("a log");
        mcap::MessageStream::new(&bytes)
            .expect("an MCAP")
            .map(|m| m.expect("a message"))
            .filter(|m| m.channel.topic == topic)
            .map(|m| (m.publish_time, String::from_utf8_lossy(&m.data).into_owned()))
            .collect()
    }
}

fn told(message: &(u64, String)) -> (u64, &str) {
    (message.0, message.1.as_str())
}

const CSV: &str = "separator = \"comma\"\nheader_lines = 1\ntime = { column = \"t\", unit = \"s\" }\n[[topic]]\nname = \"/x\"\nfields = [{ column = \"x\", name = \"x\", unit = \"1\" }]\n";

#[test]
fn an_input_is_never_written_over_and_a_foreign_file_only_with_force() {
    let of = |output: &str| format!("input = [\"a.csv\"]\noutput = \"{output}\"\n{CSV}");
    let import = Import::new(&of("a.mcap"));
    import.put("a.csv", "t,x\n0,1\n1,2\n");
    import.fine(&[]);
    // Our own log is written again.
    import.fine(&[]);
    let log = std::fs::read(import.at("a.mcap")).expect("a log");
    import.put("taken.mcap", "somebody's");
    let words = ["taken.mcap: the file is there and is not ours: it is no MCAP log", "--force"];
    import.refused(&["--out", "taken.mcap"], &words);
    assert_eq!(std::fs::read(import.at("taken.mcap")).expect("readable"), b"somebody's");
    import.fine(&["--out", "taken.mcap", "--force"]);
    assert_eq!(std::fs::read(import.at("taken.mcap")).expect("readable"), log);

    let mut other = mcap::WriteOptions::new()
        .library("px4")
        .create(std::io::BufWriter::new(
            std::fs::File::create(import.at("px4.mcap")).expect("made"),
        ))
        .expect("made");
    other.finish().expect("finished");
    import.refused(&["--out", "px4.mcap"], &["a log written by \"px4\""]);

    for output in ["a.csv", "./a.csv", "import.toml"] {
        import.refused(&["--out", output, "--force"], &["over its own input", "never"]);
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(import.at("a.csv"), import.at("link.mcap")).expect("linked");
        import.refused(&["--out", "link.mcap", "--force"], &["over its own input"]);
    }
    assert_eq!(std::fs::read(import.at("a.csv")).expect("readable"), b"t,x\n0,1\n1,2\n");
}

#[test]
fn fault_an_import_that_fails_says_that_the_log_of_an_earlier_one_stays() {
    let import = Import::new(&format!("input = [\"a.csv\"]\noutput = \"a.mcap\"\n{CSV}"));
    let stays = "a.mcap is still that of an earlier import: what reads it reads the old log";
    import.put("a.csv", "t,x\n0,1\n1,two\n");
    let (code, _, err) = import.koehler(&[]);
    assert!(code == 2 && !err.contains(stays), "there is none yet: {err}");
    import.put("a.csv", "t,x\n0,1\n1,2\n");
    import.fine(&[]);
    let log = std::fs::read(import.at("a.mcap")).expect("a log");
    for (text, why) in [("t,x\n0,1\n1,two\n", "\"two\" is no number"), ("", "the file is empty")] {
        import.put("a.csv", text);
        import.refused(&[], &[why, stays]);
        assert_eq!(std::fs::read(import.at("a.mcap")).expect("a log"), log);
    }
}

#[test]
fn fault_a_name_of_a_column_in_another_unit_is_refused() {
    let of = |more: &str| {
        format!(
            "input = [\"a.csv\"]\noutput = \"a.mcap\"\nseparator = \"comma\"\nheader_lines = 1\ntime = {{ column = \"t [s]\", unit = \"s\" }}\n[[topic]]\nname = \"/x\"\nfields = [{{ column = \"alpha [deg]\", name = \"alpha\", unit = \"rad\"{more} }}]\n"
        )
    };
    let import = Import::new(&of(""));
    import.put("a.csv", "t [s],alpha [deg]\n0,1\n1,2\n");
    let words = [
        "import.toml:8:",
        "column \"alpha [deg]\" is in \"deg\" by the header, but unit = \"rad\"",
    ];
    import.refused(&[], &words);
    import.put("import.toml", of(", despite = \"deg\""));
    import.fine(&[]);
}

#[test]
fn a_run_takes_no_folder_of_others_without_force() {
    let c = Campaign::new();
    std::fs::create_dir_all(c.path("data/signals/flight=a")).expect("made");
    c.write("data/signals/flight=a/part-0.parquet", "somebody's");
    let said = c.koehler("run", &["--out", "data"]).ended(2);
    for word in
        ["data: the folder is there and is no output folder of ours: it has \"signals\"", "--force"]
    {
        assert!(said.err.contains(word), "{}", said.err);
    }
    assert!(c.path("data/signals/flight=a/part-0.parquet").exists());
    assert!(!c.path("data/.koehler").exists());
    c.koehler("diagnose", &["--out", "data"]).ended(2);
    c.koehler("run", &["--out", "data", "--force"]).ended(0);
    // Now it is ours, and so is a folder in which there are only such.
    c.koehler("run", &["--out", "data"]).ended(0);
    std::fs::create_dir(c.path("all")).expect("made");
    std::fs::rename(c.path("data"), c.path("all/data")).expect("moved");
    c.koehler("run", &["--out", "all"]).ended(0);
}

#[test]
fn schemas_are_written_over_schemas_only() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let schema = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_koehler"));
        command.current_dir(folder.path()).args(["schema", "--out", "."]).args(args);
        let output = command.output().expect("started");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(schema(&[]).0, Some(0));
    assert_eq!(schema(&[]).0, Some(0), "again");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.schema.json"), "{\"title\": \"mine\"}").expect("written");
    std::fs::copy(at("channels.schema.json"), at("design.schema.json")).expect("copied");
    let (code, err) = schema(&[]);
    assert_eq!(code, Some(2), "{err}");
    for word in [
        "model.schema.json: the file is there and is not ours: it is no JSON Schema",
        "design.schema.json",
        "the schema \"Channel map\"",
        "2 errors",
    ] {
        assert!(err.contains(word), "{word:?} is not in\n{err}");
    }
    assert_eq!(std::fs::read(at("model.schema.json")).expect("readable"), b"{\"title\": \"mine\"}");
    assert_eq!(schema(&["--force"]).0, Some(0));
}

/// A log that PX4 wrote.
fn px4() -> Option<PathBuf> {
    const LOG: &str = "logs/foxglove_test_ulog.ulg";
    data(LOG).map(|folder| folder.join(LOG))
}

const PX4: &str = r#"
output = "px4.mcap"
[[topic]]
name = "/attitude"
from = "vehicle_attitude"
fields = [{ column = "q[0]", name = "w", unit = "1" }, { column = "q[3]", name = "z", unit = "1" }]
[[topic]]
name = "/second"
from = "estimator_attitude"
instance = 1
time = { column = "timestamp_sample", start_s = 1000 }
fields = [{ column = "q[0]", name = "w", unit = "1" }]
[[topic]]
name = "/waypoint"
from = "position_setpoint_triplet"
fields = [{ column = "current.yaw", name = "yaw", unit = "rad" }, { column = "current.valid", name = "valid", unit = "1" }]
"#;

/// The numbers are those that pyulog 1.3 reads from the file.
#[test]
fn truth_a_px4_log_is_imported_unchanged() {
    let Some(log) = px4() else { return };
    let of = |text: &str| format!("input = [\"{}\"]\n{text}", log.display());
    let import = Import::new(&of(PX4));
    let said = import.fine(&[]);
    assert!(said.contains("145 messages, 5 fields in 3 topics"), "{said}");
    let attitude = import.messages("px4.mcap", "/attitude");
    assert_eq!(attitude.len(), 131);
    assert_eq!(
        told(&attitude[0]),
        (27_330_143_000, r#"{"w":0.5250792503356934,"z":-0.8484782576560974}"#)
    );
    assert_eq!(
        told(&attitude[130]),
        (33_785_030_000, r#"{"w":0.9864653944969177,"z":0.05653127282857895}"#)
    );
    let second = import.messages("px4.mcap", "/second");
    assert_eq!((second.len(), second[0].1.as_str()), (13, r#"{"w":0.4369679391384125}"#));
    assert_eq!(second[12].1, r#"{"w":0.9862273335456848}"#);
    assert!((1_027_000_000_000..1_028_000_000_000).contains(&second[0].0), "{}", second[0].0);
    assert_eq!(
        told(&import.messages("px4.mcap", "/waypoint")[0]),
        (26_199_036_000, r#"{"yaw":0.0,"valid":0.0}"#)
    );

    // All that is not there is told at once, with what is.
    import.put(
        "import.toml",
        of(&PX4.replace("q[3]", "q[4]").replace("instance = 1", "instance = 2")),
    );
    import.refused(
        &[],
        &[
            "import.toml:",
            "\"vehicle_attitude\" has no field \"q[4]\"; it has \"q[",
            "no message \"estimator_attitude\" of instance 2",
            "\"estimator_attitude 1\"",
        ],
    );
}

#[test]
fn fault_a_cut_px4_log_is_read_as_far_as_it_goes_and_a_damaged_one_has_a_place() {
    let Some(log) = px4() else { return };
    let import = Import::new(&format!("input = [\"a.ulg\"]\n{PX4}"));
    let whole = std::fs::read(log).expect("the log");
    import.put("a.ulg", &whole[..357_240]);
    let said = import.fine(&[]);
    assert!(said.contains("a.ulg: it ends inside a record at byte 357233"), "{said}");
    assert_eq!(import.messages("px4.mcap", "/attitude").len(), 131);
    let mut damaged = whole.clone();
    damaged[112_291] += 1;
    import.put("a.ulg", &damaged);
    import.refused(&[], &["a.ulg: damaged at byte 112291: data message had wrong size"]);
    import.put("a.ulg", &whole[..10]);
    import.refused(&[], &["a.ulg: damaged at byte 10: it ends inside its header"]);
    // A text file is no ULog.
    import.put("a.ulg", "t,x\n0,1\n");
    import.refused(&[], &["a.ulg is no ULog"]);
}

/// A ULog of two messages with a nested one, and one that is saved behind the others.
fn ulog(appended: bool) -> Vec<u8> {
    let record =
        |kind: u8, body: &[u8]| [&(body.len() as u16).to_le_bytes()[..], &[kind], body].concat();
    let message = |us: u64, x: f32, n: i16| {
        let body = [&[7, 0][..], &us.to_le_bytes(), &x.to_le_bytes(), &n.to_le_bytes()].concat();
        record(b'D', &body)
    };
    let mut log = b"ULog\x01\x12\x35\x01".to_vec();
    log.extend(0u64.to_le_bytes());
    let flags_at = log.len() + 3;
    log.extend(record(b'B', &[0; 40]));
    log.extend(record(b'F', b"inner:int16_t n;"));
    log.extend(record(b'F', b"outer:uint64_t timestamp;float x;inner[1] in;uint8_t _padding0;"));
    log.extend(record(b'P', b"\x07float a\0\0\0\0"));
    log.extend(record(b'A', b"\x00\x07\x00outer"));
    log.extend(message(1_000_001, 0.5, -3));
    log.extend(record(b'O', &[40, 0]));
    let more = log.len() as u64;
    log.extend(message(u64::from(u32::MAX) << 20, 1.5, 4));
    if appended {
        log[flags_at + 8] = 1;
        // A crash has cut the record before the appended data.
        log.extend_from_slice(&[9, 0, b'D', 1]);
        let at = log.len() as u64;
        log.extend(message(3_000_000, 2.5, 5));
        assert!(more < at);
        log[flags_at + 16..flags_at + 24].copy_from_slice(&at.to_le_bytes());
    }
    log
}

const OUTER: &str = "input = [\"a.ulg\"]\noutput = \"a.mcap\"\n[[topic]]\nname = \"/o\"\nfrom = \"outer\"\nfields = [{ column = \"in[0].n\", name = \"n\", unit = \"1\" }, { column = \"x\", name = \"x\", unit = \"1\" }]\n";

#[test]
fn messages_keep_whole_microseconds_and_what_was_saved_after_a_crash_is_read() {
    let import = Import::new(OUTER);
    import.put("a.ulg", ulog(false));
    let said = import.fine(&[]);
    assert!(said.contains("a.ulg: 1 dropouts of the logger, 40 ms in all"), "{said}");
    let messages = import.messages("a.mcap", "/o");
    assert_eq!(told(&messages[0]), (1_000_001_000, r#"{"n":-3.0,"x":0.5}"#));
    assert_eq!(messages[1].0, (u64::from(u32::MAX) << 20) * 1000);
    import.put("a.ulg", ulog(true));
    import.fine(&[]);
    let messages = import.messages("a.mcap", "/o");
    assert!(
        messages.contains(&(3_000_000_000, r#"{"n":5.0,"x":2.5}"#.to_string())),
        "{messages:?}"
    );
}

#[test]
fn fault_no_damage_of_a_px4_log_is_a_panic() {
    let import = Import::new(OUTER);
    for whole in [ulog(false), ulog(true)] {
        for end in 0..whole.len() {
            import.put("a.ulg", &whole[..end]);
            let _ = run(&import.at("import.toml"), None, false);
        }
        for at in 0..whole.len() {
            for by in [0x01, 0x55, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] ^= by;
                import.put("a.ulg", damaged);
                let _ = run(&import.at("import.toml"), None, false);
            }
        }
    }
}

#[test]
fn the_description_of_messages_and_times_is_checked_at_once() {
    let import = Import::new(
        r#"
input = ["a.ulg"]
output = "a.mcap"
names = ["*", "b"]
time = { rate_hz = 0, unit = "m" }
[[topic]]
name = "/a"
from = "outer"
fields = [{ column = 3, name = "n", unit = "1" }]
[[topic]]
name = "/b"
instance = 1
time = { rate_hz = 5, column = "t", unit = "furlong" }
fields = [{ column = "c", matrix = "m", name = "n", unit = "1" }]
"#,
    );
    import.refused(
        &[],
        &[
            "several files are imported into one log",
            "\"*\" stands for all names",
            "needs {name} once in every `input`",
            "import.toml:5:20: messages bear their own time",
            "a rate in Hz needs no unit",
            "fields of messages have names",
            "topic \"/b\" does not say which messages",
            "there is no `from`",
            "there is a column of time as well",
            "columns of a matrix have numbers",
        ],
    );
    import.put(
        "import.toml",
        "input = [\"a\"]\noutput = \"b\"\n[[topic]]\nname = \"/a\"\nfields = []\n",
    );
    import.refused(&[], &["nothing says what the time of the rows is", "rate_hz"]);
}

#[test]
fn several_clocks_write_into_one_text_file() {
    let import = Import::new(
        r#"
input = ["a.csv"]
output = "a.mcap"
separator = "comma"
header_lines = 1
time = { column = "t", unit = "s" }
[[topic]]
name = "/air"
fields = [{ column = "V", name = "V", unit = "m/s" }]
[[topic]]
name = "/gps"
time = { column = "gps_ms", unit = "ms", start_s = 100 }
fields = [{ column = "lat", name = "lat", unit = "deg" }]
"#,
    );
    import.put("a.csv", "t,V,gps_ms,lat\n0.0,50,500,48.1\n0.1,51,,\n0.2,52,,48.3\n0.3,53,700,\n");
    let said = import.fine(&[]);
    assert!(said.contains("6 messages, 2 fields in 2 topics"), "{said}");
    assert!(said.contains("topic /gps: 1 rows with values and no time, left out"), "{said}");
    let gps = import.messages("a.mcap", "/gps");
    assert_eq!(
        gps,
        [
            (100_500_000_000, r#"{"lat":48.1}"#.to_string()),
            (100_700_000_000, r#"{"lat":null}"#.to_string())
        ]
    );
    assert_eq!(import.messages("a.mcap", "/air").len(), 4);
    // The time of all topics may not be missing.
    import.put("a.csv", "t,V,gps_ms,lat\n,50,500,48.1\n0.1,51,,\n");
    import.refused(&[], &["a.csv:2:1: the time is negative, not a number"]);
    import.put("a.csv", "t,V,gps_ms,lat\n0,50,,\n");
    import.refused(&[], &["no row of data for topic \"/gps\""]);
}

/// A MAT file of these matrices: name, rows, values column by column.
fn mat(variables: &[(&'static str, usize, Vec<f64>)]) -> Vec<u8> {
    let of = |(name, rows, values): &(&'static str, usize, Vec<f64>)| {
        (*name, *rows, 9, values.iter().map(|v| v.to_le_bytes()).collect())
    };
    mat_of(&variables.iter().map(of).collect::<Vec<_>>())
}

/// Name, rows, the type of the numbers, and these, column by column.
type Matrix = (&'static str, usize, u32, Vec<[u8; 8]>);

/// A MAT file of these matrices.
fn mat_of(variables: &[Matrix]) -> Vec<u8> {
    let element = |kind: u32, data: &[u8]| {
        let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let mut out = b"MATLAB 5.0 MAT-file".to_vec();
    out.resize(124, b' ');
    out.extend([0, 1, b'I', b'M']);
    for (name, rows, kind, numbers) in variables {
        let columns = numbers.len() / rows;
        let size = [(*rows as u32).to_le_bytes(), (columns as u32).to_le_bytes()].concat();
        let all = [
            element(6, &[6, 0, 0, 0, 0, 0, 0, 0]),
            element(5, &size),
            element(1, name.as_bytes()),
            element(*kind, &numbers.concat()),
        ];
        out.extend(element(14, &all.concat()));
    }
    out
}

const MAT: &str = r#"
input = ["a.mat"]
output = "a.mcap"
time = { column = "t", unit = "s" }
[[topic]]
name = "/rates"
fields = [{ column = "q", name = "q", unit = "deg/s" }, { column = 2, matrix = "X", name = "p", unit = "deg/s" }]
[[topic]]
name = "/slow"
time = { rate_hz = 50, start_s = 10 }
fields = [{ column = "z", name = "z", unit = "m" }]
"#;

#[test]
fn a_mat_file_has_several_matrices_vectors_and_no_column_of_time() {
    let import = Import::new(MAT);
    let variables = |n: usize| {
        let count = |from: f64, n: usize| (0..n).map(|i| from + i as f64).collect::<Vec<f64>>();
        // `q` lies, `t` stands; `X` has two columns.
        mat(&[
            ("t", 3, vec![0.0, 0.5, 1.0]),
            ("q", 1, count(1.0, n)),
            ("X", 3, count(10.0, 6)),
            ("z", 4, count(7.0, 4)),
        ])
    };
    import.put("a.mat", variables(3));
    let said = import.fine(&[]);
    assert!(said.contains("7 messages, 3 fields in 2 topics"), "{said}");
    let rates = import.messages("a.mcap", "/rates");
    assert_eq!(told(&rates[2]), (1_000_000_000, r#"{"q":3.0,"p":15.0}"#));
    let slow = import.messages("a.mcap", "/slow");
    assert_eq!(told(&slow[3]), (10_060_000_000, r#"{"z":10.0}"#));

    import.put("a.mat", variables(2));
    import.refused(&[], &["a.mat: topic \"/rates\" has columns of different lengths: \"t\" has 3 values, \"q\" has 2"]);
    import.put("a.mat", variables(3));
    import.put(
        "import.toml",
        MAT.replace("\"q\", name", "\"X\", name")
            .replace("matrix = \"X\"", "matrix = \"Y\"")
            .replace("\"z\", name", "2, name"),
    );
    import.refused(
        &[],
        &[
            "X is a matrix of 3 x 2: say which column",
            "there is no numeric matrix \"Y\"; the file has t (3 x 1), q (1 x 3), X (3 x 2), z (4 x 1)",
            "the file has several matrices, name one as `matrix`",
        ],
    );
    import.put("import.toml", MAT.replace(", unit = \"s\" }", " }"));
    import.refused(&[], &["\"t\" has numbers: their unit is not said"]);
    import.put("a.mat", [&b"MATLAB 7.3 MAT-file"[..], &[0; 200]].concat());
    import.refused(&[], &["MAT file of version 7.3", "-v7"]);
}

#[test]
fn whole_ns_of_a_mat_file_keep_all_their_digits_and_lost_digits_are_told() {
    let import = Import::new(
        r#"
input = ["a.mat"]
output = "a.mcap"
missing = ["-9007199254740993"]
time = { column = "t", unit = "ns" }
[[topic]]
name = "/air"
fields = [{ column = 1, matrix = "n", name = "n", unit = "1" }]
[[topic]]
name = "/again"
time = { column = 2, matrix = "T", unit = "ns" }
fields = [{ column = "x", name = "x", unit = "1" }]
"#,
    );
    let t = 1_700_000_000_123_456_789u64;
    let whole = |all: &[u64]| all.iter().map(|n| n.to_le_bytes()).collect::<Vec<_>>();
    let n = [7, (1 << 53) + 1, 0u64.wrapping_sub((1 << 53) + 1)];
    import.put(
        "a.mat",
        mat_of(&[
            ("t", 3, 12, whole(&[t, t + 1, t + 4])),
            ("T", 3, 13, whole(&[0, 0, 0, t + 2, t + 3, t + 5])),
            ("n", 3, 12, whole(&n)),
            ("x", 3, 9, [1.0f64, 2.0, 3.0].map(f64::to_le_bytes).to_vec()),
        ]),
    );
    let said = import.fine(&[]);
    let stamps = |topic: &str| {
        import.messages("a.mcap", topic).into_iter().map(|m| m.0).collect::<Vec<u64>>()
    };
    assert_eq!(stamps("/air"), [t, t + 1, t + 4]);
    assert_eq!(stamps("/again"), [t + 2, t + 3, t + 5]);
    // what stands for a missing value loses nothing
    let lost = "topic /air: 1 of 3 whole numbers of column 1 of \"n\" have more digits";
    assert!(said.contains(lost), "{said}");
    assert!(said.contains("first in row 2, 9007199254740992 for 9007199254740993"), "{said}");
}

#[test]
fn parquet_columns_with_nulls_and_timestamps_are_imported() {
    use arrow_array::*;
    use std::sync::Arc;
    let import = Import::new(
        r#"
input = ["a.parquet"]
output = "a.mcap"
time = { column = "when" }
[[topic]]
name = "/air"
fields = [{ column = "V", name = "V", unit = "m/s" }, { column = "gear", name = "gear", unit = "1" }, { column = 4, name = "n", unit = "1" }]
[[topic]]
name = "/slow"
time = { column = "t", unit = "s", start_s = 1700000000 }
fields = [{ column = "V", name = "V", unit = "m/s" }]
"#,
    );
    let stamps =
        TimestampMicrosecondArray::from(vec![1_700_000_000_000_001, 1_700_000_000_100_000]);
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("when", Arc::new(stamps.with_timezone("UTC"))),
        ("V", Arc::new(Float32Array::from(vec![Some(50.5), None]))),
        ("gear", Arc::new(BooleanArray::from(vec![true, false]))),
        ("n", Arc::new(UInt16Array::from(vec![7, 8]))),
        ("t", Arc::new(Float64Array::from(vec![None, Some(2.5)]))),
        ("who", Arc::new(StringArray::from(vec!["a", "b"]))),
    ];
    for packed in [parquet::basic::Compression::SNAPPY, parquet::basic::Compression::UNCOMPRESSED] {
        let batch = RecordBatch::try_from_iter(columns.clone()).expect("a batch");
        let how = parquet::file::properties::WriterProperties::builder().set_compression(packed);
        let mut writer =
            parquet::arrow::ArrowWriter::try_new(Vec::new(), batch.schema(), Some(how.build()))
                .expect("a writer");
        writer.write(&batch).expect("written");
        import.put("a.parquet", writer.into_inner().expect("finished"));
        import.fine(&[]);
        let air = import.messages("a.mcap", "/air");
        assert_eq!(told(&air[0]), (1_700_000_000_000_001_000, r#"{"V":50.5,"gear":1.0,"n":7.0}"#));
        assert_eq!(told(&air[1]), (1_700_000_000_100_000_000, r#"{"V":null,"gear":0.0,"n":8.0}"#));
        assert_eq!(
            import.messages("a.mcap", "/slow"),
            [(1_700_000_002_500_000_000, r#"{"V":null}"#.to_string())]
        );
    }
    // Topics that were never recorded together are on different clocks.
    let text = std::fs::read_to_string(import.at("import.toml")).expect("readable");
    import.put("import.toml", text.replace(", start_s = 1700000000", ""));
    import.refused(&[], &["topic \"/air\" begins at 1700000000 s since 1970", "19676 days before"]);
    import.put("import.toml", text);
    let text = std::fs::read_to_string(import.at("import.toml")).expect("readable");
    import.put(
        "import.toml",
        text.replace("\"V\", name", "\"who\", name").replace("\"gear\", name", "\"gaer\", name"),
    );
    import.refused(
        &[],
        &[
            "\"who\" is of type Utf8, no numbers",
            "there is no column \"gaer\"; the file has \"gear\", ",
        ],
    );
    let whole = std::fs::read(import.at("a.parquet")).expect("readable");
    import.put("a.parquet", [&whole[..20], &whole[whole.len() - 60..]].concat());
    import.refused(&[], &["a.parquet: no readable Parquet file"]);
}

#[test]
fn whole_ns_of_a_parquet_column_keep_all_their_digits() {
    use arrow_array::*;
    use std::sync::Arc;
    let import = Import::new(
        r#"
input = ["a.parquet"]
output = "a.mcap"
time = { column = "t", unit = "ns" }
[[topic]]
name = "/air"
fields = [{ column = "n", name = "n", unit = "1" }]
[[topic]]
name = "/again"
time = { column = "u", unit = "ns" }
fields = [{ column = "n", name = "n", unit = "1" }]
"#,
    );
    let t = 1_700_000_000_123_456_789i64;
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("t", Arc::new(Int64Array::from(vec![t, t + 1, t + 4]))),
        ("u", Arc::new(UInt64Array::from(vec![Some(t as u64), None, Some(t as u64 + 3)]))),
        ("n", Arc::new(UInt64Array::from(vec![7, 8, u64::MAX]))),
    ];
    let batch = RecordBatch::try_from_iter(columns).expect("a batch");
    let mut writer =
        parquet::arrow::ArrowWriter::try_new(Vec::new(), batch.schema(), None).expect("a writer");
    writer.write(&batch).expect("written");
    import.put("a.parquet", writer.into_inner().expect("finished"));
    let said = import.fine(&[]);
    assert!(said.contains("18446744073709551616 for 18446744073709551615"), "{said}");
    let air = import.messages("a.mcap", "/air");
    assert_eq!(told(&air[0]), (t as u64, r#"{"n":7.0}"#));
    assert_eq!((air[1].0, air[2].0), (t as u64 + 1, t as u64 + 4));
    let again = import.messages("a.mcap", "/again");
    assert_eq!((again.len(), again[0].0, again[1].0), (2, t as u64, t as u64 + 3));
}

#[test]
fn a_folder_of_files_is_one_description() {
    let import = Import::new(&format!(
        "names = [\"*\"]\ninput = [\"nowhere/{{name}}.csv\", \"data/run-{{name}}.csv\"]\noutput = \"logs/{{name}}.mcap\"\n{CSV}"
    ));
    import.refused(&[], &["no input file found; looked for", "nowhere/*.csv", "data/run-*.csv"]);
    for (name, x) in [("run-b", 2), ("run-a", 1), ("other", 3), (".run-c", 4)] {
        import.put(&format!("data/{name}.csv"), format!("t,x\n0,{x}\n"));
    }
    let said = import.fine(&[]);
    let (a, b) = (said.find("run-a.csv").expect("a"), said.find("run-b.csv").expect("b"));
    assert!(a < b && said.lines().count() == 2, "{said}");
    assert_eq!(told(&import.messages("logs/a.mcap", "/x")[0]), (0, r#"{"x":1.0}"#));
    // What is wrong with one file costs only its own log.
    import.put("data/run-a.csv", "t,x\n0,oops\n");
    import.put("data/run-c.csv", "t,x\n0,5\n");
    let (code, out, err) = import.koehler(&[]);
    assert!(code == 2 && err.contains("run-a.csv:2:3: column 2: \"oops\" is no number"), "{err}");
    // What was written is told all the same.
    assert!(out.contains("run-c.csv") && !out.contains("run-a.csv"), "{out}");
    assert_eq!(told(&import.messages("logs/c.mcap", "/x")[0]), (0, r#"{"x":5.0}"#));
    // A file of others among the outputs stops all before anything is read.
    import.put("logs/b.mcap", "somebody's");
    import.put("data/run-c.csv", "t,x\n0,6\n");
    import.refused(&[], &["b.mcap: the file is there and is not ours"]);
    assert_eq!(told(&import.messages("logs/c.mcap", "/x")[0]), (0, r#"{"x":5.0}"#));
    assert!(Path::new(&import.at("data/run-a.csv")).exists());
}
