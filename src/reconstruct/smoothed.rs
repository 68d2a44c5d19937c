//! A flight's signals in; its path by the smoother, stretch by stretch between long gaps, with
//! noise levels estimated first, out.

use rayon::prelude::*;
use std::borrow::Cow;

use super::axes::axes;
use super::consistency::{self, Comparison, Which, inertial};
use super::found::Found;
use super::health;
use super::path::{Bias, FLIGHT_PATH, FlightPath, Note};
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::slow::slow;
use super::smoother::grid::Outputs;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::smoother::{Innovations, Smoothed, Smoother};
use super::stretches::{SHORTEST, guess, levels, stretches};
use super::survey::{LATE, SIGNIFICANT, Survey, UNKNOWN, survey};
use super::verdicts;
use crate::error::{Errors, Result};
use crate::math::distribution::INTERVAL_95;
use crate::model::{Model, Quantity};
use crate::signal::resample::Grid;

/// A sensor with fewer samples is not used: its noise cannot be told.
const FEW: usize = 20;
/// Standard deviations per second along the path.
const DEVIATIONS_HZ: f64 = 10.0;

/// Channels with a reversed sign that are looked for, one after the other.
const REVERSED: usize = 3;

/// A flight being reconstructed.
struct Work<'a> {
    settings: &'a Settings,
    kinematics: &'a Kinematics<'a>,
    smoother: Smoother<'a>,
    stretches: Vec<[f64; 2]>,
    path: FlightPath,
    found: Found,
    /// Channels that are left out; outputs by their place in the model.
    out: Vec<Which>,
}

/// The path on `grid` from the driving signals (one per input of the model) and the measured
/// outputs.
///
/// # Errors
/// The model is none that the smoother can run.
pub fn path(
    model: &Model,
    driving: &[Series],
    measured: &[Logged],
    grid: &Grid,
    settings: &Settings,
) -> std::result::Result<FlightPath, Errors> {
    let model = &model.with_lateness(&settings.late, LATE)?;
    let mut path = FlightPath { t: grid.times(), ..Default::default() };
    let nothing = Outputs::empty(model.outputs.len(), 0, grid.n);
    (path.outputs, path.sd) = (nothing.value, nothing.sd);

    let fit = fit(model, driving, measured, &mut path);
    if fit.unfit {
        return Ok(path);
    }
    let (driving, measured) = fit.series(driving);
    Ok(smooth(model, &driving, measured, grid, settings, path)?.0)
}

/// What the checks of a flight found.
pub struct Checked<'s> {
    pub checks: Vec<consistency::Row>,
    pub notes: Vec<Note>,
    /// An input of the model is dead or has its sign reversed: there is no path.
    pub unfit: bool,
    /// The signals with what is dead or frozen masked, and without the outputs whose sign is
    /// reversed.
    pub driving: Vec<Cow<'s, [f64]>>,
    pub measured: Vec<Logged<'s>>,
}

/// Output grid of a smoothing whose path nobody asks for, Hz: it has to be fine enough to be a
/// grid.
const COARSE_HZ: f64 = 1.0;

/// The checks of a flight alone, for a path that is found otherwise; the sensor errors are left to
/// that.
///
/// # Errors
/// As `path`.
pub fn checks<'s>(
    model: &Model,
    driving: &[Series<'s>],
    measured: &'s [Logged<'s>],
    grid: &Grid,
    settings: &Settings,
) -> std::result::Result<Checked<'s>, Errors> {
    let mut path = FlightPath::default();
    let fit = fit(model, driving, measured, &mut path);
    if fit.unfit {
        let Fit { unfit, driving, measured } = fit;
        return Ok(Checked { checks: path.checks, notes: path.notes, unfit, driving, measured });
    }
    let plain =
        Settings { late: Vec::new(), candidates: Vec::new(), free: Vec::new(), ..settings.clone() };
    let coarse = Grid::covering(grid.t0, grid.time(grid.n - 1), 1.0 / COARSE_HZ);
    let nothing = Outputs::empty(model.outputs.len(), 0, coarse.n);
    (path.t, path.outputs, path.sd) = (coarse.times(), nothing.value, nothing.sd);
    let (path, out) = {
        let (driving, measured) = fit.series(driving);
        smooth(model, &driving, measured, &coarse, &plain, path)?
    };
    let unfit = out.iter().any(|which| matches!(which, Which::Input(_)));
    let reversed = |m: &Logged| out.contains(&Which::Output(m.output));
    Ok(Checked {
        checks: path.checks.into_iter().filter(|row| row.check != "sensor error").collect(),
        // what the smoother says of its own path is of no interest here
        notes: path
            .notes
            .into_iter()
            .filter(|note| note.subject != FLIGHT_PATH || unfit && note.missing)
            .collect(),
        unfit,
        driving: fit.driving,
        measured: fit.measured.into_iter().filter(|m| !reversed(m)).collect(),
    })
}

/// Signals that are fit to be used.
struct Fit<'s> {
    /// An input that ought to move is dead.
    unfit: bool,
    driving: Vec<Cow<'s, [f64]>>,
    measured: Vec<Logged<'s>>,
}

impl<'s> Fit<'s> {
    fn series<'a>(&'a self, driving: &[Series<'a>]) -> (Vec<Series<'a>>, Vec<Logged<'a>>) {
        let measured = self.measured.iter().map(|m| Logged {
            output: m.output,
            t: m.t,
            z: Cow::Borrowed(&m.z[..]),
        });
        (
            driving.iter().zip(&self.driving).map(|((t, _), y)| (*t, &y[..])).collect(),
            measured.collect(),
        )
    }
}

/// The signals with what is dead or frozen masked; their health goes into the rows and notes of the
/// path.
fn fit<'s>(
    model: &Model,
    driving: &[Series<'s>],
    measured: &'s [Logged<'s>],
    path: &mut FlightPath,
) -> Fit<'s> {
    let (driving, inputs_well) =
        well(model.inputs.iter().map(|q| (q, inertial(&q.unit))), driving, path);
    let series: Vec<Series> = measured.iter().map(|m| (m.t, &m.z[..])).collect();
    let (outputs, _) =
        well(measured.iter().map(|m| (&model.outputs[m.output], true)), &series, path);
    if !inputs_well {
        path.notes.push(Note::lost(
            "no flight path: an input of the kinematic model is dead".to_string(),
        ));
    }
    let measured =
        measured.iter().zip(outputs).map(|(m, z)| Logged { output: m.output, t: m.t, z }).collect();
    Fit { unfit: !inputs_well, driving, measured }
}

/// The path by the smoother, and the channels that were left out because their sign is reversed
/// (outputs by their place in the model).
fn smooth(
    model: &Model,
    driving: &[Series],
    mut measured: Vec<Logged>,
    grid: &Grid,
    settings: &Settings,
    mut path: FlightPath,
) -> std::result::Result<(FlightPath, Vec<Which>), Errors> {
    let axes = axes(model, driving, &measured);
    path.checks.extend(axes.rows);
    if let Some((which, words)) = axes.exchanged {
        path.notes.push(Note::lost(format!(
            "no flight path: {words}: each turns as the other one's axis does, by the attitude"
        )));
        return Ok((path, which.map(Which::Input).to_vec()));
    }
    slow(model, &mut measured, settings, &mut path);
    let mut found = Found::default();
    if !(settings.late.is_empty() && settings.candidates.is_empty() && settings.free.is_empty()) {
        found = survey(model, driving, &measured, settings)?;
    }
    let kinematics = Kinematics::new(model, found.free(model, settings))?;
    let flight = found.flight(&kinematics, driving, &measured, settings);
    let smoother = Smoother::new(&kinematics, &flight, settings.gate);
    path.late.clone_from(&found.late);
    let stretches = stretches(&flight, settings);
    if stretches.is_empty() {
        let text = format!(
            "no flight path: nowhere are all inputs of the kinematic model known for {SHORTEST} s"
        );
        path.notes.push(Note::lost(text));
    }
    path.windows = stretches.len();
    Ok(Work {
        settings,
        kinematics: &kinematics,
        smoother,
        stretches,
        path,
        found,
        out: Vec::new(),
    }
    .run(grid)?)
}

/// Signals with what is dead or frozen masked where it ought to move, their health as rows; false
/// where one is dead.
fn well<'n, 's>(
    names: impl Iterator<Item = (&'n Quantity, bool)>,
    series: &[Series<'s>],
    path: &mut FlightPath,
) -> (Vec<Cow<'s, [f64]>>, bool) {
    let mut good = true;
    let mut out = Vec::new();
    for ((quantity, moves), (t, y)) in names.zip(series) {
        let (name, mut y) = (&quantity.name, Cow::Borrowed(*y));
        let health = health::health(t, &y);
        path.checks.extend(verdicts::health_rows(name, &health, moves));
        if moves && health.dead {
            y.to_mut().fill(f64::NAN);
            good = false;
            path.notes.push(Note::of(
                name,
                health.samples,
                format!("{name} is dead: its value never changes"),
            ));
        } else if moves && health.samples < FEW {
            y.to_mut().fill(f64::NAN);
            let text = format!("{name} has only {} samples: not used", health.samples);
            path.notes.push(Note::of(name, health.samples, text));
        } else if moves && health.frozen_s > 0.0 {
            let y = y.to_mut();
            for run in &health.frozen {
                // the first sample of a run was still measured
                y[run.start + 1..run.end].fill(f64::NAN);
            }
            let text = format!(
                "{name} stands still for together {:.1} s: not used there",
                health.frozen_s
            );
            path.notes.push(Note::of(name, health.frozen.iter().map(|run| run.len()).sum(), text));
        }
        out.push(y);
    }
    (out, good)
}

impl Work<'_> {
    fn run(mut self, grid: &Grid) -> Result<(FlightPath, Vec<Which>)> {
        let flight = self.smoother.flight;
        let (mut guess, gusts) = guess(self.kinematics, flight, self.settings);
        let (out, mut compared) = self.reversed(&guess);
        let culprits = compared.split_off(compared.len() - out.len());
        let in_model = |which: &Which| match *which {
            Which::Output(k) => Which::Output(flight.channels[k].output),
            input => input,
        };
        self.out = out.iter().map(in_model).collect();
        for &which in &out {
            match which {
                Which::Output(k) => guess.r[k] = f64::INFINITY,
                Which::Input(_) => {
                    let text =
                        "no flight path: an input of the kinematic model has its sign reversed"
                            .to_string();
                    self.path.notes.push(Note::lost(text));
                    self.rows(&[compared, culprits].concat());
                    return Ok(self.finish());
                }
            }
        }
        let levels =
            levels(&self.smoother, &self.stretches, &guess, &gusts, &self.found, self.settings);
        let errors = self.smooth(grid, &levels);
        if errors.values.is_empty() {
            self.rows(&[compared, culprits].concat());
        } else {
            // again, with the noise levels and the sensor errors that the whole flight knows
            let mut sharp = levels.clone();
            errors.narrow(self.kinematics, &mut sharp);
            let known = errors.known(self.kinematics);
            let compared =
                consistency::compare(&self.smoother, &sharp, &self.stretches, &out, Some(&known));
            self.rows(&[compared, culprits].concat());
        }
        for (k, channel) in
            flight.channels.iter().enumerate().filter(|(k, _)| levels.r[*k].is_finite())
        {
            let quantity = &self.kinematics.model.outputs[channel.output];
            let innovation = &self.path.innovations.channels[k];
            let (sd, fast) = (levels.r[k].sqrt(), channel.sd);
            if let Some(text) = verdicts::outliers(innovation) {
                let text = format!(
                    "{}: {text}, further than {} sd from what all sensors together say",
                    quantity.name, self.settings.gate
                );
                self.path.notes.push(Note::of(&quantity.name, innovation.rejected, text));
            }
            self.path.checks.extend(verdicts::innovation_rows(
                &quantity.name,
                &quantity.unit,
                innovation,
                (sd, fast, levels.given[0][k]),
            ));
        }
        self.filtered(&levels);
        Ok(self.finish())
    }

    /// A note of the channels whose noise cannot be estimated because a recorder filtered it away.
    fn filtered(&mut self, levels: &Levels) {
        let model = self.kinematics.model;
        let channels = self.smoother.flight.channels.iter().enumerate();
        let known = |k: usize| levels.given[0].get(k).copied().unwrap_or(false);
        let slow = |k: usize| self.path.innovations.channels.get(k).is_some_and(verdicts::filtered);
        let names: Vec<&str> = channels
            .filter(|(k, _)| !known(*k) && slow(*k))
            .map(|(_, c)| model.outputs[c.output].name.as_str())
            .collect();
        if !names.is_empty() {
            let text = format!(
                "filtered before they were logged, so that their noise cannot be told and the path's standard deviations are too small: {}; \
                 give it in [reconstruct.method.sd]",
                names.join(", ")
            );
            self.path.notes.push(text.into());
        }
    }

    fn rows(&mut self, compared: &[Comparison]) {
        for comparison in compared {
            let name = self.name(comparison.which);
            self.path.checks.extend(comparison.rows(&name));
        }
        // A check that did not run is told.
        let is_compared = |which: &Which| compared.iter().any(|c| c.which == *which);
        let others: Vec<Which> =
            consistency::channels(&self.smoother).filter(|which| !is_compared(which)).collect();
        self.path.checks.extend(
            others
                .into_iter()
                .map(|which| verdicts::not_compared(&self.name(which)))
                .collect::<Vec<_>>(),
        );
    }

    /// The rows in the order of channels and checks.
    fn finish(self) -> (FlightPath, Vec<Which>) {
        let mut path = self.path;
        path.checks.sort_by(|a, b| (&a.channel, a.check).cmp(&(&b.channel, b.check)));
        (path, self.out)
    }

    fn name(&self, which: Which) -> String {
        let model = self.kinematics.model;
        match which {
            Which::Input(k) => model.inputs[k].name.clone(),
            Which::Output(k) => model.outputs[self.smoother.flight.channels[k].output].name.clone(),
        }
    }

    /// Channels whose sign is reversed, and the comparisons of all without them, theirs last. Where
    /// several may be the culprit (a rate and its angle contradict each other), it is the one
    /// without which the others fit together best.
    fn reversed(&mut self, levels: &Levels) -> (Vec<Which>, Vec<Comparison>) {
        let mut out: Vec<Which> = Vec::new();
        let mut culprits: Vec<Comparison> = Vec::new();
        loop {
            let mut compared =
                consistency::compare(&self.smoother, levels, &self.stretches, &out, None);
            let suspects: Vec<Comparison> =
                compared.iter().copied().filter(Comparison::reversed).collect();
            let Some(&first) = suspects.first().filter(|_| out.len() < REVERSED) else {
                compared.extend(culprits);
                return (out, compared);
            };
            let misfit = |suspect: &Comparison| {
                let without = [&out[..], &[suspect.which]].concat();
                let sum: f64 = suspects
                    .iter()
                    .map(|s| {
                        consistency::misfit(
                            &self.smoother,
                            levels,
                            &self.stretches,
                            s.which,
                            &without,
                        )
                    })
                    .sum();
                if sum.is_finite() { sum } else { f64::MAX }
            };
            let scores: Vec<f64> = suspects.par_iter().map(misfit).collect();
            let best = (0..suspects.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
            let culprit = best.map_or(first, |k| suspects[k]);
            let name = self.name(culprit.which);
            let text = format!(
                "{name}: the sign is reversed against what all other sensors say; not used"
            );
            self.path.notes.push(Note::of(&name, 1, text));
            out.push(culprit.which);
            culprits.push(culprit);
        }
    }

    /// The path itself; the sensor errors of its longest stretch.
    fn smooth(&mut self, grid: &Grid, levels: &Levels) -> Found {
        let (mut errors, mut longest) = (Found::default(), 0.0);
        let (kinematics, flight) = (self.kinematics, self.smoother.flight);
        let mut out = Outputs {
            value: std::mem::take(&mut self.path.outputs),
            sd: std::mem::take(&mut self.path.sd),
            x_sd: vec![Vec::new(); kinematics.size()],
        };
        let every = (self.settings.rate_hz / DEVIATIONS_HZ).round().max(1.0) as usize;
        let mut innovations = Innovations::new(flight.channels.len());
        for (number, stretch) in self.stretches.clone().into_iter().enumerate() {
            let x = self.smoother.begin(levels, stretch, None);
            let (mut about, _) = self.smoother.about(levels, stretch, &x, self.found.passes.max(1));
            if self.found.passes > 0 {
                // scales and delays are products with states all along
                about.get_or_insert_default().known = self.found.constants(kinematics, levels);
            }
            let smoothed = self.smoother.path(
                about.as_ref(),
                levels,
                stretch,
                &x,
                (*grid, every),
                &mut innovations,
                &mut out,
            );
            if !smoothed.finite {
                self.path.failed += 1;
                let [from, to] = stretch;
                let text = format!(
                    "no flight path from {from:.1} s to {to:.1} s: the filter does not stay finite"
                );
                self.path.notes.push(Note::lost(text));
                continue;
            }
            self.path.biases.extend(biases(kinematics, &self.found, &smoothed, number, stretch));
            self.parameters(levels, &smoothed, number);
            if stretch[1] - stretch[0] > longest {
                longest = stretch[1] - stretch[0];
                errors.values = Survey::of(kinematics, levels, &smoothed).values();
            }
        }
        for pair in self.stretches.windows(2) {
            let [from, to] = [pair[0][1], pair[1][0]];
            self.path.notes.push(
                format!("no flight path from {from:.1} s to {to:.1} s: an input has a gap").into(),
            );
        }
        self.held();
        self.undetermined(levels, &mut out);
        (self.path.outputs, self.path.sd, self.path.innovations) = (out.value, out.sd, innovations);
        errors
    }

    /// Lines about the sensor errors: what the data say of them.
    fn parameters(&mut self, levels: &Levels, smoothed: &Smoothed, stretch: usize) {
        let (nx, n) = (self.kinematics.states(), self.kinematics.size());
        let m = smoothed.p.len() / n.max(1);
        for (k, &i) in self.kinematics.free.iter().enumerate() {
            let parameter = &self.kinematics.model.parameters[i];
            let (value, sd) = (
                smoothed.x[nx + k] + self.found.offset(self.kinematics.model, i),
                smoothed.p[(nx + k) * m + nx + k].max(0.0).sqrt(),
            );
            let known = sd < UNKNOWN * levels.start_sd[nx + k];
            if let Some(sensor) = self.sensor(&parameter.quantity.name).filter(|_| known) {
                let row = verdicts::bias_row(&sensor, &parameter.quantity.unit, value);
                self.path.checks.extend(row);
            }
            let half = INTERVAL_95 * sd;
            let text = format!(
                "{} {value:.4e} +- {half:.1e} (95%), stretch {stretch}",
                parameter.quantity.doc
            );
            self.path.checks.push(consistency::Row {
                channel: parameter.quantity.name.clone(),
                check: "sensor error",
                value,
                low: parameter.start - SIGNIFICANT * sd,
                high: parameter.start + SIGNIFICANT * sd,
                unit: parameter.quantity.unit.clone(),
                verdict: match (known, (value - parameter.start).abs() > SIGNIFICANT * sd) {
                    (false, _) => "not observable",
                    (true, true) => "significant",
                    (true, false) => "not significant",
                },
                text,
            });
        }
    }

    /// The inertial sensor whose bias this is.
    fn sensor(&self, bias: &str) -> Option<String> {
        let name = format!("{}_imu", bias.strip_prefix("b_")?);
        self.kinematics.model.inputs.iter().any(|input| input.name == name).then_some(name)
    }

    /// Lines about the sensor errors that were held because the data do not support them.
    fn held(&mut self) {
        for held in &self.found.held {
            let parameter = &self.kinematics.model.parameters[held.parameter];
            self.path.checks.push(consistency::Row {
                channel: parameter.quantity.name.clone(),
                check: "sensor error",
                value: held.value,
                low: parameter.start - SIGNIFICANT * held.sd,
                high: parameter.start + SIGNIFICANT * held.sd,
                unit: parameter.quantity.unit.clone(),
                verdict: if held.known { "not significant" } else { "not observable" },
                text: format!(
                    "{} {:.4e} +- {:.1e} (95%) if it were estimated: held at {}",
                    parameter.quantity.doc,
                    held.value,
                    INTERVAL_95 * held.sd,
                    parameter.start
                ),
            });
        }
    }

    /// Outputs of states that no sensor determines have no value: not a number that was only
    /// assumed.
    fn undetermined(&mut self, levels: &Levels, out: &mut Outputs) {
        let model = self.kinematics.model;
        for i in 0..self.kinematics.states() {
            let known: Vec<f64> = out.x_sd[i].iter().copied().filter(|sd| sd.is_finite()).collect();
            if known.is_empty() || crate::math::median(&known) < UNKNOWN * levels.start_sd[i] {
                continue;
            }
            let name = &model.states[i].quantity.name;
            let lost: Vec<usize> = self
                .kinematics
                .output_jacobian
                .entries
                .iter()
                .filter(|e| e.1 == i)
                .map(|e| e.0)
                .collect();
            let names: Vec<&str> = lost.iter().map(|&k| model.outputs[k].name.as_str()).collect();
            self.path.notes.push(
                format!("no sensor determines {name}: there is no path of {}", names.join(", "))
                    .into(),
            );
            for k in lost {
                out.value[k].fill(f64::NAN);
                out.sd[k].fill(f64::NAN);
            }
        }
    }
}

/// The smoothed parameters of a stretch.
fn biases(
    kinematics: &Kinematics,
    found: &Found,
    smoothed: &Smoothed,
    window: usize,
    [t_start_s, t_end_s]: [f64; 2],
) -> Vec<Bias> {
    let (nx, n) = (kinematics.states(), kinematics.size());
    let m = smoothed.p.len() / n.max(1);
    let row = |(k, &i): (usize, &usize)| {
        let quantity = &kinematics.model.parameters[i].quantity;
        let at = nx + k;
        Bias {
            window,
            t_start_s,
            t_end_s,
            parameter: quantity.name.clone(),
            unit: quantity.unit.clone(),
            value: smoothed.x[at] + found.offset(kinematics.model, i),
            sd: Some(smoothed.p[at * m + at].max(0.0).sqrt()),
        }
    };
    let mut rows: Vec<(usize, &usize)> = kinematics.free.iter().enumerate().collect();
    rows.sort_by_key(|(_, parameter)| **parameter);
    rows.into_iter().map(row).collect()
}
