//! The base as it was and as it is with what was added, in; the gap before and after, channel by
//! channel, and what it did to the other parameters, out.

use crate::diagnose::residual::whitening::Noise;
use crate::estimate::{Block, Case, Trace};
use crate::noise::theil;

/// A model at its fit: parameters per segment place (held-out ones with their own).
pub struct At<'a> {
    pub case: &'a Case,
    pub theta: &'a dyn Fn(usize) -> Vec<f64>,
}

/// One output, before and after.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Index of the segment; none for all of the set together.
    pub segment: Option<usize>,
    pub held_out: bool,
    /// None for all outputs together: `rms` is then the root of the geometric mean of their
    /// variances, `det R^(1/2n)`.
    pub output: Option<String>,
    pub unit: String,
    pub n: usize,
    pub before: Match,
    pub after: Match,
}

/// How well one output is matched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    pub rms: f64,
    /// Theil's inequality coefficient.
    pub theil: f64,
    /// Squares of the residuals, whitened by the noise that is left in the end, per sample: 1 where
    /// there is nothing but noise. The base's own noise has part of what it lacks in it.
    pub chi2: f64,
}

/// What a parameter of the base was, and is with what was added.
#[derive(Debug, Clone, PartialEq)]
pub struct Shift {
    pub name: String,
    pub unit: String,
    pub before: f64,
    pub after: f64,
    /// Standard deviations under the base's noise.
    pub before_sd: Option<f64>,
    pub after_sd: Option<f64>,
}

/// Measured and modelled, before and after, of one output of one held-out segment.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// Index among the segments.
    pub segment: usize,
    pub before: Trace,
    /// Modelled values with what was added.
    pub after: Vec<f64>,
}

/// Sums of one output over some segments.
#[derive(Debug, Clone, Default)]
struct Sums {
    name: String,
    unit: String,
    n: f64,
    measured: Vec<f64>,
    before: Vec<f64>,
    after: Vec<f64>,
    chi2: (f64, f64),
}

/// Channels of every held-out segment, and of the held-out and of the training segments together;
/// overlays of the held-out ones. `noise` whitens both, before and after.
pub fn closure(
    before: &At,
    after: &At,
    noise: &Noise,
    held_out: &[usize],
    training: &[usize],
    used: &[usize],
) -> (Vec<Channel>, Vec<Overlay>) {
    let (mut channels, mut overlays) = (Vec::new(), Vec::new());
    for (places, held) in [(held_out, true), (training, false)] {
        let mut together: Vec<Sums> = Vec::new();
        for &s in places {
            let mut of_segment: Vec<Sums> = Vec::new();
            let theta = [(before.theta)(s), (after.theta)(s)];
            let traces = [before.case.traces(s, &theta[0]), after.case.traces(s, &theta[1])];
            for (b, a) in traces[0].iter().zip(&traces[1]) {
                let Some(output) = before.case.outputs.iter().position(|&o| o == b.output) else {
                    continue;
                };
                let chi2 = [&b.modelled, &a.modelled].map(|modelled| {
                    let e = b.measured.iter().zip(modelled).map(|(z, y)| z - y).collect();
                    2.0 * noise.cost(s, &[Block::new(output, e, Vec::new())])
                });
                for sums in [&mut of_segment, &mut together] {
                    add(sums, b, &a.modelled, chi2);
                }
                if held {
                    overlays.push(Overlay {
                        segment: used[s],
                        before: b.clone(),
                        after: a.modelled.clone(),
                    });
                }
            }
            if held {
                channels.extend(named(&of_segment, Some(used[s]), held));
            }
        }
        channels.extend(named(&together, None, held));
    }
    (channels, overlays)
}

fn add(sums: &mut Vec<Sums>, trace: &Trace, after: &[f64], chi2: [f64; 2]) {
    let at = sums.iter().position(|s| s.name == trace.name).unwrap_or(sums.len());
    if at == sums.len() {
        sums.push(Sums { name: trace.name.clone(), unit: trace.unit.clone(), ..Sums::default() });
    }
    let sum = &mut sums[at];
    sum.n += trace.measured.iter().filter(|z| z.is_finite()).count() as f64;
    sum.measured.extend(&trace.measured);
    sum.before.extend(&trace.modelled);
    sum.after.extend(after);
    sum.chi2 = (sum.chi2.0 + chi2[0], sum.chi2.1 + chi2[1]);
}

fn named(sums: &[Sums], segment: Option<usize>, held_out: bool) -> Vec<Channel> {
    let matched = |s: &Sums, y: &[f64], chi2: f64| {
        let squares: f64 = s
            .measured
            .iter()
            .zip(y)
            .map(|(z, y)| (z - y) * (z - y))
            .filter(|v| v.is_finite())
            .sum();
        Match {
            rms: (squares / s.n).sqrt(),
            theil: theil(&s.measured, y).coefficient,
            chi2: chi2 / s.n,
        }
    };
    let mut all: Vec<Channel> = sums
        .iter()
        .map(|s| Channel {
            segment,
            held_out,
            output: Some(s.name.clone()),
            unit: s.unit.clone(),
            n: s.n as usize,
            before: matched(s, &s.before, s.chi2.0),
            after: matched(s, &s.after, s.chi2.1),
        })
        .collect();
    let n: f64 = sums.iter().map(|s| s.n).sum();
    let whole = |of: fn(&Channel) -> Match, chi2: f64| Match {
        rms: libm::exp(all.iter().map(|c| libm::log(of(c).rms)).sum::<f64>() / all.len() as f64),
        theil: f64::NAN,
        chi2: chi2 / n,
    };
    let before = whole(|c| c.before, sums.iter().map(|s| s.chi2.0).sum());
    let after = whole(|c| c.after, sums.iter().map(|s| s.chi2.1).sum());
    all.push(Channel {
        segment,
        held_out,
        output: None,
        unit: "-".into(),
        n: n as usize,
        before,
        after,
    });
    all
}
