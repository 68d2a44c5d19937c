//! Topics of numbers in, one MCAP file of JSON messages with JSON Schema out: the same input gives
//! the same bytes.

use super::records::IMPORTED;
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// How headers of our logs begin to name the program that wrote them.
const PROGRAM: &str = "koehler";

/// One field of a topic: every message holds one number for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldSpec {
    /// A dot makes a nested object: `rate.p` is written as `{"rate":{"p":0.1}}`.
    pub name: String,
    /// The unit as a recorder would name it (`"deg"`, `"m/s"`); goes to the schema as `unit`.
    pub unit: String,
    /// Goes to the schema as `description`.
    pub doc: String,
}

impl FieldSpec {
    pub fn new(name: impl Into<String>, unit: impl Into<String>, doc: impl Into<String>) -> Self {
        FieldSpec { name: name.into(), unit: unit.into(), doc: doc.into() }
    }
}

/// A topic of the `LogWriter` that gave it out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TopicId(usize);

/// The messages of one topic: `n` times and `n` rows of as many values as the topic has fields.
#[derive(Debug, Clone, Copy)]
pub struct Stream<'a> {
    pub topic: TopicId,
    /// When each message is received, ns, ascending.
    pub log_time_ns: &'a [u64],
    /// When each message was sent, ns.
    pub publish_time_ns: &'a [u64],
    /// Values `[n][fields]`, row by row; NaN is written as `null`.
    pub rows: &'a [f64],
}

struct Topic {
    channel: u16,
    count: u32,
    /// The text before each value: `{"a":`, `,"b":{"c":`, ...
    keys: Vec<String>,
    /// The text after the last value.
    end: String,
}

/// Writes one log file. Nothing is at `path` until `finish` has succeeded.
///
/// Numbers are written with the fewest digits that read back to the same `f64`; chunks are
/// compressed with zstd.
pub struct LogWriter {
    writer: mcap::Writer<BufWriter<Shared>>,
    file: tempfile::NamedTempFile,
    path: PathBuf,
    topics: Vec<Topic>,
    last_ns: u64,
    text: Vec<u8>,
}

/// A second handle of the temporary file, so that the file itself stays at hand for the rename.
struct Shared(File);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

impl Seek for Shared {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.0.seek(to)
    }
}

impl LogWriter {
    /// Opens a temporary file beside `path`; missing folders are made.
    pub fn create(path: &Path) -> Result<LogWriter> {
        LogWriter::create_as(path, PROGRAM)
    }

    /// The same; the header names `writer` (which begins with "koehler") as the program that wrote
    /// the log.
    pub fn create_as(path: &Path, writer: &str) -> Result<LogWriter> {
        let failed = |e: std::io::Error| cannot_write(path, e);
        let folder = folder_of(path);
        std::fs::create_dir_all(folder).map_err(failed)?;
        let file = tempfile::Builder::new()
            .prefix(".koehler-")
            .suffix(".mcap.part")
            .tempfile_in(folder)
            .map_err(failed)?;
        let handle = file.as_file().try_clone().map_err(failed)?;
        // One compression thread: the library's own threads would make the bytes depend on the
        // machine.
        let writer = mcap::WriteOptions::new()
            .library(writer)
            .compression_threads(0)
            .create(BufWriter::new(Shared(handle)))
            .map_err(|e| cannot_write(path, e))?;
        Ok(LogWriter {
            writer,
            file,
            path: path.to_path_buf(),
            topics: Vec::new(),
            last_ns: 0,
            text: Vec::new(),
        })
    }

    /// Adds a topic whose messages are JSON objects with the given fields, in that order.
    ///
    /// # Errors
    /// A field is there twice, is a number and an object at once, or does not stand next to the
    /// others of its object.
    pub fn add_topic(&mut self, name: &str, fields: &[FieldSpec]) -> Result<TopicId> {
        let (keys, end) = layout(fields)
            .map_err(|what| cannot_write(&self.path, format!("topic {name}: {what}")))?;
        let schema = json_schema(name, fields).to_string();
        let title = name.trim_matches('/').replace('/', ".");
        let channel = self
            .writer
            .add_schema(&title, "jsonschema", schema.as_bytes())
            .and_then(|id| self.writer.add_channel(id, name, "json", &BTreeMap::new()))
            .map_err(|e| cannot_write(&self.path, e))?;
        self.topics.push(Topic { channel, count: 0, keys, end });
        Ok(TopicId(self.topics.len() - 1))
    }

    /// Writes one message: one value per field. Messages of all topics together come in the order
    /// of their log time.
    pub fn write(
        &mut self,
        topic: TopicId,
        log_time_ns: u64,
        publish_time_ns: u64,
        values: &[f64],
    ) -> Result<()> {
        let Some(t) = self.topics.get_mut(topic.0) else {
            return Err(cannot_write(&self.path, "the topic belongs to another log"));
        };
        if values.len() != t.keys.len() {
            let what =
                format!("a message needs {} values, {} were given", t.keys.len(), values.len());
            return Err(cannot_write(&self.path, what));
        }
        if log_time_ns < self.last_ns {
            let what = format!(
                "log time {log_time_ns} ns comes after {} ns: messages must be given in time order",
                self.last_ns
            );
            return Err(cannot_write(&self.path, what));
        }
        self.last_ns = log_time_ns;
        self.text.clear();
        for (key, value) in t.keys.iter().zip(values) {
            self.text.extend_from_slice(key.as_bytes());
            // NaN and infinity become `null`, JSON has no word for them.
            serde_json::to_writer(&mut self.text, value)
                .map_err(|e| cannot_write(&self.path, e))?;
        }
        self.text.extend_from_slice(t.end.as_bytes());
        let header = mcap::records::MessageHeader {
            channel_id: t.channel,
            sequence: t.count,
            log_time: log_time_ns,
            publish_time: publish_time_ns,
        };
        t.count = t.count.wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, &self.text)
            .map_err(|e| cannot_write(&self.path, e))
    }

    /// Writes whole streams merged by log time; at equal times the earlier stream in the list goes
    /// first.
    pub fn write_streams(&mut self, streams: &[Stream]) -> Result<()> {
        for s in streams {
            let width = self.topics.get(s.topic.0).map_or(0, |t| t.keys.len());
            if s.publish_time_ns.len() != s.log_time_ns.len()
                || s.rows.len() != s.log_time_ns.len() * width
            {
                let what = format!(
                    "a stream of {} log times and {width} fields has {} publish times and {} values",
                    s.log_time_ns.len(),
                    s.publish_time_ns.len(),
                    s.rows.len()
                );
                return Err(cannot_write(&self.path, what));
            }
        }
        let mut next = std::collections::BinaryHeap::new();
        let entry = |at: u64, stream: usize, row: usize| std::cmp::Reverse((at, stream, row));
        for (i, s) in streams.iter().enumerate() {
            next.extend(s.log_time_ns.first().map(|&at| entry(at, i, 0)));
        }
        while let Some(std::cmp::Reverse((at, i, row))) = next.pop() {
            let s = &streams[i];
            let width = s.rows.len() / s.log_time_ns.len();
            self.write(
                s.topic,
                at,
                s.publish_time_ns[row],
                &s.rows[row * width..(row + 1) * width],
            )?;
            next.extend(s.log_time_ns.get(row + 1).map(|&at| entry(at, i, row + 1)));
        }
        Ok(())
    }

    /// Writes what an import met beside the data, where whoever reads the log is told of it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_notes(&mut self, notes: &[String]) -> Result<()> {
        if notes.is_empty() {
            return Ok(());
        }
        let numbered = notes.iter().enumerate();
        let metadata = numbered.map(|(i, note)| (format!("{i:04}"), note.clone())).collect();
        let record = mcap::records::Metadata { name: IMPORTED.to_string(), metadata };
        self.writer.write_metadata(&record).map_err(|e| cannot_write(&self.path, e))
    }

    /// Writes the summary, forces everything to disk and puts the file in its place.
    pub fn finish(mut self) -> Result<()> {
        let path = self.path;
        self.writer.finish().map_err(|e| cannot_write(&path, e))?;
        let failed = |e: std::io::Error| cannot_write(&path, e);
        self.writer.into_inner().into_inner().map_err(|e| cannot_write(&path, e.error()))?;
        self.file.as_file().sync_all().map_err(failed)?;
        #[cfg(unix)]
        {
            // A temporary file is private; a log is as readable as any other file.
            use std::os::unix::fs::PermissionsExt;
            self.file
                .as_file()
                .set_permissions(std::fs::Permissions::from_mode(0o644))
                .map_err(failed)?;
        }
        self.file.persist(&path).map_err(|e| cannot_write(&path, e.error))?;
        File::open(folder_of(&path)).and_then(|d| d.sync_all()).map_err(failed)
    }
}

/// What the file at `path` is, where it is no log that a `koehler` wrote.
pub fn foreign(path: &Path) -> Option<String> {
    match super::file::writer(path) {
        Ok(Some(writer)) if writer.starts_with(PROGRAM) => None,
        Ok(Some(writer)) => Some(format!("a log written by \"{writer}\"")),
        Ok(None) => Some("a log that does not say who wrote it".into()),
        Err(_) => Some("no MCAP log".into()),
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn cannot_write(path: &Path, why: impl std::fmt::Display) -> Error {
    Error::new(format!("cannot write the log {}: {why}", path.display()))
}

/// The text before each value of a message, and that after the last one.
fn layout(fields: &[FieldSpec]) -> std::result::Result<(Vec<String>, String), String> {
    let mut keys = Vec::new();
    let mut open: Vec<&str> = Vec::new();
    // Paths of numbers, and of objects that are open or closed already.
    let mut seen: Vec<String> = Vec::new();
    let mut text = String::from("{");
    for f in fields {
        let mut parts: Vec<&str> = f.name.split('.').collect();
        let leaf = parts.pop().unwrap_or_default();
        let shared = open.iter().zip(&parts).take_while(|(a, b)| a == b).count();
        text.push_str(&"}".repeat(open.len() - shared));
        text.push_str(if keys.is_empty() { "" } else { "," });
        let mut claim = |path: String| {
            if seen.contains(&path) {
                Err(format!("field \"{}\" clashes with another at \"{path}\"", f.name))
            } else {
                seen.push(path);
                Ok(())
            }
        };
        for (i, part) in parts.iter().enumerate().skip(shared) {
            claim(parts[..=i].join("."))?;
            text.push_str(&format!("{}:{{", serde_json::Value::from(*part)));
        }
        claim(f.name.clone())?;
        text.push_str(&format!("{}:", serde_json::Value::from(leaf)));
        keys.push(std::mem::take(&mut text));
        open = parts;
    }
    Ok((keys, if fields.is_empty() { "{}".into() } else { "}".repeat(open.len() + 1) }))
}

fn json_schema(name: &str, fields: &[FieldSpec]) -> serde_json::Value {
    let mut schema = serde_json::json!({"title": name, "type": "object"});
    for f in fields {
        let mut node = &mut schema;
        for part in f.name.split('.') {
            node["type"] = "object".into();
            node = &mut node["properties"][part];
        }
        *node = serde_json::json!({"type": "number", "unit": f.unit, "description": f.doc});
    }
    schema
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(path: &Path) {
        let mut log = LogWriter::create(path).unwrap();
        let imu = log
            .add_topic(
                "/imu",
                &[FieldSpec::new("p", "rad/s", "Roll rate"), FieldSpec::new("q", "rad/s", "")],
            )
            .unwrap();
        let air = log.add_topic("/air", &[FieldSpec::new("V", "m/s", "True airspeed")]).unwrap();
        let imu = Stream {
            topic: imu,
            log_time_ns: &[10, 20, 30],
            publish_time_ns: &[9, 19, 29],
            rows: &[1.0, 2.0, 3.0, f64::NAN, 0.1, 1e-300],
        };
        let air = Stream {
            topic: air,
            log_time_ns: &[15, 20],
            publish_time_ns: &[15, 20],
            rows: &[100.0, 101.5],
        };
        log.write_streams(&[air, imu]).unwrap();
        log.finish().unwrap();
    }

    #[test]
    fn messages_come_out_merged_as_json_and_twice_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("new/a.mcap"), folder.path().join("b.mcap"));
        sample(&a);
        sample(&b);
        let bytes = std::fs::read(&a).unwrap();
        assert_eq!(bytes, std::fs::read(&b).unwrap());
        let got: Vec<String> = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(|m| m.unwrap())
            .map(|m| {
                format!(
                    "{} {} {} {}",
                    m.channel.topic,
                    m.log_time,
                    m.publish_time,
                    String::from_utf8_lossy(&m.data)
                )
            })
            .collect();
        let expected = [
            r#"/imu 10 9 {"p":1.0,"q":2.0}"#,
            r#"/air 15 15 {"V":100.0}"#,
            r#"/air 20 20 {"V":101.5}"#,
            r#"/imu 20 19 {"p":3.0,"q":null}"#,
            r#"/imu 30 29 {"p":0.1,"q":1e-300}"#,
        ];
        assert_eq!(got, expected);
    }

    #[test]
    fn dots_make_nested_objects_and_clashes_are_refused() {
        let fields =
            |names: &[&str]| names.iter().map(|n| FieldSpec::new(*n, "1", "")).collect::<Vec<_>>();
        let (keys, end) = layout(&fields(&["t", "rate.p", "rate.q", "a.b.c", "a.d", "z"])).unwrap();
        let text: String = keys.iter().map(|k| format!("{k}0")).collect::<String>() + &end;
        assert_eq!(text, r#"{"t":0,"rate":{"p":0,"q":0},"a":{"b":{"c":0},"d":0},"z":0}"#);
        assert_eq!(layout(&[]).unwrap(), (vec![], "{}".to_string()));
        for names in [["a", "a"], ["a", "a.b"], ["a.b", "a"]] {
            assert!(layout(&fields(&names)).unwrap_err().contains("clashes"), "{names:?}");
        }
        assert!(
            layout(&fields(&["a.b", "c", "a.d"]))
                .unwrap_err()
                .contains("clashes with another at \"a\"")
        );
        let schema = json_schema("/t", &fields(&["rate.p"]));
        assert_eq!(schema["properties"]["rate"]["properties"]["p"]["unit"], "1");
    }

    #[test]
    fn an_unfinished_log_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = LogWriter::create(&folder.path().join("a.mcap")).unwrap();
        let t = log.add_topic("/t", &[FieldSpec::new("x", "1", "")]).unwrap();
        log.write(t, 5, 5, &[1.0]).unwrap();
        drop(log);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn wrong_shapes_and_wrong_order_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = LogWriter::create(&folder.path().join("a.mcap")).unwrap();
        let t = log.add_topic("/t", &[FieldSpec::new("x", "1", "")]).unwrap();
        log.write(t, 5, 5, &[1.0]).unwrap();
        let e = log.write(t, 4, 4, &[1.0]).unwrap_err().to_string();
        assert!(e.contains("log time 4 ns comes after 5 ns"), "{e}");
        let e = log.write(t, 6, 6, &[1.0, 2.0]).unwrap_err().to_string();
        assert!(e.contains("needs 1 values, 2 were given"), "{e}");
        let e = log
            .write_streams(&[Stream {
                topic: t,
                log_time_ns: &[9],
                publish_time_ns: &[],
                rows: &[1.0],
            }])
            .unwrap_err()
            .to_string();
        assert!(e.contains("0 publish times"), "{e}");
    }
}
