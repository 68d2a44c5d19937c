//! The Gauss-Newton iteration: a problem over segments in; the maximum-likelihood point, its normal
//! matrix and history out.

use super::fit::{Fit, ended, failed};
use super::iteration::{Iteration, Stop};
use super::layout::Layout;
use super::method::{Method, StepControl};
use super::point::{Chance, Point, Trial, bounded_step};
use super::problem::Evaluate;

/// A step of this length, in standard deviations, is nothing: if no part of it improves the
/// likelihood, rounding is the reason.
const NOTHING: f64 = 1e-3;
/// A step that promises less log-likelihood than this decides nothing, whether or not any part of it brings
/// something: a twentieth of an sd.
const FLAT: f64 = 1e-3;
/// A step cut short that changes `det R` by less than this share of it is no progress.
const CREEP: f64 = 1e-8;
/// So many steps in a row that are cut short and bring next to nothing are a valley with kinks.
const CRAWL: usize = 4;
/// And so many that bring less than a fit cares for.
const CREEP_STEPS: usize = 2;
/// And the whole step is no longer than this many standard deviations.
const NEAR: f64 = 2.0;
/// At a kink so many parameters are held in turn: the kink lies across what the step moves most.
const TURNS: usize = 8;
/// Halvings of a step along a kink: a shorter one brings next to nothing.
const SHORTER: usize = 3;
/// First damping of Levenberg and Marquardt, as a share of the diagonal; with more than `DAMPED` a
/// small change proves nothing.
const DAMPING: f64 = 1e-3;
const DAMPED: f64 = 1e-2;

/// A step that was taken.
struct Taken {
    point: Point,
    /// Trial points refused before.
    refused: usize,
    damping: f64,
    /// `sqrt(d' M d)` of the step itself.
    length: f64,
}

/// Minimises `J = 1/2 sum e' R^-1 e + N/2 ln|R|` (attas A4) from `layout.start`.
pub fn minimise<F: Evaluate>(layout: &Layout, evaluate: &F, method: &Method) -> Fit {
    let Some(mut point) = Point::at(layout, evaluate, layout.start.clone()) else {
        return failed(layout, Stop::NotFinite);
    };
    if point.noise.iter().all(|r| r.count.iter().all(|&n| n == 0)) {
        return ended(layout, method, point, Vec::new(), Stop::NoData);
    }
    let mut history = vec![line(0, layout, &point)];
    if layout.start.is_empty() {
        // Where nothing is free, this is the minimum.
        return ended(layout, method, point, history, Stop::Converged);
    }
    let mut stop = Stop::IterationLimit;
    let mut damping = Damping { value: DAMPING, growth: 2.0 };
    for iteration in 1..=method.max_iterations {
        let whole = point.step(layout, method, None);
        if whole.is_none() && method.control == StepControl::Halving {
            stop = Stop::Singular;
            break;
        }
        let length = whole.as_ref().map(|step| point.length(step));
        let is_spared = |length| method.spares_last && length <= method.step_tolerance;
        if length.is_some_and(|l| l < NEAR && crawls(&history, method) || is_spared(l)) {
            stop = Stop::Converged;
            break;
        }
        let mut taken = match (method.control, &whole) {
            (StepControl::Halving, Some(step)) => {
                // What refused the last whole step is likely to refuse this one.
                let before = history.last().map_or(0, |i| i.halvings);
                let chance = if before > 0 { Chance::Poor } else { Chance::Good };
                halve(layout, evaluate, &point, (step, chance), method.max_halvings)
            }
            _ => damp(layout, evaluate, &point, &mut damping, method),
        };
        let nothing = method.step_tolerance.max(NOTHING);
        let [is_long, is_short] =
            [length.is_some_and(|l| l > nothing), length.is_some_and(|l| l <= nothing)];
        let cut_short =
            taken.as_ref().is_none_or(|taken| taken.refused > 0 || taken.damping > DAMPED);
        if is_long && cut_short && is_idle(&point, taken.as_ref()) {
            let other = turned(layout, evaluate, &point, whole.as_deref(), method);
            if !is_idle(&point, other.as_ref()) {
                taken = [taken, other]
                    .into_iter()
                    .flatten()
                    .min_by(|a, b| a.point.cost.total_cmp(&b.point.cost));
            } else if whole
                .as_ref()
                .is_some_and(|step| is_lowest(layout, evaluate, &point, step, method.max_halvings))
            {
                stop = Stop::Converged;
                break;
            }
        }
        let Some(taken) = taken else {
            stop = match length {
                None => Stop::Singular,
                Some(_) if !is_long => Stop::Converged,
                Some(_) if whole.is_some_and(|step| point.promise(&step) < FLAT) => Stop::Converged,
                Some(_) => Stop::NoImprovement,
            };
            break;
        };
        // Where only damping makes a step finite, its own length counts; whether the data determine
        // it is judged at the end.
        let length = length.unwrap_or(taken.length);
        let change = libm::expm1(taken.point.ln_det - point.ln_det).abs();
        point = taken.point;
        let now = Iteration {
            change,
            step: length,
            halvings: taken.refused,
            damping: taken.damping,
            ..line(iteration, layout, &point)
        };
        history.push(now);
        let small = method.step_tolerance == 0.0 || length <= method.step_tolerance;
        let flat = method.gradient_tolerance == 0.0 || now.gradient <= method.gradient_tolerance;
        // A step cut short changes little without being near the optimum; one that is short as a whole
        // is: rounding, or a kink, cut it.
        let free = taken.refused == 0 && taken.damping <= DAMPED || is_short || length <= NOTHING;
        if change < method.tolerance && small && flat && free {
            stop = Stop::Converged;
            break;
        }
    }
    ended(layout, method, point, history, stop)
}

/// The point at `theta + length * step` inside the bounds, if it is finite and not worse.
fn try_step<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    point: &Point,
    step: &[f64],
    (length, chance): (f64, Chance),
) -> Option<Point> {
    let theta = layout.moved(&point.theta, step, length);
    Trial::at(layout, evaluate, theta, chance)
        .filter(|trial| trial.cost <= point.cost)?
        .complete(layout, evaluate)
}

/// Whether a step brings nothing: there is none, or it changes `det R` by less than `CREEP` of it.
fn is_idle(point: &Point, taken: Option<&Taken>) -> bool {
    taken.is_none_or(|taken| libm::expm1(taken.point.ln_det - point.ln_det).abs() < CREEP)
}

/// Whether the iteration creeps along kinks of the cost (of a model with friction or stops they lie
/// wherever an event falls on a sample, of `abs` wherever its argument changes sign): the last steps
/// were all cut short, the whole one is short, and together they lowered the cost by less than one
/// step of `step_tolerance` does that ends at the lowest point of a parabola; or the last two, cut short or
/// not, by less than `creep`. At a kink a gradient need not vanish, and shorter steps come no nearer.
fn crawls(history: &[Iteration], method: &Method) -> bool {
    let tolerated = 0.5 * method.step_tolerance * method.step_tolerance;
    brought(history, CRAWL, |i| i.step < NEAR && i.halvings > 0)
        .is_some_and(|gain| gain < tolerated)
        || brought(history, CREEP_STEPS, |i| i.step < NEAR).is_some_and(|gain| gain < method.creep)
}

/// By how much the last `steps` together lowered the cost; none where there are fewer, or one of them is not
/// `such`.
pub fn brought(
    history: &[Iteration],
    steps: usize,
    such: impl Fn(&Iteration) -> bool,
) -> Option<f64> {
    let before = history.len().checked_sub(steps + 1)?;
    let (first, last) = (&history[before], &history[before + 1..]);
    let end = last.last().filter(|_| last.iter().all(such))?;
    Some(first.cost - end.cost)
}

/// A step past a kink of the cost, which stops one that is only shortened: damped, or else along
/// it, with one of the parameters held that the `whole` step moves most. The first that brings
/// something, or the best.
fn turned<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    point: &Point,
    whole: Option<&[f64]>,
    method: &Method,
) -> Option<Taken> {
    let mut fresh = Damping { value: DAMPING, growth: 2.0 };
    let mut best = damp(layout, evaluate, point, &mut fresh, method);
    for i in whole.map(|step| foremost(point, step)).into_iter().flatten() {
        if !method.turns || !is_idle(point, best.as_ref()) {
            break;
        }
        let step = point.step(layout, method, Some(i));
        let halvings = method.max_halvings.min(SHORTER);
        let along =
            step.and_then(|step| halve(layout, evaluate, point, (&step, Chance::Good), halvings));
        best = [best, along]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.point.cost.total_cmp(&b.point.cost));
    }
    best
}

/// The parameters that `step` moves most, each in its own standard deviations `|d_i| sqrt(M_ii)`.
fn foremost(point: &Point, step: &[f64]) -> Vec<usize> {
    let diagonal = point.matrix.diagonal();
    let share = |i: usize| step[i].abs() * diagonal[i].max(0.0).sqrt();
    let mut order: Vec<usize> = (0..step.len()).filter(|&i| share(i) > 0.0).collect();
    order.sort_by(|&a, &b| share(b).total_cmp(&share(a)).then(a.cmp(&b)));
    order.truncate(TURNS);
    order
}

/// Whether nothing is to be gained against a step either that brings nothing: the point is the
/// bottom of a kink. Where the cost falls that way, it is the gradient that is wrong.
fn is_lowest<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    point: &Point,
    step: &[f64],
    max_halvings: usize,
) -> bool {
    let back: Vec<f64> = step.iter().map(|d| -d).collect();
    halve(layout, evaluate, point, (&back, Chance::Good), max_halvings)
        .is_none_or(|taken| is_idle(point, Some(&taken)))
}

/// The longest of `step`, `step/2`, `step/4` ... that is finite and does not raise the cost; the chance is that
/// of the whole one.
fn halve<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    point: &Point,
    (step, chance): (&[f64], Chance),
    max_halvings: usize,
) -> Option<Taken> {
    let mut length = 1.0;
    for refused in 0..=max_halvings {
        let chance = if refused == 0 { chance } else { Chance::Poor };
        if let Some(next) = try_step(layout, evaluate, point, step, (length, chance)) {
            return Some(Taken {
                point: next,
                refused,
                damping: 0.0,
                length: length * point.length(step),
            });
        }
        length *= 0.5;
    }
    None
}

/// The damping of Levenberg and Marquardt: a share of the diagonal of the normal matrix added to it
/// (Marquardt's scaling).
struct Damping {
    value: f64,
    growth: f64,
}

/// A step of `(M + damping diag M) d = g`, damped more until it does not raise the cost. The
/// damping for the next iteration follows from the gain compared with what the quadratic model
/// promised (Nielsen's rule: Madsen, Nielsen & Tingleff, Eq. 3.14).
fn damp<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    point: &Point,
    damping: &mut Damping,
    method: &Method,
) -> Option<Taken> {
    let diagonal = point.matrix.diagonal();
    for refused in 0..=method.max_halvings {
        let used = damping.value;
        let mut matrix = point.matrix.clone();
        diagonal.iter().enumerate().for_each(|(i, d)| matrix.add_diagonal(i, used * d));
        let step = bounded_step(
            layout,
            &point.theta,
            (&matrix, &point.gradient),
            None,
            method.undetermined,
        )?;
        let chance = if refused == 0 { Chance::Good } else { Chance::Poor };
        if let Some(next) = try_step(layout, evaluate, point, &step, (1.0, chance)) {
            let promised = point.promise(&step);
            let gain = if promised > 0.0 { (point.cost - next.cost) / promised } else { 0.5 };
            let factor = 1.0 - (2.0 * gain - 1.0).powi(3);
            *damping = Damping { value: used * factor.clamp(1.0 / 3.0, 2.0), growth: 2.0 };
            return Some(Taken {
                point: next,
                refused,
                damping: used,
                length: point.length(&step),
            });
        }
        *damping = Damping { value: used * damping.growth, growth: 2.0 * damping.growth };
    }
    None
}

fn line(iteration: usize, layout: &Layout, point: &Point) -> Iteration {
    Iteration {
        iteration,
        cost: point.cost,
        det_r: libm::exp(point.ln_det),
        change: 0.0,
        step: 0.0,
        gradient: point.slope(layout),
        halvings: 0,
        damping: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn creeping_along_kinks_is_an_end_and_slow_progress_is_none() {
        let method = Method { step_tolerance: 0.1, ..Method::default() };
        let history = |gain: f64, step: f64, halvings: usize| -> Vec<Iteration> {
            let of = |i: usize| Iteration {
                iteration: i,
                cost: -100.0 - gain * i as f64,
                det_r: 1.0,
                change: 1e-7,
                step,
                gradient: 0.3,
                halvings,
                damping: 0.0,
            };
            (0..=CRAWL).map(of).collect()
        };
        // One step of 0.1 sd lowers a parabola by 0.005: four that bring 0.0044 together.
        assert!(crawls(&history(1.1e-3, 0.4, 4), &method));
        assert!(!crawls(&history(1.4e-3, 0.4, 4), &method));
        // Whole steps, long ones, or too few of them.
        assert!(!crawls(&history(9e-4, 0.4, 0), &method));
        assert!(!crawls(&history(9e-4, 3.0, 4), &method));
        assert!(!crawls(&history(9e-4, 0.4, 4)[1..], &method));
    }
}
