//! A flight whose path has candidates held, because the data do not support them, in; standard
//! deviations as if they were not, out.
//!
//! What the data do not tell is not known to be none. Of states and errors `x` and a candidate `b`,
//! jointly Gaussian, the path has the mean of `x` given `b = s`; its covariance is that of both together,
//! `P_xx = P_xx|b + P_xb P_bb^-1 P_bx`, so that what `b` may be is in what is said of `x`.

use super::smoother::grid::Outputs;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::smoother::{Smoothed, Smoother};
use crate::error::Result;
use crate::math::interpolate::between;
use crate::model::Model;
use crate::signal::resample::Grid;

/// A path with all candidates free.
pub struct Wide<'a> {
    pub smoother: Smoother<'a>,
    /// Noise levels of the survey: standard deviations at the start of all that is free.
    pub begin: Levels,
    /// Runs that are linearised about the one before.
    pub passes: usize,
}

/// The kinematic model with all candidates free, where any is held.
///
/// # Errors
/// As `Kinematics::new`.
pub fn kinematics<'m>(
    model: &'m Model,
    held: bool,
    levels: Option<&(Vec<usize>, Levels)>,
) -> Result<Option<Kinematics<'m>>> {
    let free = levels.filter(|_| held).map(|(free, _)| free.clone());
    free.map(|free| Kinematics::new(model, free)).transpose()
}

impl Wide<'_> {
    /// Makes the standard deviations of a stretch those of all together, where they are larger.
    /// `every`: points of the grid from one to the next that is computed. False where the filter does not
    /// stay finite.
    pub fn widen(
        &self,
        (kinematics, levels, stretch): (&Kinematics, &Levels, [f64; 2]),
        (grid, every): (Grid, usize),
        out: &mut Outputs,
        smoothed: &mut Smoothed,
    ) -> bool {
        let all = self.smoother.kinematics;
        let levels = self.levels(kinematics, levels);
        let x = self.smoother.begin(&levels, stretch, None);
        let (about, _) = self.smoother.about(&levels, stretch, &x, self.passes);
        let coarse = Grid { dt: grid.dt * every as f64, n: grid.n.div_ceil(every), ..grid };
        let mut wide = Outputs::empty(out.sd.len(), all.size(), coarse.n);
        let at = (coarse, 1);
        let (smoother, about) = (&self.smoother, about.as_ref());
        let found = smoother.path(about, &levels, stretch, &x, at, &mut (), &mut wide);
        if !found.finite {
            return false;
        }
        for (sd, wide) in out.sd.iter_mut().zip(&wide.sd) {
            for (k, sd) in sd.iter_mut().enumerate() {
                let (before, share) = (k / every, (k % every) as f64 / every as f64);
                let after = wide.get(before + 1).filter(|sd| sd.is_finite());
                let after = after.unwrap_or(&wide[before]);
                *sd = sd.max(between(wide[before], *after, share));
            }
        }
        let nx = kinematics.states();
        let (size, wider) = (smoothed.p.len() / kinematics.size(), found.p.len() / all.size());
        for (k, parameter) in kinematics.free.iter().enumerate() {
            let Some(place) = all.free.iter().position(|p| p == parameter) else { continue };
            let (at, place) = ((nx + k) * (size + 1), (nx + place) * (wider + 1));
            smoothed.p[at] = smoothed.p[at].max(found.p[place]);
        }
        true
    }

    /// The noise levels of the path, of all free parameters.
    fn levels(&self, kinematics: &Kinematics, levels: &Levels) -> Levels {
        let mut all = self.begin.clone();
        all.begin(self.smoother.kinematics, levels, &kinematics.free);
        all
    }
}
