//! The verbs about where results come from: a pipeline file or a file of an output folder comes in,
//! lines or a JSON document go out.

use super::args::{Form, PipelineArgs};
use super::run::out_folder;
use super::summary::count;
use super::words::{End, document, say};
use crate::error::Errors;
use crate::guard::MARK;
use crate::pipeline::{self, Explained, Fault, Plan, Store, named};

/// `koehler verify`
pub fn verify(args: &PipelineArgs, form: Form) -> Result<End, Errors> {
    let store = Store::look(&out_folder(args))?;
    let verified = pipeline::verify(&store, &args.pipeline)?;
    let end = if verified.faults.is_empty() { End::Complete } else { End::Partial };
    if form.json {
        document(&verified)?;
        return Ok(end);
    }
    for unlike in &verified.faults {
        let what = match unlike.fault {
            Fault::Differs => "differs from its record",
            Fault::Missing => "is missing",
            Fault::Unknown => "is unknown",
            Fault::Unreadable => "cannot be read",
        };
        say(&format!("{}: {what} ({})", unlike.path, unlike.role));
    }
    let sound = count(verified.sound, "file");
    say(&match verified.faults.len() {
        0 => format!("{sound} as recorded, and no others"),
        n => format!("{sound} as recorded, {n} not"),
    });
    Ok(end)
}

/// `koehler explain`
pub fn explain(
    args: &PipelineArgs,
    stage: Option<&str>,
    unit: Option<&str>,
) -> Result<End, Errors> {
    let store = Store::look(&out_folder(args))?;
    let plan = Plan::read_with(&args.pipeline, |settings| settings.keep(&store))?;
    for explained in pipeline::explain(&plan, &store, stage, unit)? {
        say(&format!("{} {}: {}", explained.stage, named(&explained.units), explained.state));
        lines(&explained, "  ");
        for root in &explained.roots {
            say(&format!("  because {} of {} is {}:", root.stage, named(&root.units), root.state));
            lines(root, "    ");
        }
    }
    Ok(End::Complete)
}

fn lines(explained: &Explained, indent: &str) {
    explained.causes.iter().for_each(|cause| say(&format!("{indent}{cause}")));
}

/// `koehler gc`
pub fn gc(args: &PipelineArgs, dry_run: bool) -> Result<End, Errors> {
    let store = Store::look(&out_folder(args))?;
    let plan = Plan::read_with(&args.pipeline, |settings| settings.keep(&store))?;
    // An output folder that is not there is not made by looking for what is in it.
    let is_there = store.root().join(MARK).is_dir();
    let _lock = (is_there && !dry_run).then(|| store.lock()).transpose()?;
    let unneeded = pipeline::unneeded(&plan, &store);
    for file in &unneeded {
        say(&format!("{}: {} bytes ({})", file.path.display(), file.bytes, file.why));
    }
    if is_there && !dry_run {
        pipeline::remove(&plan, &store, &unneeded)?;
    }
    let bytes: u64 = unneeded.iter().map(|file| file.bytes).sum();
    let files = count(unneeded.len(), "file");
    say(&match (unneeded.is_empty(), dry_run) {
        (true, _) => "nothing to remove: every file is needed, or not ours".to_string(),
        (false, true) => format!("{files}, {bytes} bytes, would be removed"),
        (false, false) => format!("{files}, {bytes} bytes, removed"),
    });
    Ok(End::Complete)
}
