//! The verb design: a study file comes in, the table `designs` and a ranking on the screen go out.

use super::args::PipelineArgs;
use super::run::out_folder;
use super::summary::count;
use super::words::{End, on_threads, print_errors, tell};
use crate::design::{self, Judged, Outcome, Results, Study};
use crate::error::Errors;
use crate::guard;
use crate::table::{write_atomic, write_part};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// `koehler design`
pub fn design(
    study: &Path,
    out: Option<PathBuf>,
    jobs: Option<usize>,
    force: bool,
) -> Result<End, Errors> {
    let out = out_folder(&PipelineArgs { pipeline: study.to_path_buf(), out });
    guard::folder(&out, force)?;
    let study = Study::load(study)?;
    let bar = std::io::stderr().is_terminal().then(bar);
    let watch = |done: usize, of: usize| {
        if let Some(bar) = &bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
    };
    let results = on_threads(jobs, || design::run(&study, &watch))??;
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    guard::mark(&out)?;
    let path = write_part(&out, &design::designs(&results)?, None, 0)?;
    let page = out.join("figures.html");
    write_atomic(&page, design::page(&study, &results)?.as_bytes())?;
    print_errors(&results.errors);
    print(&study, &results);
    tell(&format!("\nfigures: {}", page.display()));
    tell(&format!("table: {}", path.display()));
    Ok(if results.errors.is_empty() { End::Complete } else { End::Partial })
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::new(0);
    if let Ok(style) =
        ProgressStyle::with_template("{prefix:<12} {bar:30} {pos:>5}/{len} {elapsed:>4}")
    {
        bar.set_style(style);
    }
    bar.set_prefix("design");
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}

/// The designs of each estimate by rank, each with a bar as long as its trace.
fn print(study: &Study, results: &Results) {
    tell(&study.settings.title);
    for judged in &results.estimates {
        let mut order: Vec<&Judged> = judged.iter().collect();
        order.sort_by_key(|j| j.rank.unwrap_or(usize::MAX));
        let name = order.first().map_or("", |j| j.estimate.as_str());
        tell(&format!(
            "\n{name}: {}, {} each; ranked by the trace of the Cramer-Rao bound, or by the squared error where that is beyond it",
            count(judged.len(), "design"),
            count(study.settings.seeds as usize, "recording"),
        ));
        tell(&format!(
            "{:>4}  {:<10} {:<42} {:>9} {:>9} {:>8} {:>6} {:>6} {:>6} {:>6}",
            "", "", "", "", "squared", "airspeed", "pitch", "alpha", "load", "servo"
        ));
        tell(&format!(
            "{:>4}  {:<10} {:<42} {:>9} {:>9} {:>8} {:>6} {:>6} {:>6} {:>6}",
            "rank", "design", "", "trace", "error", "m/s", "deg", "deg", "factor", "A"
        ));
        let largest = judged.iter().map(|j| j.trace).filter(|t| t.is_finite()).fold(0.0, f64::max);
        order.iter().for_each(|j| tell(&line(j, largest)));
    }
    for text in moved(results) {
        tell(&text);
    }
    if let Some(found) = &results.found {
        tell(&format!("\n{}", found.words()));
    }
    let lost = results.errors.0.len();
    if lost > 0 {
        tell(&format!("\n{} could not be flown", count(lost, "design")));
    }
}

fn line(judged: &Judged, largest: f64) -> String {
    const WIDTH: f64 = 30.0;
    let rank = judged.rank.map_or("-".to_string(), |r| r.to_string());
    let head = format!("{rank:>4}  {:<10} {:<42}", judged.design.name, judged.design.words());
    let x = judged.facts.as_ref().map_or([f64::NAN; 6], |f| f.excursions.0);
    let shown = |value: f64, digits: usize| {
        if value.is_finite() { format!("{value:.digits$}") } else { "-".to_string() }
    };
    let small =
        |value: f64| if value.is_finite() { format!("{value:.3e}") } else { "-".to_string() };
    let (trace, error) = (small(judged.trace), small(judged.squared_error));
    let numbers = format!(
        "{trace:>9} {error:>9} {:>8} {:>6} {:>6} {:>6} {:>6}",
        shown(x[0], 2),
        shown(x[1].to_degrees(), 1),
        shown(x[4].to_degrees(), 1),
        shown(x[3], 2),
        shown(x[5], 2)
    );
    let bar = match judged.outcome {
        Outcome::Determined if !judged.why.is_empty() => judged.why.clone(),
        Outcome::Determined => {
            "#".repeat((WIDTH * judged.trace / largest).round().max(1.0) as usize)
        }
        other if judged.why.is_empty() => other.word().to_string(),
        other => format!("{}: {}", other.word(), judged.why),
    };
    format!("{head} {numbers}  {bar}").trim_end().to_string()
}

/// The designs that have another rank under another estimate than under the first.
fn moved(results: &Results) -> Vec<String> {
    let Some((first, others)) = results.estimates.split_first() else { return Vec::new() };
    let of = |other: &Vec<Judged>| {
        let pairs = first.iter().zip(other).filter(|(a, b)| a.rank != b.rank);
        let rank = |j: &Judged| j.rank.map_or("-".to_string(), |r| r.to_string());
        let moved: Vec<String> =
            pairs.map(|(a, b)| format!("{} {} -> {}", a.design.name, rank(a), rank(b))).collect();
        let [a, b] = [first, other].map(|all| all.first().map_or("", |j| j.estimate.as_str()));
        if moved.is_empty() {
            format!("\nno design has another rank under {b} than under {a}")
        } else {
            let n = count(moved.len(), "design");
            format!("\nother ranks under {b} than under {a} ({n}): {}", moved.join(", "))
        }
    };
    others.iter().map(of).collect()
}
