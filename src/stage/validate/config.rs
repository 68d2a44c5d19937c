//! `[[validate]]` of the pipeline file comes in; its checked settings, with where every value comes
//! from, or the mistakes, go out.

use super::settings::{NAME, Settings};
use super::source::{self, Source};
use super::tolerances::{self, Checked};
use crate::stage::check::Given;
use crate::stage::estimate;
use crate::stage::kind::Known;
use crate::stage::told::Told;

/// The checked settings of one validation.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Place of the estimate in the list of estimates.
    pub estimate: usize,
    /// Places of the fits in the list of fits.
    pub lines: Vec<usize>,
    /// The model, what drives and measures it, and which maneuvers it is run through.
    pub run: estimate::Config,
    /// Where each parameter that is not fixed by the model's file has its value from.
    pub sources: Vec<(String, Source)>,
    /// What the maneuvers are judged by.
    pub tolerances: Vec<Checked>,
}

/// Checks all `[[validate]]` and keeps what can be run.
pub fn check(told: &mut Told, known: &mut Known) {
    let Some(all) = told.get::<Vec<Settings>>(NAME).cloned() else { return };
    let Known { given, flights, columns, channels, searched, estimates, fits, .. } = known;
    let checked = given.entries(NAME, all, Settings::name, |given, key, s| {
        let Some(index) = estimates.names.iter().position(|name| *name == s.estimate) else {
            let key = format!("{key}.estimate");
            given.unknown(&key, "[[estimate]]", &s.estimate, estimates.names);
            return None;
        };
        let lines: Vec<usize> = s
            .lines
            .iter()
            .enumerate()
            .filter_map(|(i, name)| {
                let place = fits.names.iter().position(|known| known == name);
                if place.is_none() {
                    given.unknown(&format!("{key}.lines.{i}"), "[[fit]]", name, fits.names);
                }
                place
            })
            .collect();
        let base = estimates.checked.get(index)?.as_ref()?;
        let run = s.run(&base.settings);
        let run =
            estimate::Config::read(run, (given, key), (searched, flights), columns, *channels)?;
        let fits: Option<Vec<_>> =
            lines.iter().map(|&i| Some((i, fits.checked.get(i)?.as_ref()?))).collect();
        if lines.len() < s.lines.len() {
            return None;
        }
        bands((given, key), &s, &run);
        let scored: Vec<_> =
            run.outputs.iter().filter_map(|s| run.model.outputs.get(s.output)).cloned().collect();
        let tolerances = tolerances::check((given, key), &s, &scored, (columns, searched));
        let sources = source::find((given, key), &s, base, &fits?, &run.model)?;
        Some(Config { settings: s, estimate: index, lines, run, sources, tolerances })
    });
    told.keep(NAME, checked.into_iter().flatten().collect::<Vec<Config>>());
}

/// Checks that bands are those of scored outputs, given by outputs in the same unit.
fn bands((given, key): (&mut Given, &str), settings: &Settings, run: &estimate::Config) {
    let outputs = &run.model.outputs;
    let names: Vec<&str> = outputs.iter().map(|o| o.name.as_str()).collect();
    for (output, band) in &settings.band {
        let key = format!("{key}.band.{output}");
        let find = |name: &String| outputs.iter().find(|o| o.name == *name);
        match (find(output), find(band)) {
            (Some(one), Some(half)) if crate::stage::check::agree(&one.unit, &half.unit) => {}
            (Some(one), Some(half)) => given.push(
                &key,
                format!("\"{output}\" is in {}, its band \"{band}\" in {}", one.unit, half.unit),
                "",
            ),
            (None, _) => given.unknown(&key, "output of the model", output, &names),
            (_, None) => given.unknown(&key, "output of the model", band, &names),
        }
    }
}
