//! The HFB-320's whole pass printed as C in shapes that machine code could have, compiled, and timed
//! in turn with the program that was written by hand: what an emitter could reach, before there is
//! one (`cargo bench --bench estimator -- fused`).
//!
//! The operations are those of the compiled model, in its order and fused as it fuses them; the sums
//! of the sensitivities leave out what is always zero or one. All programs share reading, residuals,
//! sums of products and solution with the program by hand (`hfb.h`, beside it).

mod list;
mod printer;
mod shapes;

use super::ceiling::{self, AVX512, Ceiling, FAST, PLAIN, median};
use koehler::math::simd::Width;
use koehler::model::{Constants, Model};
use printer::Printer;
use std::path::Path;

/// How a pass goes.
#[derive(Clone, Copy, PartialEq)]
pub enum Shape {
    /// States, entries and sensitivities of a stage in one loop body.
    Fused,
    /// Lanes are segments for states and entries; then the sensitivities of each segment.
    Segments,
    /// As the estimator does it: states through a chunk, entries with stages for lanes, sensitivities.
    Passes,
}

/// How printed programs are compiled: what is fused is what we say.
const PRINTED: &[&str] = &["-O2", "-march=native", "-ffp-contract=off", "-w"];
/// Sixteen registers instead of 32, no masks, no operands that are broadcast.
const SIXTEEN: &[&str] = &["-mno-avx512f"];

/// Prints ratios to the program by hand, medians of so many blocks.
pub fn run(blocks: usize) {
    let Some(data) = super::data() else { return };
    if Width::detect() != Width::Avx512 {
        return println!("no AVX-512 on this machine: nothing to measure");
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/hfb320/hfb320.model.toml");
    let model = Model::load(&file, &Constants::default()).expect("the model");
    let (Some(hand), Some(by_hand)) =
        (ceiling::source(&data), Ceiling::of(&[PLAIN, AVX512], &data))
    else {
        return;
    };
    let printer = Printer::new(&model, 8);
    println!("operations, entries that change along a trajectory:");
    for (what, list) in [
        ("rates and their entries", &printer.stage),
        ("outputs and theirs", &printer.outs),
        ("both together", &printer.point),
    ] {
        println!("  {what:26} {:?}", list.size());
    }
    let uncosted = Ceiling::made(&without_cost(&hand), &[PLAIN, AVX512], &data);
    let mut others = vec![
        ("by hand, without the pass for the cost".to_string(), uncosted),
        ("by hand, -ffast-math".to_string(), Ceiling::of(&[PLAIN, AVX512, FAST], &data)),
    ];
    for (registers, widths) in [(32, &[8, 4, 2][..]), (16, &[4, 2])] {
        for (shape, name) in [
            (Shape::Fused, "(a) one loop body"),
            (Shape::Segments, "(b) segments side by side"),
            (Shape::Passes, "(c) three passes"),
        ] {
            for &w in widths {
                let flags = if registers == 16 { &[PRINTED, SIXTEEN][..] } else { &[PRINTED] };
                let text = Printer::new(&model, w).program(shape);
                let name = format!("{name}, {registers} registers of {}", 64 * w);
                others.push((name, Ceiling::made(&text, flags, &data)));
            }
        }
    }
    let mut first = Vec::new();
    let mut ratios = vec![[Vec::new(), Vec::new()]; others.len()];
    for _ in 0..blocks {
        let hand = by_hand.run();
        for ((_, program), ratios) in others.iter().zip(&mut ratios) {
            let Some(program) = program else { continue };
            for ((times, hand), ratios) in program.run().into_iter().zip(hand).zip(ratios) {
                ratios.push(times / hand);
            }
        }
        first.push(hand);
    }
    let [one, ten] = [0, 1].map(|i| median(first.iter().map(|t| t[i]).collect()));
    println!("medians of {blocks} blocks in turn: 1 segment, 10 segments");
    println!("  {:46} {one:8.3} ms {ten:6.3} ms", "by hand");
    for ((name, _), [one, ten]) in others.iter().zip(ratios).filter(|(_, r)| !r[0].is_empty()) {
        println!("  {name:46} {:8.2} {:9.2}", median(one), median(ten));
    }
}

/// The program by hand computes the cost of ten segments once more after a step; ours does not.
fn without_cost(source: &str) -> String {
    let begin = source.find("static void plain(").unwrap_or(source.len());
    format!("{}{}", &source[..begin], printer::NO_COST)
}
