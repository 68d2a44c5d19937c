//! The estimator's speed: published flight data and a simulated six-degree-of-freedom campaign in;
//! every figure with its floor and with the references it is held against, out. `cargo bench` (`cargo bench --bench estimator -- filter`: the filter alone; `-- ceiling`: beside programs written in C; `-- fused`: what other shapes of a pass could reach); the
//! flight data are looked for in KOEHLER_DATA or ../shared/data.
//!
//! Times are the least of many runs, so that others on the machine count little. An iteration is
//! outputs, exact Jacobian, R, normal equations and solution: the difference of estimations of one
//! and of five iterations, over four.

mod work;

use koehler::dynamics::{Directions, Propagator, Tier};
use koehler::estimate::{Prepared, Segment};
use koehler::math::simd::{Eight, Width, by_width};
use std::hint::black_box;
use std::time::Instant;
use work::{
    Work, hfb320, hfb320_filtered, six_dof, six_dof_briefly, six_dof_filtered, whole_campaign,
};

fn main() {
    let one = threads(1);
    if std::env::args().any(|a| a == "fused") {
        return work::fused::run(BLOCKS);
    }
    if std::env::args().any(|a| a == "ceiling") {
        return one.install(beside_c);
    }
    println!("vectors: {:?}", Width::detect());
    let peak = one.install(peak);
    println!("fused multiply-adds, measured peak of one thread: {:.1} 10^9/s\n", peak / 1e9);
    if std::env::args().any(|a| a == "filter") {
        return one.install(filter);
    }
    if std::env::args().any(|a| a == "six") {
        return one.install(|| alone("6-DoF", &six_dof_briefly(10), 100));
    }
    if let (true, Some(ten)) = (std::env::args().any(|a| a == "ten"), hfb320(10)) {
        return one.install(|| alone("HFB-320, ten segments", &ten, 2000));
    }
    one.install(|| {
        println!("{:46} {:>12} {:>10} {:>7} {:>7}   share of peak", "one thread", "", "ms", "must", "aim");
        if let Some(work) = hfb320(1) {
            figure("HFB-320 case A, 1 segment, 11 parameters", &work, [[0.30, 0.18], [0.17, 0.10]], peak);
            setup("  set-up", &work, [[1.0, 0.3], [10.0, 2.5]]);
            println!("  hand-written C 0.10..0.18, CasADi with gcc 0.30, SciPy/numba 0.94, JAX 1.4, NumPy 110, Octave 1210\n");
        }
        if let Some(work) = hfb320(10) {
            figure("ten copies as ten segments, 11 + 40 parameters", &work, [[3.0, 1.6], [1.9, 1.0]], peak);
            println!("  hand-written C 1.2..2.0, CasADi with gcc 4.2, SciPy/numba 13, JAX 11, NumPy 1734, Octave 17082\n");
        }
        let work = six_dof(10);
        figure("6-DoF, 12 states, 60 parameters, 10 segments", &work, [[f64::NAN; 2]; 2], peak);
        setup("  set-up", &work, [[f64::NAN; 2]; 2]);
    });
    one.install(beside_c);
    one.install(filter);
    scaling(&one);
    two_threads(&one);
    whole(&one);
}

/// Blocks in which one program follows the other.
const BLOCKS: usize = 50;

/// The same where one takes long.
const FEWER_BLOCKS: usize = 20;

/// Iterations beside those of programs written in C for these models, block by block in turn: the
/// medians of the ratios are what other work on the machine changes least.
fn beside_c() {
    use work::ceiling::{AVX2, AVX512, FAST, PLAIN};
    println!(
        "\nbeside C, medians of {BLOCKS} blocks in turn ({FEWER_BLOCKS} of 6-DoF): C, ms; interpreter and machine code, times C"
    );
    let (data, six) = (work::data(), six_dof_briefly(10));
    let hfb = hfb320(1).zip(hfb320(10)).zip(data);
    let widest = Width::detect();
    let rows = [
        ("AVX-512", Width::Avx512, &[PLAIN, AVX512][..]),
        ("AVX-512, C with -ffast-math", Width::Avx512, &[PLAIN, AVX512, FAST]),
        ("AVX2", Width::Avx2, &[PLAIN, AVX2]),
    ];
    for (name, width, flags) in rows {
        if !Width::available().contains(&width) {
            println!("  {name}: not on this machine");
            continue;
        }
        Width::narrow(width);
        let say = |what: &str, [c, i, n]: [f64; 3]| {
            println!("  {name:28} {what:28} {c:8.3} ms {i:6.2} {n:6.2}");
        };
        if let Some(((one, ten), data)) = &hfb {
            hfb_beside_c(flags, data, [one, ten])
                .into_iter()
                .for_each(|(what, row)| say(what, row));
        }
        if let Some(c) = work::hand::Hand::of(flags, &six) {
            let ours = |tier| milliseconds(&six, tier, 3);
            say("6-DoF, 10 segments, 60 + 120", c.beside(FEWER_BLOCKS, ours));
        }
    }
    Width::narrow(widest);
}

/// Milliseconds of one iteration, of so many runs.
fn milliseconds(work: &Work, tier: Tier, runs: usize) -> f64 {
    let [x, y] = [1, 5].map(|n| least(runs, || work.estimate(n, tier)));
    1e3 * (y - x) / 4.0
}

/// Of the HFB-320 as one and as ten segments: milliseconds of C, and times C both tiers.
fn hfb_beside_c(
    flags: &[&[&str]],
    data: &std::path::Path,
    [one, ten]: [&Work; 2],
) -> Vec<(&'static str, [f64; 3])> {
    let Some(c) = work::ceiling::Ceiling::of(flags, data) else { return Vec::new() };
    let block = |_| {
        let both = c.run().into_iter().zip([(one, 20), (ten, 4)]).map(|(c, (work, runs))| {
            let ours = |tier| milliseconds(work, tier, runs) / c;
            [c, ours(Tier::Interpreter), ours(Tier::Native)]
        });
        both.collect::<Vec<[f64; 3]>>()
    };
    let blocks: Vec<Vec<[f64; 3]>> = (0..BLOCKS).map(block).collect();
    let names = ["1 segment, 11 parameters", "10 segments, 11 + 40"];
    let row = |(at, name): (usize, &'static str)| {
        let of =
            |column: usize| -> Vec<f64> { blocks.iter().map(|block| block[at][column]).collect() };
        (name, [0, 1, 2].map(|column| work::ceiling::median(of(column))))
    };
    names.into_iter().enumerate().map(row).collect()
}

/// One pass through the records with all derivatives, by output error and by a filter.
fn filter() {
    println!("\none pass with derivatives, ms: output error, filter");
    let line = |name: &str, [plain, filtered]: [&Work; 2], most: f64| {
        let [a, b] = [plain, filtered].map(pass);
        println!("  {name:44} {:9.3} {:9.3}: {:.1} times ({most} wanted)", 1e3 * a, 1e3 * b, b / a);
    };
    if let (Some(plain), Some(filtered)) = (hfb320(1), hfb320_filtered()) {
        line("HFB-320, 4 states, 11 parameters", [&plain, &filtered], 5.0);
    }
    line("6-DoF, 12 states, 60 parameters", [&six_dof(1), &six_dof_filtered(1)], 10.0);
}

/// Nothing but iterations of one work by machine code, for a profiler.
fn alone(name: &str, work: &Work, runs: usize) {
    let seconds = least(runs, || work.estimate(5, Tier::Native));
    println!(
        "{name}, machine code: five iterations and a set-up {:.2} ms, {runs} times",
        1e3 * seconds
    );
}

/// Seconds of one pass through all segments at the model's starts, with derivatives.
fn pass(work: &Work) -> f64 {
    let segments: Vec<Segment> =
        work.records.iter().map(|r| Segment { record: r.clone(), ..Segment::default() }).collect();
    let case = Prepared::new(&work.model, &segments, &work.settings)
        .expect("settings that fit the model")
        .compiled()
        .case();
    let all = || {
        for s in 0..case.records.len() {
            black_box(case.evaluate(s, &case.layout.local(s, &case.layout.start), true));
        }
    };
    least(30, all)
}

/// A campaign as large as those of published work, from its starts to its uncertainties.
fn whole(one: &rayon::ThreadPool) {
    let (work, two) = (whole_campaign(), threads(2));
    println!(
        "\n6-DoF, 20 maneuvers of 30 s at 50 Hz, 60 parameters up to a fifth off: on one and two threads"
    );
    let each = [one, &two].map(|pool| pool.install(|| iteration(&work, Tier::Auto)));
    println!("  one iteration     {:8.3} s {:8.3} s", each[0], each[1]);
    let mut iterations = 0;
    let mut clock = |pool: &rayon::ThreadPool| {
        pool.install(|| least(3, || iterations = work.whole(Tier::Auto)))
    };
    let all = [clock(one), clock(&two)];
    println!(
        "  all {iterations} iterations {:8.2} s {:8.2} s (10 s wanted on two threads)",
        all[0], all[1]
    );
}

fn threads(n: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads")
}

/// Least time of `runs` runs, s: what others on the machine add is left out.
fn least(runs: usize, mut f: impl FnMut()) -> f64 {
    let mut run = || {
        let start = Instant::now();
        f();
        start.elapsed().as_secs_f64()
    };
    (0..runs).map(|_| run()).fold(f64::INFINITY, f64::min)
}

/// Seconds of one iteration.
fn iteration(work: &Work, tier: Tier) -> f64 {
    let runs = (2_000_000 / (work.samples() * work.model.parameters.len())).clamp(5, 300);
    let [a, b] = [1, 5].map(|iterations| least(runs, || work.estimate(iterations, tier)));
    (b - a) / 4.0
}

const TIERS: [(Tier, &str); 2] = [(Tier::Interpreter, "interpreter"), (Tier::Native, "native")];

fn line(name: &str, tier: &str, ms: f64, [must, aim]: [f64; 2]) -> String {
    let number = |x: f64| if x.is_finite() { format!("{x:.2}") } else { "-".into() };
    format!("{name:46} {tier:>12} {ms:10.3} {:>7} {:>7}", number(must), number(aim))
}

fn figure(name: &str, work: &Work, floors: [[f64; 2]; 2], peak: f64) {
    for ((tier, word), floors) in TIERS.into_iter().zip(floors) {
        let seconds = iteration(work, tier);
        let share = work.multiply_adds() / seconds / peak;
        let per = 1e9 * seconds / (work.samples() * work.directions()) as f64;
        println!(
            "{}   {:4.1}%  {per:.2} ns per sample and parameter",
            line(name, word, 1e3 * seconds, floors),
            100.0 * share
        );
    }
}

/// From a compiled model to programs (and machine code) that are ready to run.
fn setup(name: &str, work: &Work, floors: [[f64; 2]; 2]) {
    let parameters = (0..work.model.parameters.len()).collect();
    let starts = work.settings.initial.iter().filter_map(|name| work.model.state(name)).collect();
    let directions = Directions { parameters, starts };
    for ((tier, word), floors) in TIERS.into_iter().zip(floors) {
        let seconds = least(20, || {
            let mut propagator =
                Propagator::new(&work.model, directions.clone()).expect("a propagator");
            propagator.compile(tier, 20, work.samples());
            black_box(&propagator);
        });
        println!("{}", line(name, word, 1e3 * seconds, floors));
    }
}

/// Time of an iteration per segment has to stay the same.
fn scaling(one: &rayon::ThreadPool) {
    println!("\n6-DoF, one thread, automatic tier: per iteration and segment");
    let mut first = f64::NAN;
    for segments in [10, 100, 1000] {
        let work = six_dof(segments);
        let each = one.install(|| iteration(&work, Tier::Auto)) / segments as f64;
        first = if first.is_nan() { each } else { first };
        println!(
            "  {segments:5} segments {:10.4} ms, {:.2} of the first (within 0.8..1.2)",
            1e3 * each,
            each / first
        );
    }
}

/// Time on the clock of one thread against two.
fn two_threads(one: &rayon::ThreadPool) {
    let (work, two) = (six_dof(100), threads(2));
    let clock = |pool: &rayon::ThreadPool| {
        let run = |iterations| {
            let start = Instant::now();
            pool.install(|| work.estimate(iterations, Tier::Auto));
            start.elapsed().as_secs_f64()
        };
        (0..5).map(|_| run(5) - run(1)).fold(f64::INFINITY, f64::min)
    };
    println!(
        "\n6-DoF, 100 segments, two threads: {:.2} times one (1.8 wanted, on two idle cores)",
        clock(one) / clock(&two)
    );
}

by_width! { fn multiply_adds(rounds: usize, out: &mut f64) = multiply_adds_body }

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn multiply_adds_body<V: Eight>(rounds: usize, out: &mut f64) {
    // SAFETY: the caller's promise; the array has eight numbers.
    unsafe {
        let (a, b) = (V::splat(0.999_999), V::splat(1e-9));
        let mut sums = [V::splat(1.0); 12];
        for _ in 0..rounds {
            sums.iter_mut().for_each(|s| *s = s.fma(a, b));
        }
        let mut lanes = [0.0; 8];
        for s in sums {
            s.store(lanes.as_mut_ptr());
            *out += lanes[0];
        }
    }
}

/// Fused multiply-adds per second.
fn peak() -> f64 {
    let rounds = 200_000;
    let mut out = 0.0;
    // SAFETY: the width is this machine's.
    let seconds = least(20, || unsafe { multiply_adds(Width::detect(), rounds, &mut out) });
    black_box(out);
    (rounds * 12 * 8) as f64 / seconds
}
