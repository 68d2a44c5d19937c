//! The estimator's speed: published flight data and a simulated six-degree-of-freedom campaign in; every figure with its floor and
//! with the references it is held against, out. `cargo bench`; the flight data are looked for in KOEHLER_DATA or ../shared/data.

mod work;

use std::hint::black_box;
use std::time::Instant;
use work::{Work, hfb320, six_dof};

fn main() {
    let threads = rayon_threads(1);
    threads.install(|| {
        if let Some(work) = hfb320(1) {
            figure("HFB-320 case A: 1 segment, 11 parameters", &work);
        }
        if let Some(work) = hfb320(10) {
            figure("HFB-320 ten copies as ten segments: 11 + 40 parameters", &work);
        }
        figure("6-DoF, 12 states, 60 parameters, 10 segments", &six_dof(10));
    });
}

fn rayon_threads(n: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads")
}

/// Least time of `repeats` runs, s: what the machine needs when nothing disturbs it.
fn least(repeats: usize, mut f: impl FnMut()) -> f64 {
    (0..repeats)
        .map(|_| {
            let t = Instant::now();
            f();
            t.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn figure(name: &str, work: &Work) {
    let (low, high) = (1, 5);
    let repeats = if work.samples() > 100_000 { 3 } else { 40 };
    let a = least(repeats, || {
        black_box(work.estimate(low));
    });
    let b = least(repeats, || {
        black_box(work.estimate(high));
    });
    println!("{name}: {:.4} ms per iteration, {:.3} ms without", 1e3 * (b - a) / (high - low) as f64, 1e3 * (a - (b - a) / 2.0));
}
