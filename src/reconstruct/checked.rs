//! A flight's signals in, whose path is found otherwise; what the smoother's checks say of them, and what of
//! them is fit to be used, out.

use std::borrow::Cow;

use super::consistency;
use super::pairs::Which;
use super::path::{FLIGHT_PATH, FlightPath, Note};
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::smoothed::smooth;
use super::smoother::grid::Outputs;
use super::usable::{Usable, usable};
use crate::error::Errors;
use crate::model::Model;
use crate::signal::resample::Grid;

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
    let usable = usable(model, driving, measured, &mut path);
    if usable.unfit {
        let Usable { unfit, driving, measured } = usable;
        return Ok(Checked { checks: path.checks, notes: path.notes, unfit, driving, measured });
    }
    let (usable, flight) = usable.following(model, driving, settings, &mut path)?;
    let plain =
        Settings { late: Vec::new(), candidates: Vec::new(), free: Vec::new(), ..settings.clone() };
    let coarse = Grid::covering(grid.t0, grid.time(grid.n - 1), 1.0 / COARSE_HZ);
    let nothing = Outputs::empty(model.outputs.len(), 0, coarse.n);
    (path.t, path.outputs, path.sd) = (coarse.times(), nothing.value, nothing.sd);
    let (path, out) = {
        let (driving, measured) = usable.series(driving);
        smooth(model, (&driving, flight), measured, &coarse, &plain, path)?
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
        driving: usable.driving,
        measured: usable.measured.into_iter().filter(|m| !reversed(m)).collect(),
    })
}
