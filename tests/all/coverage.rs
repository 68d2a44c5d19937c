//! Do the intervals of the main job cover the truth? The shipped Citation campaign, recorded again
//! with other sensor errors, goes from its logs through every stage; the truth is looked at here
//! alone.
//!
//! The slow test needs `KOEHLER_SLOW=1` (`.ci/run` sets it, in release mode). `KOEHLER_SEEDS`
//! chooses another number of campaigns.

use koehler::math::distribution::{f_quantile, t_quantile};
use koehler::pipeline::{Plan, Store, run};
use koehler::simulate::{Campaign, Truth, write_log};
use koehler::table::{Table, read_dataset};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The lines of citation Eqs. 8 to 11, 14 and 18 to 21: estimate, coefficient, slope (1/rad) and
/// intercept.
const LINES: [(&str, &str, f64, f64); 9] = [
    ("elevator", "C_h_delta", -0.3717, -0.3189),
    ("elevator", "C_h_deltadot", -0.094, -0.017),
    ("elevator", "C_h_alpha", -0.4229, -0.0107),
    ("elevator", "C_h_alphadot", -0.0333, -0.0072),
    ("elevator", "C_h_0", -0.39, 0.0216),
    ("aileron", "C_ha_delta", -0.705, -0.0795),
    ("aileron", "C_ha_deltadot", -0.121, -0.0065),
    ("aileron", "C_ha_alpha", -0.120, -0.0159),
    ("aileron", "C_ha_beta", -0.3095, 0.0591),
];

/// Whether only the simulation reads a file of the campaign.
fn is_of_the_truth(name: &str) -> bool {
    let parts = ["truth", "aerodynamics", "controls", "mechanics", "leveller", "pilot", "campaign"];
    parts.iter().any(|part| name.contains(part))
}

fn campaign_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation")
}

/// What one recorded campaign says.
struct Outcome {
    /// Per line: joint statistic over its 95% quantile, and whether the whole truth line is inside
    /// the simultaneous band (Working-Hotelling) at 1 - 0.05/9.
    joint: [(f64, bool); LINES.len()],
    /// Per coefficient: (estimate - truth) / sd of every maneuver.
    normed: [Vec<f64>; LINES.len()],
    /// The same for slope and intercept of the elevator's lines in one fit of all maneuvers.
    one_fit: Vec<(String, f64)>,
    maneuvers: usize,
}

impl Outcome {
    /// A line as soon as it is known: all of them take hours.
    fn print(&self, seed: u64) {
        let statistics: Vec<String> = self.joint.iter().map(|(j, _)| format!("{j:.2}")).collect();
        let z = t_quantile(0.975, 1e6);
        let errors: Vec<f64> = self.one_fit.iter().map(|(_, e)| *e).collect();
        let inside = errors.iter().filter(|e| e.abs() <= z).count();
        let lines = statistics.join(" ");
        println!("seed {seed}: lines {lines}; one fit {inside} of {}", errors.len());
    }
}

/// Copies the campaign's files without its simulation and report, records the truth with `seed`,
/// and runs the pipeline.
fn analyse(campaign: &Campaign, truths: &[Truth], seed: u64) -> Outcome {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for entry in std::fs::read_dir(campaign_folder()).expect("the campaign").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".toml") && !is_of_the_truth(&name) {
            std::fs::copy(entry.path(), folder.path().join(&name)).expect("copied");
        }
    }
    let pipeline =
        std::fs::read_to_string(campaign_folder().join("pipeline.toml")).expect("the pipeline");
    std::fs::write(folder.path().join("pipeline.toml"), without_pictures(&pipeline))
        .expect("written");
    for truth in truths {
        let recording = campaign.record(truth, seed).expect("recorded");
        write_log(
            &recording,
            &folder.path().join(format!("logs/{}.mcap", truth.flight)),
            "koehler",
        )
        .expect("a log");
    }
    let plan = Plan::read(&folder.path().join("pipeline.toml")).unwrap_or_else(|e| panic!("{e}"));
    let out = folder.path().join("out");
    let result =
        run(&plan, &Store::open(&out), &koehler::engine::Threads, &|_| {}, &Default::default())
            .unwrap_or_else(|e| panic!("{e}"));
    let lost: Vec<_> =
        result.notes.iter().filter(|n| n.severity == koehler::stage::Severity::Missing).collect();
    assert!(result.complete(), "seed {seed}: {lost:?} {}", result.errors);
    judge(&out, truths)
}

/// The pipeline's estimates and lines: neither simulated nor drawn, and nothing validated.
fn without_pictures(pipeline: &str) -> String {
    let mut pipeline: toml::Table = toml::from_str(pipeline).expect("TOML");
    ["simulate", "figure", "validate", "report"].iter().for_each(|key| drop(pipeline.remove(*key)));
    let estimates = pipeline["estimate"].as_array_mut().expect("estimates");
    estimates.retain(|e| e["name"].as_str() != Some("aileron-short"));
    toml::to_string(&pipeline).expect("text")
}

fn table(out: &Path, name: &str) -> Table {
    read_dataset(out, name).unwrap_or_else(|e| panic!("{e}"))
}

/// True values of the coefficients at the maneuver that covers `t`.
fn truth_at(truths: &[Truth], flight: &str, t: f64) -> BTreeMap<String, f64> {
    let truth = truths.iter().find(|x| x.flight == flight).expect("a flight");
    truth.at(t).into_iter().map(|(name, value)| (name.to_string(), value)).collect()
}

fn judge(out: &Path, truths: &[Truth]) -> Outcome {
    let (fits, estimates, segments) =
        (table(out, "fits"), table(out, "estimates"), table(out, "segments"));
    let mut joint = [(f64::NAN, false); LINES.len()];
    let text = |column: &str| fits.strings(column).unwrap();
    let (of, parameters, against) = (text("model"), text("parameter"), text("against"));
    for (k, (model, name, slope, intercept)) in LINES.iter().enumerate() {
        let row = (0..fits.rows())
            .find(|&i| of[i] == *model && parameters[i] == *name && against[i] == "alpha")
            .unwrap_or_else(|| panic!("no line of {name}"));
        let get = |column: &str| fits.f64(column).unwrap()[row];
        let dof = fits.i64("n").unwrap()[row] as f64 - 2.0;
        let (ds, di) = (get("slope") - slope, get("intercept") - intercept);
        let (vs, vi, c) = (get("slope_sd").powi(2), get("intercept_sd").powi(2), get("covariance"));
        let statistic = (di * di * vs - 2.0 * ds * di * c + ds * ds * vi) / (vs * vi - c * c) / 2.0;
        let width = (2.0 * f_quantile(1.0 - 0.05 / LINES.len() as f64, 2.0, dof)).sqrt();
        let inside = (0..=20).all(|i| {
            let x = get("x_min") + f64::from(i) / 20.0 * (get("x_max") - get("x_min"));
            (di + ds * x).abs() <= width * (vi + 2.0 * x * c + x * x * vs).sqrt()
        });
        joint[k] = (statistic / f_quantile(0.95, 2.0, dof), inside);
    }
    let (ids, flights) =
        (segments.strings("segment").unwrap(), segments.strings("flight").unwrap());
    let starts = segments.f64("t_start_s").unwrap();
    let mut normed: [Vec<f64>; LINES.len()] = Default::default();
    let models = estimates.strings("model").unwrap();
    let (names, of) =
        (estimates.strings("parameter").unwrap(), estimates.opt_strings("segment").unwrap());
    let groups = estimates.strings("group").unwrap();
    let (values, sds) = (estimates.f64("value").unwrap(), estimates.f64("sd").unwrap());
    for row in 0..estimates.rows() {
        let line = LINES.iter().position(|l| l.0 == models[row] && l.1 == names[row]);
        let Some(k) = line else { continue };
        let id = of[row].unwrap_or(groups[row]);
        let segment = ids.iter().position(|s| *s == id).expect("a segment");
        let truth = truth_at(truths, flights[segment], starts[segment] + 1.0);
        normed[k].push((values[row] - truth[&format!("{}_true", names[row])]) / sds[row]);
    }
    let maneuvers = normed[0].len();
    let one_fit = (0..estimates.rows())
        .filter(|&row| models[row] == "elevator-lines")
        .filter_map(|row| {
            Some((names[row].to_string(), (values[row] - line_truth(names[row])?) / sds[row]))
        })
        .collect();
    Outcome { joint, normed, one_fit, maneuvers }
}

/// What `C_h_delta_slope` and `C_h_delta_0`, and their like, are in truth.
fn line_truth(name: &str) -> Option<f64> {
    LINES.iter().find_map(|(_, of, slope, intercept)| match name.strip_prefix(of)? {
        "_slope" => Some(*slope),
        "_0" => Some(*intercept),
        _ => None,
    })
}

/// The truth flights: one motion, recorded again for every seed.
fn fly() -> (Campaign, Vec<Truth>) {
    let campaign =
        Campaign::load(&campaign_folder().join("campaign.toml")).unwrap_or_else(|e| panic!("{e}"));
    let ids: Vec<String> = campaign.flights().iter().map(|f| f.to_string()).collect();
    let truths =
        ids.par_iter().map(|id| campaign.truth(id).unwrap_or_else(|e| panic!("{e}"))).collect();
    (campaign, truths)
}

/// One campaign per core at a time, each on a single thread: whole campaigns that waited for each
/// other would pile up in memory.
fn analyse_all(campaign: &Campaign, truths: &[Truth], seeds: u64) -> Vec<Outcome> {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let worker = |first: u64| -> Vec<(u64, Outcome)> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        (first..seeds)
            .step_by(cores as usize)
            .map(|seed| (seed, pool.install(|| analyse(campaign, truths, 1000 + seed))))
            .inspect(|(seed, outcome)| outcome.print(1000 + seed))
            .collect()
    };
    let mut outcomes: Vec<(u64, Outcome)> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..cores).map(|first| scope.spawn(move || worker(first))).collect();
        handles.into_iter().flat_map(|h| h.join().expect("a campaign failed")).collect()
    });
    outcomes.sort_by_key(|(seed, _)| *seed);
    outcomes.into_iter().map(|(_, outcome)| outcome).collect()
}

#[test]
fn recovery_coverage_of_the_citation_campaign() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (about ten minutes in release mode on two cores)");
        return;
    }
    let seeds: u64 =
        std::env::var("KOEHLER_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(100);
    let (campaign, truths) = fly();
    let outcomes = analyse_all(&campaign, &truths, seeds);
    let n = outcomes.len() as f64;
    println!("{seeds} campaigns, {} maneuvers each", outcomes[0].maneuvers);
    println!(
        "{:<14} {:>10} {:>12} {:>10} {:>10} {:>10}",
        "line", "joint 95%", "in the band", "maneuvers", "mean/sd", "rms/sd"
    );
    let z = t_quantile(0.975, 1e6);
    let (mut lines, mut points, mut all_points) = (Vec::new(), 0.0, 0.0);
    for (k, (_, name, ..)) in LINES.iter().enumerate() {
        let covered = outcomes.iter().filter(|o| o.joint[k].0 <= 1.0).count();
        let band = outcomes.iter().filter(|o| o.joint[k].1).count();
        let normed: Vec<f64> = outcomes.iter().flat_map(|o| o.normed[k].iter().copied()).collect();
        let m = normed.len() as f64;
        let inside = normed.iter().filter(|v| v.abs() <= z).count() as f64;
        let (mean, square) =
            (normed.iter().sum::<f64>() / m, normed.iter().map(|v| v * v).sum::<f64>() / m);
        println!(
            "{name:<14} {covered:>10} {band:>12} {:>9.2}% {mean:>10.3} {:>10.3}",
            100.0 * inside / m,
            square.sqrt()
        );
        lines.push(covered as f64);
        points += inside;
        all_points += m;
    }
    let (pooled_lines, pooled_points) =
        (lines.iter().sum::<f64>() / (lines.len() as f64 * n), points / all_points);
    let mut one_fit: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, error) in outcomes.iter().flat_map(|o| &o.one_fit) {
        one_fit.entry(name).or_default().push(*error);
    }
    let inside = |errors: &[f64]| errors.iter().filter(|e| e.abs() <= z).count() as f64;
    for (name, errors) in &one_fit {
        let mean = errors.iter().sum::<f64>() / n;
        println!("one fit: {name:<18} {:>5} of {n} mean/sd {mean:>6.2}", inside(errors));
    }
    let pooled_one: f64 = one_fit.values().map(|e| inside(e)).sum::<f64>() / (10.0 * n);
    println!(
        "pooled: lines {:.2}%, maneuvers {:.2}%, one fit {:.2}%",
        100.0 * pooled_lines,
        100.0 * pooled_points,
        100.0 * pooled_one
    );
    for (covered, (_, name, ..)) in lines.iter().zip(&LINES) {
        assert!(
            (0.88..=1.0).contains(&(covered / n)),
            "{name}: the joint region covers {covered} of {n}"
        );
    }
    assert!((0.93..=0.97).contains(&pooled_lines), "all lines pooled: {pooled_lines}");
    assert!((0.93..=0.97).contains(&pooled_one), "slopes and intercepts in one fit: {pooled_one}");
    assert!((0.93..=0.97).contains(&pooled_points), "all maneuvers pooled: {pooled_points}");
}

/// All files below a folder with their bytes, without the pipeline's own records.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut out, mut open) = (BTreeMap::new(), vec![folder.to_path_buf()]);
    while let Some(dir) = open.pop() {
        for entry in std::fs::read_dir(dir).expect("a folder").flatten() {
            let path = entry.path();
            if entry.file_name() == ".koehler" {
                continue;
            } else if path.is_dir() {
                open.push(path);
            } else {
                out.insert(
                    path.strip_prefix(folder).expect("below").to_path_buf(),
                    std::fs::read(&path).expect("readable"),
                );
            }
        }
    }
    out
}

#[test]
fn recovery_coverage_needs_no_truth_file() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (half a minute in release mode)");
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    for entry in std::fs::read_dir(campaign_folder())
        .expect("the campaign")
        .flatten()
        .filter(|e| e.path().is_file())
    {
        std::fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("copied");
    }
    let pipeline = folder.path().join("pipeline.toml");
    let analyse = |out: &str| {
        let plan = Plan::read(&pipeline).unwrap_or_else(|e| panic!("{e}"));
        if let Some(simulation) = &plan.simulation {
            simulation.fly(&simulation.missing, &|_| {}).unwrap_or_else(|e| panic!("{e}"));
        }
        let out = folder.path().join(out);
        let result =
            run(&plan, &Store::open(&out), &koehler::engine::Threads, &|_| {}, &Default::default())
                .unwrap_or_else(|e| panic!("{e}"));
        assert!(result.complete(), "{}", result.errors);
        contents(&out)
    };
    let with = analyse("with");
    let truth = folder.path().join("truth");
    assert!(truth.is_dir(), "the simulation left no truth to delete");
    std::fs::remove_dir_all(truth).expect("deleted");
    for entry in std::fs::read_dir(folder.path()).expect("the campaign").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".model.toml") && is_of_the_truth(&name) {
            std::fs::remove_file(entry.path()).expect("deleted");
        }
    }
    let without = analyse("without");
    assert!(with.len() > 20);
    assert!(with.keys().eq(without.keys()));
    for (path, bytes) in &with {
        assert!(*bytes == without[path], "{} differs without the truth files", path.display());
    }
}
