//! The call of a function: items in, outputs as they come or in the order of the items out.

use super::code::{decode, encode};
use super::data::{Blobs, Kept, Said};
use super::function::{Function, Source};
use super::job::{Engine, Job};
use super::serve::{CODE, Packed};
use super::threads::Threads;
use crate::error::{Error, Result};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Where a caller is: its engine, what it keeps, and who listens to item `i`.
pub struct Here<'a> {
    /// Does the items.
    pub engine: &'a dyn Engine,
    /// What this process keeps.
    pub kept: &'a Kept,
    /// Hears what item `i` says.
    pub hear: &'a (dyn Fn(usize, Said) + Sync),
}

/// Hands every output to `take` as soon as it is there, from any thread; an error where an item can
/// be done neither elsewhere nor here.
pub fn each<F: Function>(
    here: &Here,
    parameters: &F::Parameters<'_>,
    items: &[F::Item],
    take: &(dyn Fn(usize, Result<F::Output>) + Sync),
) {
    each_on::<F>(here.engine, here, parameters, items, take);
}

/// The same by the threads of this process, whose own work goes to the engine.
pub fn each_here<F: Function>(
    here: &Here,
    parameters: &F::Parameters<'_>,
    items: &[F::Item],
    take: &(dyn Fn(usize, Result<F::Output>) + Sync),
) {
    each_on::<F>(&Threads, here, parameters, items, take);
}

/// Outputs of all items, in their order.
pub fn map<F: Function>(
    here: &Here,
    parameters: &F::Parameters<'_>,
    items: &[F::Item],
) -> Vec<Result<F::Output>> {
    let outputs: Vec<OnceLock<Result<F::Output>>> = items.iter().map(|_| OnceLock::new()).collect();
    each::<F>(here, parameters, items, &|i, output| drop(outputs[i].set(output)));
    let missing = || Err(Error::new(format!("{} was not done", F::NAME)));
    outputs.into_iter().map(|output| output.into_inner().unwrap_or_else(missing)).collect()
}

fn each_on<F: Function>(
    engine: &dyn Engine,
    here: &Here,
    parameters: &F::Parameters<'_>,
    items: &[F::Item],
    take: &(dyn Fn(usize, Result<F::Output>) + Sync),
) {
    if items.is_empty() {
        return;
    }
    let done = items.iter().map(|_| AtomicBool::new(false)).collect();
    let call = Call::<F> { here, parameters, items, take, done };
    engine.run(&call);
    if call.done.iter().any(|done| !done.load(Ordering::Acquire)) {
        Threads.run(&call);
    }
}

/// The job of one call.
struct Call<'a, 'p, F: Function> {
    here: &'a Here<'a>,
    parameters: &'a F::Parameters<'p>,
    items: &'a [F::Item],
    take: &'a (dyn Fn(usize, Result<F::Output>) + Sync),
    done: Vec<AtomicBool>,
}

impl<F: Function> Call<'_, '_, F> {
    /// The first output of an item counts.
    fn put(&self, i: usize, output: Result<F::Output>) {
        if !self.done[i].swap(true, Ordering::AcqRel) {
            (self.take)(i, output);
        }
    }
}

impl<F: Function> Job for Call<'_, '_, F> {
    fn name(&self) -> &'static str {
        F::NAME
    }

    fn version(&self) -> u32 {
        F::VERSION
    }

    fn count(&self) -> usize {
        self.items.len()
    }

    fn here(&self, i: usize) {
        if self.done[i].load(Ordering::Acquire) {
            return;
        }
        let Here { kept, engine, hear } = *self.here;
        let tell = |said| hear(i, said);
        let source = Source { kept, engine, blobs: None, tell: &tell };
        self.put(i, F::run(self.parameters, &self.items[i], &source));
    }

    fn parameters(&self, blobs: &dyn Blobs) -> Result<Vec<u8>> {
        encode(&Packed { code: CODE.into(), parameters: F::pack(self.parameters, blobs)?.into() })
    }

    fn item(&self, i: usize) -> Result<Vec<u8>> {
        encode(&self.items[i])
    }

    fn said(&self, i: usize, said: Said) {
        (self.here.hear)(i, said);
    }

    fn done(&self, i: usize, output: &[u8]) -> Result<()> {
        self.put(i, Ok(decode(output)?));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice a number; the parameter is added.
    struct Twice;

    impl Function for Twice {
        const NAME: &'static str = "twice";
        const VERSION: u32 = 1;
        type Parameters<'a> = i64;
        type Item = i64;
        type Output = i64;

        fn run(more: &i64, item: &i64, _: &Source) -> Result<i64> {
            Ok(2 * item + more)
        }

        fn pack(more: &i64, _: &dyn Blobs) -> Result<Vec<u8>> {
            encode(more)
        }

        fn lend(bytes: &[u8], _: &Source, to: &mut dyn FnMut(&i64) -> Result<()>) -> Result<()> {
            to(&decode(bytes)?)
        }
    }

    /// Loses every third item, does every third twice, and answers one with nonsense.
    struct Unreliable;

    impl Engine for Unreliable {
        fn run(&self, job: &dyn Job) {
            assert!(job.done(1, b"\xc1 nonsense").is_err());
            for i in (0..job.count()).rev().filter(|i| i % 3 > 0) {
                (0..i % 3).for_each(|_| job.here(i));
            }
        }
    }

    #[test]
    fn what_an_engine_leaves_is_done_here_and_once() {
        let kept = Kept::default();
        let here = Here { engine: &Unreliable, kept: &kept, hear: &|_, _| {} };
        let items: Vec<i64> = (0..10).collect();
        let outputs = map::<Twice>(&here, &1, &items);
        let outputs: Vec<i64> = outputs.into_iter().collect::<Result<_>>().expect("all of them");
        assert_eq!(outputs, items.iter().map(|i| 2 * i + 1).collect::<Vec<_>>());
        let taken = std::sync::Mutex::new(Vec::new());
        each::<Twice>(&here, &1, &items, &|i, _| taken.lock().expect("alive").push(i));
        let mut taken = taken.into_inner().expect("alive");
        taken.sort_unstable();
        assert_eq!(taken, (0..10).collect::<Vec<_>>());
    }
}
