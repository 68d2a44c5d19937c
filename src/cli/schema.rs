//! The verb schema: the name of a configuration file comes in, its JSON Schema for editors goes
//! out.

use super::words::{End, say};
use crate::config::schema_text;
use crate::error::{Error, Errors};
use crate::guard;
use crate::stage::validate;
use crate::{design, diagnose, log, model, pipeline, simulate, table};
use std::path::Path;

/// The configuration files and their schemas.
fn schemas() -> Vec<(&'static str, String)> {
    vec![
        ("pipeline", schema_text::<pipeline::Settings>("Pipeline file")),
        ("channels", schema_text::<log::ChannelMap>("Channel map")),
        ("campaign", schema_text::<simulate::Settings>("Simulated campaign")),
        ("design", schema_text::<design::Settings>("Study of input designs")),
        ("model", schema_text::<model::file::ModelFile>("Model file")),
        ("aircraft", schema_text::<model::Constants>("Constants of the aircraft")),
        ("effect", schema_text::<diagnose::effect::file::EffectFile>("Candidate effect")),
        ("tolerances", schema_text::<validate::Tolerances>("File of tolerances")),
        ("import", schema_text::<log::import::Import>("Import of text columns")),
    ]
}

/// `koehler schema`
pub fn schema(file: Option<&str>, out: Option<&Path>, force: bool) -> Result<End, Errors> {
    let schemas = schemas();
    let names: Vec<&str> = schemas.iter().map(|(name, _)| *name).collect();
    let chosen: Vec<&(&str, String)> =
        schemas.iter().filter(|(name, _)| file.is_none_or(|f| f == *name)).collect();
    match (file, out, chosen.as_slice()) {
        (Some(file), _, []) => {
            let what = format!("there is no configuration file \"{file}\"");
            Err(Error::new(what).help(format!("there are {}", names.join(", "))).into())
        }
        (_, Some(folder), chosen) => {
            let path = |name: &str| folder.join(format!("{name}.schema.json"));
            let mut errors = Errors::default();
            for (name, text) in chosen {
                errors.take(guard::file(&path(name), &[], force, |there| foreign(there, text)));
            }
            errors.or(())?;
            for (name, text) in chosen {
                let path = path(name);
                table::write_atomic(&path, text.as_bytes())?;
                say(&path.display().to_string());
            }
            Ok(End::Complete)
        }
        (None, None, _) => {
            say(&format!(
                "schemas: {}; name one, or give --out DIR to write all",
                names.join(", ")
            ));
            Ok(End::Complete)
        }
        (Some(_), None, chosen) => {
            chosen.iter().for_each(|(_, text)| say(text));
            Ok(End::Complete)
        }
    }
}

/// What a file is that is not the schema `ours` of this or another version of the program: those
/// have the same title.
fn foreign(path: &Path, ours: &str) -> Option<String> {
    let title = |text: &str| {
        let value: serde_json::Value = serde_json::from_str(text).ok()?;
        value.get("$schema")?;
        Some(value.get("title")?.as_str()?.to_string())
    };
    let Ok(text) = std::fs::read_to_string(path) else { return Some("no text".into()) };
    match title(&text) {
        Some(other) if Some(&other) != title(ours).as_ref() => {
            Some(format!("the schema \"{other}\""))
        }
        Some(_) => None,
        None => Some("no JSON Schema".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::schemas;

    /// Editors check configuration files against `schemas/config/`;
    /// `UPDATE_SCHEMAS=1 cargo test --release committed_schemas` rewrites them.
    #[test]
    fn the_committed_schemas_are_those_of_the_settings() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas/config");
        for (name, text) in schemas() {
            let path = folder.join(format!("{name}.schema.json"));
            if std::env::var_os("UPDATE_SCHEMAS").is_some() {
                crate::table::write_atomic(&path, text.as_bytes()).unwrap();
            }
            let committed = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(
                committed == text,
                "{} is behind the settings: UPDATE_SCHEMAS=1 cargo test --release committed_schemas",
                path.display()
            );
        }
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), schemas().len());
    }
}
