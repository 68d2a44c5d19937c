//! How fast logs are read: made-up flights of twenty channels in every encoding in; ns per field and
//! the ratio to bare decompression of the same chunks out. `cargo bench --bench logs -- [minutes] [encoding]`.
//! Then what the program takes for a flight: ingest and the report's pages beside their bytes alone.
//!
//! One thread, the file in the page cache, checksums verified, numbers into columns. Times are the
//! least of many runs in turn, so that others on the machine count little.

#[allow(dead_code)]
#[path = "../tests/all/campaign.rs"]
mod campaign;
#[path = "work/flight.rs"]
mod flight;

use koehler::config;
use koehler::log::decode::{self, Prepared};
use koehler::log::{Buffer, ChannelMap, LogFile, read_flight};
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Topic, rate in Hz, fields.
const TOPICS: [(&str, u64, &[&str]); 4] = [
    ("/imu", 100, &["p", "q", "r", "ax", "ay", "az"]),
    ("/surfaces", 100, &["elevator", "aileron", "rudder", "flap", "trim"]),
    ("/air", 50, &["tas", "alpha", "beta", "static_pressure", "temperature"]),
    ("/engine", 20, &["n1", "n2", "fuel_flow", "thrust"]),
];
const START_NS: u64 = 1_700_000_000_000_000_000;
const RUNS: usize = 15;

/// Encoding, schema encoding, wanted ratio to bare decompression.
const ROWS: [(&str, &str, f64); 3] =
    [("cdr", "ros2msg", 1.5), ("protobuf", "protobuf", 1.5), ("json", "", 3.0)];

fn main() {
    let minutes = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(20);
    let folder = tempfile::tempdir().expect("a folder");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    println!("{minutes} min, 20 channels and a time stamp in 4 topics, one thread");
    println!(
        "{:9} {:>8} {:>9} {:>9} {:>9} {:>9} {:>8} {:>7}",
        "encoding", "MB", "zstd ms", "columns", "flight", "ns/field", "ratio", "wanted"
    );
    let only = std::env::args().skip(1).find(|a| ROWS.iter().any(|row| row.0 == a));
    for (encoding, schema, wanted) in ROWS {
        if only.as_ref().is_some_and(|only| only != encoding) {
            continue;
        }
        let path = folder.path().join(encoding);
        write(&path, encoding, schema, minutes, 5);
        one.install(|| row(&path, encoding, wanted));
    }
    println!("\na flight by the program, --jobs 1: processor ms beside those of its bytes alone");
    println!(
        "{:24} {:>8} {:>9} {:>9} {:>9} {:>8}",
        "", "MB out", "zstd", "written", "program", "ratio"
    );
    for (encoding, schema, _) in ROWS {
        if only.as_ref().is_some_and(|only| only != encoding) {
            continue;
        }
        let write = |path: &Path, seed| write(path, encoding, schema, minutes, seed);
        flight::ingest(encoding, &map(), write, bare);
    }
    flight::pages();
}

fn row(path: &Path, encoding: &str, wanted: f64) {
    let (map, doc) = config::parse::<ChannelMap>("channels.toml", &map()).expect("a sound map");
    let mut least = [f64::INFINITY; 3];
    let (mut bytes, mut fields) = (0, 0);
    for _ in 0..RUNS {
        let mut time = |i: usize, work: &mut dyn FnMut()| {
            let clock = Instant::now();
            work();
            least[i] = least[i].min(clock.elapsed().as_secs_f64());
        };
        time(0, &mut || bytes = bare(path));
        time(1, &mut || fields = columns(path));
        time(2, &mut || drop(black_box(read_flight(path, &map, &doc).expect("a sound log"))));
    }
    let [zstd, columns, flight] = least.map(|s| 1e3 * s);
    println!(
        "{encoding:9} {:8.1} {zstd:9.1} {columns:9.1} {flight:9.1} {:9.1} {:8.2} {wanted:7.1}",
        bytes as f64 / 1e6,
        1e6 * columns / fields as f64,
        columns / zstd
    );
}

/// Decompresses all chunks, and nothing else; the bytes that came out.
fn bare(path: &Path) -> usize {
    let log = std::fs::read(path).expect("a log");
    let summary = mcap::Summary::read(&log).expect("a summary").expect("a summary");
    let mut zstd = zstd::bulk::Decompressor::new().expect("a decompressor");
    let (mut buffer, mut bytes) = (Vec::new(), 0);
    for chunk in &summary.chunk_indexes {
        buffer.clear();
        buffer.reserve(chunk.uncompressed_size as usize);
        let start = chunk.compressed_data_offset().expect("an offset") as usize;
        let packed = &log[start..start + chunk.compressed_size as usize];
        bytes += zstd.decompress_to_buffer(packed, &mut buffer).expect("a sound chunk");
        black_box(&buffer);
    }
    bytes
}

/// Reads all fields and stamps into columns; how many numbers.
fn columns(path: &Path) -> usize {
    let log = LogFile::open(path).expect("a sound log");
    let prepared: BTreeMap<u16, Prepared> = log
        .channels
        .iter()
        .map(|(&id, channel)| {
            let (_, _, fields) =
                TOPICS.iter().find(|t| t.0 == channel.topic).expect("a topic of this file");
            let stamp = ["stamp.sec", "stamp.nanosec"].iter();
            let paths: Vec<String> = stamp.chain(*fields).map(|f| f.to_string()).collect();
            (id, decode::prepare(channel, &paths).expect("known").expect("a sound schema"))
        })
        .collect();
    let (mut buffer, mut row, mut numbers) = (Buffer::default(), [0.0; 8], 0);
    // As when a flight is read: room for as many messages as the part before had.
    let mut room: BTreeMap<u16, usize> = prepared.keys().map(|&id| (id, 0)).collect();
    for part in 0..log.parts() {
        let mut readers: Vec<_> = prepared
            .iter()
            .map(|(&id, p)| {
                let channel = &log.channels[&id];
                let width =
                    2 + TOPICS.iter().find(|t| t.0 == channel.topic).map_or(0, |t| t.2.len());
                let rows = room[&id];
                let values = Vec::with_capacity(rows * width);
                (id, width, p(), Vec::with_capacity(rows), values)
            })
            .collect();
        log.messages(part, &mut buffer, |m| {
            let reader = readers.iter_mut().find(|r| r.0 == m.channel).expect("a known channel");
            (reader.2)(m.data, &mut row[..reader.1]);
            reader.3.push(m.log_time);
            reader.4.extend_from_slice(&row[..reader.1]);
        })
        .expect("a sound chunk");
        numbers += readers.iter().map(|r| r.4.len()).sum::<usize>();
        room.extend(readers.iter().map(|r| (r.0, r.3.len())));
        black_box(readers.iter().map(|r| (&r.3, &r.4)).collect::<Vec<_>>());
    }
    numbers
}

fn map() -> String {
    let one = |topic: &str, field: &str| {
        format!("[signal.{field}]\ntopic = \"{topic}\"\nfield = \"{field}\"\nunit = \"1\"\n")
    };
    let of = |t: &(&str, u64, &[&str])| t.2.iter().map(|f| one(t.0, f)).collect::<String>();
    format!("[defaults]\ntime = \"stamp\"\n{}", TOPICS.iter().map(of).collect::<String>())
}

/// Writes a flight: slow movements with noise, five digits behind the point.
fn write(path: &Path, encoding: &str, schema: &str, minutes: u64, seed: u64) {
    let file = std::io::BufWriter::new(std::fs::File::create(path).expect("a file"));
    let options = mcap::WriteOptions::new().compression_threads(0);
    let mut log = options.create(file).expect("a log");
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let channels = TOPICS.map(|(topic, _, fields)| {
        let (name, text) = definition(encoding, topic, fields);
        let id = if schema.is_empty() {
            0
        } else {
            log.add_schema(&name, schema, &text).expect("a schema")
        };
        log.add_channel(id, topic, encoding, &BTreeMap::new()).expect("a channel")
    });
    for tick in 0..minutes * 6000 {
        for ((_, rate, fields), &channel_id) in TOPICS.iter().zip(&channels) {
            if tick % (100 / rate) != 0 {
                continue;
            }
            let ns = START_NS + tick * 10_000_000;
            let value = |i: usize| {
                let noise: f64 = rng.random_range(-0.01..0.01);
                let slow = libm::sin(tick as f64 / 100.0 * 0.1 * (i + 1) as f64);
                libm::round(1e5 * (slow + noise)) / 1e5
            };
            let values: Vec<f64> = (0..fields.len()).map(value).collect();
            let data = message(encoding, ns, fields, &values);
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time: ns,
                publish_time: ns,
            };
            log.write_to_known_channel(&header, &data).expect("written");
        }
    }
    log.finish().expect("a whole log");
}

/// Name and text of a topic's schema.
fn definition(encoding: &str, topic: &str, fields: &[&str]) -> (String, Vec<u8>) {
    let name = topic.trim_matches('/');
    if encoding == "protobuf" {
        return (format!("b.{name}"), descriptors(name, fields));
    }
    let members: String = fields.iter().map(|f| format!("float64 {f}\n")).collect();
    (format!("b/msg/{name}"), format!("builtin_interfaces/Time stamp\n{members}").into_bytes())
}

fn descriptors(name: &str, fields: &[&str]) -> Vec<u8> {
    use prost::Message;
    use prost_types::field_descriptor_proto::Type;
    use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto};
    let field = |name: &str, number: usize, kind: Type| FieldDescriptorProto {
        name: Some(name.into()),
        number: Some(number as i32),
        r#type: Some(kind.into()),
        ..Default::default()
    };
    let message = |name: &str, field: Vec<FieldDescriptorProto>| DescriptorProto {
        name: Some(name.into()),
        field,
        ..Default::default()
    };
    let stamp = vec![field("sec", 1, Type::Int64), field("nanosec", 2, Type::Uint32)];
    let mut own = vec![FieldDescriptorProto {
        type_name: Some(".b.Stamp".into()),
        ..field("stamp", 1, Type::Message)
    }];
    own.extend(fields.iter().enumerate().map(|(i, f)| field(f, i + 2, Type::Double)));
    let file = FileDescriptorProto {
        package: Some("b".into()),
        syntax: Some("proto3".into()),
        message_type: vec![message("Stamp", stamp), message(name, own)],
        ..Default::default()
    };
    prost_types::FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

fn message(encoding: &str, ns: u64, fields: &[&str], values: &[f64]) -> Vec<u8> {
    let (sec, nanosec) = (ns / 1_000_000_000, ns % 1_000_000_000);
    let mut out = Vec::new();
    match encoding {
        "json" => {
            let text: String =
                fields.iter().zip(values).map(|(f, x)| format!(",\"{f}\":{x}")).collect();
            out =
                format!("{{\"stamp\":{{\"sec\":{sec},\"nanosec\":{nanosec}}}{text}}}").into_bytes();
        }
        "cdr" => {
            out.extend([0, 1, 0, 0]);
            out.extend((sec as i32).to_le_bytes());
            out.extend((nanosec as u32).to_le_bytes());
            values.iter().for_each(|x| out.extend(x.to_le_bytes()));
        }
        _ => {
            let mut stamp = vec![0x08];
            prost::encoding::encode_varint(sec, &mut stamp);
            stamp.push(0x10);
            prost::encoding::encode_varint(nanosec, &mut stamp);
            out.extend([0x0a, stamp.len() as u8]);
            out.extend(stamp);
            for (i, x) in values.iter().enumerate() {
                out.push((((i + 2) << 3) | 1) as u8);
                out.extend(x.to_le_bytes());
            }
        }
    }
    out
}
