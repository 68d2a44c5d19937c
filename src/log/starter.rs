//! Logs in; a starter campaign folder (pipeline, channel map, aircraft) to be completed out.

use super::guess::{self, Known};
use super::inspect::{FieldSurvey, Short, Survey, TopicSurvey, survey};
use super::ros_units;
use super::stamps;
use super::starter_texts::{AIRCRAFT, CHANNELS, PIPELINE};
use crate::error::{Error, Errors};
use std::fmt::Write;
use std::path::{Component, Path, PathBuf};

/// Writes `pipeline.toml`, `channels.toml` and `aircraft.toml` to the folder `out`; the text tells
/// the next steps.
///
/// # Errors
/// A log cannot be read; the folder has one of the files already (nothing is overwritten) or cannot
/// be written.
pub fn run(logs: &[PathBuf], out: &Path) -> Result<String, Errors> {
    let mut errors = Errors::default();
    if logs.is_empty() {
        errors.push(Error::new("no log is given").help("koehler init LOG... --out DIR"));
    }
    let surveys: Vec<Survey> = logs.iter().filter_map(|path| errors.take(survey(path))).collect();
    for name in ["pipeline.toml", "channels.toml", "aircraft.toml"] {
        if out.join(name).exists() {
            errors.push(
                Error::new(format!("{} is there already", out.join(name).display()))
                    .help("choose another folder with --out"),
            );
        }
    }
    errors.or(())?;
    let candidates = candidates(&surveys);
    let failed = |e: std::io::Error| {
        Errors::from(Error::new(format!("cannot write to {}: {e}", out.display())))
    };
    std::fs::create_dir_all(out).map_err(failed)?;
    let title = out
        .canonicalize()
        .map_err(failed)?
        .file_name()
        .map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let (channels, open) = channels(&surveys, &candidates);
    for (name, text) in [
        ("channels.toml", channels),
        ("pipeline.toml", pipeline(&title, logs, out, &candidates)),
        ("aircraft.toml", AIRCRAFT.to_string()),
    ] {
        let mut file = tempfile::NamedTempFile::new_in(out).map_err(failed)?;
        std::io::Write::write_all(&mut file, text.as_bytes()).map_err(failed)?;
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            file.as_file()
                .set_permissions(std::fs::Permissions::from_mode(0o644))
                .map_err(failed)?;
        }
        file.persist(out.join(name)).map_err(|e| failed(e.error))?;
    }
    Ok(next_steps(out, &candidates, open))
}

/// A field that may be a signal.
struct Candidate<'a> {
    known: Option<&'static Known>,
    topic: &'a TopicSurvey,
    field: &'a FieldSurvey,
    /// How many of the logs have it.
    logs: usize,
}

/// Every field of every log once; for each well-known signal at most one field (the first by topic
/// and field) carries it.
fn candidates(surveys: &[Survey]) -> Vec<Candidate<'_>> {
    let mut all: Vec<Candidate> = Vec::new();
    for topic in surveys.iter().flat_map(|s| &s.topics) {
        for field in &topic.fields {
            match all
                .iter_mut()
                .find(|c| c.topic.topic == topic.topic && c.field.info.path == field.info.path)
            {
                Some(known) => known.logs += 1,
                None => all.push(Candidate { known: None, topic, field, logs: 1 }),
            }
        }
    }
    let mut taken: Vec<&str> = Vec::new();
    for candidate in &mut all {
        let known = guess::signal_of(&candidate.field.info).filter(|k| !taken.contains(&k.signal));
        taken.extend(known.map(|k| k.signal));
        candidate.known = known;
    }
    all
}

/// The channel map's text, and how many entries are to be completed.
fn channels(surveys: &[Survey], candidates: &[Candidate]) -> (String, usize) {
    let mut text = String::from(CHANNELS);
    text.push_str(&stamps::of(surveys));
    let mut open = 0;
    for known in guess::KNOWN {
        let Some(c) = candidates.iter().find(|c| c.known.is_some_and(|k| k.signal == known.signal))
        else {
            continue;
        };
        let _ = write!(text, "\n[signal.{}]\n", known.signal);
        open += usize::from(entry(&mut text, c, surveys.len(), ""));
        let rivals = candidates.iter().filter(|o| {
            o.known.is_none()
                && guess::signal_of(&o.field.info).is_some_and(|k| k.signal == known.signal)
        });
        for rival in rivals {
            let _ = writeln!(
                text,
                "# or: topic = {}, field = {}",
                quote(&rival.topic.topic),
                quote(&rival.field.info.path)
            );
        }
    }
    let own = own_names(candidates);
    for (c, name) in candidates.iter().zip(&own) {
        if let Some(name) = name {
            let _ = write!(text, "\n[signal.{name}]\n");
            entry(&mut text, c, surveys.len(), "");
        }
    }
    text.push_str("\n# --- the other fields of the logs: take away the \"# \" of the ones you need, and give them a name ---\n");
    let others = candidates.iter().zip(&own).filter(|(c, own)| c.known.is_none() && own.is_none());
    for (i, (c, _)) in others.enumerate() {
        let _ = write!(text, "\n# [signal.field_{}]\n", i + 1);
        entry(&mut text, c, surveys.len(), "# ");
    }
    for topic in surveys.iter().flat_map(|s| &s.topics).filter(|t| !t.decodable) {
        let line = format!(
            "\n# {} cannot be decoded yet ({} messages)",
            quote(&topic.topic),
            quote(&topic.message_encoding)
        );
        if !text.contains(&line) {
            text.push_str(&line);
            text.push('\n');
        }
    }
    (text, open)
}

/// One entry below its header; true where its unit has to be completed.
fn entry(text: &mut String, c: &Candidate, logs: usize, comment: &str) -> bool {
    let f = c.field;
    let range = if f.count > 0 {
        format!("{} .. {} in the log", Short(f.min), Short(f.max))
    } else {
        "no sample in the log".to_string()
    };
    let unit = unit(c);
    let (unit, why) = unit
        .as_ref()
        .map_or(("?", "COMPLETE: unit of the numbers in the log"), |(u, why)| (u.as_str(), *why));
    let doc = if f.info.doc.is_empty() { c.known.map_or("", |k| k.doc) } else { &f.info.doc };
    let only =
        if c.logs < logs { format!(" (in {} of {logs} logs)", c.logs) } else { String::new() };
    let _ = writeln!(
        text,
        "{comment}topic = {}{}",
        quote(&c.topic.topic),
        if only.is_empty() { String::new() } else { format!(" #{only}") }
    );
    let _ = writeln!(text, "{comment}field = {} # {range}", quote(&f.info.path));
    let _ = writeln!(text, "{comment}unit = {} # {why}", quote(unit));
    let _ = writeln!(text, "{comment}doc = {}", quote(doc));
    unit == "?"
}

/// The unit of a field, and where it is from: its schema, its name, or the standard that its message's type
/// keeps to.
fn unit(c: &Candidate) -> Option<(String, &'static str)> {
    let info = &c.field.info;
    let standard = || {
        let unit = ros_units::of(&c.topic.schema_name, &info.path)?;
        Some((unit.to_string(), "as ROS prescribes for this type (REP 103)"))
    };
    guess::unit_of(info).or_else(standard)
}

/// Where no field is known by its name, those with a unit are signals under names of their own, so that the
/// log can be looked at: their paths, and the topic's too where another one has the same.
fn own_names(candidates: &[Candidate]) -> Vec<Option<String>> {
    let plain = |text: &str| {
        let of = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        text.chars().map(of).collect::<String>().trim_matches('_').to_string()
    };
    let whole = |c: &Candidate| plain(&c.field.info.path);
    let name = |c: &Candidate| {
        let twice = candidates.iter().filter(|o| whole(o) == whole(c)).count() > 1;
        let name = if twice { plain(&c.topic.topic) + "_" + &whole(c) } else { whole(c) };
        let begins = name.starts_with(|first: char| first.is_ascii_alphabetic());
        if begins { name } else { format!("f_{name}") }
    };
    let none_known = candidates.iter().all(|c| c.known.is_none());
    let one = |c: &Candidate| (none_known && unit(c).is_some()).then(|| name(c));
    candidates.iter().map(one).collect()
}

/// A TOML string on one line: JSON's escapes are TOML's, but for the one control character that
/// JSON lets through.
fn quote(text: &str) -> String {
    serde_json::Value::from(text).to_string().replace('\u{7f}', "\\u007f")
}

fn pipeline(title: &str, logs: &[PathBuf], out: &Path, candidates: &[Candidate]) -> String {
    // The grid follows the fastest recognised signal.
    let fastest = candidates
        .iter()
        .filter(|c| c.known.is_some())
        .map(|c| c.topic.rate_hz)
        .fold(0.0, f64::max);
    let rate = if fastest > 0.0 { libm::round(fastest).max(1.0) } else { 50.0 };
    let logs: Vec<String> =
        logs.iter().map(|log| format!("    {},\n", quote(&relative(log, out)))).collect();
    let there: Vec<&str> = candidates.iter().filter_map(|c| Some(c.known?.signal)).collect();
    let missing: Vec<&str> =
        guess::INPUTS.into_iter().filter(|name| !there.contains(name)).collect();
    let missing = if missing.is_empty() {
        String::new()
    } else {
        format!(" (not recognised: {})", missing.join(", "))
    };
    PIPELINE
        .replace("{title}", &quote(title))
        .replace("{logs}", &logs.concat())
        .replace("{rate}", &format!("{rate:?}"))
        .replace("{inputs}", &guess::INPUTS.join(", "))
        .replace("{missing}", &missing)
        .replace("{outputs}", &guess::OUTPUTS.join(", "))
}

/// The path of `log` as seen from the folder `out`.
fn relative(log: &Path, out: &Path) -> String {
    let (Ok(log_full), Ok(out_full)) = (log.canonicalize(), out.canonicalize()) else {
        return log.display().to_string();
    };
    let (to, from): (Vec<Component>, Vec<Component>) =
        (log_full.components().collect(), out_full.components().collect());
    let shared = to.iter().zip(&from).take_while(|(a, b)| a == b).count();
    let mut path = PathBuf::new();
    (shared..from.len()).for_each(|_| path.push(".."));
    to.iter().skip(shared).for_each(|c| path.push(c));
    path.display().to_string()
}

fn next_steps(out: &Path, candidates: &[Candidate], open: usize) -> String {
    let out = out.display();
    let recognised: Vec<&str> = candidates.iter().filter_map(|c| Some(c.known?.signal)).collect();
    let mut text = format!("{out}/ is there: pipeline.toml, channels.toml, aircraft.toml\n");
    let own = own_names(candidates).into_iter().flatten().count();
    let _ = match recognised.is_empty() {
        true if own > 0 => writeln!(
            text,
            "No field was recognised by its name; {own} whose units are known are signals under their own names, {} are comments in channels.toml.",
            candidates.len() - own
        ),
        true => {
            writeln!(
                text,
                "No field was recognised by its name; all {} are listed in channels.toml as comments.",
                candidates.len()
            )
        }
        false => writeln!(
            text,
            "Recognised by name: {} (of {} fields).",
            recognised.join(", "),
            candidates.len()
        ),
    };
    let _ = writeln!(text, "Next:");
    let _ = match open {
        0 => writeln!(
            text,
            "  1. look through {out}/channels.toml: units, signs (sign = -1), delays; add the fields you need"
        ),
        n => writeln!(
            text,
            "  1. complete {out}/channels.toml: the units marked \"?\" ({n}); signs (sign = -1), delays; add the fields you need"
        ),
    };
    let _ = writeln!(text, "  2. fill in {out}/aircraft.toml: the constants that your models name");
    let _ = writeln!(
        text,
        "  3. say in {out}/pipeline.toml what is to be found: maneuvers, models, fits"
    );
    let _ = writeln!(
        text,
        "  4. koehler check {out}/pipeline.toml, then koehler run {out}/pipeline.toml"
    );
    text
}
