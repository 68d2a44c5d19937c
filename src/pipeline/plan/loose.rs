//! A pipeline file that does not fit its schema, in; the mistakes of the files it names all the
//! same, out: so that a person sees them in one go.

use crate::config;
use crate::error::Errors;
use crate::log::ChannelMap;
use crate::model::{Constants, Model};
use crate::simulate;
use std::path::Path;
use toml::{Table, Value};

/// Checks every file that can be recognised in `pipeline`, as far as that goes without the pipeline
/// file itself.
pub fn mistakes(pipeline: &Path) -> Errors {
    let mut errors = Errors::default();
    let Some(table) = config::read_text(pipeline).ok().and_then(|text| text.parse::<Table>().ok())
    else {
        return errors;
    };
    let folder = pipeline.parent().unwrap_or_else(|| Path::new(""));
    // a file that is not there is for the pipeline file's own check
    let file = |name: Option<&Value>| {
        name.and_then(Value::as_str).map(|name| folder.join(name)).filter(|path| path.is_file())
    };
    let constants = match table.get("aircraft") {
        None => Some(Constants::default()),
        // what other pipelines estimate is not looked for here, and models want it
        Some(several) if several.is_array() => None,
        one => file(one)
            .and_then(|path| errors.take(config::load::<Constants>(&path)))
            .map(|(constants, _)| constants),
    };
    if let Some(path) = file(table.get("channels"))
        && let Some((map, doc)) = errors.take(config::load::<ChannelMap>(&path))
    {
        errors.take(map.check(&doc));
    }
    if let Some(path) = file(table.get("simulate")) {
        errors.take(simulate::Campaign::load(&path));
    }
    let of = |section: &str| table.get(section).and_then(|section| section.get("model"));
    let first = [of("reconstruct"), of("derive")].into_iter().flatten();
    let estimated = table
        .get("estimate")
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .map(|estimate| estimate.get("model"));
    let mut models: Vec<_> = first.map(Some).chain(estimated).filter_map(file).collect();
    models.sort();
    models.dedup();
    if let Some(constants) = &constants {
        models.iter().for_each(|path| {
            errors.take(Model::load(path, constants));
        });
    }
    errors
}
