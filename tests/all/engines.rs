//! A second engine, which keeps the seam honest: parameters, items and outputs are bytes on their
//! way to two other processes and back, in another order, and all pipelines make the same bytes.

use crate::campaign::{Campaign, MODEL};
use crate::flightdata;
use bytes::Bytes;
use koehler::FUNCTIONS;
use koehler::engine::{self, Engine, Folder, Job, Kept, Said, Source, Threads};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

/// One item on its way.
#[derive(Serialize, Deserialize)]
struct Request {
    name: String,
    version: u32,
    parameters: Bytes,
    item: Bytes,
}

/// What comes back for it.
#[derive(Serialize, Deserialize)]
enum Answer {
    Said(Said),
    Done(Result<Bytes, String>),
}

/// An error where the other side is gone.
fn send<T: Serialize>(stream: &mut TcpStream, value: &T) -> std::io::Result<()> {
    let bytes = engine::encode(value).expect("bytes");
    stream.write_all(&(bytes.len() as u32).to_le_bytes())?;
    stream.write_all(&bytes)
}

/// None where the other side is gone.
fn receive<T: serde::de::DeserializeOwned>(stream: &mut TcpStream) -> Option<T> {
    let mut length = [0; 4];
    stream.read_exact(&mut length).ok()?;
    let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
    stream.read_exact(&mut bytes).ok()?;
    Some(engine::decode(&bytes).expect("a message"))
}

/// Two processes of this very program.
struct Processes {
    workers: Vec<(Mutex<TcpStream>, Child)>,
    blobs: Folder,
    folder: tempfile::TempDir,
    /// How many items of each function were done by each worker.
    done: Mutex<BTreeMap<(&'static str, usize), usize>>,
    failed: Mutex<Vec<String>>,
}

const ADDRESS: &str = "KOEHLER_TEST_WORKER";
const BLOBS: &str = "KOEHLER_TEST_BLOBS";
/// After so many items the worker is gone, in the middle of the next one.
const LASTS: &str = "KOEHLER_TEST_LASTS";

/// The connection of a process that was just started.
fn connection(listener: &TcpListener, child: &mut Child) -> TcpStream {
    listener.set_nonblocking(true).expect("set");
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false).expect("set");
                stream.set_nodelay(true).expect("set");
                return stream;
            }
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            Err(e) => panic!("no connection: {e}"),
        }
        let ended = child.try_wait().expect("known");
        assert!(ended.is_none(), "the other process ended: {ended:?}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

impl Processes {
    /// The first of them lasts for so many items.
    fn start(lasts: Option<usize>) -> Processes {
        let folder = tempfile::tempdir().expect("a folder");
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string();
        let worker = |w: usize| {
            let mut command = Command::new(std::env::current_exe().expect("this program"));
            if let Some(n) = lasts.filter(|_| w == 0) {
                command.env(LASTS, n.to_string());
            }
            let mut child = command
                .args(["engines::works_for_another_process", "--exact"])
                .env(ADDRESS, &address)
                .env(BLOBS, folder.path())
                .current_dir(std::env::temp_dir())
                .stdout(Stdio::null())
                .spawn()
                .expect("started");
            (Mutex::new(connection(&listener, &mut child)), child)
        };
        Processes {
            workers: (0..2).map(worker).collect(),
            blobs: Folder(folder.path().to_path_buf()),
            folder,
            done: Mutex::default(),
            failed: Mutex::default(),
        }
    }

    /// Whether the process is still there afterwards.
    fn one(&self, stream: &mut TcpStream, job: &dyn Job, parameters: &[u8], i: usize) -> bool {
        let request = Request {
            name: job.name().into(),
            version: job.version(),
            parameters: Bytes::copy_from_slice(parameters),
            item: job.item(i).expect("an item").into(),
        };
        if send(stream, &request).is_err() {
            return false;
        }
        loop {
            match receive(stream) {
                None => return false,
                Some(Answer::Said(said)) => {
                    job.said(i, said);
                    continue;
                }
                Some(Answer::Done(Ok(output))) => job.done(i, &output).expect("an output"),
                Some(Answer::Done(Err(why))) => self.failed.lock().expect("alive").push(why),
            }
            return true;
        }
    }
}

impl Engine for Processes {
    fn run(&self, job: &dyn Job) {
        let parameters = match job.parameters(&self.blobs) {
            Ok(parameters) => parameters,
            Err(why) => return self.failed.lock().expect("alive").push(why.to_string()),
        };
        // Any order but that of the items.
        let mut order: Vec<usize> = (0..job.count()).collect();
        order.sort_by_key(|i| (i * 2_654_435_761) % 4_294_967_291 % 97);
        let left = Mutex::new(order);
        std::thread::scope(|scope| {
            for (w, (stream, _)) in self.workers.iter().enumerate() {
                let (left, parameters) = (&left, &parameters);
                scope.spawn(move || {
                    while let Some(i) = { left.lock().expect("alive").pop() } {
                        if !self.one(&mut stream.lock().expect("alive"), job, parameters, i) {
                            return;
                        }
                        *self.done.lock().expect("alive").entry((job.name(), w)).or_default() += 1;
                    }
                });
            }
        });
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        for (stream, child) in &mut self.workers {
            let _ = stream.get_mut().expect("alive").shutdown(std::net::Shutdown::Both);
            let _ = child.wait();
        }
    }
}

/// The other side: does what is asked of it until nobody is there any more. No test by itself.
#[test]
fn works_for_another_process() {
    let Some(address) = std::env::var_os(ADDRESS) else { return };
    let address = address.into_string().expect("an address");
    let blobs = Folder(std::env::var_os(BLOBS).map(PathBuf::from).expect("a folder"));
    let mut stream = TcpStream::connect(address).expect("connected");
    stream.set_nodelay(true).expect("set");
    let kept = Kept::at_most(24);
    let lasts = std::env::var(LASTS).ok().map(|n| n.parse::<usize>().expect("a number"));
    let mut done = 0;
    while let Some(request) = receive::<Request>(&mut stream) {
        if lasts == Some(done) {
            return;
        }
        done += 1;
        let back = Mutex::new(stream.try_clone().expect("a second handle"));
        let tell = |said| {
            send(&mut back.lock().expect("alive"), &Answer::Said(said)).expect("sent");
        };
        let source = Source { kept: &kept, engine: &Threads, blobs: Some(&blobs), tell: &tell };
        let known = FUNCTIONS
            .iter()
            .find(|f| f.name == request.name && f.version == request.version)
            .ok_or(format!("there is no {} {}", request.name, request.version));
        let output = known.and_then(|function| {
            function
                .run(&request.parameters, &request.item, &source)
                .map_err(|e| format!("{}: {e}", request.name))
        });
        send(&mut stream, &Answer::Done(output.map(Bytes::from))).expect("sent");
    }
}

/// All that a run left, by path, without lock, memory and the log with its times.
fn left(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(folder: &Path, root: &Path, all: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.strip_prefix(root).expect("below").to_path_buf();
            if path.is_dir() {
                walk(&path, root, all);
            } else if !["lock", "memo.json", "log.txt"]
                .contains(&name.file_name().and_then(|n| n.to_str()).unwrap_or_default())
            {
                all.insert(name, std::fs::read(&path).expect("readable"));
            }
        }
    }
    let mut all = BTreeMap::new();
    walk(folder, folder, &mut all);
    all
}

/// Runs a command over a pipeline with both engines; what both leave has to be the same bytes.
/// Returns how many items of each function were done elsewhere, and the exit code.
fn same_bytes(
    verb: &str,
    pipeline: &Path,
    processes: &Processes,
) -> (BTreeMap<&'static str, usize>, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str| {
        let out = folder.path().join(name);
        let engines: [(&str, &dyn Engine); 2] = [("threads", &Threads), ("processes", processes)];
        let mut args = vec!["koehler".into(), verb.into(), pipeline.as_os_str().to_os_string()];
        args.extend(["--out".into(), out.clone().into_os_string()]);
        args.extend(["--engine", name].map(Into::into));
        let code = koehler::cli::main_with(&engines, args.into_iter());
        (format!("{code:?}"), left(&out))
    };
    let (here, elsewhere) = (run("threads"), run("processes"));
    let failed = processes.failed.lock().expect("alive");
    assert!(failed.is_empty(), "{failed:?}");
    assert_eq!(here.0, elsewhere.0, "exit codes");
    assert_eq!(here.1.keys().collect::<Vec<_>>(), elsewhere.1.keys().collect::<Vec<_>>());
    assert!(here.1.len() > 10);
    for (path, bytes) in &here.1 {
        assert!(*bytes == elsewhere.1[path], "{} is not the same", path.display());
    }
    assert!(processes.folder.path().is_dir());
    let mut counts = BTreeMap::new();
    for ((function, worker), n) in processes.done.lock().expect("alive").iter() {
        println!("{function}: {n} by process {worker}");
        *counts.entry(*function).or_default() += n;
    }
    (counts, here.0)
}

/// Estimates per maneuver, and one of all of them with everything that a problem can be made of.
#[test]
fn two_processes_make_the_same_bytes() {
    let c = Campaign::new();
    let shift = "y_0 = { unit = \"rad\", start = 0.0, per = \"segment\" }\n";
    let fed = MODEL.replace(shift, "").replace("x =", "y =").replace("- x)", "- y)");
    let fed = fed.replace("x + y_0", "y");
    c.write("fed.model.toml", &fed);
    let more = r#"
[[estimate]]
name = "together"
model = "fed.model.toml"
input = "drive"
group = "all"

[estimate.method]
start = "equation error"
per = { T = "flight" }
noise_per = "flight"
stabilise = { y = 0.5 }
profile = ["K"]

[[estimate]]
name = "candidates"
model = "lag.model.toml"
input = "drive"
group = "flight"

[estimate.method]
candidates = ["y_0"]

[[diagnose]]
estimate = "candidates"

[[fit]]"#;
    c.edit("pipeline.toml", "\n[[fit]]", more);
    for verb in ["run", "diagnose"] {
        let counts = same_bytes(verb, &c.path("pipeline.toml"), &Processes::start(None)).0;
        for function in FUNCTIONS {
            let n = counts.get(function.name).copied().unwrap_or_default();
            assert!(n > 10, "{}: {n} done elsewhere", function.name);
        }
    }
}

/// A flight whose log is no log fails elsewhere as it does here: same notes, same exit code. So do
/// the others when one of the processes is lost over an item, which is then done by somebody else.
#[test]
fn what_fails_and_who_is_lost_change_no_byte() {
    let c = Campaign::new();
    c.write("logs/flight-4.mcap", "not a log");
    let processes = Processes::start(Some(3));
    let (counts, code) = same_bytes("run", &c.path("pipeline.toml"), &processes);
    assert_eq!(code, format!("{:?}", std::process::ExitCode::FAILURE));
    let done = processes.done.lock().expect("alive");
    assert_eq!(done.iter().filter(|((_, w), _)| *w == 0).map(|(_, n)| n).sum::<usize>(), 3);
    assert!(done.iter().any(|((_, w), _)| *w == 1), "{counts:?}");
}

/// Every shipped pipeline whose data are there; `KOEHLER_SLOW=1`.
#[test]
fn two_processes_make_the_same_bytes_of_every_pipeline() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (many minutes in release mode)");
        return;
    }
    let Some(data) = flightdata::data("README.md") else { return };
    let shipped: [(&str, &[&str], &str, &str); 11] = [
        ("citation", &[], "run", "pipeline.toml"),
        ("citation", &[], "run", "ground.toml"),
        ("citation-phlab", &["import.toml"], "run", "pipeline.toml"),
        ("hfb320", &["import.toml"], "run", "pipeline.toml"),
        ("y13aus", &["import.toml"], "run", "pipeline.toml"),
        ("twin-otter", &["import.toml"], "run", "pipeline.toml"),
        ("jsbsim", &[], "run", "flight-path.toml"),
        ("jsbsim", &[], "run", "pipeline.toml"),
        ("attas-real", &["import.toml"], "run", "pipeline.toml"),
        ("attas-real", &["import.toml"], "diagnose", "stall.toml"),
        ("attas", &[], "run", "pipeline.toml"),
    ];
    for (pipeline, imports, verb, file) in shipped {
        let folder = flightdata::copy(pipeline);
        imports.iter().for_each(|i| flightdata::koehler(folder.path(), &data, &["import", i]));
        let made = same_bytes(verb, &folder.path().join(file), &Processes::start(None));
        println!("{pipeline}/{file}: {made:?}");
    }
}
