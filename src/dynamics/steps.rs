//! A block of Jacobians and S in; S after some stages of Runge-Kutta steps, `S' = J_x S + J_p + J_d
//! D`, out.

use super::few;
pub use super::job::Steps;
use super::rows::{Block, Rows, each_chunk, row_of};
use crate::math::simd::{Eight, by_width};
use std::ops::Range;

by_width! {
    /// Takes S through some stages of a block, each the one of its step that its number modulo four
    /// tells.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn steps(block: Block, stages: Range<usize>, job: &mut Steps) = steps_body
}

#[inline(always)]
unsafe fn steps_body<V: Eight>(block: Block, stages: Range<usize>, job: &mut Steps) {
    let (size, reach) = (block.rows.size(), block.rows.reach);
    assert!(block.fits(&stages) && job.s.len() >= size && job.sum.len() >= size);
    assert!(
        job.k.as_ref().is_none_or(|k| k.len() >= size)
            && job.between.iter().all(|b| b.len() >= size.max(reach))
    );
    assert!(!job.plain || job.s.len() >= reach);
    let started = stages.clone().filter(|n| n % 4 == 0).count();
    if job.every > 0 {
        let kept = (job.phase + started).div_ceil(job.every) - usize::from(job.phase > 0);
        assert!(job.phase < job.every && job.kept.len() >= kept * size);
    }
    let whole = stages.start.is_multiple_of(4) && stages.end.is_multiple_of(4);
    let alone = job.plain && job.k.is_none() && reach <= size;
    // SAFETY: the sizes were just checked.
    unsafe {
        if !(whole && alone && few::steps::<V>(&block, &stages, job)) {
            each_chunk!(block.rows.lanes, v, steps_chunk, &block, &stages, job)
        }
    }
}

/// # Safety
/// As `steps_body`, sizes checked.
#[inline(always)]
unsafe fn steps_chunk<V: Eight, const K: usize>(
    v: usize,
    block: &Block,
    stages: &Range<usize>,
    job: &mut Steps,
) {
    let size = block.rows.size();
    let (mut phase, mut kept) = (job.phase, job.kept.as_mut_ptr());
    // SAFETY: the caller's promises.
    unsafe {
        for n in stages.clone() {
            if n % 4 == 0 && job.every > 0 {
                if phase == 0 {
                    copy_rows::<V, K>(v, block.rows, job.s.as_ptr(), kept);
                    kept = kept.add(size);
                }
                phase = (phase + 1) % job.every;
            }
            match n % 4 {
                0 => stage::<V, K, 0>(v, block, n, job),
                1 => stage::<V, K, 1>(v, block, n, job),
                2 => stage::<V, K, 2>(v, block, n, job),
                _ => stage::<V, K, 3>(v, block, n, job),
            }
        }
    }
}

/// # Safety
/// The machine has the width; both have the size of `rows`.
#[inline(always)]
unsafe fn copy_rows<V: Eight, const K: usize>(
    v: usize,
    rows: &Rows,
    from: *const f64,
    to: *mut f64,
) {
    for row in 0..rows.rows {
        for i in 0..K {
            let at = row * rows.lanes + v + 8 * i;
            // SAFETY: the caller's promises.
            unsafe { V::load(from.add(at)).store(to.add(at)) };
        }
    }
}

/// # Safety
/// As `steps_body`, sizes checked; `N` is `n % 4`.
#[inline(always)]
unsafe fn stage<V: Eight, const K: usize, const N: usize>(
    v: usize,
    block: &Block,
    n: usize,
    job: &mut Steps,
) {
    let rows = block.rows;
    let [a, b] = [job.between[0].as_mut_ptr(), job.between[1].as_mut_ptr()];
    let (s, sum) = (job.s.as_mut_ptr(), job.sum.as_mut_ptr());
    let from: *const f64 = if N == 0 && job.plain { s } else { [b, a, b, a][N] };
    let to = [a, b, a, s][N];
    let mut first = 0;
    // SAFETY: the caller's promises.
    unsafe {
        let (weight, ahead) = (V::splat(job.weights[N][0]), V::splat(job.weights[N][1]));
        let (values, direct) = (
            block.registers.as_ptr().cast::<f64>().add(n),
            block.direct.as_ptr().add(n * rows.stride),
        );
        for (row, &end) in rows.ends.iter().enumerate() {
            let products = rows.products.get_unchecked(first..end as usize);
            first = end as usize;
            let direct = (direct, rows.places(row, v));
            let k = row_of::<V, K>(values, direct, products, from.add(v));
            for (i, k) in k.into_iter().enumerate() {
                let at = row * rows.lanes + v + 8 * i;
                if let Some(list) = &mut job.k {
                    k.store(list.as_mut_ptr().add(at));
                }
                let led = match N {
                    0 => {
                        weight.fma(k, V::splat(0.0)).store(sum.add(at));
                        k
                    }
                    3 => k.add(V::load(sum.add(at))),
                    _ => {
                        weight.fma(k, V::load(sum.add(at))).store(sum.add(at));
                        k
                    }
                };
                ahead.fma(led, V::load(s.add(at))).store(to.add(at));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::{Block, LANES, Rows};
    use super::{Steps, steps};
    use crate::math::simd::{Aligned, Width};
    use crate::model::{Constants, Model};

    /// `n` states, each driven by its neighbour, the first one and three parameters.
    fn model(n: usize) -> Model {
        let mut text =
            String::from("title = \"Few\"\n[inputs]\nu = { unit = \"-\" }\n[parameters]\n");
        (0..3 * n).for_each(|i| text += &format!("p{i} = {{ unit = \"1/s\", start = 0.1 }}\n"));
        text += "[states]\n";
        for i in 0..n {
            let [a, b, c] = [0, 1, 2].map(|k| 3 * i + k);
            let rate = format!("p{a}*sin(x{i})*x{} - p{b}*u + p{c}*x0", (i + 1) % n);
            text += &format!("x{i} = {{ unit = \"-\", rate = \"{rate}\", start = 0.0 }}\n");
        }
        text += "[outputs]\ny = { unit = \"-\", value = \"x0\" }\n";
        Model::parse("few", &text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Numbers without any pattern, some of them zeros of both signs.
    fn numbers(n: usize, seed: usize) -> Vec<f64> {
        let of = |i: usize| match (7 * i + seed) % 5 {
            0 => -0.0,
            1 => 0.0,
            _ => ((i * i + 3 * i + seed) as f64).sin(),
        };
        (0..n).map(of).collect()
    }

    #[test]
    fn registers_hold_what_memory_would() {
        for n in 1..=5 {
            let model = model(n);
            let linear = model.linearize(&(0..3 * n).collect::<Vec<_>>(), &[]);
            for (lanes, every) in [(8, 0), (16, 1), (24, 2), (40, 3)] {
                let rows = Rows::new(&linear.rates, &linear.rates_program, n, n, lanes);
                let size = linear.rates_program.file_len() * LANES;
                let mut registers = Aligned::of_zeros(size);
                registers.copy_from_slice(&numbers(size, 1));
                let mut direct = Aligned::of_zeros(rows.direct_size());
                rows.spread(registers.rows_of(), &mut direct);
                let block = Block { rows: &rows, registers: registers.rows_of(), direct: &direct };
                let of = |width| {
                    let zeros = || Aligned::of_zeros(rows.size());
                    let (mut s, mut sum, mut a, mut b) = (zeros(), zeros(), zeros(), zeros());
                    s.copy_from_slice(&numbers(rows.size(), 2));
                    let mut kept = vec![0.0; 4 * rows.size()];
                    let mut job = Steps {
                        s: &mut s,
                        sum: &mut sum,
                        between: [&mut a, &mut b],
                        k: None,
                        weights: super::super::tangent::weights(0.1),
                        plain: true,
                        kept: &mut kept,
                        every,
                        phase: every / 2,
                    };
                    // SAFETY: this machine has the width.
                    unsafe { steps(width, block, 0..LANES, &mut job) };
                    s.iter().chain(&kept).map(|x| x.to_bits()).collect::<Vec<u64>>()
                };
                let want = of(Width::Plain);
                for &width in Width::available() {
                    assert_eq!(of(width), want, "{n} states, {lanes} lanes, {width:?}");
                }
            }
        }
    }
}
