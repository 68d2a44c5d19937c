//! Fragment names in `use` to their texts: the embedded library, and files beside a model.

use std::path::{Path, PathBuf};

use super::file::{Effect, ModelFile};
use crate::config::{self, Doc};
use crate::error::{Error, Errors};

macro_rules! embedded {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("fragments/", $name, ".model.toml")))),*]
    };
}

/// The embedded fragments: one line each.
pub const EMBEDDED: &[(&str, &str)] = embedded![
    "air_data",
    "atmosphere",
    "downwash",
    "dryden",
    "gust_dryden_u",
    "gust_dryden_v",
    "gust_dryden_w",
    "gust_first_order_v",
    "gust_first_order_w",
    "kinematics",
    "kinematics_wind",
    "path_air",
    "path_air_angles",
    "path_airspeed",
    "path_altitude",
    "path_euler",
    "path_flat_earth",
    "path_ground",
    "path_imu",
    "path_outputs",
    "path_position",
    "path_quaternion",
    "path_round_earth",
    "path_vanes",
    "rigid_body_6dof",
    "sensors",
    "standard_air",
    "tail_flow"
];

/// A parsed model file, or one of its effects, with the positions of its keys.
#[derive(Debug, Clone)]
pub struct Source {
    pub file: ModelFile,
    pub doc: Doc,
    /// Of an effect: where it stands in the file, `"effect.0."`; empty for the file itself.
    pub prefix: String,
    /// Of an effect: what it adds and replaces.
    pub amends: Option<Effect>,
}

/// The file itself, then each of its effects, as the sources that the compiler reads.
pub fn sources_of(mut file: ModelFile, doc: Doc) -> Vec<Source> {
    let effects = std::mem::take(&mut file.effect);
    let of_effect = |(i, e): (usize, Effect)| {
        let file = ModelFile {
            title: e.title.clone(),
            constants: e.constants.clone(),
            parameters: e.parameters.clone(),
            equations: e.equations.clone(),
            states: e.states.clone(),
            ..Default::default()
        };
        Source { file, doc: doc.clone(), prefix: format!("effect.{i}."), amends: Some(e) }
    };
    let effects: Vec<Source> = effects.into_iter().enumerate().map(of_effect).collect();
    let own = Source { file, doc: doc.clone(), prefix: String::new(), amends: None };
    std::iter::once(own).chain(effects).collect()
}

/// Where text comes from when a fragment is named.
pub enum Folder<'a> {
    /// Beside the model file.
    At(&'a Path),
    /// Nowhere: only embedded fragments.
    None,
}

/// The model `text` and everything it uses, fragments first; each fragment once.
pub fn gather(name: &str, text: &str, folder: Folder) -> Result<Vec<Source>, Errors> {
    let mut out = Vec::new();
    let mut done = Vec::new();
    let mut open = Vec::new();
    let base = match folder {
        Folder::At(path) => Some(path.to_path_buf()),
        Folder::None => None,
    };
    visit(name, text, base, &mut out, &mut done, &mut open)?;
    Ok(out)
}

fn visit(
    name: &str,
    text: &str,
    base: Option<PathBuf>,
    out: &mut Vec<Source>,
    done: &mut Vec<String>,
    open: &mut Vec<String>,
) -> Result<(), Errors> {
    let (file, doc) = config::parse::<ModelFile>(name, text)?;
    let mut errors = Errors::default();
    open.push(name.to_string());
    for (i, used) in file.uses.iter().enumerate() {
        let key = format!("use.{i}");
        if let Err(e) = fragment(used, base.as_deref(), &doc, &key, out, done, open) {
            errors.0.extend(e.0);
        }
    }
    open.pop();
    out.extend(sources_of(file, doc));
    errors.or(())
}

fn fragment(
    used: &str,
    base: Option<&Path>,
    doc: &Doc,
    key: &str,
    out: &mut Vec<Source>,
    done: &mut Vec<String>,
    open: &mut Vec<String>,
) -> Result<(), Errors> {
    let (name, text, base) = if used.starts_with("./") || used.starts_with("../") {
        let Some(base) = base else {
            return Err(doc
                .error(
                    key,
                    format!("\"{used}\": this model is not a file, so nothing is beside it"),
                )
                .into());
        };
        let path = base.join(used);
        let text = config::read_text(&path)
            .map_err(|e| doc.error(key, format!("\"{used}\": {}", e.what)))?;
        (path.to_string_lossy().into_owned(), text, path.parent().map(Path::to_path_buf))
    } else {
        let Some((_, text)) = EMBEDDED.iter().find(|(n, _)| *n == used) else {
            let known: Vec<&str> = EMBEDDED.iter().map(|e| e.0).collect();
            return Err(Error::at(doc.place(key), format!("there is no fragment \"{used}\""))
                .help(format!(
                    "embedded fragments: {}; a file beside the model begins with \"./\"",
                    known.join(", ")
                ))
                .into());
        };
        (format!("<{used}>"), text.to_string(), None)
    };
    if open.contains(&name) {
        return Err(doc
            .error(key, format!("\"{used}\" uses itself: {} -> {name}", open.join(" -> ")))
            .into());
    }
    if done.contains(&name) {
        return Ok(());
    }
    done.push(name.clone());
    visit(&name, &text, base, out, done, open)
}
