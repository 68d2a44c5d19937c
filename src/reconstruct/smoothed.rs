//! A flight's signals in; its path by the smoother, stretch by stretch between long gaps, with
//! noise levels estimated first, out.

use rayon::prelude::*;

use super::airspeed;
use super::axes::{ANGLES, axes};
use super::consistency;
use super::found::Found;
use super::pairs::{Comparison, Which};
use super::path::{FlightPath, Note};
use super::sensor_errors::{biases, estimated, held};
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::slow::slow;
use super::smoother::flight::Flight;
use super::smoother::grid::Outputs;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::smoother::{Innovations, Smoother};
use super::stretches::{SHORTEST, guess, levels, stretches};
use super::survey::{ENOUGH, LATE, Survey, UNKNOWN, survey};
use super::usable::usable;
use super::verdicts;
use super::wide::{self, Wide};
use crate::error::{Errors, Result};
use crate::model::Model;
use crate::signal::resample::Grid;

/// Standard deviations per second along the path.
const DEVIATIONS_HZ: f64 = 10.0;

/// Without a channel that drives it.
const REVERSED_INPUT: &str =
    "no flight path: an input of the kinematic model has its sign reversed";

/// Channels with a reversed sign that are looked for, one after the other.
const REVERSED: usize = 3;

/// A flight being reconstructed.
struct Work<'a> {
    settings: &'a Settings,
    kinematics: &'a Kinematics<'a>,
    smoother: Smoother<'a>,
    /// Where candidates are held.
    wide: Option<Wide<'a>>,
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

    let usable = usable(model, driving, measured, &mut path);
    if usable.unfit {
        return Ok(path);
    }
    let (usable, flight) = usable.following(model, driving, settings, &mut path)?;
    let (driving, measured) = usable.series(driving);
    Ok(smooth(model, (&driving, flight), measured, grid, settings, path)?.0)
}

/// The path by the smoother, and the channels that were left out because their sign is reversed
/// (outputs by their place in the model). The flight is driven by `driving`.
pub fn smooth(
    model: &Model,
    (driving, flight): (&[Series], Flight),
    measured: Vec<Logged>,
    grid: &Grid,
    settings: &Settings,
    mut path: FlightPath,
) -> std::result::Result<(FlightPath, Vec<Which>), Errors> {
    let axes = axes(model, driving, &measured, settings);
    path.checks.extend(axes.rows);
    if let Some((which, words)) = axes.unfit {
        path.notes.push(Note::lost(format!("no flight path: {words}")));
        return Ok((path, which.into_iter().map(Which::Input).collect()));
    }
    if let Some(tau) = axes.late {
        let text = format!(
            "{} are late by {tau:.3} s, by all gyros: the path has their stamps moved back by that",
            ANGLES.join(", ")
        );
        path.notes.push(text.into());
    }
    let is_angle = |m: &Logged| ANGLES.contains(&&*model.outputs[m.output].name);
    let earlier: Vec<Option<Vec<f64>>> = measured
        .iter()
        .map(|m| axes.late.filter(|_| is_angle(m)).map(|tau| m.t.iter().map(|t| t - tau).collect()))
        .collect();
    let mut measured: Vec<Logged> = measured
        .into_iter()
        .zip(&earlier)
        .map(|(m, earlier)| Logged { t: earlier.as_deref().unwrap_or(m.t), ..m })
        .collect();
    slow(model, &mut measured, settings, &mut path);
    let mut found = Found::default();
    let mut flight = flight.measuring(model, measured.iter().map(|m| (m.output, &m.z[..])));
    if !(settings.late.is_empty() && settings.candidates.is_empty() && settings.free.is_empty()) {
        (found, flight) = survey(model, flight, &measured, settings)?;
    }
    let kinematics = Kinematics::new(model, found.free(model, settings))?;
    let flight = found.flight(flight, &measured);
    let smoother = Smoother::new(&kinematics, &flight, settings.gate);
    path.late.clone_from(&found.late);
    let angles = ANGLES.iter().filter_map(|angle| model.output(angle));
    path.late.extend(angles.zip(axes.late.into_iter().cycle()));
    let all = wide::kinematics(model, !found.held.is_empty(), found.levels.as_ref())?;
    let wide = all.as_ref().zip(found.levels.clone()).map(|(all, (_, begin))| Wide {
        smoother: Smoother::new(all, &flight, settings.gate),
        begin,
        passes: found.passes,
    });
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
        wide,
        stretches,
        path,
        found,
        out: Vec::new(),
    }
    .run(grid)?)
}

impl Work<'_> {
    fn run(mut self, grid: &Grid) -> Result<(FlightPath, Vec<Which>)> {
        let flight = self.smoother.flight;
        let (mut guess, gusts) = guess(self.kinematics, flight, self.settings);
        let (out, mut compared) = self.reversed(&guess);
        let culprits = compared.split_off(compared.len() - out.len());
        // With so many that contradict each other there is nothing to hold an inertial sensor against.
        let drives = |c: &&Comparison| matches!(c.which, Which::Input(_)) && c.reversed();
        let more = compared.iter().find(drives).map(|c| c.which);
        let out: Vec<Which> = out.into_iter().chain(more).collect();
        let in_model = |which: &Which| match *which {
            Which::Output(k) => Which::Output(flight.channels[k].output),
            input => input,
        };
        self.out = out.iter().map(in_model).collect();
        for &which in &out {
            match which {
                Which::Output(k) => guess.r[k] = f64::INFINITY,
                Which::Input(_) => {
                    self.path.notes.push(Note::lost(REVERSED_INPUT.to_string()));
                    self.rows(&[compared, culprits].concat());
                    return Ok(self.finish());
                }
            }
        }
        let levels =
            levels(&self.smoother, &self.stretches, &guess, &gusts, &self.found, self.settings);
        self.level(&levels)?;
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
            if compared.iter().any(|c| drives(&c)) {
                self.path.notes.push(Note::lost(REVERSED_INPUT.to_string()));
                let (values, sds) = (&mut self.path.outputs, &mut self.path.sd);
                values.iter_mut().chain(sds).for_each(|column| column.fill(f64::NAN));
            }
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
        self.needed(&levels);
        self.filtered(&levels);
        Ok(self.finish())
    }

    /// The line of the airspeed's level, by the longest stretch.
    fn level(&mut self, levels: &Levels) -> Result<()> {
        let length = |s: &&[f64; 2]| s[1] - s[0];
        let longest = self.stretches.iter().max_by(|a, b| length(a).total_cmp(&length(b)));
        let Some(&[from, to]) = longest else { return Ok(()) };
        let (flight, part) = (self.smoother.flight, [from, to.min(from + ENOUGH)]);
        let row = airspeed::level(self.kinematics, flight, levels, part, self.settings)?;
        self.path.checks.extend(row);
        Ok(())
    }

    /// The lines about how noisy the inertial sensors have to be.
    fn needed(&mut self, levels: &Levels) {
        let flight = self.smoother.flight;
        for (i, input) in flight.inputs.iter().enumerate().filter(|(_, input)| input.sd > 0.0) {
            let quantity = &self.kinematics.model.inputs[i];
            if consistency::inertial(&quantity.unit) {
                let sd = (levels.density[i] / flight.clocks[input.clock].spacing).sqrt();
                let of = (sd, input.sd, levels.given[1][i]);
                self.path.checks.push(verdicts::needed_row(&quantity.name, &quantity.unit, of));
            }
        }
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
            let mut rows = comparison.rows(&name);
            // what gyros and attitude alone tell is told already
            rows.retain(|row| !self.path.checks.iter().any(|known| known.is_of(row)));
            self.path.checks.extend(rows);
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
            let mut smoothed = self.smoother.path(
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
            let at = (kinematics, levels, stretch);
            let mut widened = |wide: &Wide| wide.widen(at, (*grid, every), &mut out, &mut smoothed);
            if self.wide.as_ref().is_some_and(|wide| !widened(wide)) {
                let text = "standard deviations suppose that errors which the data do not support are none: with them the filter does not stay finite";
                self.path.notes.push(text.to_string().into());
            }
            let found = &self.found;
            self.path.biases.extend(biases(kinematics, found, &smoothed, number, stretch));
            self.path.checks.extend(estimated(kinematics, found, levels, &smoothed, number));
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
        self.path.checks.extend(held(kinematics, &self.found));
        self.undetermined(levels, &mut out);
        (self.path.outputs, self.path.sd, self.path.innovations) = (out.value, out.sd, innovations);
        errors
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
