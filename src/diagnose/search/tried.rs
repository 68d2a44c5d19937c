//! What is tried of every candidate, and what screening says of it.

/// One column of a candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Index into `Candidate::added`.
    pub size: usize,
    /// Where it belongs to; none for a size common to all.
    pub only: Option<Only>,
}

/// Segments that have a size in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Only {
    pub segments: Vec<usize>,
    /// Their value of the column by which the size differs.
    pub value: String,
}

/// One way to bring a candidate in: a row of the starts of its shapes and the steps of its sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    pub candidate: usize,
    /// Of the starts of its shapes and the steps of its sizes.
    pub row: usize,
    /// Values of the added parameters, sizes at null.
    pub at: Vec<f64>,
    pub columns: Vec<usize>,
}

/// What screening says of one candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// Gain in log-likelihood of the best of its trials.
    pub gain: f64,
    /// Parameters that this gain takes.
    pub taken: usize,
    /// Values of the added parameters that a fit may start from (of the first segment, for those
    /// per segment).
    pub at: Vec<f64>,
    /// Share of the column that the base's parameters cannot imitate.
    pub left: f64,
    /// Base parameters that imitate it most, where next to nothing is left.
    pub imitators: Vec<Imitator>,
    /// Of sizes that differ by a column, where the base moves all of their values at once: the value from
    /// which the others differ.
    pub references: Vec<Reference>,
    /// The model did not run, or nothing in the flights moves it.
    pub silent: bool,
}

/// Where a size stays at null, and from which the others differ.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Index into `Candidate::added`.
    pub size: usize,
    /// Value of the column by which the size differs.
    pub value: String,
}

/// A parameter of the base that takes over what a candidate would say.
#[derive(Debug, Clone, PartialEq)]
pub struct Imitator {
    pub name: String,
    pub unit: String,
    /// How far it comes out off where one unit of the candidate's size is left out.
    pub shift: f64,
}

/// All that is tried.
#[derive(Debug, Clone)]
pub struct Tried {
    pub trials: Vec<Trial>,
    pub columns: Vec<Column>,
    pub bounds: Vec<(f64, f64)>,
}

/// Where products of the columns of each trial stand among those of all: squares, one after the
/// other.
pub struct Squares(Vec<usize>);

impl Squares {
    pub fn of(trials: &[Trial]) -> Squares {
        let mut from = 0;
        let one = |trial: &Trial| {
            let here = from;
            from += trial.columns.len().pow(2);
            here
        };
        Squares(trials.iter().map(one).collect())
    }

    /// Of two columns of a trial of `k`.
    pub fn place(&self, trial: usize, k: usize, [a, b]: [usize; 2]) -> usize {
        self.0[trial] + a * k + b
    }

    pub fn of_trial(&self, trial: usize, k: usize) -> std::ops::Range<usize> {
        self.0[trial]..self.0[trial] + k * k
    }
}

/// Columns of every product.
pub fn pairs(trials: &[Trial]) -> impl Iterator<Item = [usize; 2]> {
    let of = |trial: &Trial| {
        let all = &trial.columns;
        all.iter().flat_map(|&a| all.iter().map(move |&b| [a, b])).collect::<Vec<_>>()
    };
    trials.iter().flat_map(of)
}
