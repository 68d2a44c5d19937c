//! A pipeline file and all files it names come in; a checked campaign, or every mistake in any of
//! them at once, goes out.

mod columns;
mod logs;
mod loose;
mod names;
mod unknown;

use super::settings::Settings;
use super::simulate::Simulation;
use super::store::Store;
use crate::config::{self, Doc};
use crate::diagnose::effect;
use crate::error::{Error, Errors, Result};
use crate::log::ChannelMap;
use crate::model::{Constants, Model};
use crate::segment::Kind;
use crate::stage::{
    Campaign, Channels, Known, STAGES, Told, derive, diagnose, estimate, fit, reconstruct, segment,
};
use columns::Columns;
use std::path::{Path, PathBuf};

pub use logs::FlightLog;

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
        let plan = |(mut settings, doc): (Settings, Doc)| {
            change(&mut settings);
            let folder = pipeline.parent().unwrap_or_else(|| Path::new("")).to_path_buf();
            let pipeline = pipeline.to_path_buf();
            Reader { settings, doc, pipeline, folder, errors: Errors::default() }.plan()
        };
        let mut errors = match config::load(pipeline) {
            Ok(read) => return plan(read),
            Err(errors) => errors,
        };
        let more = match config::load_sound(pipeline) {
            Some(sound) => plan(sound).err().unwrap_or_default(),
            None => loose::mistakes(pipeline),
        };
        errors.0.extend(more.0);
        Err(errors)
    }

    /// The log of a flight.
    pub fn log(&self, flight: &str) -> Result<&FlightLog> {
        self.logs
            .iter()
            .find(|l| l.flight == flight)
            .ok_or_else(|| Error::new(format!("flight {flight} has no log")))
    }

    /// Hash of a flight's log; none where the log is not there.
    pub fn log_hash(&self, store: &Store, flight: &str) -> Result<Option<String>> {
        store.memo.hash(&self.log(flight)?.path)
    }
}

/// Collects the mistakes of all files on the way to a plan.
struct Reader {
    settings: Settings,
    doc: Doc,
    pipeline: PathBuf,
    folder: PathBuf,
    errors: Errors,
}

impl Reader {
    fn plan(mut self) -> std::result::Result<Plan, Errors> {
        let channels = self.channels();
        let aircraft = self.aircraft();
        let simulation = self.simulation();
        let logs = self.logs(simulation.as_ref());
        let flights: Vec<String> = logs.iter().map(|l| l.flight.clone()).collect();
        // A name is a mistake only where nothing that has mistakes could have declared it.
        let mut columns = Columns::of_signals(channels.as_ref());
        let kinematics = self.kinematics(aircraft.as_ref());
        if self.settings.reconstruct.is_some() {
            columns = columns.with_flight_path(kinematics.as_ref());
        }
        let reconstruct = self.reconstruct(kinematics, channels.as_ref());
        let derive = self.derive(aircraft.as_ref(), &columns);
        let columns = match &derive {
            Some(derive) => columns.with_derived(derive),
            None => columns.with_unsure(self.declared()),
        };
        if let Some(channels) = &channels {
            columns.distinct(channels, &self.doc, &mut self.errors);
        }
        let segment = self.segment(&flights, &columns);
        let estimates = self.estimates(aircraft.as_ref(), &columns, channels.as_ref());
        let fits = self.fits(&estimates, &columns);
        let diagnoses = self.diagnoses(&estimates);
        let told = self.told(&flights, &columns);
        let settings = self.settings.fields;
        match (self.errors.is_empty(), channels, derive) {
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
                    fits,
                    diagnoses,
                    told,
                    stages: STAGES,
                },
                simulation: simulation.and_then(|s| s.for_missing(&logs)),
                logs,
            }),
            _ => Err(self.errors),
        }
    }

    /// What the file says under the names of stages, each checked by its stage.
    fn told(&mut self, flights: &[String], columns: &Columns) -> Told {
        let mut told = Told::default();
        for (stage, key) in STAGES.iter().filter_map(|stage| Some((stage, stage.key.as_ref()?))) {
            if let Some(value) = self.settings.told.remove(stage.name) {
                self.errors.take(told.put(stage.name, key, value, &self.doc).map_err(Errors::from));
            }
        }
        let column = |name: &str| columns.unit(name);
        let known = Known { doc: &self.doc, flights, column: &column };
        let found =
            STAGES.iter().flat_map(|stage| (stage.check)(&told, &known).0).collect::<Vec<_>>();
        self.errors.0.extend(found);
        told
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.join(relative)
    }

    /// Files an error at a key of the pipeline file.
    fn push(&mut self, key: &str, what: String, help: &str) {
        let error = self.doc.error(key, what);
        self.errors.push(if help.is_empty() { error } else { error.help(help) });
    }

    /// Reports a file that is not there at the place that names it, which is where the mistake is.
    fn names_a_file(&mut self, key: &str, relative: &str) -> bool {
        let path = self.path(relative);
        let there = path.is_file();
        if !there {
            self.push(
                key,
                format!("there is no file {}", path.display()),
                "paths are relative to the folder of the pipeline file",
            );
        }
        there
    }

    fn channels(&mut self) -> Option<Channels> {
        let name = self.settings.channels.clone();
        if !self.names_a_file("channels", &name) {
            return None;
        }
        let (map, doc) = self.errors.take(config::load::<ChannelMap>(&self.path(&name)))?;
        self.errors.take(map.check(&doc))?;
        Some(Channels { map, doc })
    }

    /// The constants; none where the file has mistakes, empty where the pipeline file names none.
    fn aircraft(&mut self) -> Option<Constants> {
        let Some(name) = self.settings.aircraft.clone() else { return Some(Constants::default()) };
        if !self.names_a_file("aircraft", &name) {
            return None;
        }
        let path = self.path(&name);
        self.errors.take(config::load::<Constants>(&path)).map(|(constants, _)| constants)
    }

    fn simulation(&mut self) -> Option<Simulation> {
        let name = self.settings.simulate.clone()?;
        let path = self.path(&name);
        if Simulation::is_over(&path) || !self.names_a_file("simulate", &name) {
            return None;
        }
        self.errors.take(Simulation::read(&path))
    }

    fn logs(&mut self, simulation: Option<&Simulation>) -> Vec<FlightLog> {
        let found = logs::find(&self.settings, &self.doc, &self.folder, simulation);
        self.errors.take(found).unwrap_or_default()
    }

    fn model(&mut self, key: &str, relative: &str, aircraft: Option<&Constants>) -> Option<Model> {
        if !self.names_a_file(key, relative) {
            return None;
        }
        let path = self.path(relative);
        self.errors.take(Model::load(&path, aircraft?))
    }

    /// The model of `[reconstruct]`; none where it has mistakes.
    fn kinematics(&mut self, aircraft: Option<&Constants>) -> Option<Model> {
        let settings = self.settings.reconstruct.clone()?;
        match &settings.model {
            Some(file) => self.model("reconstruct.model", file, aircraft),
            None => self.errors.take(settings.embedded(aircraft?, &self.doc)),
        }
    }

    fn reconstruct(
        &mut self,
        kinematics: Option<Model>,
        channels: Option<&Channels>,
    ) -> Option<reconstruct::Config> {
        let settings = self.settings.reconstruct.clone()?;
        let checked = reconstruct::Config::new(settings, kinematics?, channels?, &self.doc);
        self.errors.take(checked)
    }

    fn derive(
        &mut self,
        aircraft: Option<&Constants>,
        columns: &Columns,
    ) -> Option<derive::Config> {
        let settings = self.settings.derive.clone();
        if !(settings.rate_hz > 0.0 && settings.rate_hz.is_finite()) {
            self.push(
                "derive.rate_hz",
                format!(
                    "the rate of the grid is a positive number of Hz, not {}",
                    settings.rate_hz
                ),
                "",
            );
        }
        for (name, window) in &settings.smooth {
            let key = format!("derive.smooth.{name}");
            if !(*window > 0.0 && *window <= 3600.0) {
                self.push(
                    &key,
                    format!("a signal is smoothed over a positive number of seconds, not {window}"),
                    "",
                );
            }
            columns.look_up(name, "signal or column", &self.doc, &key, &mut self.errors);
        }
        let model = match &settings.model {
            Some(file) => {
                let model = self.model("derive.model", &file.clone(), aircraft)?;
                if !model.states.is_empty() {
                    self.push(
                        "derive.model",
                        "the model of [derive] has states".to_string(),
                        "only a model without states can be evaluated sample by sample",
                    );
                }
                Some(model)
            }
            None => None,
        };
        let inputs = match &model {
            Some(model) => names::drivers(
                model,
                &settings.inputs,
                columns,
                &self.doc,
                "derive.inputs",
                &mut self.errors,
            ),
            None => Vec::new(),
        };
        Some(derive::Config { settings, model, inputs })
    }

    /// The columns that the model of `[derive]` is meant to make.
    fn declared(&self) -> Option<Vec<String>> {
        Model::declared_outputs(&self.path(self.settings.derive.model.as_ref()?))
    }

    fn segment(&mut self, flights: &[String], columns: &Columns) -> Option<segment::Config> {
        let settings = self.settings.segment.clone()?;
        let edits = self.doc.place("segment.edits");
        self.errors.0.extend(segment::check(&settings, flights, &edits).0);
        for (i, input) in settings.input.iter().enumerate() {
            let key = format!("segment.input.{i}.signal");
            columns.look_up(&input.signal, "signal or column", &self.doc, &key, &mut self.errors);
        }
        Some(segment::Config { settings, edits })
    }

    /// One entry per `[[estimate]]`, so that fits find theirs; none where its model has mistakes.
    fn estimates(
        &mut self,
        aircraft: Option<&Constants>,
        columns: &Columns,
        channels: Option<&Channels>,
    ) -> Vec<Option<estimate::Config>> {
        let all = self.settings.estimate.clone();
        let mut names: Vec<String> = Vec::new();
        let mut checked = Vec::new();
        for (i, settings) in all.into_iter().enumerate() {
            let key = format!("estimate.{i}");
            self.new_name(&key, &settings.name(), &mut names);
            checked.push(self.estimate(&key, settings, aircraft, columns, channels));
        }
        checked
    }

    fn estimate(
        &mut self,
        key: &str,
        settings: estimate::Settings,
        aircraft: Option<&Constants>,
        columns: &Columns,
        channels: Option<&Channels>,
    ) -> Option<estimate::Config> {
        let inputs: Vec<&str> =
            self.settings.segment.iter().flat_map(|s| s.input.iter().map(|i| i.name())).collect();
        for input in settings
            .input
            .iter()
            .flat_map(estimate::Used::names)
            .filter(|input| !inputs.contains(&input.as_str()))
        {
            let error = unknown::unknown(
                &self.doc,
                &format!("{key}.input"),
                "[[segment.input]]",
                input,
                &inputs,
            );
            self.errors.push(error);
        }
        if settings.alone && settings.input.is_none() {
            self.push(
                &format!("{key}.alone"),
                "`alone` belongs to `input`, which is missing".to_string(),
                "",
            );
        }
        let kinds = Kind::ALL.map(Kind::name);
        for (i, kind) in
            settings.kinds.iter().enumerate().filter(|(_, kind)| !kinds.contains(&kind.as_str()))
        {
            let error = unknown::unknown(
                &self.doc,
                &format!("{key}.kinds.{i}"),
                "kind of maneuver",
                kind,
                &kinds,
            );
            self.errors.push(error);
        }
        let times = [
            ("pre_s", settings.pre_s),
            ("post_s", settings.post_s),
            ("preroll_s", settings.preroll_s),
            ("settle_s", settings.settle_s),
        ];
        for (name, value) in times {
            if !(value >= 0.0 && value.is_finite()) {
                self.push(
                    &format!("{key}.{name}"),
                    format!("{name} is a time of zero or more seconds, not {value}"),
                    "",
                );
            }
        }
        let model = self.model(&format!("{key}.model"), &settings.model, aircraft)?;
        let inputs = names::inputs(&model, &settings, columns, &self.doc, key, &mut self.errors);
        let outputs = names::outputs(&model, &settings, columns, &self.doc, key, &mut self.errors);
        if let Some(channels) = channels {
            names::itself(
                &model,
                (&inputs, &outputs),
                columns,
                channels,
                &self.doc,
                key,
                &mut self.errors,
            );
        }
        names::levels(&settings, columns, &self.doc, key, &mut self.errors);
        match crate::estimate::extended(&model, &settings.method) {
            Ok(extended) => names::method(&extended, &settings, &self.doc, key, &mut self.errors),
            Err(errors) => self.errors.0.extend(
                errors.0.into_iter().map(|e| names::placed(&self.doc, &format!("{key}.method"), e)),
            ),
        }
        Some(estimate::Config { settings, model, inputs, outputs })
    }

    fn fits(
        &mut self,
        estimates: &[Option<estimate::Config>],
        columns: &Columns,
    ) -> Vec<fit::Config> {
        let all = self.settings.fit.clone();
        let mut names: Vec<String> = Vec::new();
        let mut checked = Vec::new();
        for (i, settings) in all.into_iter().enumerate() {
            let key = format!("fit.{i}");
            self.new_name(&key, &settings.name(), &mut names);
            checked.extend(self.fit(&key, settings, estimates, columns));
        }
        checked
    }

    fn fit(
        &mut self,
        key: &str,
        settings: fit::Settings,
        estimates: &[Option<estimate::Config>],
        columns: &Columns,
    ) -> Option<fit::Config> {
        let names: Vec<String> =
            self.settings.estimate.iter().map(estimate::Settings::name).collect();
        let Some(index) = names.iter().position(|name| *name == settings.estimate) else {
            let error = unknown::unknown(
                &self.doc,
                &format!("{key}.estimate"),
                "[[estimate]]",
                &settings.estimate,
                &names,
            );
            self.errors.push(error);
            return None;
        };
        if !(settings.level > 0.0 && settings.level < 1.0) {
            self.push(
                &format!("{key}.level"),
                format!("a confidence level is between 0 and 1, not {}", settings.level),
                "95% is 0.95",
            );
        }
        let unit_x = columns.look_up(
            &settings.against,
            "column",
            &self.doc,
            &format!("{key}.against"),
            &mut self.errors,
        );
        let estimate = estimates.get(index)?.as_ref()?;
        if estimate.settings.group != estimate::Group::Segment || estimate.settings.input.is_none()
        {
            self.push(
                &format!("{key}.estimate"),
                format!("estimate \"{}\" does not give one estimate per maneuver", settings.estimate),
                "a line goes through estimates per maneuver: give it `input`, and group = \"segment\"",
            );
        }
        let mut units = Vec::new();
        for (i, name) in settings.parameters.iter().enumerate() {
            let known: Vec<&str> =
                estimate.model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
            match estimate.model.parameters.iter().find(|p| p.quantity.name == *name) {
                Some(parameter) => units.push(parameter.quantity.unit.clone()),
                None => {
                    let error = unknown::unknown(
                        &self.doc,
                        &format!("{key}.parameters.{i}"),
                        "parameter of the model",
                        name,
                        &known,
                    );
                    self.errors.push(error);
                }
            }
        }
        let complete = units.len() == settings.parameters.len();
        complete.then_some(fit::Config { settings, estimate: index, units, unit_x: unit_x? })
    }

    fn diagnoses(&mut self, estimates: &[Option<estimate::Config>]) -> Vec<diagnose::Config> {
        let all = self.settings.diagnose.clone();
        let mut names: Vec<String> = Vec::new();
        let mut checked = Vec::new();
        for (i, settings) in all.into_iter().enumerate() {
            let key = format!("diagnose.{i}");
            self.new_name(&key, &settings.name(), &mut names);
            checked.extend(self.diagnosis(&key, settings, estimates));
        }
        checked
    }

    fn diagnosis(
        &mut self,
        key: &str,
        settings: diagnose::Settings,
        estimates: &[Option<estimate::Config>],
    ) -> Option<diagnose::Config> {
        for (name, what) in settings.method.faults() {
            self.push(&format!("{key}.method.{name}"), what, "");
        }
        let names: Vec<String> =
            self.settings.estimate.iter().map(estimate::Settings::name).collect();
        let Some(index) = names.iter().position(|name| *name == settings.estimate) else {
            let error = unknown::unknown(
                &self.doc,
                &format!("{key}.estimate"),
                "[[estimate]]",
                &settings.estimate,
                &names,
            );
            self.errors.push(error);
            return None;
        };
        let folders: Vec<PathBuf> =
            settings.effects.iter().map(|folder| self.path(folder)).collect();
        for (i, folder) in folders.iter().enumerate().filter(|(_, folder)| !folder.is_dir()) {
            self.push(
                &format!("{key}.effects.{i}"),
                format!("there is no folder {}", folder.display()),
                "",
            );
        }
        let folders: Vec<&Path> =
            folders.iter().map(PathBuf::as_path).filter(|folder| folder.is_dir()).collect();
        let effects = self.errors.take(effect::load(&folders))?;
        let base = estimates.get(index)?.as_ref()?;
        self.roles(key, &settings, &base.model);
        Some(diagnose::Config { settings, estimate: index, effects })
    }

    /// Checks that roles are roles, and what plays them is in the model.
    fn roles(&mut self, key: &str, settings: &diagnose::Settings, model: &Model) {
        let known: Vec<String> =
            effect::roles::names().iter().map(|name| name.to_string()).collect();
        for (role, players) in &settings.roles {
            if !effect::roles::exists(role) {
                let error = unknown::unknown(
                    &self.doc,
                    &format!("{key}.roles.{role}"),
                    "role",
                    role,
                    &known,
                );
                self.errors.push(error);
            }
            for (i, name) in
                players.iter().enumerate().filter(|(_, name)| !effect::roles::is_of(model, name))
            {
                let what = format!(
                    "\"{name}\" is nothing of the model that could play the role \"{role}\""
                );
                self.push(
                    &format!("{key}.roles.{role}.{i}"),
                    what,
                    "give an input, a state, an equation, a constant, or output(name)",
                );
            }
        }
    }

    /// Checks that a name is new and safe in a file's name.
    fn new_name(&mut self, key: &str, name: &str, names: &mut Vec<String>) {
        let clean = !name.is_empty()
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))
            && !name.starts_with('.');
        if !clean {
            self.push(
                &format!("{key}.name"),
                format!("\"{name}\" is no name"),
                "use letters, digits, '.', '_' and '-'",
            );
        }
        if names.iter().any(|n| n == name) {
            self.push(
                &format!("{key}.name"),
                format!("the name \"{name}\" is taken"),
                "give it another `name`",
            );
        }
        names.push(name.to_string());
    }
}
