//! One equation and the candidates among its terms in; the steps of a search, and the candidates that
//! it takes, out.
//!
//! - Stepwise: the candidate with the largest partial F comes in where it is above the limit, then
//!   the one with the smallest goes out where it is below (Draper & Smith 1998, ch. 15; Klein &
//!   Morelli 2006, sec. 5.4).
//! - Orthogonal: candidates are made orthogonal to all that are in (modified Gram-Schmidt), and come
//!   in by how much each explains, all of them; the number is chosen where the predicted square error
//!   is least (Morelli 1995; Klein & Morelli 2006, sec. 5.4).
//!
//! Both need sums of products alone. Taking a column out of all others, `G_jk -= G_jc G_ck / G_cc`, is a
//! step of Gram and Schmidt.

use super::Settings;
use super::regressors::Problem;
use super::sides::Side;
use crate::least_squares::{Block, Evaluate};
use crate::math::products::dot;

/// The steps of a search, and the names of the candidates that it takes.
type Found = (Vec<Step>, Vec<String>);

/// One step of the search in one equation.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    pub equation: String,
    /// Unit of the left side.
    pub unit: String,
    /// 0 is the equation without candidates.
    pub step: usize,
    /// "start", "in" or "out".
    pub action: &'static str,
    /// The candidate that comes or goes.
    pub parameter: Option<String>,
    /// What it explains per column, in mean squares of what is left; NaN at the start.
    pub partial_f: f64,
    /// The limit it is held against; NaN in an orthogonal search.
    pub limit: f64,
    /// Columns in the equation after this step.
    pub terms: usize,
    /// Predicted square error, unit of the left side squared.
    pub pse: f64,
    pub r2: f64,
    /// Standard error of the residuals, unit of the left side.
    pub s: f64,
    /// Whether the equation as it is after this step is the one that is kept.
    pub kept: bool,
}

/// A candidate: its name, and its columns.
pub(super) struct Candidate {
    name: String,
    columns: Vec<usize>,
}

/// Sums of products of one equation at the start values: what is left, and the columns of its
/// terms, scaled to length 1.
pub(super) struct Sums<'a> {
    side: &'a Side,
    n: f64,
    /// `[columns][columns]`.
    gram: Vec<f64>,
    /// With what is left.
    along: Vec<f64>,
    square: f64,
    /// Sum of squares of the left side about its mean.
    total: f64,
    pub candidates: Vec<Candidate>,
    others: Vec<usize>,
}

/// Below this share of its length a column is one of the others.
const DEPENDENT: f64 = 1e-10;

/// What is left when some columns are in.
#[derive(Clone)]
struct Left {
    gram: Vec<f64>,
    along: Vec<f64>,
    square: f64,
    terms: usize,
}

impl Left {
    /// Takes a column out of all others; whether there was anything of it.
    fn take(&mut self, c: usize) -> bool {
        let n = self.along.len();
        let pivot = self.gram[c * n + c];
        if pivot <= DEPENDENT {
            return false;
        }
        let column: Vec<f64> = (0..n).map(|j| self.gram[j * n + c]).collect();
        let along = self.along[c];
        self.square -= along * along / pivot;
        for j in 0..n {
            self.along[j] -= column[j] * along / pivot;
            for k in 0..n {
                self.gram[j * n + k] -= column[j] * column[k] / pivot;
            }
        }
        self.terms += 1;
        true
    }
}

impl<'a> Sums<'a> {
    pub fn new(problem: &'a Problem, equation: usize, settings: &Settings) -> Sums<'a> {
        let case = problem.case;
        let layout = &case.layout;
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); layout.start.len()];
        let (mut e, mut left) = (Vec::new(), Vec::new());
        for (s, part) in layout.parts.iter().enumerate() {
            let blocks = problem.blocks(s, &layout.local(s, &layout.start), true);
            let Some(block) = blocks.and_then(|b| b.into_iter().nth(equation)) else { continue };
            let Block { e: these, g, .. } = block;
            let directions = part.directions();
            let place = |d: usize| match part.shared.get(d) {
                Some(&i) => i,
                None => part.offset + d - part.shared.len(),
            };
            for (k, value) in these.iter().enumerate().filter(|(_, e)| e.is_finite()) {
                e.push(*value);
                left.push(problem.segments[s].left[equation][k]);
                columns.iter_mut().for_each(|column| column.push(0.0));
                for d in 0..directions {
                    if let Some(last) = columns[place(d)].last_mut() {
                        *last = g[k * directions + d];
                    }
                }
            }
        }
        for column in &mut columns {
            let length = dot(column, column).sqrt();
            let factor = if length > 0.0 { 1.0 / length } else { 0.0 };
            column.iter_mut().for_each(|v| *v *= factor);
        }
        let n = columns.len();
        let mut gram = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let product = dot(&columns[i], &columns[j]);
                (gram[i * n + j], gram[j * n + i]) = (product, product);
            }
        }
        let mean = left.iter().sum::<f64>() / left.len() as f64;
        let (mut candidates, mut others): (Vec<Candidate>, Vec<usize>) = (Vec::new(), Vec::new());
        for i in (0..n).filter(|&i| gram[i * n + i] > 0.0) {
            let name = &case.unknowns[i].name;
            if !settings.candidates.contains(name) {
                others.push(i);
            } else if let Some(known) = candidates.iter_mut().find(|c| c.name == *name) {
                known.columns.push(i);
            } else {
                candidates.push(Candidate { name: name.clone(), columns: vec![i] });
            }
        }
        let number = |c: &Candidate| settings.candidates.iter().position(|name| *name == c.name);
        candidates.sort_by_key(number);
        Sums {
            side: &problem.sides[equation],
            n: e.len() as f64,
            along: columns.iter().map(|column| dot(column, &e)).collect(),
            gram,
            square: dot(&e, &e),
            total: left.iter().map(|l| (l - mean) * (l - mean)).sum(),
            candidates,
            others,
        }
    }

    /// What is left with these candidates in.
    fn with(&self, candidates: &[usize]) -> Left {
        let mut left = Left {
            gram: self.gram.clone(),
            along: self.along.clone(),
            square: self.square,
            terms: 0,
        };
        let columns = candidates.iter().flat_map(|&c| &self.candidates[c].columns);
        self.others.iter().chain(columns).for_each(|&c| {
            left.take(c);
        });
        left
    }

    /// Partial F of what takes `before` to `after`; 0 where nothing does.
    fn partial_f(&self, before: &Left, after: &Left) -> f64 {
        let added = (after.terms - before.terms) as f64;
        let freedom = self.n - after.terms as f64;
        if added > 0.0 && freedom > 0.0 && after.square > 0.0 {
            (before.square - after.square) / added / (after.square / freedom)
        } else {
            0.0
        }
    }

    fn step(
        &self,
        (step, action): (usize, &'static str),
        candidate: Option<usize>,
        (partial_f, limit): (f64, f64),
        left: &Left,
    ) -> Step {
        let terms = left.terms as f64;
        Step {
            equation: self.side.name.clone(),
            unit: self.side.unit.clone(),
            step,
            action,
            parameter: candidate.map(|c| self.candidates[c].name.clone()),
            partial_f,
            limit,
            terms: left.terms,
            // Klein & Morelli 2006, sec. 5.4: PSE = e'e/N + sigma_max^2 p/N, sigma_max^2 = sum (z - mean)^2/N
            pse: left.square / self.n + self.total / self.n * terms / self.n,
            r2: 1.0 - left.square / self.total,
            s: (left.square / (self.n - terms)).sqrt(),
            kept: false,
        }
    }

    pub fn stepwise(&self, limit: f64) -> Found {
        let mut taken: Vec<usize> = Vec::new();
        let mut left = self.with(&taken);
        let mut steps = vec![self.step((0, "start"), None, (f64::NAN, f64::NAN), &left)];
        // Each comes in and goes out a few times at most.
        while steps.len() < 4 * self.candidates.len() + 2 {
            let before = steps.len();
            let comes = (0..self.candidates.len()).filter(|c| !taken.contains(c)).map(|c| {
                let more = self.with(&[&taken[..], &[c]].concat());
                (c, self.partial_f(&left, &more), more)
            });
            let best = comes.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            if let Some((c, f, more)) = best.filter(|(_, f, _)| *f > limit) {
                (left, taken) = (more, [&taken[..], &[c]].concat());
                steps.push(self.step((steps.len(), "in"), Some(c), (f, limit), &left));
            }
            let goes = taken.iter().map(|&c| {
                let others: Vec<usize> = taken.iter().copied().filter(|o| *o != c).collect();
                let less = self.with(&others);
                (c, self.partial_f(&less, &left), less)
            });
            let worst = goes.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            if let Some((c, f, less)) = worst.filter(|(_, f, _)| *f < limit) {
                left = less;
                taken.retain(|o| *o != c);
                steps.push(self.step((steps.len(), "out"), Some(c), (f, limit), &left));
            }
            if steps.len() == before {
                break;
            }
        }
        if let Some(last) = steps.last_mut() {
            last.kept = true;
        }
        self.found(steps, &taken)
    }

    pub fn orthogonal(&self) -> Found {
        let mut left = self.with(&[]);
        let mut steps = vec![self.step((0, "start"), None, (f64::NAN, f64::NAN), &left)];
        let mut order: Vec<usize> = Vec::new();
        loop {
            let comes = (0..self.candidates.len()).filter(|c| !order.contains(c)).map(|c| {
                let mut more = left.clone();
                let any =
                    self.candidates[c].columns.iter().fold(false, |any, &i| more.take(i) | any);
                (c, any, more)
            });
            let comes = comes.filter(|(_, any, _)| *any);
            let Some((c, _, more)) =
                comes.min_by(|a, b| a.2.square.total_cmp(&b.2.square).then(a.0.cmp(&b.0)))
            else {
                break;
            };
            let f = self.partial_f(&left, &more);
            left = more;
            order.push(c);
            steps.push(self.step((steps.len(), "in"), Some(c), (f, f64::NAN), &left));
        }
        let least = (0..steps.len()).min_by(|&a, &b| steps[a].pse.total_cmp(&steps[b].pse));
        let least = least.unwrap_or(0);
        steps[least].kept = true;
        self.found(steps, &order[..least])
    }

    fn found(&self, steps: Vec<Step>, taken: &[usize]) -> Found {
        let taken = taken.iter().map(|&c| self.candidates[c].name.clone()).collect();
        (steps, taken)
    }
}
