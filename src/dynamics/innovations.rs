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
use super::history::Past;
use super::propagator::Propagator;
use super::starts::start_file;
use super::stiffness::Stiffness;
use super::tableau::{AHEAD, MOST_SUBSTEPS, OFFSET, WEIGHT};
use super::values::Run;
use super::{Lost, Record};
use crate::model::graph::Leaf;
use crate::model::linear::Sparse;
use crate::model::{Covariance, Model, Program, StartKind};

/// Two times closer than this share of a grid step are one.
const SAME: f64 = 1e-6;

/// The programs of what is measured, beside those of a propagator for the same model.
#[derive(Debug, Clone)]
pub struct Filter {
    covariance: Covariance,
    /// Per output of the propagator.
    measured: Vec<Measured>,
    /// Per output of the propagator, whether its first sample started a state.
    starts: Vec<bool>,
}

/// One output: the program has its value, its slopes with respect to the states it depends on, and
/// the derivatives of all these.
#[derive(Debug, Clone)]
struct Measured {
    program: Program,
    slopes: Vec<usize>,
    derivatives: Sparse,
    /// The parameter that is the standard deviation of its noise, and its direction, if it is free.
    sd: usize,
    direction: Option<usize>,
}

/// What one channel says, sample by sample; NaN where it is masked or outside the grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Innovation {
    /// `nu/sqrt(s)`
    pub e: Vec<f64>,
    /// What was predicted from all before it.
    pub y: Vec<f64>,
    /// `s`
    pub s: Vec<f64>,
    /// `-dnu/sqrt(s)` and `ds/s`, `[sample][direction]`; empty unless asked for.
    pub dy: Vec<f64>,
    pub ds: Vec<f64>,
}

/// What a filter says of a record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Innovations {
    /// Per channel of the record.
    pub channels: Vec<Innovation>,
    /// Why it was given up, where it was.
    pub lost: Option<Lost>,
}

impl Filter {
    /// The filter of a model that has a covariance; none for another one.
    pub fn new(model: &Model, propagator: &Propagator) -> Option<Filter> {
        let covariance = model.covariance.clone()?;
        let free = &propagator.directions.parameters;
        let measured = propagator.outputs.iter().map(|&output| {
            let mut g = model.graph.clone();
            let y = model.output_nodes[output];
            let leaves = g.leaves(&[y]);
            let slopes: Vec<usize> =
                (0..covariance.motion).filter(|i| leaves.contains(&Leaf::State(*i))).collect();
            let mut nodes = vec![y];
            nodes.extend(slopes.iter().map(|&i| g.derivative(y, Leaf::State(i))));
            let (derivatives, program) = model.differentiated(&mut g, &nodes, free);
            let sd = covariance.sd[output]?;
            let direction = free.iter().position(|&p| p == sd);
            Some(Measured { program, slopes, derivatives, sd, direction })
        });
        let measured = measured.collect::<Option<Vec<Measured>>>()?;
        let starts = propagator.outputs.iter().map(|&output| {
            let state = model.state(&model.outputs[output].name);
            state.is_some_and(|i| {
                model.states[i].start == StartKind::Measured
                    && !propagator.directions.starts.contains(&i)
            })
        });
        Some(Filter { starts: starts.collect(), covariance, measured })
    }

    /// Filters a record. `parameters`: all of the model's; `given`: start values as for a trajectory.
    pub fn run(
        &self,
        propagator: &Propagator,
        parameters: &[f64],
        given: &[f64],
        record: &Record,
        derivatives: bool,
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
        let run = Run::new(propagator, record, &mut programs.taus);
        let mut walk = Walk::new(self, propagator, run, programs, (parameters, given), nd);
        let mut samples = schedule(record).into_iter().peekable();
        for k in 0..n {
            let mut from = 0.0;
            while let Some(sample) = samples.next_if(|s| s.k == k) {
                if sample.c > from {
                    walk.advance(k, [from, sample.c]);
                    from = sample.c;
                }
                let channel = &record.channels[sample.channel];
                let Some(j) = propagator.outputs.iter().position(|o| *o == channel.output) else {
                    continue;
                };
                let first = k == 0 && sample.c == 0.0 && self.starts[j];
                let z = channel.z[sample.at];
                if z.is_finite() && !first {
                    walk.measured(j, (k, from), z, &mut out.channels[sample.channel], sample.at);
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
        }
        out
    }
}

impl Innovation {
    fn of(samples: usize, nd: usize) -> Innovation {
        let nothing = || vec![f64::NAN; samples];
        let rows = || vec![0.0; samples * nd];
        Innovation { e: nothing(), y: nothing(), s: nothing(), dy: rows(), ds: rows() }
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
    jacobian: Single<'p>,
    delays: Single<'p>,
    outputs: Vec<Single<'p>>,
    stiffness: Option<Stiffness<'p>>,
    substeps: usize,
    variances: Vec<f64>,
    sds: Vec<f64>,
    nd: usize,
    /// States, and `[state][direction]`.
    x: Vec<f64>,
    s: Vec<f64>,
    lost: Option<Lost>,
    work: Work,
}

/// Scratch.
#[derive(Default)]
struct Work {
    point: Vec<f64>,
    pasts: Vec<Past>,
    x: Vec<f64>,
    sum: Vec<f64>,
    s: Vec<f64>,
    k: Vec<f64>,
    sums: Vec<f64>,
    late: Vec<f64>,
    h: Vec<f64>,
    dh: Vec<f64>,
    dc: Vec<f64>,
    dy: Vec<f64>,
    ds: Vec<f64>,
    left: Vec<f64>,
}

impl<'p> Walk<'p> {
    fn new(
        filter: &'p Filter,
        propagator: &'p Propagator,
        run: Run<'p>,
        programs: Programs<'p>,
        (parameters, given): (&[f64], &[f64]),
        nd: usize,
    ) -> Self {
        let nx = propagator.layout.states;
        let single = |program: &'p Program| Single::new(program, propagator, parameters);
        let record = run.record;
        let starts = &propagator.starts;
        let file =
            start_file(starts, propagator.layout, &propagator.tables, parameters, given, record);
        let x = (0..nx).map(|i| starts.program.output(&file, i)[0]).collect();
        let mut s = vec![0.0; nx * nd];
        let free = propagator.directions.parameters.len();
        for e in starts.entries.iter().filter(|_| nd > 0) {
            let column = match e.column.checked_sub(free) {
                None => Some(e.column),
                Some(k) => {
                    let state = starts.given[k];
                    propagator.directions.starts.iter().position(|&i| i == state).map(|p| free + p)
                }
            };
            if let Some(column) = column {
                s[e.row * nd + column] = starts.program.output(&file, e.output)[0];
            }
        }
        let sds: Vec<f64> = filter.measured.iter().map(|m| parameters[m.sd]).collect();
        let width = propagator.layout.time() + 1;
        Walk {
            stiffness: (record.substeps == 0).then(|| Stiffness::new(propagator, parameters)),
            substeps: record.substeps.max(1),
            jacobian: single(&propagator.linear.rates_program),
            delays: single(&propagator.linear.delays_program),
            outputs: filter.measured.iter().map(|m| single(&m.program)).collect(),
            variances: sds.iter().map(|sd| sd * sd).collect(),
            sds,
            work: Work { point: vec![0.0; width], ..Work::default() },
            filter,
            propagator,
            run,
            programs,
            nd,
            x,
            s,
            lost: None,
        }
    }

    /// Through a part of grid step `k`.
    fn advance(&mut self, k: usize, [from, to]: [f64; 2]) {
        if self.lost.is_some() || to <= from {
            return;
        }
        if let Some(stiffness) = self.stiffness.as_mut().filter(|_| from == 0.0) {
            self.run.arguments(k, 0.0, &self.x, &mut self.work.point);
            self.substeps = stiffness.substeps(&self.work.point, self.run.record.dt);
            if self.substeps > MOST_SUBSTEPS {
                let (state, time_constant) = stiffness.fastest(&self.work.point);
                self.lost = Some(Lost::Stiff { state, time_constant });
                return;
            }
        }
        let parts = ((to - from) * self.substeps as f64 - 1e-9).ceil().max(1.0);
        for part in 0..parts as usize {
            let at = |i: f64| from + (to - from) * i / parts;
            self.step(k, at(part as f64), at(part as f64 + 1.0));
        }
    }

    /// One step of the Runge-Kutta method.
    fn step(&mut self, k: usize, from: f64, to: f64) {
        let h = (to - from) * self.run.record.dt;
        let mut work = std::mem::take(&mut self.work);
        work.x.clone_from(&self.x);
        work.s.clone_from(&self.s);
        work.sum.clear();
        work.sum.resize(self.x.len(), 0.0);
        work.sums.clear();
        work.sums.resize(self.s.len(), 0.0);
        for stage in 0..4 {
            self.run.arguments(k, from + OFFSET[stage] * (to - from), &work.x, &mut work.point);
            work.pasts.clear();
            self.run.delayed(&mut work.point, &mut self.programs.taus, true, &mut work.pasts);
            self.programs.rates.at(&work.point);
            if self.nd > 0 {
                self.slopes(&mut work);
                add(WEIGHT[stage], &work.k, &mut work.sums);
                if stage < 3 {
                    work.s.clone_from(&self.s);
                    add(AHEAD[stage] * h, &work.k, &mut work.s);
                }
            }
            for i in 0..self.x.len() {
                let f = self.programs.rates.get(i);
                work.sum[i] += WEIGHT[stage] * f;
                if stage < 3 {
                    work.x[i] = self.x[i] + AHEAD[stage] * h * f;
                }
            }
        }
        add(h / 6.0, &work.sum, &mut self.x);
        add(h / 6.0, &work.sums, &mut self.s);
        self.work = work;
    }

    /// `A S + B` at a stage, into `work.k`.
    fn slopes(&mut self, work: &mut Work) {
        let (nd, entries) = (self.nd, &self.propagator.linear.rates);
        self.jacobian.at(&work.point);
        work.k.clear();
        work.k.resize(self.s.len(), 0.0);
        for e in &entries.states {
            let to = &mut work.k[e.row * nd..(e.row + 1) * nd];
            add(self.jacobian.get(e.output), &work.s[e.column * nd..(e.column + 1) * nd], to);
        }
        for e in &entries.parameters {
            work.k[e.row * nd + e.column] += self.jacobian.get(e.output);
        }
        if entries.delayed.is_empty() {
            return;
        }
        self.late(work);
        for e in &entries.delayed {
            let to = &mut work.k[e.row * nd..(e.row + 1) * nd];
            add(self.jacobian.get(e.output), &work.late[e.column * nd..(e.column + 1) * nd], to);
        }
    }

    /// Derivatives of the delayed inputs: `-du/dt dtau`.
    fn late(&mut self, work: &mut Work) {
        let (nd, of) = (self.nd, &self.propagator.linear.delays);
        self.delays.at(&work.point);
        work.late.clear();
        work.late.resize(self.propagator.delays.len() * nd, 0.0);
        for e in &of.states {
            let by = -work.pasts[e.row].slope[0] * self.delays.get(e.output);
            let to = &mut work.late[e.row * nd..(e.row + 1) * nd];
            add(by, &work.s[e.column * nd..(e.column + 1) * nd], to);
        }
        for e in &of.parameters {
            let by = -work.pasts[e.row].slope[0] * self.delays.get(e.output);
            work.late[e.row * nd + e.column] += by;
        }
    }

    /// Takes a sample of output `j`.
    fn measured(
        &mut self,
        j: usize,
        (k, c): (usize, f64),
        z: f64,
        out: &mut Innovation,
        at: usize,
    ) {
        if self.lost.is_some() {
            return;
        }
        let mut work = std::mem::take(&mut self.work);
        let (nd, p) = (self.nd, &self.filter.covariance);
        self.run.arguments(k, c, &self.x, &mut work.point);
        work.pasts.clear();
        self.run.delayed(&mut work.point, &mut self.programs.taus, true, &mut work.pasts);
        let of = &self.filter.measured[j];
        self.outputs[j].at(&work.point);
        let slope = |i: usize| self.outputs[j].get(i + 1);
        let (y, r, n) = (self.outputs[j].get(0), self.variances[j], p.motion);
        work.h.clear();
        work.h.extend((0..n).map(|i| {
            let terms = of.slopes.iter().enumerate();
            terms.map(|(a, &b)| self.x[p.place(i, b)] * slope(a)).sum::<f64>()
        }));
        let seen: f64 = of.slopes.iter().enumerate().map(|(a, &b)| slope(a) * work.h[b]).sum();
        let (nu, s) = (z - y, seen + r);
        (out.y[at], out.s[at], out.e[at]) = (y, s, nu / s.sqrt());
        if !(s > 0.0 && nu.is_finite()) {
            self.lost = Some(Lost::Diverges);
        }
        if nd > 0 {
            self.derivatives(j, &mut work, (nu, s), out, at);
        }
        let h = &work.h;
        // What the gain leaves of the covariance with the innovation.
        work.left.clear();
        work.left.extend(h.iter().map(|h| h - h / s * seen));
        for i in 0..n {
            for j in 0..=i {
                let joseph = h[i] * h[j] / s + work.left[i] * h[j] / s - r * h[i] * h[j] / (s * s);
                self.x[p.place(i, j)] -= joseph;
            }
        }
        (0..n).for_each(|i| self.x[i] += h[i] / s * nu);
        self.work = work;
    }

    /// The derivatives of an innovation and of what it does to the states.
    fn derivatives(
        &mut self,
        j: usize,
        work: &mut Work,
        (nu, s): (f64, f64),
        out: &mut Innovation,
        at: usize,
    ) {
        let (nd, p, of) = (self.nd, &self.filter.covariance, &self.filter.measured[j]);
        let (n, program) = (p.motion, &self.outputs[j]);
        // Of the output and of its slopes.
        work.dc.clear();
        work.dc.resize((1 + of.slopes.len()) * nd, 0.0);
        for e in &of.derivatives.states {
            let to = &mut work.dc[e.row * nd..(e.row + 1) * nd];
            add(program.get(e.output), &self.s[e.column * nd..(e.column + 1) * nd], to);
        }
        for e in &of.derivatives.parameters {
            work.dc[e.row * nd + e.column] += program.get(e.output);
        }
        if !of.derivatives.delayed.is_empty() {
            std::mem::swap(&mut work.s, &mut self.s);
            self.late(work);
            std::mem::swap(&mut work.s, &mut self.s);
            let program = &self.outputs[j];
            for e in &of.derivatives.delayed {
                let to = &mut work.dc[e.row * nd..(e.row + 1) * nd];
                add(program.get(e.output), &work.late[e.column * nd..(e.column + 1) * nd], to);
            }
        }
        let program = &self.outputs[j];
        work.dy.clear();
        work.dy.extend_from_slice(&work.dc[..nd]);
        work.dh.clear();
        work.dh.resize(n * nd, 0.0);
        for i in 0..n {
            let to = &mut work.dh[i * nd..(i + 1) * nd];
            for (a, &b) in of.slopes.iter().enumerate() {
                let place = p.place(i, b);
                add(program.get(a + 1), &self.s[place * nd..(place + 1) * nd], to);
                add(self.x[place], &work.dc[(a + 1) * nd..(a + 2) * nd], to);
            }
        }
        work.ds.clear();
        work.ds.resize(nd, 0.0);
        for (a, &b) in of.slopes.iter().enumerate() {
            add(work.h[b], &work.dc[(a + 1) * nd..(a + 2) * nd], &mut work.ds);
            add(program.get(a + 1), &work.dh[b * nd..(b + 1) * nd], &mut work.ds);
        }
        if let Some(d) = of.direction {
            work.ds[d] += 2.0 * self.sds[j];
        }
        let root = 1.0 / s.sqrt();
        add(root, &work.dy, &mut out.dy[at * nd..(at + 1) * nd]);
        add(1.0 / s, &work.ds, &mut out.ds[at * nd..(at + 1) * nd]);
        let h = &work.h;
        for i in 0..n {
            let to = &mut self.s[i * nd..(i + 1) * nd];
            add(-h[i] / s, &work.dy, to);
            add(nu / s, &work.dh[i * nd..(i + 1) * nd], to);
            add(-h[i] / (s * s) * nu, &work.ds, to);
        }
        for i in 0..n {
            for j in 0..=i {
                let place = p.place(i, j);
                let to = &mut self.s[place * nd..(place + 1) * nd];
                add(-h[j] / s, &work.dh[i * nd..(i + 1) * nd], to);
                add(-h[i] / s, &work.dh[j * nd..(j + 1) * nd], to);
                add(h[i] * h[j] / (s * s), &work.ds, to);
            }
        }
    }
}

/// `to += by from`
fn add(by: f64, from: &[f64], to: &mut [f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += by * from;
    }
}
