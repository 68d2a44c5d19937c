//! The engine: jobs come in; their items are done by workers, in one query per job, and what workers
//! could not do is left to the caller.

use crate::query::{Answers, Client};
use crate::row::{self, Answer, Parameters};
use koehler::engine::{Engine, Folder, Job, Said, Threads, encode};
use koehler::error::{Error, Result};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock};
use std::time::{Duration, Instant};

/// A query is tried so often.
const TRIES: usize = 3;

/// So long a run waits for a first worker, or for another one after all are lost.
const PATIENCE: Duration = Duration::from_secs(15);

/// Work that takes less than so many queries of nothing stays here.
const WORTH: u32 = 10;

/// The function whose items are large by themselves: one of a stage says nothing of another's.
const UNITS: &str = "unit of a stage";

/// Flights that are under way at a time, half of them: enough for many workers, and the same number
/// for any number of them.
const WIDE: usize = 64;

/// What workers made is filed by so many threads: they wait for the disk, and use no processor while
/// they do.
const FILING: usize = 8;

/// Workers behind a scheduler.
pub struct Cluster {
    client: Client,
    scheduler: String,
    /// Where parameters and large outputs are, made for the first job.
    place: PathBuf,
    folder: OnceLock<Option<Folder>>,
    /// The time of a query that does nothing.
    overhead: Duration,
    /// How long jobs took here, by function and number of items.
    here: Mutex<BTreeMap<(&'static str, usize), Duration>>,
    filing: rayon::ThreadPool,
    /// No worker is left.
    lost: AtomicBool,
    quiet: bool,
    said: Mutex<BTreeSet<String>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|p| p.into_inner())
}

impl Cluster {
    /// The workers of a scheduler, for a run into this output folder.
    ///
    /// # Errors
    /// Nobody does any work there.
    pub fn new(client: Client, scheduler: &str, out: &Path, quiet: bool) -> Result<Cluster> {
        let failed = |e| {
            Error::new(format!("the cluster at {scheduler} does no work: {e}"))
                .help("start a scheduler and workers first: koehler scheduler, koehler worker (docs/cluster.md)")
        };
        // The first query also makes connections.
        client.nothing(PATIENCE).map_err(failed)?;
        let overhead = client.nothing(PATIENCE).map_err(failed)?;
        let filing = rayon::ThreadPoolBuilder::new().num_threads(FILING).build();
        let filing = filing.map_err(|e| Error::new(format!("cannot start threads: {e}")))?;
        let out = std::path::absolute(out).map_err(|e| Error::new(e.to_string()))?;
        let place = out.join(".koehler").join(format!("cluster-{}", std::process::id()));
        let cluster = Cluster {
            client,
            scheduler: scheduler.into(),
            place,
            folder: OnceLock::new(),
            overhead,
            here: Mutex::default(),
            filing,
            lost: AtomicBool::new(false),
            quiet,
            said: Mutex::default(),
        };
        cluster.note(&format!("a query of {scheduler} takes {:.2} s", overhead.as_secs_f64()));
        Ok(cluster)
    }

    /// Says something once.
    fn note(&self, text: &str) {
        if !self.quiet && locked(&self.said).insert(text.into()) {
            eprintln!("note: {text}");
        }
    }

    /// The shared folder; none where it cannot be made.
    fn folder(&self) -> Option<&Folder> {
        let make = || match std::fs::create_dir_all(&self.place) {
            Ok(()) => Some(Folder(self.place.clone())),
            Err(e) => {
                self.note(&format!("cannot make {}: {e}; all is done here", self.place.display()));
                None
            }
        };
        self.folder.get_or_init(make).as_ref()
    }

    /// Whether a job is worth the way.
    fn pays(&self, job: &dyn Job) -> bool {
        if job.count() < 2 || self.lost.load(Ordering::Acquire) {
            return false;
        }
        if job.name() == UNITS {
            return true;
        }
        let took = locked(&self.here).get(&(job.name(), job.count())).copied();
        took.is_some_and(|took| took >= WORTH * self.overhead)
    }

    /// Does a job with the threads of this process, and notes how long it took.
    fn here(&self, job: &dyn Job) {
        let begin = Instant::now();
        Threads.run(job);
        let took = begin.elapsed();
        if job.name() != UNITS && job.count() > 1 {
            locked(&self.here).insert((job.name(), job.count()), took);
            if took < WORTH * self.overhead {
                self.note(&format!(
                    "\"{}\" stays here: a job of it takes less than {WORTH} queries that do nothing",
                    job.name()
                ));
            }
        }
    }

    fn away(&self, job: &dyn Job, folder: &Folder) -> Result<()> {
        use koehler::engine::Blobs;
        let key = folder.put(&job.parameters(folder)?)?;
        let parameters = encode(&Parameters { folder: folder.0.clone(), key })?;
        let function = row::function(job.name(), job.version());
        let item = |i: usize| Ok((i, job.item(i)?));
        let mut left: Vec<(usize, Vec<u8>)> = (0..job.count()).map(item).collect::<Result<_>>()?;
        for attempt in 1..=TRIES {
            let mut answers = BTreeMap::new();
            let mut take = |more: Answers| answers.extend(more);
            let ended = self.client.answers(&function, &parameters, &left, &mut take);
            self.take(job, folder, &answers);
            left.retain(|(i, _)| !answers.contains_key(i));
            let failed = match ended {
                Ok(()) if left.is_empty() => return Ok(()),
                Ok(()) => format!("{} items were lost", left.len()),
                Err(e) => e.to_string(),
            };
            self.note(&format!(
                "query {attempt} of {TRIES} for \"{}\" failed: {failed}",
                job.name()
            ));
            if let Err(e) = self.client.nothing(PATIENCE) {
                self.lost.store(true, Ordering::Release);
                return Err(Error::new(format!("no worker of {} is left: {e}", self.scheduler)));
            }
        }
        Err(Error::new(format!("{} of {} items were not done", left.len(), job.count())))
    }

    /// Hands answers on. What a worker could not do is done here afterwards, and said.
    fn take(&self, job: &dyn Job, folder: &Folder, answers: &BTreeMap<usize, Vec<u8>>) {
        let answers: Vec<(&usize, &Vec<u8>)> = answers.iter().collect();
        let file = |(i, answer): (&usize, &Vec<u8>)| {
            let taken = Answer::decoded(answer).and_then(|answer| {
                answer.said.into_iter().for_each(|words| job.said(*i, Said::Words(words)));
                let output = answer.output.map_err(Error::new)?;
                job.done(*i, &output.bytes(folder)?)
            });
            if let Err(e) = taken {
                self.note(&format!("an item of \"{}\" is done here: {e}", job.name()));
            }
        };
        let known = answers.into_par_iter().filter(|(i, _)| **i < job.count());
        self.filing.install(|| known.for_each(file));
    }
}

impl Engine for Cluster {
    fn run(&self, job: &dyn Job) {
        let folder = if self.pays(job) { self.folder() } else { None };
        let Some(folder) = folder else { return self.here(job) };
        if let Err(e) = self.away(job, folder) {
            self.note(&format!("{e}; what is left is done here"));
        }
    }

    fn wide(&self) -> Option<usize> {
        Some(WIDE)
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        if let Some(Some(folder)) = self.folder.get()
            && let Err(e) = std::fs::remove_dir_all(&folder.0)
        {
            self.note(&format!("cannot remove {}: {e}", folder.0.display()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_function_of_stages_has_this_name() {
        assert!(koehler::FUNCTIONS.iter().any(|function| function.name == UNITS));
    }
}
