//! A function's name, its parameters and an item come in as bytes, from whoever reached this worker;
//! an answer goes out, always: what is refused or fails is said in it.

use crate::roots::Roots;
use crate::row::{self, Answer, Output, Parameters};
use bytes::Bytes;
use koehler::FUNCTIONS;
use koehler::engine::{Folder, Kept, Key, Said, Source, Threads, decode};
use koehler::error::{Error, Result};
use serde::Deserialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// The function that does nothing, by which the time of a query is measured.
pub const NOTHING: &str = "nothing";

/// Where a worker does its work.
pub struct Desk {
    roots: Roots,
    kept: Kept,
    pool: rayon::ThreadPool,
}

impl std::fmt::Debug for Desk {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "Desk({:?})", self.roots)
    }
}

/// What parameters carry around those of the function itself.
#[derive(Deserialize)]
struct Outer {
    parameters: Bytes,
}

/// The paths that parameters name.
#[derive(Deserialize)]
struct Paths {
    #[serde(default)]
    pipeline: Option<PathBuf>,
    #[serde(default)]
    folder: Option<PathBuf>,
}

impl Desk {
    /// A desk with so many threads and so many bytes for what is kept.
    ///
    /// # Errors
    /// There are no threads to be had.
    pub fn new(roots: Roots, threads: usize, bytes: usize) -> Result<Desk> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|e| Error::new(format!("cannot start {threads} threads: {e}")))?;
        Ok(Desk { roots, kept: Kept::at_most(bytes), pool })
    }

    /// Does one item.
    pub fn answer(&self, function: &str, parameters: &[u8], item: &[u8]) -> Answer {
        let said = Mutex::new(Vec::new());
        let work = || self.pool.install(|| self.output(function, parameters, item, &said));
        let output = match catch_unwind(AssertUnwindSafe(work)) {
            Ok(output) => output.map_err(|e| e.to_string()),
            Err(_) => Err(format!("{function} panicked over this item")),
        };
        Answer { said: said.into_inner().unwrap_or_else(|p| p.into_inner()), output }
    }

    fn output(
        &self,
        function: &str,
        parameters: &[u8],
        item: &[u8],
        said: &Mutex<Vec<String>>,
    ) -> Result<Output> {
        if function == NOTHING {
            return Ok(Output::Here(Bytes::new()));
        }
        let known = FUNCTIONS.iter().find(|f| row::function(f.name, f.version) == function);
        let known = known.ok_or_else(|| Error::new(format!("refused: no function {function}")))?;
        let parameters: Parameters = decode(parameters)?;
        self.roots.writable(&parameters.folder)?;
        let folder = Folder(parameters.folder);
        let parameters = self.parameters(&folder, &parameters.key)?;
        let tell = |what| {
            if let Said::Words(words) = what {
                said.lock().unwrap_or_else(|p| p.into_inner()).push(words);
            }
        };
        let source =
            Source { kept: &self.kept, engine: &Threads, blobs: Some(&folder), tell: &tell };
        Output::of(known.run(&parameters, item, &source)?, &folder)
    }

    /// The parameters of a key, read once; the paths in them have to be below the roots.
    fn parameters(&self, folder: &Folder, key: &Key) -> Result<Arc<Vec<u8>>> {
        let make = || {
            let bytes = row::whole(folder, key)?;
            self.allowed(&bytes)?;
            Ok(bytes)
        };
        self.kept.get_sized(&Key(format!("parameters {}", key.0)), make, Vec::len)
    }

    fn allowed(&self, parameters: &[u8]) -> Result<()> {
        let outer: Outer = decode(parameters)?;
        let paths: Paths = decode(&outer.parameters)?;
        if let Some(pipeline) = &paths.pipeline {
            self.roots.readable(pipeline)?;
        }
        if let Some(folder) = &paths.folder {
            self.roots.readable(folder)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use koehler::engine::{Blobs, encode};
    use serde::Serialize;

    #[derive(Serialize)]
    struct Asked {
        parameters: Bytes,
    }

    #[derive(Serialize)]
    struct Named {
        pipeline: PathBuf,
        folder: PathBuf,
    }

    #[test]
    fn what_is_not_listed_or_lies_outside_is_refused() {
        let temporary = tempfile::tempdir().expect("a folder");
        let out = temporary.path().join("out");
        std::fs::create_dir(&out).expect("made");
        std::fs::write(temporary.path().join("secret"), "").expect("written");
        let roots = Roots::found(&[], &out).expect("there");
        let desk = Desk::new(roots, 1, 1 << 20).expect("threads");
        let said = |function: &str, parameters: &[u8]| {
            desk.answer(function, parameters, b"").output.expect_err("refused")
        };
        assert!(said("rm@1", b"").contains("no function rm@1"));
        let unit = row::function(FUNCTIONS[0].name, FUNCTIONS[0].version);
        let outside = Parameters { folder: temporary.path().into(), key: Key::of(b"") };
        assert!(said(&unit, &encode(&outside).expect("bytes")).contains("is not below"));
        let secret = temporary.path().join("secret");
        let named = encode(&Named { pipeline: secret, folder: out.clone() }).expect("bytes");
        let asked = encode(&Asked { parameters: named.into() }).expect("bytes");
        let key = Folder(out.clone()).put(&asked).expect("written");
        let inside = encode(&Parameters { folder: out, key }).expect("bytes");
        assert!(said(&unit, &inside).contains("is in no folder of this worker"));
        let nothing = desk.answer(NOTHING, b"", b"").output;
        assert!(matches!(nothing, Ok(Output::Here(bytes)) if bytes.is_empty()));
    }
}
