//! Folders that a worker was given, and paths that others name, in; whether it may go there, out.

use koehler::error::{Error, Result};
use std::path::{Path, PathBuf};

/// The folders that a worker reads and writes in.
#[derive(Debug, Clone)]
pub struct Roots {
    /// Where logs and pipeline files are: read alone.
    pub data: Vec<PathBuf>,
    /// Where results are.
    pub out: PathBuf,
}

impl Roots {
    /// The same with their true places.
    ///
    /// # Errors
    /// One of them is not there.
    pub fn found(data: &[PathBuf], out: &Path) -> Result<Roots> {
        let place = |path: &Path| {
            path.canonicalize().map_err(|e| {
                Error::new(format!("cannot find the folder {}: {e}", path.display()))
                    .help("make it first; all machines have to see it under the same path")
            })
        };
        let data = data.iter().map(|path| place(path)).collect::<Result<_>>()?;
        Ok(Roots { data, out: place(out)? })
    }

    /// A file that may be read.
    ///
    /// # Errors
    /// It is not there, or outside of all roots.
    pub fn readable(&self, path: &Path) -> Result<()> {
        let path = self.true_path(path)?;
        let inside = self.data.iter().chain([&self.out]).any(|root| path.starts_with(root));
        inside.then_some(()).ok_or_else(|| {
            Error::new(format!("{} is in no folder of this worker", path.display()))
                .help("start the worker with --data or --out of a folder above it")
        })
    }

    /// A folder that may be written to.
    ///
    /// # Errors
    /// It is not there, or outside of the root of results.
    pub fn writable(&self, path: &Path) -> Result<()> {
        let path = self.true_path(path)?;
        path.starts_with(&self.out).then_some(()).ok_or_else(|| {
            Error::new(format!("{} is not below {}", path.display(), self.out.display()))
                .help("start the worker with --out of a folder above it")
        })
    }

    /// Links are followed: what counts is where a path ends.
    fn true_path(&self, path: &Path) -> Result<PathBuf> {
        let absolute = path.is_absolute().then_some(path);
        absolute.and_then(|path| path.canonicalize().ok()).ok_or_else(|| {
            Error::new(format!("there is no {} on this machine", path.display()))
                .help("all machines have to see the campaign under the same path")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_and_dots_do_not_lead_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        for name in ["data", "out", "else"] {
            std::fs::create_dir(path(name)).expect("made");
            std::fs::write(path(name).join("a"), "").expect("written");
        }
        std::os::unix::fs::symlink(path("else"), path("data/link")).expect("linked");
        let roots = Roots::found(&[path("data")], &path("out")).expect("there");
        assert!(roots.readable(&path("data/a")).is_ok());
        assert!(roots.readable(&path("out/a")).is_ok());
        assert!(roots.writable(&path("out")).is_ok());
        for wrong in ["else/a", "data/link/a", "data/../else/a", "data/none"] {
            assert!(roots.readable(&path(wrong)).is_err(), "{wrong}");
        }
        assert!(roots.writable(&path("data")).is_err());
        assert!(roots.readable(Path::new("data/a")).is_err());
    }
}
