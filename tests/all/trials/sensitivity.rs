//! The thresholds of a diagnosis, each halved and doubled, in; what becomes of a selection of
//! trials, as the table of `docs/thresholds.md`, out.
//!
//! `KOEHLER_TRIALS=thresholds cargo test --release --test all -- trials::sensitivity
//! --nocapture` runs all of them, `KOEHLER_TRIALS=thresholds:name_factor,apart` some. What has ended is kept in `target/tmp/trials-thresholds.tsv`,
//! and gone on from with the same program.

use std::io::Write as _;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use koehler::diagnose::{Settings, Thresholds};

use super::campaign::{self, Setting, Trial};
use super::summary::{End, Kind, Row};
use super::truth::Hidden;

/// What `KOEHLER_TRIALS` begins with for this.
pub const WANTED: &str = "thresholds";

/// Besides the selection: campaigns with nothing missing, and what is too faint for a name as often
/// as not.
const BESIDES: [&str; 3] = ["nothing#905001-905004", "scale of az#5", "drift of theta#3"];

/// What is described beside the verdict and cannot change it.
const DESCRIBING: [&str; 10] = [
    "feedback",
    "half_window",
    "repeats",
    "distinguishable",
    "longest_lag",
    "relation_p",
    "coherence_bands",
    "gap_bands",
    "gap_times",
    "moving",
];

/// Settings that users have, changed in the same way.
const SETTINGS: [&str; 8] = [
    "1 - quantile",
    "surrogates",
    "refits",
    "effects",
    "decisive",
    "apart",
    "hold_every",
    "block_s",
];

/// Settings with one number multiplied; none where it has no such value (every maneuver held out).
fn scaled(name: &str, by: f64) -> Option<Settings> {
    let mut settings = Settings::default();
    let count = |n: usize| ((n as f64 * by).round() as usize).max(1);
    match name {
        "1 - quantile" => settings.quantile = 1.0 - by * (1.0 - settings.quantile),
        "surrogates" => settings.surrogates = count(settings.surrogates),
        "refits" => settings.refits = count(settings.refits),
        "effects" => settings.effects = count(settings.effects),
        "decisive" => settings.decisive *= by,
        "apart" => settings.apart *= by,
        "hold_every" => settings.hold_every = count(settings.hold_every),
        "block_s" => settings.block_s *= by,
        name => settings.thresholds = settings.thresholds.scaled(name, by)?,
    }
    settings.faults().is_empty().then_some(settings)
}

/// All numbers that a run asks about, in the order of the documents.
fn names() -> Vec<String> {
    let all = Thresholds::default()
        .told()
        .into_iter()
        .map(|told| told.0)
        .filter(|name| !DESCRIBING.contains(name));
    all.chain(SETTINGS).map(String::from).collect()
}

/// A change of one number and one trial under it.
struct Job {
    name: String,
    by: f64,
    trial: usize,
}

/// One that ended.
#[derive(Debug, Clone, PartialEq)]
struct Ended {
    name: String,
    by: f64,
    row: Row,
}

impl Ended {
    fn line(&self) -> String {
        format!("{}\t{}\t{}", self.name, self.by, self.row.line())
    }

    fn parse(line: &str) -> Option<Ended> {
        let mut fields = line.splitn(3, '\t');
        let (name, by) = (fields.next()?.to_string(), fields.next()?.parse().ok()?);
        Some(Ended { name, by, row: Row::parse(fields.next()?)? })
    }
}

type Flown = (&'static Hidden, Setting, Option<Trial>);

/// Flies everything, a trial per core.
fn fly() -> Vec<Flown> {
    let all: Vec<(&'static Hidden, Setting)> =
        super::SELECTION.iter().chain(&BESIDES).flat_map(|name| super::trials(name)).collect();
    let flown: Vec<Mutex<Option<Trial>>> = all.iter().map(|_| Mutex::new(None)).collect();
    side_by_side(all.len(), &|i| {
        *flown[i].lock().expect("no panic") = campaign::trial(all[i].0, &all[i].1)
    });
    let flown = flown.into_iter().map(|trial| trial.into_inner().expect("no panic"));
    all.into_iter().zip(flown).map(|((hidden, setting), trial)| (hidden, setting, trial)).collect()
}

/// Calls `of` for every number below `n`, each on one thread, as many at once as there are cores.
fn side_by_side(n: usize, of: &(dyn Fn(usize) + Sync)) {
    let next = AtomicUsize::new(0);
    let work = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        loop {
            let i = next.fetch_add(1, Ordering::SeqCst);
            if i >= n {
                break;
            }
            pool.install(|| of(i));
        }
    };
    std::thread::scope(|scope| (0..super::cores()).for_each(|_| drop(scope.spawn(work))));
}

/// Runs what has not ended already.
fn run(jobs: &[Job], flown: &[Flown], file: &Path) -> Vec<Ended> {
    let program = super::program();
    let old =
        std::fs::read_to_string(file).ok().filter(|text| text.lines().next() == Some(&program));
    let known: Vec<Ended> =
        old.as_deref().unwrap_or_default().lines().filter_map(Ended::parse).collect();
    let same = |job: &Job, e: &Ended| {
        let (hidden, setting, _) = &flown[job.trial];
        e.name == job.name
            && e.by == job.by
            && e.row.hidden == hidden.name
            && e.row.seed == setting.seed
    };
    let left: Vec<&Job> = jobs.iter().filter(|job| !known.iter().any(|e| same(job, e))).collect();
    let open = std::fs::OpenOptions::new()
        .create(true)
        .append(old.is_some())
        .write(true)
        .truncate(old.is_none())
        .open(file);
    let mut out = open.unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    if old.is_none() {
        writeln!(out, "{program}").expect("written");
    }
    println!(
        "{} of {} runs are in {} already",
        jobs.len() - left.len(),
        jobs.len(),
        file.display()
    );
    let done = Mutex::new((known, out));
    side_by_side(left.len(), &|i| {
        let job = left[i];
        let (hidden, setting, trial) = &flown[job.trial];
        let settings = scaled(&job.name, job.by).unwrap_or_default();
        let outcome =
            trial.as_ref().map(|trial| super::diagnosed(hidden, setting, trial, &settings));
        let ended = Ended {
            name: job.name.clone(),
            by: job.by,
            row: super::row(hidden, setting, outcome.as_ref()),
        };
        let (rows, out) = &mut *done.lock().expect("no panic");
        println!("{}", ended.line());
        writeln!(out, "{}", ended.line()).expect("written");
        rows.push(ended);
    });
    done.into_inner().expect("no panic").0
}

/// How many trials of one change are right, wrong, located, and nulls that name something; and
/// those that ended otherwise than unchanged.
fn cell(rows: &[&Row], unchanged: &[&Row]) -> String {
    let count =
        |kind: Kind, end: End| rows.iter().filter(|r| r.kind == kind && r.end == end).count();
    let inside = rows.iter().filter(|r| r.kind == Kind::Inside).count();
    let wrong = rows.iter().filter(|r| r.kind != Kind::Nothing && r.end == End::Wrong).count();
    let nulls = rows.iter().filter(|r| r.kind == Kind::Nothing);
    let (named, nulls) = (
        nulls.clone().filter(|r| !matches!(r.end, End::Nothing | End::Located | End::None)).count(),
        nulls.count(),
    );
    let changed = rows.iter().filter_map(|r| {
        let before = unchanged.iter().find(|u| u.hidden == r.hidden && u.seed == r.seed)?;
        let names = if r.names.is_empty() { String::new() } else { format!(" `{}`", r.names) };
        (before.end != r.end)
            .then(|| format!("{}#{} {}{names}", r.hidden, r.seed, super::summary::word(r.end)))
    });
    let changed: Vec<String> = changed.collect();
    let counts = format!(
        "{}/{inside} right, {wrong} wrong, {named}/{nulls} nulls named",
        count(Kind::Inside, End::Right)
    );
    match (changed.is_empty(), std::ptr::eq(rows, unchanged)) {
        (_, true) => counts,
        (true, _) => "the same".to_string(),
        (false, _) => format!("{counts}: {}", changed.join(", ").replace('|', " or ")),
    }
}

/// The table of the document.
fn table(names: &[String], ended: &[Ended]) -> String {
    let of = |name: &str, by: f64| -> Vec<&Row> {
        ended.iter().filter(|e| e.name == name && e.by == by).map(|e| &e.row).collect()
    };
    let unchanged = of("unchanged", 1.0);
    let mut text = format!(
        "Unchanged: {}\n\n| threshold | halved | doubled |\n|---|---|---|\n",
        cell(&unchanged, &unchanged)
    );
    for name in names {
        let cell = |by: f64| match scaled(name, by) {
            None => "no such value".to_string(),
            Some(_) => cell(&of(name, by), &unchanged),
        };
        text += &format!("| `{name}` | {} | {} |\n", cell(0.5), cell(2.0));
    }
    text
}

#[test]
fn sensitivity_of_verdicts_to_thresholds() {
    let wanted = std::env::var("KOEHLER_TRIALS").unwrap_or_default();
    let Some(wanted) = wanted.strip_prefix(WANTED) else {
        println!(
            "skipped: set KOEHLER_TRIALS=thresholds, or thresholds:name,name (an hour of two cores in release mode for all)"
        );
        return;
    };
    let wanted: Vec<&str> =
        wanted.trim_start_matches(':').split(',').filter(|name| !name.is_empty()).collect();
    let mut names = names();
    let unknown: Vec<&&str> =
        wanted.iter().filter(|name| !names.iter().any(|n| n == *name)).collect();
    assert!(unknown.is_empty(), "no such thresholds: {unknown:?}; there are {names:?}");
    names.retain(|name| wanted.is_empty() || wanted.contains(&name.as_str()));
    let flown = fly();
    let trials = |name: &str, by: f64| {
        let name = name.to_string();
        (0..flown.len()).map(move |trial| Job { name: name.clone(), by, trial }).collect::<Vec<_>>()
    };
    let changes = names.iter().flat_map(|name| [0.5, 2.0].map(|by| (name.as_str(), by)));
    let changes = changes.filter(|(name, by)| scaled(name, *by).is_some());
    let jobs: Vec<Job> = trials("unchanged", 1.0)
        .into_iter()
        .chain(changes.flat_map(|(name, by)| trials(name, by)))
        .collect();
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("trials-thresholds.tsv");
    println!("\n{}", table(&names, &run(&jobs, &flown, &file)));
}

#[test]
fn every_threshold_is_in_the_document() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/thresholds.md");
    let document =
        std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let told =
        |(name, value, unit): (&str, String, &str)| format!("| `{name}` | {value} | {unit} |");
    let rows: Vec<String> = Thresholds::default().told().into_iter().map(told).collect();
    let missing: Vec<&String> =
        rows.iter().filter(|row| !document.contains(row.as_str())).collect();
    assert!(missing.is_empty(), "docs/thresholds.md should say\n{}", rows.join("\n"));
}
