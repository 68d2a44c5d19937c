//! A compiled model over a record: trajectories, exact sensitivities, trim.

/// What was measured of one model output, at its own time stamps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Channel {
    /// Index into the model's outputs.
    pub output: usize,
    /// Seconds, on the clock of the record's grid; ascending, inside the grid.
    pub t: Vec<f64>,
    /// Values in SI; NaN marks a masked sample.
    pub z: Vec<f64>,
}

/// One stretch of flight as a model sees it: inputs on a uniform grid, outputs at their own times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Time of grid point 0, s.
    pub t0: f64,
    /// Grid spacing, s.
    pub dt: f64,
    /// Number of grid points.
    pub n: usize,
    /// Inputs `[n][nu]`, row by row, in the order of the model's inputs.
    pub inputs: Vec<f64>,
    /// Grid points before the record proper that only feed delays (pre-roll); the states start at this grid point.
    pub start: usize,
    /// The channels scored, in the order of the model's outputs; outputs that are not measured are absent.
    pub channels: Vec<Channel>,
}
