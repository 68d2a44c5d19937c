//! The study file in; the study with the truth, the sensors and the models that it names, or every
//! mistake in any of them, out.

use super::check;
use super::prepared::Prepared;
use super::rows::{Design, expand};
use super::settings::{Rate, Settings};
use crate::config::{self, Doc};
use crate::error::{Error, Errors};
use crate::log::ChannelMap;
use crate::model::{Constants, Model};
use crate::simulate::{Campaign, Flight};
use crate::stage::Channels;
use crate::stage::check::Columns;
use std::path::{Path, PathBuf};

/// A checked study, ready to be flown.
#[derive(Debug)]
pub struct Study {
    /// What the file says.
    pub settings: Settings,
    /// Where its keys stand.
    pub doc: Doc,
    /// The truth and its sensors; the flights are those of `flying`.
    pub campaign: Campaign,
    /// Which topic and field is which signal.
    pub channels: Channels,
    /// The designs, in the order of the file.
    pub designs: Vec<Design>,
    /// The estimates, in the order of the file.
    pub estimates: Vec<Prepared>,
}

impl Study {
    /// Reads a study file and all that it names.
    ///
    /// # Errors
    /// Every mistake in any of the files.
    pub fn load(path: &Path) -> Result<Study, Errors> {
        let (settings, doc) = config::load::<Settings>(path)?;
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let mut reader =
            Reader { settings: &settings, doc: &doc, folder, errors: Errors::default() };
        let campaign = reader.campaign();
        let channels = reader.channels();
        let constants = reader.constants();
        let designs = expand(&settings.row, &settings.input);
        reader.errors.0.extend(check::designs(&settings, &designs, &doc).0);
        if let Some(campaign) = &campaign {
            reader.errors.0.extend(check::against_truth(&settings, campaign, &doc).0);
        }
        if let (Some(campaign), Some(channels)) = (&campaign, &channels) {
            reader.errors.0.extend(check::recorded(&settings, campaign, channels, &doc).0);
        }
        let columns = reader.columns(channels.as_ref());
        let estimates = reader.estimates(constants.as_ref(), channels.as_ref(), &columns);
        reader.errors.0.extend(check::true_values(&settings, &estimates, &doc).0);
        reader.errors.0.extend(check::search(&settings, &doc).0);
        let errors = reader.errors;
        let (Some(campaign), Some(channels)) = (campaign, channels) else { return Err(errors) };
        errors.or(())?;
        Ok(Study { settings, doc, campaign, channels, designs, estimates })
    }

    /// The campaign with one flight per design, of the design's name, at the study's test point.
    pub fn flying(&self, designs: &[Design]) -> Campaign {
        let (settings, mut own) = (&self.settings, self.campaign.settings.clone());
        own.flights.clear();
        for design in designs {
            own.maneuvers.insert(design.name.clone(), design.maneuver.clone());
            let flight = Flight {
                altitude_ft: Some(settings.altitude_ft),
                speeds_kt: vec![settings.speed_kt],
                at_each: vec![design.name.clone(); design.repeats as usize],
                turbulence: settings.turbulence,
                ..Flight::default()
            };
            own.flights.insert(design.name.clone(), flight);
        }
        Campaign::new(own, self.campaign.folder.clone(), self.campaign.model.clone())
    }

    /// What went wrong with a design, at the place of the entry that it comes from.
    pub fn about(&self, design: &Design, error: Error) -> Error {
        Error {
            place: Some(self.doc.place(&design.key)),
            what: format!("design {} ({}): {}", design.name, design.words(), error.what),
            ..error
        }
    }
}

/// Reads what the study file names and files the mistakes.
struct Reader<'a> {
    settings: &'a Settings,
    doc: &'a Doc,
    folder: PathBuf,
    errors: Errors,
}

impl Reader<'_> {
    /// The path of a file that a key names; the mistake is there if there is none.
    fn path(&mut self, key: &str, relative: &str) -> Option<PathBuf> {
        let path = self.folder.join(relative);
        if path.is_file() {
            return Some(path);
        }
        let what = format!("there is no file {}", path.display());
        let help = "paths are relative to the folder of the study file";
        self.errors.push(self.doc.error(key, what).help(help));
        None
    }

    fn campaign(&mut self) -> Option<Campaign> {
        let path = self.path("campaign", &self.settings.campaign)?;
        self.errors.take(Campaign::load_with(&path, &self.settings.truth))
    }

    fn channels(&mut self) -> Option<Channels> {
        let path = self.path("channels", &self.settings.channels)?;
        let (map, doc) = self.errors.take(config::load::<ChannelMap>(&path))?;
        self.errors.take(map.check(&doc))?;
        Some(Channels { map, doc })
    }

    fn constants(&mut self) -> Option<Constants> {
        let mut all = Some(Constants::default());
        for (i, file) in self.settings.constants.iter().enumerate() {
            let read = self.path(&format!("constants.{i}"), file);
            let read = read.and_then(|path| self.errors.take(config::load::<Constants>(&path)));
            match (read, &mut all) {
                (Some((more, _)), Some(all)) => all.0.extend(more.0),
                _ => all = None,
            }
        }
        all
    }

    /// Signals and their rates.
    fn columns(&mut self, channels: Option<&Channels>) -> Columns {
        let mut columns = Columns::of_signals(channels);
        let grid = &self.settings.grid;
        for (name, window) in &grid.smooth {
            let key = format!("grid.smooth.{name}");
            columns.look_up(name, "signal", self.doc, &key, &mut self.errors);
            if !(*window > 0.0 && *window <= 3600.0) {
                let what =
                    format!("a signal is smoothed over a positive number of seconds, not {window}");
                self.errors.push(self.doc.error(&key, what));
            }
        }
        let mut rates = Vec::new();
        for (name, rate) in &grid.rates {
            let key = format!("grid.rates.{name}.of");
            let unit = columns.look_up(&rate.of, "signal", self.doc, &key, &mut self.errors);
            rates.push((name, Rate::unit(&unit.unwrap_or_default())));
        }
        rates.into_iter().for_each(|(name, unit)| columns.put(name, &unit));
        columns
    }

    fn estimates(
        &mut self,
        constants: Option<&Constants>,
        channels: Option<&Channels>,
        columns: &Columns,
    ) -> Vec<Prepared> {
        if self.settings.estimate.is_empty() {
            let help = "add one: [estimate.linear]";
            self.errors.push(self.doc.error("estimate", "the study has no estimate").help(help));
        }
        let mut prepared = Vec::new();
        for (name, settings) in &self.settings.estimate {
            let key = format!("estimate.{name}");
            let model = self.model(&format!("{key}.model"), &settings.model, constants);
            let derive = settings
                .derive
                .as_ref()
                .map(|file| self.model(&format!("{key}.derive"), file, constants));
            // Nothing can be said about the names where a model has mistakes of its own.
            let (Some(model), Some(channels), Some(derive)) =
                (model, channels, derive.map_or(Some(None), |read| read.map(Some)))
            else {
                continue;
            };
            let parts = (self.doc, columns, channels);
            prepared.push(check::estimate(
                parts,
                name,
                settings,
                (model, derive),
                &mut self.errors,
            ));
        }
        prepared
    }

    fn model(&mut self, key: &str, file: &str, constants: Option<&Constants>) -> Option<Model> {
        let path = self.path(key, file)?;
        let model = self.errors.take(Model::load(&path, constants?))?;
        self.errors.take(model.without_noise("a study"))?;
        Some(model)
    }
}
