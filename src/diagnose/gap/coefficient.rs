//! A base at its fit in; what each force and moment coefficient lacks along every maneuver, and
//! what noise of the sensors makes of it, out.
//!
//! Every coefficient gets an increment of its own, `C_m = ... + d`, and all measured states have
//! observer feedback (`driven`), so that the model remembers no longer than `1/K`. Its exact
//! sensitivities `S` to the increments then say what an increment of the last moments does to every
//! output, to accelerometers and displaced sensors as well: `z - y = S d`. Weighted least squares
//! over a window that goes along the maneuver give `d(t)`, all coefficients at once, so that what
//! one lacks is not laid on another.
//!
//! Its uncertainty is found by measuring once more: white noise of the measured size is added to
//! all measurements, and what that does to `d(t)` is noise.

use super::driven::{noises, with_feedback};
use super::looks::Looks;
use crate::diagnose::base::found::Found;
use crate::diagnose::base::stand::Known;
use crate::diagnose::effect::{Context, roles};
use crate::dynamics::Channel;
use crate::error::Errors;
use crate::estimate::{Block, Case, Prepared, Segment, Settings};
use crate::math::dense;
use crate::model::Model;
use crate::simulate::Stream;
use rayon::prelude::*;

const ROLES: [&str; 6] =
    ["lift", "drag", "side-force", "roll-moment", "pitch-moment", "yaw-moment"];

/// What a coefficient lacks.
#[derive(Debug, Clone, PartialEq)]
pub struct Lack {
    /// The coefficient, or the rate that takes its place in a model without one.
    pub name: String,
    pub unit: String,
    /// Per maneuver used and point of its grid from the record's start on; NaN where the data do
    /// not tell.
    pub values: Vec<Vec<f64>>,
    /// Per maneuver used: the root of the mean square that noise of the sensors gives.
    pub noise: Vec<f64>,
}

/// What an increment adds to.
struct Target {
    /// As `[effect.add]` names it.
    text: String,
    /// Name of the increment.
    increment: String,
    unit: String,
}

/// What every coefficient lacks that these data can tell; none where the model has none.
///
/// # Errors
/// None that the base itself would not have.
pub fn coefficients(
    found: &Found,
    segments: &[Segment],
    context: &Context,
    states: &[String],
    looks: &Looks,
) -> Result<Vec<Lack>, Errors> {
    let targets = targets(&found.model, context);
    let Ok(model) = found.model.amended(&increments(&targets)) else { return Ok(Vec::new()) };
    let mut method = with_feedback(&found.method, states, looks.feedback);
    if let Some(free) = &mut method.free {
        free.extend(targets.iter().map(|t| t.increment.clone()));
    }
    let base = found.case();
    let Some(observer) = Observer::new((found, &base), &model, segments, &method)? else {
        return Ok(Vec::new());
    };
    let noise = noises(found);
    let Some(sums) = observer.with(|case| sums(case, &observer, &targets, &noise, looks)) else {
        return Ok(Vec::new());
    };
    let told = told(&sums, looks.distinguishable);
    let values: Vec<Vec<Vec<f64>>> = sums.iter().map(|s| s.solve(&told, &s.residuals)).collect();
    let mut squares = vec![vec![0.0; told.len()]; values.len()];
    for repeat in 0..looks.repeats {
        let again = measured_again(segments, &found.prepared.model, &noise, repeat);
        let Some(other) = Observer::new((found, &base), &model, &again, &method)? else {
            return Ok(Vec::new());
        };
        let Some(residuals) = other.with(|case| residuals(case, &other)) else {
            return Ok(Vec::new());
        };
        for ((s, residuals), squares) in sums.iter().zip(&residuals).zip(&mut squares) {
            let moved: Vec<f64> = residuals.iter().zip(&s.residuals).map(|(a, b)| a - b).collect();
            s.solve(&told, &moved)
                .iter()
                .zip(squares)
                .for_each(|(d, sum)| *sum += mean_square(d) / looks.repeats as f64);
        }
    }
    let lack = |(j, &t): (usize, &usize)| Lack {
        name: targets[t].text.clone(),
        unit: targets[t].unit.clone(),
        values: values.iter().map(|of| of[j].clone()).collect(),
        noise: squares.iter().map(|of| of[j].sqrt()).collect(),
    };
    Ok(told.iter().enumerate().map(lack).collect())
}

pub fn mean_square(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|v| v.is_finite());
    finite().map(|v| v * v).sum::<f64>() / finite().count() as f64
}

fn targets(model: &Model, context: &Context) -> Vec<Target> {
    let mut all: Vec<Target> = Vec::new();
    for bound in ROLES.iter().flat_map(|role| roles::find(role, model, context)) {
        if all.iter().all(|t| t.text != bound.text) {
            all.push(Target {
                text: bound.text,
                increment: format!("increment_{}", bound.ident),
                unit: bound.unit,
            });
        }
    }
    all
}

/// The increments as a block of a model file.
fn increments(targets: &[Target]) -> String {
    let parameters: String = targets
        .iter()
        .map(|t| format!("{} = {{ unit = \"{}\", start = 0.0 }}\n", t.increment, t.unit))
        .collect();
    let terms: String =
        targets.iter().map(|t| format!("\"{}\" = \"{}\"\n", t.text, t.increment)).collect();
    format!(
        "\n[[effect]]\ntitle = \"increments\"\n[effect.parameters]\n{parameters}[effect.add]\n{terms}"
    )
}

/// The model with its increments and observer feedback, at the base's fit.
struct Observer<'a> {
    found: &'a Found,
    base: &'a Case,
    prepared: Prepared,
}

impl<'a> Observer<'a> {
    /// None where other maneuvers can be used than for the base.
    fn new(
        (found, base): (&'a Found, &'a Case),
        model: &Model,
        segments: &[Segment],
        method: &Settings,
    ) -> Result<Option<Observer<'a>>, Errors> {
        let prepared = Prepared::new(model, segments, method)?;
        Ok((prepared.used == found.prepared.used).then_some(Observer { found, base, prepared }))
    }

    fn with<T>(&self, of: impl FnOnce(&Case) -> T) -> T {
        let mut case = self.prepared.case();
        case.records
            .iter_mut()
            .zip(&self.base.records)
            .for_each(|(to, from)| to.substeps = from.substeps.max(2));
        of(&case)
    }

    /// Residuals and sensitivities of a maneuver.
    fn blocks(&self, case: &Case, s: usize, sensitivities: bool) -> Option<Vec<Block>> {
        let found = self.found;
        let theta =
            Known::of(self.base, &found.prepared, &found.theta(s)).placed(case, &self.prepared);
        case.evaluate(s, &case.layout.local(s, &theta), sensitivities)
    }
}

/// Channels with a block each.
fn scored(case: &Case, s: usize) -> impl Iterator<Item = &Channel> {
    case.records[s].channels.iter().filter(|c| case.outputs.contains(&c.output))
}

/// Residuals of all maneuvers, sample after sample.
fn residuals(case: &Case, observer: &Observer) -> Option<Vec<Vec<f64>>> {
    let one =
        |s: usize| Some(observer.blocks(case, s, false)?.into_iter().flat_map(|b| b.e).collect());
    (0..case.records.len()).into_par_iter().map(one).collect()
}

/// What one maneuver says: rows of the weighted sensitivities, and where they belong.
struct Sums {
    /// Points of the grid from the record's start on.
    n: usize,
    /// Coefficients.
    width: usize,
    /// Samples after a moment that tell of it: from and to.
    ahead: (usize, usize),
    back: usize,
    residuals: Vec<f64>,
    /// Per sample: its point of the grid, the weight of its residual, its sensitivities.
    rows: Vec<(usize, f64, Vec<f64>)>,
}

fn sums(
    case: &Case,
    observer: &Observer,
    targets: &[Target],
    noise: &[(String, f64)],
    looks: &Looks,
) -> Option<Vec<Sums>> {
    let one = |s: usize| {
        let (record, part) = (&case.records[s], &case.layout.parts[s]);
        let place =
            |t: &Target| part.shared.iter().position(|&i| case.unknowns[i].name == t.increment);
        let columns: Vec<usize> = targets.iter().map(place).collect::<Option<_>>()?;
        let (nd, n) = (part.directions(), record.n.saturating_sub(record.start));
        let (mut residuals, mut rows) = (Vec::new(), Vec::new());
        for (channel, block) in scored(case, s).zip(observer.blocks(case, s, true)?) {
            let name = &case.model.outputs[channel.output].name;
            let sd = noise.iter().find(|n| n.0 == *name).map_or(0.0, |n| n.1);
            let weight = if sd > 0.0 { 1.0 / (sd * sd) } else { 0.0 };
            for (k, t) in channel.t.iter().enumerate() {
                let at = ((t - record.t0) / record.dt).round() - record.start as f64;
                let known = block.e[k].is_finite() && at >= 0.0 && (at as usize) < n;
                let row = columns.iter().map(|c| block.g[k * nd + c]).collect();
                rows.push((at.max(0.0) as usize, if known { weight } else { 0.0 }, row));
            }
            residuals.extend(block.e);
        }
        let steps = |time: f64| (time / record.dt).round() as usize;
        // A state under feedback follows with the lag `1/K`: what it shows now was then.
        let (late, half) = (steps(1.0 / looks.feedback), steps(looks.half_window).max(1));
        let (from, back) = (late.saturating_sub(half), half.saturating_sub(late));
        Some(Sums { n, width: targets.len(), ahead: (from, late + half), back, residuals, rows })
    };
    (0..case.records.len()).into_par_iter().map(one).collect()
}

impl Sums {
    /// `S'WS` of the coefficients in `of`, up to every point of the grid: `[n + 1][m * m]`.
    fn grams(&self, of: &[usize]) -> Vec<f64> {
        let m = of.len();
        let mut sums = vec![0.0; (self.n + 1) * m * m];
        for (at, weight, row) in self.rows.iter().filter(|r| r.1 > 0.0) {
            let to = &mut sums[(at + 1) * m * m..(at + 2) * m * m];
            for (i, &a) in of.iter().enumerate() {
                of.iter().enumerate().for_each(|(j, &b)| to[i * m + j] += weight * row[a] * row[b]);
            }
        }
        running(&mut sums, m * m);
        sums
    }

    /// Least squares over the window of every point: per coefficient of `of` its values along the
    /// grid.
    fn solve(&self, of: &[usize], residuals: &[f64]) -> Vec<Vec<f64>> {
        let m = of.len();
        let grams = self.grams(of);
        let mut right = vec![0.0; (self.n + 1) * m];
        for ((at, weight, row), e) in
            self.rows.iter().zip(residuals).filter(|(r, e)| r.1 > 0.0 && e.is_finite())
        {
            let to = &mut right[(at + 1) * m..(at + 2) * m];
            to.iter_mut().zip(of).for_each(|(to, &a)| *to += weight * row[a] * e);
        }
        running(&mut right, m);
        let mut out = vec![vec![f64::NAN; self.n]; m];
        for k in 0..self.n {
            let (from, to) = (
                (k + self.ahead.0).saturating_sub(self.back).min(self.n),
                (k + self.ahead.1 + 1).min(self.n),
            );
            let between = |sums: &[f64], size: usize| -> Vec<f64> {
                (0..size).map(|i| sums[to * size + i] - sums[from * size + i]).collect()
            };
            let Ok(factor) = dense::cholesky(&between(&grams, m * m), m) else { continue };
            let mut d = between(&right, m);
            dense::cholesky_solve(&factor, m, &mut d);
            out.iter_mut().zip(d).for_each(|(out, d)| out[k] = d);
        }
        out
    }
}

/// Running sums over rows of `size`.
fn running(sums: &mut [f64], size: usize) {
    (size..sums.len()).for_each(|i| sums[i] += sums[i - size]);
}

/// The coefficients that the data distinguish, in their order: those with the most information left
/// go first, and one of which no more than `least` is left is not distinguishable from them.
fn told(sums: &[Sums], least: f64) -> Vec<usize> {
    let m = sums.first().map_or(0, |s| s.width);
    let all: Vec<usize> = (0..m).collect();
    let mut gram = vec![0.0; m * m];
    for s in sums {
        let of = s.grams(&all);
        gram.iter_mut().zip(&of[s.n * m * m..]).for_each(|(sum, v)| *sum += v);
    }
    let own: Vec<f64> = (0..m).map(|i| gram[i * m + i]).collect();
    let mut told = Vec::new();
    loop {
        let left = |i: &usize| if own[*i] > 0.0 { gram[i * m + i] / own[*i] } else { 0.0 };
        let rest = all.iter().copied().filter(|i| !told.contains(i));
        let Some(best) =
            rest.max_by(|a, b| left(a).total_cmp(&left(b))).filter(|i| left(i) > least)
        else {
            break;
        };
        let row: Vec<f64> = gram[best * m..(best + 1) * m].to_vec();
        for i in 0..m {
            (0..m).for_each(|j| gram[i * m + j] -= row[i] * row[j] / row[best]);
        }
        told.push(best);
    }
    told.sort_unstable();
    told
}

/// The same maneuvers with more noise on every channel.
fn measured_again(
    segments: &[Segment],
    model: &Model,
    noise: &[(String, f64)],
    repeat: usize,
) -> Vec<Segment> {
    let mut again = segments.to_vec();
    for (s, segment) in again.iter_mut().enumerate() {
        for channel in &mut segment.record.channels {
            let Some(output) = model.outputs.get(channel.output) else { continue };
            let sd = noise
                .iter()
                .find(|n| n.0 == output.name)
                .map(|n| n.1)
                .filter(|sd| *sd > 0.0)
                .unwrap_or(0.0);
            let mut stream =
                Stream::new(repeat as u64, &["coefficients", &s.to_string(), &output.name]);
            channel.z.iter_mut().for_each(|z| *z += sd * stream.normal());
        }
    }
    again
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::base::found::at_first;
    use crate::diagnose::base::stand::Stand;
    use crate::diagnose::gap::comparison::comparison;
    use crate::diagnose::gap::driven::EquationError;
    use crate::diagnose::settings::Base;
    use crate::diagnose::subject::Subject;
    use crate::diagnose::tests::{campaign, parsed};

    /// Short period with lift and moment coefficients, and what is hidden in the moment.
    fn model(hidden: &str) -> Model {
        parsed(&format!(
            r#"title = "short period"
[inputs]
de = "rad"
V = "m/s"
[constants]
k = {{ unit = "1/s", value = 0.2 }}
j = {{ unit = "1/s^2", value = 5.0 }}
[parameters]
C_L_a = {{ unit = "-", start = 4.5 }}
C_L_d = {{ unit = "-", start = 0.5 }}
C_m_a = {{ unit = "-", start = -0.8 }}
C_m_q = {{ unit = "s", start = -0.3 }}
C_m_d = {{ unit = "-", start = -1.2 }}
[equations]
C_L = "C_L_a*alpha + C_L_d*de"
C_m = "C_m_a*alpha + C_m_q*q + C_m_d*de {hidden}"
ddt_alpha = "q - k*C_L"
[states]
alpha = {{ unit = "rad", rate = "ddt_alpha", start = 0.0 }}
q = {{ unit = "rad/s", rate = "j*C_m", start = 0.0 }}
[outputs]
alpha = {{ unit = "rad", value = "alpha" }}
q = {{ unit = "rad/s", value = "q" }}
nz = {{ unit = "1/s", value = "ddt_alpha - q" }}
"#
        ))
    }

    fn errors(truth: &Model) -> Vec<EquationError> {
        let (base, segments, held_out) =
            (model(""), campaign(truth, 3, 0.0), [false, false, true].repeat(3));
        let (method, context, settings) =
            (Settings::default(), Context::default(), crate::diagnose::Settings::default());
        let subject = Subject {
            model: &base,
            segments: &segments,
            held_out: &held_out,
            method: &method,
            context: &context,
            settings: &settings,
        };
        let stand = Stand::first(&base, &method, Base::Estimated);
        let found = at_first(&stand, &subject)
            .unwrap_or_else(|e| panic!("{e}"))
            .unwrap_or_else(|e| panic!("{e:?}"));
        comparison(&subject, &found, &found).unwrap_or_else(|e| panic!("{e}")).lacking.equations
    }

    fn ratio(all: &[EquationError], name: &str) -> f64 {
        let row = all
            .iter()
            .find(|e| e.name == name && e.segment.is_none())
            .unwrap_or_else(|| panic!("{name} in {all:?}"));
        row.rms / row.noise
    }

    #[test]
    fn recovery_what_is_hidden_in_the_moment_is_laid_on_the_moment_alone() {
        let all = errors(&model("+ 6.0*de^2"));
        assert!(ratio(&all, "C_m") > 3.0 && ratio(&all, "C_L") < 1.3, "{all:?}");
    }

    #[test]
    fn recovery_where_nothing_is_missing_coefficients_lack_what_noise_makes_of_them() {
        let all = errors(&model(""));
        for name in ["C_L", "C_m"] {
            assert!((0.8..1.25).contains(&ratio(&all, name)), "{name}: {all:?}");
        }
    }
}
