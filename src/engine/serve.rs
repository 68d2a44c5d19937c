//! The other side of an engine that moves work: bytes of parameters and of an item in, bytes of the
//! output out.

use super::code;
use super::function::{Function, Source};
use crate::error::{Error, Result};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

mod codes {
    #![allow(dead_code)]
    // `ALL`, written by `build.rs`.
    include!(concat!(env!("OUT_DIR"), "/codes.rs"));

    pub const EVERYTHING: &str = ALL;
}

/// Hash of all sources, dependencies, compiler and target: processes that work together have the
/// same.
pub const CODE: &str = codes::EVERYTHING;

/// Parameters on their way.
#[derive(Serialize, Deserialize)]
pub struct Packed<'a> {
    pub code: Cow<'a, str>,
    pub parameters: Bytes,
}

/// Parameters, item and source in, output out; all as bytes.
type Serve = fn(&[u8], &[u8], &Source) -> Result<Vec<u8>>;

/// A function, as a process that does the work of others knows it.
#[derive(Clone, Copy)]
pub struct Served {
    /// `Function::NAME`
    pub name: &'static str,
    /// `Function::VERSION`
    pub version: u32,
    serve: Serve,
}

impl Served {
    /// This function.
    pub const fn of<F: Function>() -> Served {
        Served { name: F::NAME, version: F::VERSION, serve: serve::<F> }
    }

    /// Does one item. Whoever serves picks the function by name and version; that both programs are
    /// made from the same sources is checked here.
    ///
    /// # Errors
    /// The bytes are none of this function, come from a program of other sources, or name data that
    /// are not there.
    pub fn run(&self, parameters: &[u8], item: &[u8], source: &Source) -> Result<Vec<u8>> {
        (self.serve)(parameters, item, source)
    }
}

fn serve<F: Function>(parameters: &[u8], item: &[u8], source: &Source) -> Result<Vec<u8>> {
    let Packed { code, parameters } = code::decode(parameters)?;
    if code != CODE {
        return Err(Error::new(format!("{}: this program is made from other sources", F::NAME)));
    }
    let item: F::Item = code::decode(item)?;
    let mut output = Err(Error::new(format!("{} got no parameters", F::NAME)));
    F::lend(&parameters, source, &mut |parameters| {
        output = code::encode(&F::run(parameters, &item, source)?);
        Ok(())
    })?;
    output
}
