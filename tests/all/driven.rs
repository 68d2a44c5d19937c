//! A fuzz target (a plain function of bytes), inputs of its format and where the pieces of that format
//! begin, in; runs of the target over what is kept for it, and over inputs that `bolero` makes of that,
//! out: the same ones in every run and everywhere, because run `n` is made from the number `n`.

use crate::counted::peak;
use bolero_engine::driver::Options;
use bolero_engine::input::Bytes;
use bolero_engine::{BorrowedGeneratorTest, Driver, Engine, Test, ValueGenerator};
use rand::{RngExt, SeedableRng};
use std::ops::Bound;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Inputs of each target; a hundred times as many with `KOEHLER_SLOW=1`.
const RUNS: u64 = 10_000;
/// Bytes that one input is made from: more than a generator asks for.
const CHOICES: usize = 2048;
/// The longest that one input may take. It is held against a clock among the slow tests only.
const LONGEST: Duration = Duration::from_secs(1);

/// What a generator knows of a format.
#[derive(Clone, Copy)]
pub struct Form {
    /// Where its pieces begin (records, elements, fields, words), ascending.
    pub pieces: fn(&[u8]) -> Vec<usize>,
    /// Where in a piece its kind stands, and its size: offset, and bytes. None in a text.
    pub kind: Option<usize>,
    pub size: Option<(usize, usize)>,
    /// What its readers look for.
    pub words: &'static [&'static [u8]],
}

/// Inputs made of others, by whole pieces and by single bytes.
struct Damaged<'a> {
    seeds: &'a [Vec<u8>],
    form: Form,
}

/// A number below `n`, which is not 0.
fn below(driver: &mut impl Driver, n: usize) -> Option<usize> {
    driver.gen_usize(Bound::Included(&0), Bound::Excluded(&n))
}

fn byte(driver: &mut impl Driver) -> Option<u8> {
    driver.gen_u8(Bound::Unbounded, Bound::Unbounded)
}

impl ValueGenerator for Damaged<'_> {
    type Output = Vec<u8>;

    fn generate<D: Driver>(&self, driver: &mut D) -> Option<Vec<u8>> {
        let mut bytes = self.seeds[below(driver, self.seeds.len())?].clone();
        for _ in 0..below(driver, 6)? {
            match driver.gen_bool(None)? {
                true => self.piece(driver, &mut bytes)?,
                false => self.bytes(driver, &mut bytes)?,
            }
        }
        Some(bytes)
    }
}

impl Damaged<'_> {
    /// A place among the pieces of an input: from byte, to byte.
    fn place(&self, driver: &mut impl Driver, bytes: &[u8]) -> Option<(usize, usize)> {
        let mut starts = (self.form.pieces)(bytes);
        starts.push(bytes.len());
        let at = below(driver, starts.len())?;
        Some((starts[at], starts.get(at + 1).copied().unwrap_or(bytes.len())))
    }

    /// Does something to a piece as a whole, or to what it says of itself.
    fn piece(&self, driver: &mut impl Driver, bytes: &mut Vec<u8>) -> Option<()> {
        let (from, to) = self.place(driver, bytes)?;
        match (below(driver, 7)?, self.form.kind, self.form.size) {
            (0, ..) => drop(bytes.drain(from..to)),
            (1, ..) => {
                let again = bytes[from..to].to_vec();
                drop(bytes.splice(from..from, again));
            }
            (2, ..) => {
                let other = &self.seeds[below(driver, self.seeds.len())?];
                let (start, end) = self.place(driver, other)?;
                drop(bytes.splice(from..to, other[start..end].iter().copied()));
            }
            (3, ..) => {
                let (other, _) = self.place(driver, bytes)?;
                let moved: Vec<u8> = bytes.drain(from..to).collect();
                let to = if other >= to { other - moved.len() } else { other.min(from) };
                drop(bytes.splice(to..to, moved));
            }
            (4, Some(kind), _) => {
                let new = byte(driver)? % 24;
                bytes.iter_mut().skip(from + kind).take(1).for_each(|b| *b = new);
            }
            (5 | 6, _, Some((at, width))) => {
                let lies =
                    [0, 1, below(driver, 10_000)? as u64, u64::from(u32::MAX), u64::MAX, 1 << 62];
                let lie = lies[below(driver, lies.len())?].to_le_bytes();
                let place = bytes.iter_mut().skip(from + at).take(width);
                place.zip(lie).for_each(|(byte, new)| *byte = new);
            }
            _ => {
                let word = self.form.words[below(driver, self.form.words.len())?];
                let end = if driver.gen_bool(None)? { to } else { from };
                drop(bytes.splice(from..end, word.iter().copied()));
            }
        }
        Some(())
    }

    /// Does something to bytes, whatever they are.
    fn bytes(&self, driver: &mut impl Driver, bytes: &mut Vec<u8>) -> Option<()> {
        let at = below(driver, bytes.len() + 1)?;
        let n = below(driver, 40)?.min(bytes.len() - at);
        match below(driver, 6)? {
            0 if n > 0 => bytes[at] ^= 1 << below(driver, 8)?,
            1 => {
                for byte_there in &mut bytes[at..at + n] {
                    *byte_there = byte(driver)?;
                }
            }
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..at + n)),
            4 => {
                let again = bytes[at..at + n].to_vec();
                drop(bytes.splice(at..at, again));
            }
            _ => bytes[at..at + n].fill(byte(driver)?),
        }
        Some(())
    }
}

/// The engine that `bolero` runs a target with: so many inputs, each from its number. The engine that it
/// has itself takes its seeds from the system, so that what fails once need not fail again.
struct Numbered<'a> {
    of: &'a str,
    runs: u64,
}

impl<T: Test<Value = Vec<u8>>> Engine<T> for Numbered<'_> {
    type Output = ();

    fn run(self, mut test: T, options: Options) {
        let mut choices = [0; CHOICES];
        for run in 0..self.runs {
            rand_pcg::Pcg64::seed_from_u64(run).fill(&mut choices[..]);
            match test.test(&mut Bytes::new(&choices, &options)) {
                Ok(is_made) => assert!(is_made, "{}, run {run}: no input was made", self.of),
                Err(error) => {
                    let bytes = test.generate_value(&mut Bytes::new(&choices, &options));
                    let path = saved(self.of, &bytes);
                    panic!("{}, run {run}: {error}; the input is {path}", self.of);
                }
            }
        }
    }
}

/// Keeps an input that fails where people can find it.
fn saved(of: &str, bytes: &[u8]) -> String {
    let path = std::env::temp_dir().join(format!("koehler-fuzz-{of}-{}", std::process::id()));
    match std::fs::write(&path, bytes) {
        Ok(()) => path.display().to_string(),
        Err(e) => format!("lost: {}: {e}", path.display()),
    }
}

fn is_slow() -> bool {
    std::env::var("KOEHLER_SLOW").as_deref() == Ok("1")
}

/// Memory that reading `bytes` may hold at once: a file that says how long it is may lie.
fn allowed(bytes: usize) -> usize {
    64 * bytes + (16 << 20)
}

/// Runs a target within its memory and, among the slow tests, its time: a second look tells an input that
/// takes long from a machine that had something else to do.
fn within_limits(bytes: &[u8], target: fn(&[u8]), is_timed: bool) {
    let took = || {
        let start = Instant::now();
        let ((), most) = peak(|| target(bytes));
        assert!(most <= allowed(bytes.len()), "{most} bytes held for {}", bytes.len());
        start.elapsed()
    };
    let time = took();
    assert!(!is_timed || time.min(LONGEST) < LONGEST || took() < LONGEST, "{time:?} for one input");
}

/// What is kept for a target, by name.
fn corpus(of: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(of);
    let folder = std::fs::read_dir(folder).expect("a corpus");
    let mut files: Vec<PathBuf> = folder.map(|file| file.expect("a file").path()).collect();
    files.sort();
    assert!(!files.is_empty(), "{of} has no corpus");
    let read = |path: PathBuf| std::fs::read(&path).map(|bytes| (path, bytes));
    files.into_iter().map(read).collect::<Result<_, _>>().expect("readable")
}

/// Drives a target with its corpus, and with what is made of that and of `seeds`.
pub fn drive(of: &str, target: fn(&[u8]), form: Form, seeds: &[Vec<u8>]) {
    let (is_timed, kept) = (is_slow(), corpus(of));
    for (path, bytes) in &kept {
        // the last line that is printed names what fails
        println!("{of}: {}", path.display());
        within_limits(bytes, target, is_timed);
    }
    let seeds: Vec<Vec<u8>> =
        seeds.iter().cloned().chain(kept.into_iter().map(|(_, bytes)| bytes)).collect();
    let made = Damaged { seeds: &seeds, form };
    let test =
        BorrowedGeneratorTest::new(|bytes: &Vec<u8>| within_limits(bytes, target, is_timed), made);
    let runs = if is_slow() { 100 * RUNS } else { RUNS };
    Numbered { of, runs }.run(test, Options::default().with_max_len(CHOICES));
}

/// The inputs of so many runs; one of them fails, if it is told to.
fn inputs(runs: u64, failing: usize) -> Vec<Vec<u8>> {
    let seeds = [b"one two three".to_vec()];
    let all = std::sync::Mutex::new(Vec::new());
    let keep = |bytes: &Vec<u8>| {
        let mut all = all.lock().unwrap_or_else(|e| e.into_inner());
        assert!(all.len() != failing, "no good");
        all.push(bytes.clone());
    };
    let made = Damaged { seeds: &seeds, form: crate::forms::TEXT };
    let test = BorrowedGeneratorTest::new(keep, made);
    Numbered { of: "itself", runs }.run(test, Options::default());
    all.into_inner().expect("inputs")
}

#[test]
fn the_same_number_makes_the_same_input() {
    let (some, again) = (inputs(300, usize::MAX), inputs(300, usize::MAX));
    assert_eq!(some, again);
    assert!(some.iter().filter(|bytes| *bytes != b"one two three").count() > 150);
}

#[test]
fn an_input_that_fails_is_told_and_kept() {
    let failed = std::panic::catch_unwind(|| inputs(30, 20)).expect_err("a failure");
    let told = failed.downcast_ref::<String>().expect("a text");
    assert!(told.starts_with("itself, run 20: no good; the input is "), "{told}");
    let path = told.rsplit(' ').next().expect("a path");
    assert_eq!(std::fs::read(path).expect("kept"), inputs(30, usize::MAX)[20]);
    std::fs::remove_file(path).expect("removed");
}
