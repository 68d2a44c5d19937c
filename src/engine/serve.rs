//! The other side of an engine that moves work: bytes of parameters and of an item in, bytes of the
//! output out.

use super::code;
use super::function::{Function, Source};
use crate::error::{Error, Result};

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

    /// Does one item.
    ///
    /// # Errors
    /// The bytes are none of this function, or the data that they name are not there.
    pub fn run(&self, parameters: &[u8], item: &[u8], source: &Source) -> Result<Vec<u8>> {
        (self.serve)(parameters, item, source)
    }
}

fn serve<F: Function>(parameters: &[u8], item: &[u8], source: &Source) -> Result<Vec<u8>> {
    let item: F::Item = code::decode(item)?;
    let mut output = Err(Error::new(format!("{} got no parameters", F::NAME)));
    F::lend(parameters, source, &mut |parameters| {
        output = code::encode(&F::run(parameters, &item, source)?);
        Ok(())
    })?;
    output
}
