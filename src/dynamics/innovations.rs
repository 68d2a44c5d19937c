//! A model with the covariance of its states, and a record, in; the innovations of an extended Kalman
//! filter with their variances, and the exact derivatives of both, out.
//!
//! Between two measurements states and covariance go by the Runge-Kutta method of all trajectories
//! (`model::Covariance`), and `S = d(x, P)/dtheta` by the same method on `S' = A S + B`. Everything
//! measured at one instant is taken one scalar after the other. With `c = dy/dx` and `r` the
//! variance of the noise,
//!
//! `nu = z - y`, `h = P c`, `s = c'h + r`, `K = h/s`, `x <- x + K nu`, `P <- (I - K c') P (I - K c')' + r K K'`
//!
//! (Joseph's form: Bierman 1977), and by the product rule, the derivatives of the gain included,
//!
//! `dh = dP c + P dc`, `ds = dc'h + c'dh + dr`, `dx <- dx + K dnu + (dh - K ds)/s nu`,
//! `dP <- dP - (dh h' + h dh')/s + h h' ds/s^2`.
//!
//! Steps end at every sample, so that each is taken at its own time. The likelihood of the record is
//! `exp(-1/2 sum (nu^2/s + ln s))` (Schweppe 1965).

use super::evaluate::{Programs, Single};
use super::filter::{Filter, Innovation, Innovations, Measured, Taken, Way};
use super::innovation_slopes::Slopes;
use super::modes::Span;
use super::propagator::Propagator;
use super::starts::start_file;
use super::stiffness::Stiffness;
use super::tableau::{MOST_SUBSTEPS, OFFSET};
use super::values::Run;
use super::{Lost, Record};

/// Two times closer than this share of a grid step are one.
const SAME: f64 = 1e-6;
/// Grid steps whose derivatives are taken together.
const CHUNK: usize = 32;
/// Grid steps between two looks at the Jacobian where sub-steps are chosen along the way.
const LOOK: usize = 64;

impl Filter {
    /// Filters a record. `parameters`: all of the model's; `given`: start values as for a trajectory.
    pub fn run(
        &self,
        propagator: &Propagator,
        parameters: &[f64],
        given: &[f64],
        record: &Record,
        derivatives: bool,
    ) -> Innovations {
        self.walk(propagator, (parameters, given), record, (derivatives, true))
    }

    /// The same record without a look at what was measured: `y` is the motion by itself, `s` the
    /// variance of a measurement about it, to first order along it.
    pub fn alone(
        &self,
        propagator: &Propagator,
        parameters: &[f64],
        given: &[f64],
        record: &Record,
    ) -> Innovations {
        self.walk(propagator, (parameters, given), record, (false, false))
    }

    /// `correct`: samples correct the states.
    fn walk(
        &self,
        propagator: &Propagator,
        (parameters, given): (&[f64], &[f64]),
        record: &Record,
        (derivatives, correct): (bool, bool),
    ) -> Innovations {
        let n = record.n.saturating_sub(record.start);
        let nd = if derivatives { propagator.directions.len() } else { 0 };
        let mut out = Innovations::default();
        out.channels.extend(record.channels.iter().map(|c| Innovation::of(c.t.len(), nd)));
        if n == 0 || record.inputs.len() < record.n * propagator.layout.inputs {
            out.lost = (n > 0).then_some(Lost::Diverges);
            return out;
        }
        let mut programs = Programs::new(propagator, parameters);
        let mut run = Run::new(propagator, record, &mut programs.taus);
        let starts = &propagator.starts;
        let file =
            start_file(starts, propagator.layout, &propagator.tables, parameters, given, record);
        let mut slopes = derivatives.then(|| Slopes::new(self, propagator, parameters, &file));
        let x: Vec<f64> =
            (0..propagator.layout.states).map(|i| starts.program.output(&file, i)[0]).collect();
        run.limit(&x, &mut programs);
        let mut walk = Walk::new(self, propagator, run, programs, parameters, x);
        walk.correct = correct;
        let mut samples = schedule(record).into_iter().peekable();
        for k in 0..n {
            let mut from = 0.0;
            while let Some(sample) = samples.next_if(|s| s.k == k) {
                walk.advance(k, [from, sample.c]);
                from = sample.c;
                let channel = &record.channels[sample.channel];
                let Some(j) = propagator.outputs.iter().position(|o| *o == channel.output) else {
                    continue;
                };
                let first = k == 0 && sample.c == 0.0 && self.starts[j];
                let z = channel.z[sample.at];
                if !correct || (z.is_finite() && !first) {
                    walk.take(j, &sample, z, &mut out.channels[sample.channel]);
                }
            }
            if k + 1 < n {
                walk.advance(k, [from, 1.0]);
            }
            if walk.lost.is_none() && walk.x.iter().any(|x| !x.is_finite()) {
                walk.lost = Some(Lost::Diverges);
            }
            if walk.lost.is_some() {
                out.lost = walk.lost;
                break;
            }
            if k % CHUNK == CHUNK - 1 || k + 1 == n {
                if let Some(slopes) = &mut slopes {
                    slopes.advance(&walk.run, &walk.way, &mut out.channels);
                }
                walk.way.clear();
            }
        }
        out
    }
}

/// A sample: behind grid point `k` (from the start point) by `c` steps.
struct Sample {
    k: usize,
    c: f64,
    channel: usize,
    at: usize,
}

/// All samples on the grid in the order of time.
fn schedule(record: &Record) -> Vec<Sample> {
    let n = record.n - record.start;
    let mut all = Vec::new();
    for (channel, of) in record.channels.iter().enumerate() {
        for (at, t) in of.t.iter().enumerate() {
            let place = (t - record.t0) / record.dt - record.start as f64;
            let whole = place.round();
            let place = if (place - whole).abs() < SAME { whole } else { place };
            if place >= 0.0 && place <= (n - 1) as f64 {
                let k = place.floor();
                all.push(Sample { k: k as usize, c: place - k, channel, at });
            }
        }
    }
    all.sort_by(|a, b| a.k.cmp(&b.k).then(a.c.total_cmp(&b.c)).then(a.channel.cmp(&b.channel)));
    all
}

/// A filter on its way.
struct Walk<'p> {
    filter: &'p Filter,
    propagator: &'p Propagator,
    run: Run<'p>,
    programs: Programs<'p>,
    outputs: Vec<Single<'p>>,
    stiffness: Option<Stiffness<'p>>,
    substeps: usize,
    looked: Option<usize>,
    /// Of the noise of the outputs.
    variances: Vec<f64>,
    x: Vec<f64>,
    lost: Option<Lost>,
    /// Whether samples correct the states.
    correct: bool,
    way: Way,
    /// Scratch.
    left: Vec<f64>,
    sum: Vec<f64>,
}

impl<'p> Walk<'p> {
    fn new(
        filter: &'p Filter,
        propagator: &'p Propagator,
        run: Run<'p>,
        programs: Programs<'p>,
        parameters: &[f64],
        x: Vec<f64>,
    ) -> Self {
        let single = |m: &'p Measured| Single::new(&m.values, propagator, parameters);
        let record = run.record;
        let outputs: Vec<Single> = filter.measured.iter().map(single).collect();
        let variance = |m: &Measured| parameters[m.sd] * parameters[m.sd];
        Walk {
            stiffness: (record.substeps == 0).then(|| Stiffness::new(propagator, parameters)),
            substeps: record.substeps.max(1),
            looked: None,
            variances: filter.measured.iter().map(variance).collect(),
            way: Way { points: vec![Vec::new(); outputs.len()], ..Way::default() },
            outputs,
            filter,
            propagator,
            run,
            programs,
            x,
            lost: None,
            correct: true,
            left: Vec::new(),
            sum: Vec::new(),
        }
    }

    /// Through a part of grid step `k`.
    fn advance(&mut self, k: usize, [from, to]: [f64; 2]) {
        if self.lost.is_some() || to <= from {
            return;
        }
        self.look(k);
        let parts = ((to - from) * self.substeps as f64 - 1e-9).ceil().max(1.0);
        let at = |i: usize| from + (to - from) * i as f64 / parts;
        for part in 0..parts as usize {
            let span = Span { from: at(part), to: at(part + 1), ..Span::whole(k, 0, 1) };
            if self.propagator.plain() {
                self.march(span);
            } else {
                self.run.step(span, &mut self.x, &mut self.programs, &mut self.way.chunk);
            }
        }
    }

    /// Chooses the number of steps, where that is left to the program.
    fn look(&mut self, k: usize) {
        let Some(stiffness) = &mut self.stiffness else { return };
        if self.looked == Some(k / LOOK) {
            return;
        }
        self.looked = Some(k / LOOK);
        let mut point = vec![0.0; self.propagator.layout.time() + 1];
        self.run.arguments(k, 0.0, &self.x, &mut point);
        self.substeps = stiffness.substeps(&point, self.run.record.dt);
        if self.substeps > MOST_SUBSTEPS {
            let (state, time_constant) = stiffness.fastest(&point);
            self.lost = Some(Lost::Stiff { state, time_constant });
        }
    }

    /// One step of a plain model.
    fn march(&mut self, span: Span) {
        let (width, h) =
            (self.propagator.layout.time() + 1, self.run.record.dt * (span.to - span.from));
        let chunk = &mut self.way.chunk;
        let at = chunk.stages.len();
        chunk.stages.resize(at + 4 * width, 0.0);
        for (stage, row) in chunk.stages[at..].chunks_exact_mut(width).enumerate() {
            self.run.arguments(span.k, span.at(OFFSET[stage]), &self.x, row);
        }
        self.sum.resize(self.x.len(), 0.0);
        let stages = &mut chunk.stages[at..];
        self.programs.rates.march(stages, width, h, &mut self.x, &mut self.sum);
        chunk.lengths.push(h);
    }

    /// Takes a sample of output `j`.
    fn take(&mut self, j: usize, sample: &Sample, z: f64, out: &mut Innovation) {
        if self.lost.is_some() {
            return;
        }
        let (filter, of, way) = (self.filter, &self.filter.measured[j], &mut self.way);
        let (n, width) = (filter.motion, self.propagator.layout.time() + 1);
        let place = |i: usize, j: usize| filter.places[i * n + j];
        let from = way.points[j].len();
        way.points[j].resize(from + width, 0.0);
        let point = &mut way.points[j][from..];
        self.run.arguments(sample.k, sample.c, &self.x, point);
        self.run.delayed(point, &mut self.programs.taus, true, &mut way.pasts);
        self.outputs[j].at(point);
        let (y, r) = (self.outputs[j].get(0), self.variances[j]);
        let [at_c, at_h] = [way.c.len(), way.h.len()];
        way.x.extend_from_slice(&self.x);
        way.c.resize(at_c + n, 0.0);
        let c = &mut way.c[at_c..];
        of.slopes.iter().enumerate().for_each(|(a, &b)| c[b] = self.outputs[j].get(a + 1));
        way.h.extend(
            (0..n).map(|i| of.slopes.iter().map(|&b| self.x[place(i, b)] * c[b]).sum::<f64>()),
        );
        let h = &way.h[at_h..];
        let seen: f64 = of.slopes.iter().map(|&b| c[b] * h[b]).sum();
        let (nu, s) = (z - y, seen + r);
        (out.y[sample.at], out.s[sample.at], out.e[sample.at]) = (y, s, nu / s.sqrt());
        if !self.correct {
            return;
        }
        if !(s > 0.0 && nu.is_finite()) {
            self.lost = Some(Lost::Diverges);
        }
        // What the gain leaves of the covariance with the innovation.
        self.left.clear();
        self.left.extend(h.iter().map(|h| h - h / s * seen));
        for i in 0..n {
            for j in 0..=i {
                let joseph = h[i] * h[j] / s + self.left[i] * h[j] / s - r * h[i] * h[j] / (s * s);
                self.x[place(i, j)] -= joseph;
            }
        }
        way.gain.extend(h.iter().map(|h| h / s));
        (0..n).for_each(|i| self.x[i] += h[i] / s * nu);
        way.taken.push(Taken {
            after: way.chunk.lengths.len(),
            output: j,
            point: from / width,
            channel: sample.channel,
            at: sample.at,
            nu,
            s,
        });
    }
}
