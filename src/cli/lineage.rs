//! The verb lineage: a file of an output folder comes in; what it was made from goes out, in words or
//! as JSON.

use super::args::Form;
use super::words::{End, document, say};
use crate::error::Errors;
use crate::pipeline::{self, Lineage, named, shown};
use serde_json::Value;
use std::path::Path;

/// Characters of the hash of a stage's sources that are shown.
const CODE: usize = 12;

/// Characters of a setting's value that are shown.
const VALUE: usize = 120;

/// `koehler lineage`
pub fn lineage(file: &Path, form: Form) -> Result<End, Errors> {
    let lineage = pipeline::lineage(file)?;
    if form.json {
        document(&lineage)?;
        return Ok(End::Complete);
    }
    say("file");
    lineage.files.iter().for_each(|(path, hash)| say(&format!("  {path}  {hash}")));
    say("made by, last stage first");
    stages(&lineage);
    say("from the logs");
    logs(&lineage);
    say(&format!("settings files of the last run of {}", lineage.pipeline));
    lineage.settings.iter().for_each(|(path, hash)| say(&format!("  {path}  {hash}")));
    for outdated in &lineage.outdated {
        say(&format!("outdated: {outdated}"));
    }
    Ok(End::Complete)
}

fn stages(lineage: &Lineage) {
    for step in lineage.stages.iter().rev() {
        let code: String = step.code.chars().take(CODE).collect();
        let by = match &step.version {
            Some(version) => format!("koehler {version}"),
            None => "an earlier koehler".to_string(),
        };
        say(&format!("  {} of {} ({by}, sources {code})", step.stage, named(&step.units)));
        match &step.settings {
            Some(settings) => settings
                .iter()
                .filter(|(_, value)| !is_empty(value))
                .for_each(|(name, value)| say(&format!("    {name}: {}", shown(value, VALUE)))),
            None => say("    values of its settings were not kept: the next run adds them"),
        }
    }
}

/// Whether nothing is said under a setting.
fn is_empty(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::String(text) => text.is_empty(),
        Value::Array(all) => all.is_empty(),
        Value::Object(all) => all.is_empty(),
        _ => false,
    }
}

fn logs(lineage: &Lineage) {
    for log in &lineage.logs {
        let path = log.path.clone().unwrap_or_else(|| format!("of flight {}", log.flight));
        let kept = log.kept.map_or(String::new(), |kept| {
            format!(
                "  {} samples of {} signals, {:.2} s to {:.2} s",
                kept.samples, kept.signals, kept.from_s, kept.to_s
            )
        });
        say(&format!("  {path}  {}{kept}", log.hash));
    }
}
