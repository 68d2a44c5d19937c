//! A plan comes in; what its run reads and writes that no stage's record names (settings files,
//! where the logs are, the pipeline's own tables) goes out, to be kept beside the records.

use super::own::Filed;
use super::plan::Plan;
use super::provenance::VERSION;
use super::store::Store;
use crate::error::{Error, Result};
use crate::guard::MARK;
use crate::table::write_atomic;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What the last run read and wrote besides what the records of its stages say. Paths are relative
/// to the folder of the pipeline file where they are inside of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Version of the program.
    pub version: String,
    /// Name of the pipeline file.
    pub pipeline: String,
    /// Every configuration file that was read, with the hash of its text.
    pub settings: BTreeMap<String, String>,
    /// Where the log of each flight is; its hash is in the records.
    pub logs: BTreeMap<String, String>,
    /// The tables that the pipeline itself writes, relative to the output folder.
    #[serde(deserialize_with = "tables")]
    pub tables: BTreeMap<String, Filed>,
}

impl Origin {
    /// Of a plan's run, with the tables that it wrote itself.
    pub fn of(plan: &Plan, tables: BTreeMap<String, Filed>) -> Origin {
        let folder = folder(&plan.pipeline);
        let name = plan.pipeline.file_name().map(|n| n.to_string_lossy().into_owned());
        let inside = |path: &Path| {
            path.strip_prefix(folder).unwrap_or(path).to_string_lossy().replace('\\', "/")
        };
        Origin {
            version: VERSION.to_string(),
            pipeline: name.unwrap_or_default(),
            settings: plan.files.iter().map(|(path, hash)| (inside(path), hash.clone())).collect(),
            logs: plan.logs.iter().map(|log| (log.flight.clone(), inside(&log.path))).collect(),
            tables,
        }
    }

    /// That of an output folder; none where no run of this program or a later one has ended there.
    pub fn read(store: &Store) -> Option<Origin> {
        let bytes = std::fs::read(path(store)).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// The same, where there has to be one.
    ///
    /// # Errors
    /// There is no output folder, or an earlier program wrote it.
    pub fn wanted(store: &Store) -> Result<Origin> {
        let root = store.root().display();
        let what = match store.root().join(MARK).is_dir() {
            false => format!("{root} is no output folder: it has no {MARK}/"),
            true => format!("{root}: no run has ended that kept what it was made from"),
        };
        Origin::read(store).ok_or_else(|| {
            Error::new(what).help(
                "`koehler run PIPELINE` keeps it; what is fresh is not made again (--out names another folder)",
            )
        })
    }

    /// Files it beside the records.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn keep(&self, store: &Store) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| Error::new(format!("cannot write what a run was made from: {e}")))?;
        write_atomic(&path(store), text.as_bytes())
    }
}

/// The tables as this program says them, or as an earlier one did: by the hash of their bytes alone.
fn tables<'de, D: Deserializer<'de>>(
    from: D,
) -> std::result::Result<BTreeMap<String, Filed>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Said {
        Filed(Filed),
        Hash(String),
    }
    let said = BTreeMap::<String, Said>::deserialize(from)?.into_iter();
    Ok(said
        .map(|(path, said)| match said {
            Said::Filed(filed) => (path, filed),
            Said::Hash(hash) => (path, Filed { hash, of: None }),
        })
        .collect())
}

fn path(store: &Store) -> PathBuf {
    store.root().join(MARK).join("run.json")
}

/// The folder that the paths of a pipeline file are relative to.
pub fn folder(pipeline: &Path) -> &Path {
    pipeline.parent().unwrap_or_else(|| Path::new(""))
}
