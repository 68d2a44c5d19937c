//! A recording of a flight in; its signals, and what an estimate derives from them around one
//! maneuver, on one grid out.

use super::prepared::Prepared;
use super::settings::{Grid as GridSettings, Rate};
use super::study::Study;
use crate::error::{Error, Result};
use crate::log::{Recorded, Series};
use crate::signal::resample::{Grid, linear};
use crate::signal::smooth::{SavitzkyGolay, smooth};
use crate::simulate::{Recording, TopicLog};
use crate::stage::derive::{Column, add_model, points, spacing};
use indexmap::IndexMap;

/// A recording as the estimates read it.
pub struct Samples {
    /// Signals at their own times.
    pub series: IndexMap<String, Series>,
    pub grid: Grid,
    /// Signals and their rates on the grid.
    columns: IndexMap<String, Column>,
}

impl Samples {
    /// The signals of a recording that begins at `start_ns` and lasts `duration` s.
    ///
    /// # Errors
    /// A signal of the channel map is not recorded (the check of the study says so before), or a
    /// filter cannot be made.
    pub fn of(
        study: &Study,
        recording: &Recording,
        start_ns: u64,
        duration: f64,
    ) -> Result<Samples> {
        let settings = &study.settings.grid;
        let grid = Grid::covering(0.0, duration, 1.0 / settings.rate_hz);
        let map = &study.channels.map;
        let (mut series, mut columns) = (IndexMap::new(), IndexMap::new());
        for (name, signal) in &map.signal {
            let topic = recording.topics.iter().find(|t| t.topic == signal.topic);
            let topic = topic.ok_or_else(|| {
                Error::new(format!("the recorder has no topic \"{}\"", signal.topic))
            })?;
            let one = recorded(topic, |r| r.series(map, signal, start_ns))?;
            let values = linear(&one.t_s, &one.value, &grid, settings.max_gap * spacing(&one.t_s));
            let unit = study.channels.unit(name);
            columns.insert(name.clone(), Column { unit, doc: String::new(), values });
            series.insert(name.clone(), one);
        }
        add_rates(settings, &grid, &mut columns)?;
        for (name, window) in &settings.smooth {
            if let Some(column) = columns.get_mut(name) {
                column.values = smooth(&column.values, points(*window, grid.dt), 3)?;
            }
        }
        Ok(Samples { series, grid, columns })
    }

    /// The columns of an estimate for the maneuver whose first step is at `t`: held signals at their
    /// mean over the `quiet` seconds before it, and what the estimate derives.
    ///
    /// # Errors
    /// A held signal has no value there, or the model has states.
    pub fn around(
        &self,
        prepared: &Prepared,
        t: f64,
        quiet: f64,
    ) -> Result<IndexMap<String, Column>> {
        let mut columns = self.columns.clone();
        for name in &prepared.settings.held {
            let Some(one) = self.series.get(name) else { continue };
            let before = one.t_s.iter().zip(&one.value);
            let before = before.filter(|(at, _)| (t - quiet..t).contains(*at));
            let (sum, n) = before.fold((0.0, 0usize), |(sum, n), (_, v)| (sum + v, n + 1));
            if n == 0 {
                return Err(Error::new(format!(
                    "the signal \"{name}\" has no value in the {quiet} s before {t:.1} s"
                )));
            }
            if let Some(column) = columns.get_mut(name) {
                column.values.fill(sum / n as f64);
            }
        }
        if let Some(model) = &prepared.derive {
            add_model(model, &prepared.derived_from, &self.grid, &mut columns)?;
        }
        Ok(columns)
    }
}

/// Rates are those of the signals before any smoothing of these.
fn add_rates(
    settings: &GridSettings,
    grid: &Grid,
    columns: &mut IndexMap<String, Column>,
) -> Result<()> {
    for (name, rate) in &settings.rates {
        let filter = SavitzkyGolay::new(points(rate.window_s, grid.dt), 3, 1, grid.dt)?;
        let Some(column) = columns.get(&rate.of) else { continue };
        let (unit, values) = (Rate::unit(&column.unit), filter.apply(&column.values));
        columns.insert(name.clone(), Column { unit, doc: String::new(), values });
    }
    Ok(())
}

/// The messages of a topic as a log would hold them.
fn recorded<T>(topic: &TopicLog, read: impl FnOnce(Recorded) -> T) -> T {
    let fields: Vec<&str> = topic.fields.iter().map(|f| f.name.as_str()).collect();
    read(Recorded {
        fields: &fields,
        publish_ns: &topic.publish_ns,
        log_ns: &topic.log_ns,
        rows: &topic.rows,
    })
}
