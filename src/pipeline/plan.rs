//! A pipeline file and all files it names come in; a checked campaign, or every mistake in any of
//! them at once, goes out.

mod aircraft;
mod flights;
mod logs;
mod loose;
mod once;
mod summaries;
mod twins;

use super::provenance::hash_bytes;
use super::settings::Settings;
use super::simulate::Simulation;
use crate::config::{self, Doc};
use crate::error::Errors;
use crate::log::ChannelMap;
use crate::model::{Constants, Model};
use crate::stage::check::{Columns, Given};
use crate::stage::{
    Campaign, Channels, Known, Named, STAGES, Told, derive, estimate, fit, reconstruct, segment,
};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

pub use aircraft::{Source, lacking};
pub use logs::FlightLog;
pub use summaries::Summaries;

/// A checked campaign, ready to run.
#[derive(Debug)]
pub struct Plan {
    /// The pipeline file.
    pub pipeline: PathBuf,
    pub campaign: Campaign,
    /// The logs, in the order of the campaign's flights.
    pub logs: Vec<FlightLog>,
    /// The simulation that makes logs which are not there yet; none where all are there.
    pub simulation: Option<Simulation>,
    /// What is said under the names of stages, as the command that runs the plan has changed it.
    pub told: BTreeMap<String, Value>,
    /// The pipelines whose results it takes, in the order of the file.
    pub sources: Vec<Source>,
    /// Every configuration file that was read for it, with the hash of its text.
    pub files: BTreeMap<PathBuf, String>,
    /// Flights whose logs are those of others, once somebody asks.
    twins: OnceLock<BTreeMap<String, String>>,
}

impl Plan {
    /// Reads and checks everything that a person wrote; reads no log.
    ///
    /// # Errors
    /// Every mistake in any of the files.
    pub fn read(pipeline: &Path) -> std::result::Result<Plan, Errors> {
        Plan::read_with(pipeline, |_| {})
    }

    /// The same, with settings changed by the command before they are checked.
    ///
    /// # Errors
    /// As `read`.
    pub fn read_with(
        pipeline: &Path,
        change: impl FnOnce(&mut Settings),
    ) -> std::result::Result<Plan, Errors> {
        let (plan, texts) = config::watched(|| Plan::read_in(pipeline, &[], change));
        let mut plan = plan?;
        plan.files =
            texts.into_iter().map(|(path, text)| (path, hash_bytes(text.as_bytes()))).collect();
        Ok(plan)
    }

    /// The same for the pipelines in `chain`, which take its results.
    fn read_in(
        pipeline: &Path,
        chain: &[PathBuf],
        change: impl FnOnce(&mut Settings),
    ) -> std::result::Result<Plan, Errors> {
        let plan = |(mut settings, doc): (Settings, Doc)| {
            change(&mut settings);
            let folder = pipeline.parent().unwrap_or_else(|| Path::new("")).to_path_buf();
            let given = Given::new(doc, folder);
            let chain = [chain, &[aircraft::canonical(pipeline)]].concat();
            Reader { settings, pipeline: pipeline.to_path_buf(), given, chain }.plan()
        };
        let mut errors = match config::load(pipeline) {
            Ok(read) => return plan(read).map_err(once::once),
            Err(errors) => errors,
        };
        let more = match config::load_sound(pipeline) {
            Some(sound) => plan(sound).err().unwrap_or_default(),
            None => loose::mistakes(pipeline),
        };
        errors.0.extend(more.0);
        Err(once::once(errors))
    }

    /// What its logs say at their ends against its channel map.
    pub fn summaries(&self) -> Summaries {
        summaries::summaries(&self.campaign.channels, &self.logs)
    }
}

/// Collects the mistakes of all files on the way to a plan.
struct Reader {
    settings: Settings,
    pipeline: PathBuf,
    given: Given,
    /// This file behind those that take its results.
    chain: Vec<PathBuf>,
}

impl Reader {
    fn plan(mut self) -> std::result::Result<Plan, Errors> {
        let channels = self.channels();
        let sources = self.aircraft();
        let so_far = self.given.errors.0.len();
        let simulation = self.simulation();
        // A campaign file with mistakes may have been meant to make any log.
        let unsure = self.given.errors.0.len() > so_far;
        let logs = self.logs(simulation.as_ref(), unsure);
        let known = if unsure { &[] } else { &logs[..] };
        let flights: Vec<String> = known.iter().map(|l| l.flight.clone()).collect();
        // A name is a mistake only where nothing that has mistakes could have declared it.
        let mut columns = Columns::of_signals(channels.as_ref());
        let kinematics = self.kinematics();
        if self.settings.reconstruct.is_some() {
            columns = columns.with_flight_path(kinematics.as_ref());
        }
        let mut columns =
            columns.with_unsure(Some(self.lacking(kinematics.as_ref(), channels.as_ref())));
        let reconstruct = self.reconstruct(kinematics, channels.as_ref());
        let derive = self.settings.fields.derive.clone();
        let derive = derive::Config::read(derive, &mut self.given, &mut columns);
        let columns = match &derive {
            Some(derive) => columns.with_derived(derive.model.as_ref()),
            None => columns.with_unsure(self.declared()),
        };
        if let Some(channels) = &channels {
            columns.distinct(channels, &self.given.doc, &mut self.given.errors);
        }
        let segment = self.settings.fields.segment.clone();
        let segment =
            segment.map(|s| segment::Config::read(s, &mut self.given, &flights, &columns));
        let inputs = self.settings.segment.iter().flat_map(|s| &s.input);
        let searched: Vec<String> = inputs.map(|i| i.name().to_string()).collect();
        let estimates = self.estimates((&searched, &flights), &columns, channels.as_ref());
        let names = &self.settings.fields.estimate;
        let names: Vec<String> = names.iter().map(estimate::Settings::name).collect();
        let fits = self.fits((&names, &estimates), &columns);
        let fit_names: Vec<String> =
            self.settings.fields.fit.iter().map(fit::Settings::name).collect();
        let said = self.settings.told.clone();
        let told = self.told(&mut |given| Known {
            given,
            flights: &flights,
            columns: &columns,
            channels: channels.as_ref(),
            searched: &searched,
            estimates: Named { names: &names, checked: &estimates },
            fits: Named { names: &fit_names, checked: &fits },
            tables: tables(),
        });
        let settings = self.settings.fields;
        let simulation = simulation.and_then(|s| s.for_flights(&flights));
        match (self.given.errors.is_empty(), channels, derive) {
            (true, Some(channels), Some(derive)) => Ok(Plan {
                pipeline: self.pipeline,
                campaign: Campaign {
                    title: settings.title,
                    flights,
                    channels,
                    reconstruct,
                    derive,
                    segment,
                    estimates: estimates.into_iter().flatten().collect(),
                    fits: fits.into_iter().flatten().collect(),
                    told,
                    stages: STAGES,
                    written: OnceLock::new(),
                },
                told: said,
                files: BTreeMap::new(),
                twins: OnceLock::new(),
                sources,
                simulation,
                logs,
            }),
            (_, channels, _) => {
                // What no log agrees with is a mistake of the channel map as well.
                let seen = channels.map(|channels| summaries::summaries(&channels, &logs));
                let hopeless = seen.filter(Summaries::hopeless);
                self.given.errors.0.extend(logs::missing(&logs).0);
                self.given.errors.0.extend(hopeless.into_iter().flat_map(|seen| seen.mistakes.0));
                Err(self.given.errors)
            }
        }
    }

    /// What the file says under the names of stages, each checked by its stage.
    fn told<'a>(&'a mut self, known: &mut dyn FnMut(&'a mut Given) -> Known<'a>) -> Told {
        let mut told = Told::default();
        for (stage, key) in STAGES.iter().filter_map(|stage| Some((stage, stage.key.as_ref()?))) {
            if let Some(value) = self.settings.told.remove(stage.name) {
                self.given
                    .errors
                    .take(told.put(stage.name, key, value, &self.given.doc).map_err(Errors::from));
            }
        }
        let mut known = known(&mut self.given);
        STAGES.iter().for_each(|stage| (stage.check)(&mut told, &mut known));
        told
    }

    fn channels(&mut self) -> Option<Channels> {
        let name = self.settings.channels.clone();
        if !self.given.names_a_file("channels", &name) {
            return None;
        }
        let path = self.given.path(&name);
        let (map, doc) = match config::load::<ChannelMap>(&path) {
            Ok(read) => read,
            Err(errors) => {
                self.given.errors.0.extend(errors.0);
                config::load_sound(&path)?
            }
        };
        // Names are known all the same; a signal whose unit has a mistake has none.
        self.given.errors.take(map.check(&doc));
        Some(Channels { map, doc })
    }

    /// Reads the constants, and says which other pipelines they come from.
    fn aircraft(&mut self) -> Vec<Source> {
        let Some(said) = self.settings.aircraft.clone() else {
            self.given.aircraft = Some(Constants::default());
            return Vec::new();
        };
        let estimates =
            |path: &Path| Plan::read_in(path, &self.chain, |_| {}).map(|p| p.campaign.estimates);
        let (constants, sources) = aircraft::read(&mut self.given, &said, &self.chain, &estimates);
        self.given.aircraft = constants;
        sources
    }

    fn simulation(&mut self) -> Option<Simulation> {
        let name = self.settings.simulate.clone()?;
        let path = self.given.path(&name);
        if Simulation::is_over(&path) || !self.given.names_a_file("simulate", &name) {
            return None;
        }
        self.given.errors.take(Simulation::read(&path))
    }

    fn logs(&mut self, simulation: Option<&Simulation>, unsure: bool) -> Vec<FlightLog> {
        let (doc, folder) = (&self.given.doc, &self.given.folder);
        let made = if unsure { logs::Made::Unsure } else { logs::Made::By(simulation) };
        let found = logs::find(&self.settings, doc, folder, made);
        self.given.errors.take(found).unwrap_or_default()
    }

    /// The model of `[reconstruct]`; none where it has mistakes.
    fn kinematics(&mut self) -> Option<Model> {
        let settings = self.settings.reconstruct.clone()?;
        match &settings.model {
            Some(file) => self.given.model("reconstruct.model", file),
            None => {
                let model = settings.embedded(self.given.aircraft.as_ref()?, &self.given.doc);
                self.given.errors.take(model)
            }
        }
    }

    /// The signals that the kinematic model is driven by and that there are not: where they are
    /// missed as well, it is the same mistake.
    fn lacking(&self, kinematics: Option<&Model>, channels: Option<&Channels>) -> Vec<String> {
        let (Some(settings), Some(model), Some(channels)) =
            (&self.settings.reconstruct, kinematics, channels)
        else {
            return Vec::new();
        };
        let signals = &settings.method.signals;
        let names = model.inputs.iter().map(|i| signals.get(&i.name).unwrap_or(&i.name));
        names.filter(|name| !channels.map.signal.contains_key(*name)).cloned().collect()
    }

    fn reconstruct(
        &mut self,
        kinematics: Option<Model>,
        channels: Option<&Channels>,
    ) -> Option<reconstruct::Config> {
        let settings = self.settings.reconstruct.clone()?;
        let checked = reconstruct::Config::new(settings, kinematics?, channels?, &self.given.doc);
        self.given.errors.take(checked)
    }

    /// The columns that the model of `[derive]` is meant to make.
    fn declared(&self) -> Option<Vec<String>> {
        Model::declared_outputs(&self.given.path(self.settings.derive.model.as_ref()?))
    }

    /// One entry per `[[estimate]]`, so that fits find theirs; none where its model has mistakes.
    fn estimates(
        &mut self,
        known: (&[String], &[String]),
        columns: &Columns,
        channels: Option<&Channels>,
    ) -> Vec<Option<estimate::Config>> {
        let read = |given: &mut Given, key: &str, settings| {
            estimate::Config::read(settings, (given, key), known, columns, channels)
        };
        self.given.entries(
            "estimate",
            self.settings.fields.estimate.clone(),
            estimate::Settings::name,
            read,
        )
    }

    fn fits(
        &mut self,
        estimates: (&[String], &[Option<estimate::Config>]),
        columns: &Columns,
    ) -> Vec<Option<fit::Config>> {
        let read = |given: &mut Given, key: &str, settings| {
            fit::Config::read(settings, (given, key), estimates, columns)
        };
        let all = self.settings.fields.fit.clone();
        self.given.entries("fit", all, fit::Settings::name, read)
    }
}

/// Names of the tables that stages write, each once.
fn tables() -> Vec<&'static str> {
    let mut all: Vec<&str> = STAGES.iter().flat_map(|stage| stage.writes).copied().collect();
    all.sort_unstable();
    all.dedup();
    all
}
