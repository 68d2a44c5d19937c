//! Hidden-effect trials: does the diagnosis name what was hidden in a campaign that it knows
//! nothing about?
//!
//! A fixed selection is among the tests of every `cargo test`. `KOEHLER_TRIALS=60 cargo test
//! --release --test all -- trials::matrix
//! --nocapture` runs a matrix of 60 trials, `KOEHLER_TRIALS=full` the whole one, `KOEHLER_TRIALS="flap
//! lag#3"` one trial in detail, `"flap#1-9"` all whose name has that in it, with these seeds; `"inside#1"`, `"outside#1-3"`
//! all of a kind; `"inside#1 light 50"` with another aircraft (transport, light, unmanned) at another rate, `"inside#1-3 mixed"` with
//! each of them at 20, 50 and 100 Hz by turns. A matrix keeps every trial that has ended in a file, and goes on from there when
//! it is started again with the same program.

mod aircraft;
mod campaign;
mod company;
mod sensitivity;
mod summary;
mod truth;
mod values;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use aircraft::Aircraft;
use campaign::{Setting, Trial};
use koehler::diagnose::{self, Diagnosis, Subject, Verdict, effect};
use summary::{End, Kind, Row};
use truth::{Hidden, INSIDE, NOTHING, OUTSIDE};

struct Outcome {
    end: End,
    size: f64,
    channel: String,
    amount: f64,
    diagnosis: Diagnosis,
    seconds: f64,
}

/// Hides, flies and diagnoses. `None` where the size wanted cannot be flown.
fn run(hidden: &Hidden, setting: &Setting) -> Option<Outcome> {
    let trial = campaign::trial(hidden, setting)?;
    Some(diagnosed(hidden, setting, &trial, &diagnose::Settings::default()))
}

/// Diagnoses what was flown.
fn diagnosed(
    hidden: &Hidden,
    setting: &Setting,
    trial: &Trial,
    settings: &diagnose::Settings,
) -> Outcome {
    let clock = std::time::Instant::now();
    let (base, method) = (truth::base(setting.aircraft), campaign::method());
    let settings = diagnose::Settings { seed: setting.seed, ..settings.clone() };
    let names: Vec<String> = (0..trial.segments.len()).map(|i| format!("s{i}")).collect();
    let held_out = diagnose::held_out(&trial.segments, &names, &settings).held_out;
    let library = effect::load(&[]).unwrap_or_else(|e| panic!("{e}"));
    let records: Vec<_> = trial.segments.iter().map(|s| &s.record).collect();
    let context = effect::Context::of(&base, &records);
    let (segments, held_out) = (&trial.segments[..], &held_out[..]);
    let subject = Subject {
        model: &base,
        segments,
        held_out,
        method: &method,
        context: &context,
        settings: &settings,
    };
    let offer = |model: &koehler::model::Model, wanted: &effect::Wanted| {
        let offer = effect::candidates_of(model, &context, &library, wanted);
        let skipped = offer.skipped.into_iter().map(|s| (s.effect, s.why)).collect();
        Ok((offer.candidates, skipped))
    };
    let diagnosis = diagnose::diagnose(&subject, &offer, &|_| {})
        .unwrap_or_else(|e| panic!("{}: {e}", hidden.name));
    let end = graded(hidden, setting, &diagnosis);
    Outcome {
        end,
        size: trial.size,
        channel: trial.channel.clone(),
        amount: trial.amount,
        diagnosis,
        seconds: clock.elapsed().as_secs_f64(),
    }
}

/// The classes that were named, one per effect that was added.
fn named(diagnosis: &Diagnosis) -> Vec<Vec<&str>> {
    diagnosis.findings.iter().map(|f| class(diagnosis, f)).collect()
}

/// What was added first, then those that explain the flights as well.
fn class<'d>(diagnosis: &'d Diagnosis, finding: &diagnose::Finding) -> Vec<&'d str> {
    let round = &diagnosis.rounds[finding.round];
    let others = finding.class.iter().copied().filter(|&i| i != finding.added);
    std::iter::once(finding.added).chain(others).map(|i| round.judged[i].name.as_str()).collect()
}

/// Gusts: in turbulent air they are there, whatever else is hidden, and their name is not counted.
const AIR: [&str; 2] = ["vertical-gust", "head-gust"];

fn graded(hidden: &Hidden, setting: &Setting, diagnosis: &Diagnosis) -> End {
    let air = |class: &Vec<&str>| setting.turbulence && class.iter().all(|name| AIR.contains(name));
    let classes: Vec<Vec<&str>> =
        named(diagnosis).into_iter().filter(|class| !air(class)).collect();
    let has_truth = |class: &Vec<&str>| class.iter().any(|name| hidden.is.contains(name));
    match &diagnosis.verdict {
        Verdict::None(_) => End::None,
        // "made smaller by" is no name
        Verdict::Located => End::Located,
        _ if classes.is_empty() => End::Nothing,
        _ if !classes.iter().all(has_truth) => End::Wrong,
        _ if classes.iter().any(|class| class.len() > 3) => End::Broad,
        _ => End::Right,
    }
}

fn kind(hidden: &Hidden) -> Kind {
    match hidden.name {
        name if name == NOTHING.name => Kind::Nothing,
        _ if hidden.is.is_empty() => Kind::Outside,
        _ => Kind::Inside,
    }
}

/// Whether a trial ended as it should.
fn expected(hidden: &Hidden, end: End) -> bool {
    match kind(hidden) {
        Kind::Nothing => end == End::Nothing,
        Kind::Outside => end == End::Located,
        Kind::Inside => end == End::Right,
    }
}

/// Everything there is to know of a trial.
fn story(hidden: &Hidden, setting: &Setting, outcome: &Outcome) -> String {
    let d = &outcome.diagnosis;
    let mut text = format!(
        "{} #{} {} {} Hz {}: amount {:.4}, size {:.2} in {}, {:?}, {} in {:.1} s",
        hidden.name,
        setting.seed,
        setting.aircraft.name,
        setting.rate_hz,
        if setting.turbulence { "turbulence" } else { "calm" },
        outcome.amount,
        outcome.size,
        outcome.channel,
        outcome.end,
        d.verdict.as_str(),
        outcome.seconds
    );
    for round in &d.rounds {
        let _ = write!(
            text,
            "\n {} round, limit {:.1}, base has {}",
            if round.strict { "strict" } else { "search" },
            round.limit,
            round.base.join(" + ")
        );
        let mut order: Vec<_> = round.judged.iter().collect();
        order.sort_by(|a, b| b.score.total_cmp(&a.score));
        for j in order.iter().take(12) {
            let _ = write!(
                text,
                "\n  {} score {:.1} evidence {:.1} {}: {}",
                j.name,
                j.score,
                j.evidence,
                j.standing.as_str(),
                j.why
            );
            if let Some(refit) = &j.refit {
                let values: Vec<String> =
                    refit.values.iter().map(|v| format!("{} {:.4}", v.name, v.value)).collect();
                let held: Vec<String> = refit
                    .held_out
                    .iter()
                    .map(|g| format!("{:.1}/{:.1}", g.realised, g.predicted))
                    .collect();
                let _ = write!(
                    text,
                    "\n     gain {:.1}, {}, held out {}",
                    refit.gain,
                    values.join(", "),
                    held.join(" ")
                );
            }
        }
        for j in round.judged.iter().filter(|j| hidden.is.contains(&j.name.as_str())) {
            let _ = write!(
                text,
                "\n  truth: {} score {:.1} {}: {}",
                j.name,
                j.score,
                j.standing.as_str(),
                j.why
            );
        }
    }
    for l in d.located().take(4) {
        let _ = write!(text, "\n {l:?}");
    }
    text
}

/// What trials are flown with.
#[derive(Debug, Clone, Copy)]
struct With {
    /// None: the three take turns.
    aircraft: Option<&'static Aircraft>,
    /// None: 20, 50 and 100 Hz take turns.
    rate_hz: Option<f64>,
}

impl With {
    /// What is said behind the seeds, "3-9 light 50": aircraft and rate, or "mixed"; the transport at 25 Hz without it.
    fn of(text: &str) -> (&str, With) {
        let mut words = text.split_whitespace();
        let seeds = words.next().unwrap_or("1");
        let mut with = With { aircraft: Some(&aircraft::TRANSPORT), rate_hz: Some(25.0) };
        for word in words {
            match (word, word.parse()) {
                ("mixed", _) => with = With { aircraft: None, rate_hz: None },
                (_, Ok(rate)) => with.rate_hz = Some(rate),
                (name, _) => {
                    let named = aircraft::ALL.into_iter().find(|a| a.name == name);
                    assert!(named.is_some(), "no aircraft {name}: transport, light or unmanned");
                    with.aircraft = named;
                }
            }
        }
        (seeds, with)
    }

    /// `nth`: whose turn it is, where they take turns.
    fn setting(&self, seed: u64, nth: usize, turbulence: bool, size: f64) -> Setting {
        let rates = [20.0, 50.0, 100.0];
        Setting {
            seed,
            turbulence,
            size,
            aircraft: self.aircraft.unwrap_or(aircraft::ALL[nth % 3]),
            rate_hz: self.rate_hz.unwrap_or(rates[nth / 3 % 3]),
        }
    }
}

/// The trials of a matrix: what is hidden, and how.
fn trials(wanted: &str) -> Vec<(&'static Hidden, Setting)> {
    let (name, seeds) = wanted.split_once('#').unwrap_or((wanted, "1"));
    let (range, with) = With::of(seeds);
    let setting = |seed: u64, turn: usize, nth: usize| {
        // sizes from 1 to 4, spread evenly over their logarithm
        let share = ((seed ^ (seed >> 7)).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64
            / (1u64 << 24) as f64;
        with.setting(seed, nth, turn % 2 == 1, 4f64.powf(share))
    };
    // seed by seed, so that the first of them has every effect once
    let of = |all: &'static [Hidden], seeds: u64| {
        let one = |s: u64| {
            all.iter().enumerate().map(move |(i, h)| {
                (h, setting(1000 * i as u64 + s, s as usize + i, s as usize + i))
            })
        };
        (1..=seeds).flat_map(one).collect::<Vec<_>>()
    };
    let nothing = |n: u64| {
        (1..=n)
            .map(|s| (&NOTHING, setting(900_000 + s, s as usize, s as usize)))
            .collect::<Vec<_>>()
    };
    if wanted == "full" {
        // All three side by side, so that what has ended is a sample of the whole at any time.
        let share = |list: Vec<(&'static Hidden, Setting)>| {
            let n = list.len();
            list.into_iter().enumerate().map(move |(i, trial)| (i as f64 / n as f64, trial))
        };
        let mut all: Vec<_> = share(of(INSIDE, 20))
            .chain(share(nothing(200)))
            .chain(share(of(OUTSIDE, 20)))
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        return all.into_iter().map(|(_, trial)| trial).collect();
    }
    if let Ok(n) = wanted.parse::<usize>() {
        let (outside, null) = (n / 8, n / 6);
        let seeds = |all: &[Hidden], n: usize| n.div_ceil(all.len()) as u64;
        let first = |all: &'static [Hidden], n: usize| {
            of(all, seeds(all, n)).into_iter().take(n).collect::<Vec<_>>()
        };
        return [first(INSIDE, n - outside - null), nothing(null as u64), first(OUTSIDE, outside)]
            .concat();
    }
    let (first, last) = range.split_once('-').unwrap_or((range, range));
    let (first, last): (u64, u64) = (first.parse().unwrap_or(1), last.parse().unwrap_or(1));
    let wanted = |h: &&Hidden| match name {
        "inside" => kind(h) == Kind::Inside,
        "outside" => kind(h) == Kind::Outside,
        name => h.name.contains(name),
    };
    let all = INSIDE.iter().chain(OUTSIDE).chain([&NOTHING]).filter(wanted);
    let seeds = |(i, h)| {
        (first..=last).map(move |seed| {
            (h, setting(seed, (seed % 1000 + seed / 1000) as usize, i + seed as usize))
        })
    };
    all.enumerate().flat_map(seeds).collect()
}

/// The gain of the best candidate that passes all tests but that of evidence itself, over what
/// chance gives the best of its round; 0 without one. What a name must have is chosen so that
/// nothing has it where nothing is missing.
fn most(diagnosis: &Diagnosis) -> f64 {
    use diagnose::Standing::{Alike, Beaten, Chosen, Faint};
    let thresholds = diagnose::Thresholds::default();
    let passes = |j: &&diagnose::Judged| matches!(j.standing, Alike | Beaten | Chosen | Faint);
    let of = |r: &diagnose::Round| {
        r.judged
            .iter()
            .filter(passes)
            .map(|j| {
                // Its evidence as a gain, over what chance gives the best of its round.
                let chance = diagnose::chance(j.screened.taken.max(1), thresholds.false_alarm);
                (j.evidence + chance) / (r.limit + chance)
            })
            .fold(0.0, f64::max)
    };
    diagnosis.rounds.iter().map(of).fold(0.0, f64::max)
}

/// How often each effect that came out of the search was chosen from other maneuvers.
fn votes(diagnosis: &Diagnosis) -> Vec<String> {
    let one = |(name, stability): (&str, &diagnose::Stability)| {
        let count = stability.count(name, &diagnose::Settings::default());
        let rivals: Vec<String> =
            count.rivals.iter().map(|(name, n)| format!("{name} {n}")).collect();
        let (own, cast, all) = (count.own, count.cast, stability.votes.len());
        format!("votes for {name}: {own} of {cast} (of {all}); {}", rivals.join(", "))
    };
    let found = diagnosis
        .findings
        .iter()
        .map(|f| (&diagnosis.rounds[f.round].judged[f.added].name[..], &f.stability));
    let unstable = diagnosis.unstable.iter().map(|(name, stability)| (&name[..], stability));
    let votes = found.chain(unstable).map(one);
    let varying = diagnosis.varying.iter().map(|v| format!("{v:?}"));
    let left = diagnosis
        .turbulence
        .iter()
        .filter_map(|t| Some(format!("left: {}", t.objection.as_ref()?)));
    let located = diagnosis.located().take(2);
    let located = located.map(|l| format!("{} responds to {}", l.output, l.source));
    let doubts = diagnosis.doubts.iter().map(|(name, why)| format!("{name}, but {why}"));
    let missed = diagnosis.missed.iter().map(|m| format!("{m:?}"));
    let unphysical = diagnosis.unphysical.iter().chain(&diagnosis.turned).cloned();
    votes
        .chain(varying)
        .chain(unphysical)
        .chain(left)
        .chain(located)
        .chain(doubts)
        .chain(missed)
        .collect()
}

/// Runs a trial and tells it.
fn ended(hidden: &Hidden, setting: &Setting, alone: bool) -> Row {
    let outcome = run(hidden, setting);
    let told = |o: &&Outcome| alone || !expected(hidden, o.end);
    outcome.iter().filter(told).for_each(|o| println!("{}\n", story(hidden, setting, o)));
    let row = row(hidden, setting, outcome.as_ref());
    println!("{}", row.line());
    if let Some(o) = &outcome {
        votes(&o.diagnosis)
            .iter()
            .for_each(|line| println!("{} #{}: {line}", row.hidden, row.seed));
    }
    if let Some(o) = outcome.as_ref().filter(|_| row.kind == Kind::Nothing) {
        println!(
            "{} #{}: gain over that by chance {:.2}",
            row.hidden,
            row.seed,
            most(&o.diagnosis)
        );
    }
    row
}

fn row(hidden: &Hidden, setting: &Setting, outcome: Option<&Outcome>) -> Row {
    let row = Row {
        kind: kind(hidden),
        hidden: hidden.name.to_string(),
        seed: setting.seed,
        turbulence: setting.turbulence,
        size: setting.size,
        channel: String::new(),
        end: End::Unflown,
        names: String::new(),
        seconds: 0.0,
    };
    let Some(o) = outcome else { return row };
    let names: Vec<String> = named(&o.diagnosis).iter().map(|c| c.join("|")).collect();
    Row {
        size: o.size,
        channel: o.channel.clone(),
        end: o.end,
        names: names.join(" then "),
        seconds: o.seconds,
        ..row
    }
}

/// Where the trials of a matrix are kept; none for a selection.
fn kept(wanted: &str) -> Option<PathBuf> {
    let matrix = wanted == "full" || wanted.parse::<usize>().is_ok();
    matrix.then(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("trials-{wanted}.tsv")))
}

/// The program's fingerprint (FNV-1a): what another one has found is not gone on from.
fn program() -> String {
    let bytes = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
    let hash = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    format!("# program {hash:016x}")
}

/// How many trials end between two prints of the totals.
const EVERY: usize = 100;

/// Runs a list of trials, every one on a single thread, as many at once as there are cores; those
/// that `file` has already are taken from it.
fn all(list: &[(&'static Hidden, Setting)], file: Option<&Path>) -> Vec<Row> {
    let program = program();
    let old = file
        .and_then(|file| std::fs::read_to_string(file).ok())
        .filter(|text| text.lines().next() == Some(&program));
    let rows: Vec<Row> =
        old.as_deref().unwrap_or_default().lines().filter_map(Row::parse).collect();
    let has = |(hidden, setting): &&(&Hidden, Setting)| {
        rows.iter().any(|r| r.hidden == hidden.name && r.seed == setting.seed)
    };
    let left: Vec<_> = list.iter().filter(|trial| !has(trial)).collect();
    let mut out = file.map(|file| {
        println!(
            "{} of {} trials are in {} already",
            list.len() - left.len(),
            list.len(),
            file.display()
        );
        let new = std::fs::OpenOptions::new()
            .create(true)
            .append(old.is_some())
            .write(true)
            .truncate(old.is_none())
            .open(file);
        new.unwrap_or_else(|e| panic!("{}: {e}", file.display()))
    });
    if let Some(out) = out.as_mut().filter(|_| old.is_none()) {
        writeln!(out, "{program}").expect("written");
    }
    let (next, done) = (AtomicUsize::new(0), Mutex::new((rows, out)));
    let work = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        while let Some((hidden, setting)) = left.get(next.fetch_add(1, Ordering::SeqCst)) {
            let row = pool.install(|| ended(hidden, setting, list.len() <= 3));
            let (rows, out) = &mut *done.lock().expect("no panic");
            if let Some(out) = out {
                writeln!(out, "{}", row.line()).expect("written");
            }
            rows.push(row);
            if rows.len().is_multiple_of(EVERY) {
                println!("\n{} of {} trials\n{}\n", rows.len(), list.len(), summary::totals(rows));
            }
        }
    };
    std::thread::scope(|scope| (0..cores()).for_each(|_| drop(scope.spawn(work))));
    done.into_inner().expect("no panic").0
}

/// How many trials run at once.
fn cores() -> usize {
    let wanted = std::env::var("RAYON_NUM_THREADS").ok().and_then(|n| n.parse().ok());
    wanted.or(std::thread::available_parallelism().ok().map(usize::from)).unwrap_or(1)
}

#[test]
fn matrix_of_hidden_effects() {
    let wanted = std::env::var("KOEHLER_TRIALS").ok().filter(|wanted| {
        !wanted.starts_with(sensitivity::WANTED)
            && !wanted.starts_with("company")
            && wanted != "votes"
    });
    let Some(wanted) = wanted else {
        println!("skipped: set KOEHLER_TRIALS to 60, full, or the name of what is hidden");
        return;
    };
    let rows = all(&trials(&wanted), kept(&wanted).as_deref());
    println!("\n{}\n\n{}", summary::table(&rows), summary::totals(&rows));
}

/// `KOEHLER_TRIALS=votes`: fifty trials, their votes by one step from the solution and by full fits.
#[test]
fn one_step_chooses_as_full_fits_do() {
    if std::env::var("KOEHLER_TRIALS").as_deref() != Ok("votes") {
        println!("skipped: set KOEHLER_TRIALS=votes (some minutes in release mode)");
        return;
    }
    let list: Vec<_> = trials("inside#62001-62002").into_iter().take(50).collect();
    let (next, counts) = (AtomicUsize::new(0), Mutex::new([0usize; 3]));
    let work = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        while let Some((hidden, setting)) = list.get(next.fetch_add(1, Ordering::SeqCst)) {
            let Some(trial) = campaign::trial(hidden, setting) else { continue };
            let of = |whole_votes: bool| {
                let settings = diagnose::Settings { whole_votes, ..diagnose::Settings::default() };
                cast(pool.install(|| diagnosed(hidden, setting, &trial, &settings)).diagnosis)
            };
            let (step, whole) = (of(false), of(true));
            let same = step.iter().zip(&whole).filter(|(a, b)| a == b).count();
            println!("{} #{}: {same} of {} alike", hidden.name, setting.seed, whole.len());
            let mut all = counts.lock().expect("no panic");
            let more = [same, whole.len(), usize::from(!whole.is_empty())];
            all.iter_mut().zip(more).for_each(|(all, more)| *all += more);
        }
    };
    std::thread::scope(|scope| (0..cores()).for_each(|_| drop(scope.spawn(work))));
    let [same, all, trials] = counts.into_inner().expect("no panic");
    println!("{same} of {all} votes alike, in {trials} trials");
    assert!(trials >= 40 && same as f64 >= 0.95 * all as f64, "{same} of {all}");
}

/// Every vote on what came out of the search.
fn cast(diagnosis: Diagnosis) -> Vec<(String, Option<String>)> {
    let found = diagnosis.findings.into_iter().map(|f| f.stability);
    let unstable = diagnosis.unstable.into_iter().map(|(_, stability)| stability);
    found.chain(unstable).flat_map(|s| s.votes).map(|v| (v.variant, v.chosen)).collect()
}

#[test]
fn a_trial_is_read_as_it_was_written() {
    let row = Row {
        kind: Kind::Outside,
        hidden: "two structural modes".into(),
        seed: 1002,
        turbulence: true,
        size: 1.25,
        channel: "q".into(),
        end: End::Wrong,
        names: "sensor-lag:q|sensor-delay:q then upwash".into(),
        seconds: 3.5,
    };
    assert_eq!(Row::parse(&row.line()), Some(row.clone()));
    let empty = Row { channel: String::new(), names: String::new(), end: End::Unflown, ..row };
    assert_eq!(Row::parse(&empty.line()), Some(empty));
}

/// As `KOEHLER_TRIALS` names them; `#3` and `#9` fly in turbulence.
const SELECTION: [&str; 9] = [
    "late vane#2",
    "flap delay#4",
    "elevator backlash#33015",
    "downwash of the flaps#4",
    "elevator cubic#6",
    "elevator lag#3",
    "nothing#8",
    "nothing#9",
    "two structural modes#2",
];

#[test]
fn recovery_a_selection_of_hidden_effects() {
    for (hidden, setting) in SELECTION.iter().flat_map(|name| trials(name)) {
        let outcome = run(hidden, &setting).expect("it flies");
        println!("{}", story(hidden, &setting, &outcome));
        assert!(expected(hidden, outcome.end), "{}: {:?}", hidden.name, outcome.end);
        if outcome.end == End::Right {
            let whole =
                |c: &&diagnose::Channel| c.held_out && c.segment.is_none() && c.output.is_none();
            let gap = outcome
                .diagnosis
                .comparison
                .channels
                .iter()
                .find(whole)
                .expect("held-out maneuvers together");
            println!("chi-square per sample {} before, {} after", gap.before.chi2, gap.after.chi2);
            assert!(gap.before.chi2 > 1.1 * gap.after.chi2 && (gap.after.chi2 - 1.0).abs() < 0.15);
        }
    }
}

#[test]
fn everything_hidden_has_its_candidates() {
    let base = truth::base(&aircraft::TRANSPORT);
    let offer = effect::candidates(
        &base,
        &effect::Context::default(),
        &effect::load(&[]).unwrap_or_else(|e| panic!("{e}")),
    );
    let names: Vec<&str> = offer.candidates.iter().map(|c| c.name.as_str()).collect();
    for hidden in INSIDE.iter().chain(OUTSIDE) {
        aircraft::ALL.iter().for_each(|aircraft| drop(hidden.model(aircraft)));
        for name in hidden.is {
            assert!(names.contains(name), "{}: there is no candidate {name}", hidden.name);
        }
    }
    assert!(INSIDE.len() >= 24 && OUTSIDE.len() >= 4);
}
