//! The model language: a text file in, a compiled model out (`docs/model-language.md` is the
//! reference).
//!
//! `file` (sections) and `syntax` (expressions) read the text; `fragments` gathers what it uses;
//! `compile` looks up names (`declare`), checks units and builds (`lower`) one shared graph
//! (`graph`), in which `fuse` joins products and sums. `linear` asks for exact derivatives
//! (`derivative`) and lowers values and Jacobians to flat lists of operations (`program`), which
//! `interpret` runs over lanes and `machine` turns into machine code; `arithmetic` says to the bit
//! what one operation is; `amend` applies the effects of a file; `extend` adds zero shifts and
//! feedback to a compiled model; `equations` takes some of its equations alone. Nothing here knows about time steps: that is `dynamics`.

mod amend;
mod arithmetic;
pub mod compile;
mod covariance;
mod declare;
mod derivative;
mod driven;
mod equations;
pub mod extend;
pub mod file;
pub mod fragments;
#[cfg(test)]
mod fragments_page;
mod functions;
mod fuse;
pub mod graph;
mod instruction;
mod interpret;
pub mod linear;
mod lower;
pub mod machine;
mod moving;
mod op;
mod parts;
pub mod program;
pub mod syntax;
pub mod tables;
mod turbulent;
mod walk;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use crate::config;
use crate::error::Errors;
use crate::units::Dim;
pub use covariance::{Covariance, Scored, noise_of};
use fragments::Folder;
use graph::{Graph, Node};
#[cfg(feature = "internals")]
pub use instruction::{Code, Instruction};
pub use parts::{
    Assumed, Constants, Delay, Delayed, Given, Moving, Origin, Parameter, Quantity, Scope,
    StartKind, State, Trim,
};
pub use program::{Layout, Program};
pub use tables::Tables;
pub use turbulent::{Driven, density_of, lasting_of};

/// A compiled model. States made by `lag()` stand behind the declared ones.
#[derive(Debug, Clone, Default)]
pub struct Model {
    pub name: String,
    pub title: String,
    pub source: String,
    pub inputs: Vec<Quantity>,
    pub constants: Vec<Assumed>,
    pub parameters: Vec<Parameter>,
    pub states: Vec<State>,
    pub outputs: Vec<Quantity>,
    pub delays: Vec<Delay>,
    pub moving: Vec<Moving>,
    /// Where the covariance of the states stands among them, in a model made for a filter.
    pub covariance: Option<Covariance>,
    pub trim: Trim,
    pub tables: Tables,
    pub layout: Layout,
    pub graph: Graph,
    /// Nodes of the state rates, the outputs, and the named equations.
    pub rates: Vec<Node>,
    pub output_nodes: Vec<Node>,
    pub equations: IndexMap<String, Node>,
    /// Dimension of every input, constant, parameter, equation and state.
    pub dims: BTreeMap<String, Dim>,
    /// The resolved text, fragments included: what a cache key hashes (together with `constants`).
    pub text: String,
    /// What it was compiled from.
    recipe: Option<Arc<Recipe>>,
}

/// What a model is compiled from.
#[derive(Debug, Clone)]
pub struct Recipe {
    name: String,
    sources: Vec<fragments::Source>,
    constants: Constants,
    /// Names of the constants that are parameters with their sd for a prior.
    estimated: Vec<String>,
}

/// What a model is compiled from, as text.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Text {
    name: String,
    /// Name and text of every file, those it uses first.
    files: Vec<(String, String)>,
    constants: Constants,
    /// Names of the constants that are parameters.
    estimated: Vec<String>,
}

impl Text {
    /// The model.
    ///
    /// # Errors
    /// As `Model::load`.
    pub fn compile(self) -> Result<Model, Errors> {
        let mut sources = Vec::new();
        for (name, text) in &self.files {
            let (file, doc) = config::parse(name, text)?;
            sources.extend(fragments::sources_of(file, doc));
        }
        Model::compiled(Recipe {
            name: self.name,
            sources,
            constants: self.constants,
            estimated: self.estimated,
        })
    }
}

impl Model {
    /// Reads, checks and compiles a model file; its name is the file name without `.model.toml`.
    ///
    /// # Errors
    /// Every mistake of the file and of its fragments, with file, line and column.
    pub fn load(path: &Path, constants: &Constants) -> Result<Model, Errors> {
        let text = config::read_text(path)?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let name = name
            .strip_suffix(".model.toml")
            .or(name.strip_suffix(".toml"))
            .unwrap_or(&name)
            .to_string();
        let folder = path.parent().unwrap_or(Path::new("."));
        let sources = fragments::gather(&path.to_string_lossy(), &text, Folder::At(folder))?;
        Model::compiled(Recipe {
            name,
            sources,
            constants: constants.clone(),
            estimated: Vec::new(),
        })
    }

    /// The outputs that a model file and its fragments declare, whether or not they compile; none
    /// where a file cannot be read as one.
    pub fn declared_outputs(path: &Path) -> Option<Vec<String>> {
        let text = config::read_text(path).ok()?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let sources = fragments::gather(&path.to_string_lossy(), &text, Folder::At(folder)).ok()?;
        Some(sources.iter().flat_map(|s| s.file.outputs.keys().cloned()).collect())
    }

    /// Compiles model text that is not in a file; it can use embedded fragments only.
    ///
    /// # Errors
    /// As `load`.
    pub fn parse(name: &str, text: &str, constants: &Constants) -> Result<Model, Errors> {
        let sources = fragments::gather(name, text, Folder::None)?;
        Model::compiled(Recipe {
            name: name.to_string(),
            sources,
            constants: constants.clone(),
            estimated: Vec::new(),
        })
    }

    fn compiled(recipe: Recipe) -> Result<Model, Errors> {
        let model = compile::compile(
            &recipe.name,
            &recipe.sources,
            &recipe.constants,
            compile::Uncertain::Estimated(&recipe.estimated),
        )?;
        Ok(Model { recipe: Some(Arc::new(recipe)), ..model })
    }

    /// The same model with every constant of non-zero sd as a fixed parameter of the same name,
    /// behind its own parameters: what it takes to differentiate with respect to a constant.
    /// Constants are folded in the model itself, which keeps it fast.
    ///
    /// # Errors
    /// None that compiling the model itself would not have found.
    pub fn opened(&self) -> Result<Model, Errors> {
        let Some(recipe) = &self.recipe else { return Ok(self.clone()) };
        let model = compile::compile(
            &recipe.name,
            &recipe.sources,
            &recipe.constants,
            compile::Uncertain::Open,
        )?;
        Ok(Model { name: self.name.clone(), recipe: Some(recipe.clone()), ..model })
    }

    /// The same model with more effects behind its own file: `blocks` is text of `[[effect]]`
    /// sections.
    ///
    /// # Errors
    /// Mistakes of the blocks, at their place in the longer file; a model that was not compiled
    /// from text.
    pub fn amended(&self, blocks: &str) -> Result<Model, Errors> {
        let recipe = self
            .recipe
            .as_ref()
            .ok_or_else(|| crate::error::Error::new("this model has no text to add to"))?;
        let own = recipe.sources.iter().rposition(|s| s.amends.is_none()).unwrap_or(0);
        let mut sources = recipe.sources[..own].to_vec();
        let doc = &recipe.sources[own].doc;
        let (file, doc) = config::parse(doc.file(), &format!("{}{blocks}", doc.text()))?;
        sources.extend(fragments::sources_of(file, doc));
        Model::compiled(Recipe {
            name: recipe.name.clone(),
            sources,
            constants: recipe.constants.clone(),
            estimated: recipe.estimated.clone(),
        })
    }

    /// The same model with these constants as parameters to estimate, behind its own ones: value and
    /// sd of each are its prior.
    ///
    /// # Errors
    /// None that compiling the model itself would not have found.
    pub fn with_estimated(&self, constants: &[String]) -> Result<Model, Errors> {
        let Some(recipe) = &self.recipe else { return Ok(self.clone()) };
        Model::compiled(Recipe { estimated: constants.to_vec(), ..(**recipe).clone() })
    }

    /// What the model is compiled from, as text; none if it was not compiled from text.
    pub fn recipe_text(&self) -> Option<Text> {
        let recipe = self.recipe.as_ref()?;
        let files = recipe.sources.iter().filter(|s| s.amends.is_none());
        Some(Text {
            name: recipe.name.clone(),
            files: files.map(|s| (s.doc.file().to_string(), s.doc.text().to_string())).collect(),
            constants: recipe.constants.clone(),
            estimated: recipe.estimated.clone(),
        })
    }

    /// Names of the constants that are parameters (see `with_estimated`).
    pub fn estimated(&self) -> &[String] {
        self.recipe.as_ref().map_or(&[], |recipe| &recipe.estimated)
    }

    /// The text of the model's own file with these numbers as starts of its parameters, and those that stand in
    /// what it uses; none if it was not compiled from text.
    pub fn started_at(&self, values: &[(&str, f64)]) -> Option<(String, Vec<String>)> {
        let sources = self.recipe.iter().flat_map(|r| &r.sources);
        let doc = &sources.into_iter().rfind(|s| s.amends.is_none())?.doc;
        let place = |name: &str| format!("parameters.{name}.start");
        let (own, others): (Vec<_>, Vec<_>) =
            values.iter().partition(|(name, _)| doc.has(&place(name)));
        let own: Vec<(String, String)> =
            own.iter().map(|(name, value)| (place(name), format!("{value:?}"))).collect();
        let others = others.iter().map(|(name, _)| name.to_string()).collect();
        Some((doc.with_values(&own)?, others))
    }

    /// The text of the model's own file, without what it uses; empty if it was not compiled from
    /// text.
    pub fn own_text(&self) -> &str {
        let own = self.recipe.iter().flat_map(|r| &r.sources).rfind(|s| s.amends.is_none());
        own.map_or("", |s| s.doc.text())
    }

    /// The files that the model was compiled from, those it uses first.
    pub fn files(&self) -> impl Iterator<Item = &file::ModelFile> {
        self.recipe.iter().flat_map(|r| &r.sources).map(|s| &s.file)
    }

    /// The constants of the aircraft file that the model was compiled with.
    pub fn given(&self) -> Option<&Constants> {
        self.recipe.as_ref().map(|r| &r.constants)
    }

    /// An embedded fragment as a model of its own.
    ///
    /// # Errors
    /// As `load`; also when there is no such fragment.
    pub fn embedded(name: &str, constants: &Constants) -> Result<Model, Errors> {
        let text = fragments::EMBEDDED.iter().find(|e| e.0 == name).map(|e| e.1);
        let text = text.ok_or_else(|| {
            crate::error::Error::new(format!("there is no embedded fragment \"{name}\""))
        })?;
        Model::parse(&format!("<{name}>"), text, constants)
            .map(|m| Model { name: name.to_string(), ..m })
    }

    pub fn parameter(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|p| p.quantity.name == name)
    }

    pub fn state(&self, name: &str) -> Option<usize> {
        self.states.iter().position(|s| s.quantity.name == name)
    }

    pub fn input(&self, name: &str) -> Option<usize> {
        self.inputs.iter().position(|i| i.name == name)
    }

    pub fn output(&self, name: &str) -> Option<usize> {
        self.outputs.iter().position(|o| o.name == name)
    }

    /// Start values of all parameters, in order.
    pub fn parameter_starts(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.start).collect()
    }
}
