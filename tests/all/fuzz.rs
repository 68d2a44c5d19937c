//! Any bytes in; every reader of files that people give must answer or refuse, and never panic, within
//! its memory (and its time, with `KOEHLER_SLOW=1`).
//!
//! The targets are plain functions of bytes. What they are driven with, and how, is in `driven.rs`: the
//! files of `tests/corpus`, a folder per target (what readers were written with in view, and whatever broke
//! one), then what `bolero` makes of these and of sound files.

use crate::driven::{Form, drive};
use crate::forms::{CDR, MAT, MCAP, PROTOBUF, TEXT, ULOG};
use koehler::config;
use koehler::log::decode::{self, FieldInfo};
use koehler::log::{Buffer, ChannelMap, LogFile, import};
use koehler::model::{Constants, Model};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// A folder that no write waits for a disk in, where there is one.
fn in_memory() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

thread_local! {
    /// Where a target that reads files has its own; gone with the thread.
    static FOLDER: tempfile::TempDir = in_memory();
}

/// Such a file with these bytes.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = FOLDER.with(|folder| folder.path().join(name));
    std::fs::write(&path, bytes).expect("written");
    path
}

/// A small log of some messages, as the options say.
fn log(options: mcap::WriteOptions) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut log =
        options.chunk_size(Some(300)).compression_threads(0).create(&mut bytes).expect("begun");
    let channel_id = log.add_channel(0, "/t", "json", &Default::default()).expect("a channel");
    for i in 0..40 {
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: i,
            log_time: u64::from(i) * 1000,
            publish_time: 0,
        };
        log.write_to_known_channel(&header, b"{\"x\":1.5}").expect("written");
    }
    log.finish().expect("finished");
    drop(log);
    bytes.into_inner()
}

fn walk_log(bytes: &[u8]) {
    let Ok(log) = LogFile::open(&file("a.mcap", bytes)) else { return };
    let mut buffer = Buffer::default();
    for part in 0..log.parts() {
        log.messages(part, &mut buffer, |_| ()).expect("the file stays as it is");
    }
}

#[test]
fn fault_any_bytes_are_walked_as_a_log() {
    let plain = || mcap::WriteOptions::new().compression(None);
    let seeds = [
        log(mcap::WriteOptions::new()),
        log(mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4))),
        // damage is met by the checksum here, and by what reads the records of chunks there
        log(plain()),
        log(plain().calculate_chunk_crcs(false).calculate_summary_section_crc(false)),
        log(plain().use_chunks(false)),
    ];
    drive("log", walk_log, MCAP, &seeds);
}

/// A target with its name and the form of its inputs, and what these are made of.
type Case<T> = (&'static str, fn(&[u8]), Form, T);
type Target = Box<dyn Fn(&[u8]) + Send + Sync>;

/// The channel of a log: sound messages and schema, and what reads others.
struct Decoder {
    messages: Vec<Vec<u8>>,
    schema: Vec<u8>,
    as_message: Target,
    as_schema: Target,
}

/// The first messages of a channel.
fn messages(log: &LogFile, channel: u16) -> Vec<Vec<u8>> {
    let mut messages: Vec<Vec<u8>> = Vec::new();
    for part in 0..log.parts() {
        let take = |m: koehler::log::file::Message| {
            if m.channel == channel && messages.len() < 5 {
                messages.push(m.data.to_vec());
            }
        };
        log.messages(part, &mut Buffer::default(), take).expect("readable");
    }
    messages
}

/// What reads the channels of a log in an encoding.
fn decoders(encoding: &str) -> Vec<Decoder> {
    let log = LogFile::open(&shipped(&format!("tests/logs/{encoding}.mcap"))).expect("a log");
    let mut all = Vec::new();
    for (id, channel) in &log.channels {
        let Some(known) = decode::encoding_of(channel) else { continue };
        let messages = messages(&log, *id);
        let (first, others) = (messages[0].clone(), messages.clone());
        let paths = |fields: Vec<FieldInfo>| -> Vec<String> {
            fields.into_iter().map(|f| f.path).take(50).collect()
        };
        let sound = paths((known.fields)(channel, &[&first]));
        let prepared = (known.prepare)(channel, &sound).expect("a sound schema");
        let mut changed = channel.clone();
        let schema = std::mem::take(&mut changed.schema);
        // A reader remembers how the message before was laid out.
        let as_message: Target = Box::new(move |bytes| {
            let (mut reader, mut row) = (prepared(), vec![0.0; sound.len()]);
            [&first[..], bytes, &first[..]].into_iter().for_each(|m| reader(m, &mut row));
        });
        let as_schema: Target = Box::new(move |bytes| {
            let mut channel = changed.clone();
            channel.schema = bytes.to_vec();
            let paths = paths((known.fields)(&channel, &[&others[0]]));
            let Ok(prepared) = (known.prepare)(&channel, &paths) else { return };
            let (mut reader, mut row) = (prepared(), vec![0.0; paths.len()]);
            others.iter().for_each(|message| reader(message, &mut row));
        });
        all.push(Decoder { messages, schema, as_message, as_schema });
    }
    all
}

static JSON: LazyLock<Vec<Decoder>> = LazyLock::new(|| decoders("json"));
static PROTO: LazyLock<Vec<Decoder>> = LazyLock::new(|| decoders("protobuf"));
static ROS2: LazyLock<Vec<Decoder>> = LazyLock::new(|| decoders("ros2"));

fn json_message(bytes: &[u8]) {
    JSON.iter().for_each(|d| (d.as_message)(bytes));
}

fn json_schema(bytes: &[u8]) {
    JSON.iter().for_each(|d| (d.as_schema)(bytes));
}

fn protobuf_message(bytes: &[u8]) {
    PROTO.iter().for_each(|d| (d.as_message)(bytes));
}

fn protobuf_schema(bytes: &[u8]) {
    PROTO.iter().for_each(|d| (d.as_schema)(bytes));
}

fn ros2_message(bytes: &[u8]) {
    ROS2.iter().for_each(|d| (d.as_message)(bytes));
}

fn ros2_schema(bytes: &[u8]) {
    ROS2.iter().for_each(|d| (d.as_schema)(bytes));
}

#[test]
fn fault_any_bytes_are_decoded_as_messages() {
    let all: [Case<&Vec<Decoder>>; 3] = [
        ("json", json_message, TEXT, &JSON),
        ("protobuf", protobuf_message, PROTOBUF, &PROTO),
        ("ros2", ros2_message, CDR, &ROS2),
    ];
    for (encoding, target, form, decoders) in all {
        let seeds: Vec<Vec<u8>> = decoders.iter().flat_map(|d| d.messages.clone()).collect();
        drive(encoding, target, form, &seeds);
    }
}

#[test]
fn fault_any_bytes_are_read_as_schemas() {
    let all: [Case<&Vec<Decoder>>; 3] = [
        ("json", json_schema, TEXT, &JSON),
        ("protobuf", protobuf_schema, PROTOBUF, &PROTO),
        ("ros2", ros2_schema, TEXT, &ROS2),
    ];
    for (encoding, target, form, decoders) in all {
        let seeds: Vec<Vec<u8>> = decoders.iter().map(|d| d.schema.clone()).collect();
        drive(encoding, target, form, &seeds);
    }
}

/// A MAT file with one matrix.
fn mat() -> Vec<u8> {
    let element = |kind: u32, data: &[u8]| {
        let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let numbers: Vec<u8> = (0..12).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let sizes = [6u32, 2].map(u32::to_le_bytes).concat();
    let flags = [6u32, 0].map(u32::to_le_bytes).concat();
    let parts = [element(6, &flags), element(5, &sizes), element(1, b"data"), element(9, &numbers)];
    let mut out = b"MATLAB 5.0 MAT-file".to_vec();
    out.resize(124, b' ');
    out.extend([0, 1, b'I', b'M']);
    out.extend(element(14, &parts.concat()));
    out
}

/// A ULog with one topic.
fn ulog() -> Vec<u8> {
    let mut out = [b"ULog\x01\x12\x35\x01".to_vec(), 0u64.to_le_bytes().to_vec()].concat();
    let mut record = |kind: u8, body: &[u8]| {
        out.extend((body.len() as u16).to_le_bytes());
        out.push(kind);
        out.extend(body);
    };
    record(b'B', &[0; 40]);
    record(b'F', b"outer:uint64_t timestamp;float x;");
    record(b'A', b"\0\0\0outer");
    for i in 0..5u64 {
        let body = [&[0, 0], &(1000 * i).to_le_bytes()[..], &1.5f32.to_le_bytes()].concat();
        record(b'D', &body);
    }
    out
}

/// Imports a file of these bytes as a description says; how many logs that made.
fn imported(description: &str, bytes: &[u8]) -> usize {
    let description = file("import.toml", description.as_bytes());
    file("a.bin", bytes);
    import::run(&description, None, true).map_or(0, |(done, _)| done.len())
}

const OF_TEXT: &str = "separator = \"comma\"\nheader_lines = 1\ninput = [\"a.bin\"]\noutput = \"a.mcap\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[[topic]]\nname = \"/o\"\nfields = [{ column = \"x\", name = \"x\", unit = \"1\" }]\n";
const OF_MAT: &str = "input = [\"a.bin\"]\noutput = \"a.mcap\"\n[time]\ncolumn = 1\nunit = \"s\"\n[[topic]]\nname = \"/o\"\nfields = [{ column = 2, name = \"x\", unit = \"1\" }]\n";
const OF_ULOG: &str = "input = [\"a.bin\"]\noutput = \"a.mcap\"\n[[topic]]\nname = \"/o\"\nfrom = \"outer\"\nfields = [{ column = \"x\", name = \"x\", unit = \"1\" }]\n";

fn import_text(bytes: &[u8]) {
    imported(OF_TEXT, bytes);
}

fn import_mat(bytes: &[u8]) {
    imported(OF_MAT, bytes);
}

fn import_ulog(bytes: &[u8]) {
    imported(OF_ULOG, bytes);
}

#[test]
fn fault_any_bytes_are_imported_or_refused() {
    let table = b"t,x\n0,1\n0.1,2\n0.2,\"3\"\n".to_vec();
    let all: [Case<(&str, Vec<u8>)>; 3] = [
        ("text", import_text, TEXT, (OF_TEXT, table)),
        ("mat", import_mat, MAT, (OF_MAT, mat())),
        ("ulog", import_ulog, ULOG, (OF_ULOG, ulog())),
    ];
    for (kind, target, form, (description, sound)) in all {
        assert_eq!(imported(description, &sound), 1, "{description}");
        drive(kind, target, form, &[sound]);
    }
}

fn read_channels(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok((map, doc)) = config::parse::<ChannelMap>("channels.toml", &text) {
        let _ = map.check(&doc);
    }
}

#[test]
fn fault_any_bytes_are_read_as_a_channel_map() {
    let seeds = [
        crate::campaign::CHANNELS.as_bytes().to_vec(),
        std::fs::read(shipped("pipelines/citation/channels.toml")).expect("a channel map"),
    ];
    drive("channels", read_channels, TEXT, &seeds);
}

fn read_model(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = Model::parse("a.model.toml", &text, &Constants::default());
}

#[test]
fn fault_any_bytes_are_read_as_a_model() {
    let seeds = [
        crate::campaign::MODEL.as_bytes().to_vec(),
        std::fs::read(shipped("pipelines/hfb320/hfb320.model.toml")).expect("a model"),
    ];
    drive("model", read_model, TEXT, &seeds);
}
