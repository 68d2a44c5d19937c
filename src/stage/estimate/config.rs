//! An `[[estimate]]` of the pipeline file comes in; its checked settings, with what drives the model
//! and what measures its outputs, or the mistakes, go out.

use super::method;
use super::names::{self, Driver, Scored};
use super::settings::{Settings, Used};
use crate::model::Model;
use crate::segment::Kind;
use crate::stage::channels::Channels;
use crate::stage::check::{Columns, Given, placed};
use crate::stage::notes::{Note, Severity};

/// The stage's name, and its key in the pipeline file.
pub const NAME: &str = "estimate";

/// Shortest segment that a record is cut into, s: no motion is seen in less.
const SHORTEST_WINDOW: f64 = 0.1;

/// The checked settings of one estimate.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    pub model: Model,
    /// Column of the samples table, or of the conditions, for each input of the model.
    pub inputs: Vec<Driver>,
    /// What measures the outputs that are scored.
    pub outputs: Vec<Scored>,
}

impl Config {
    pub fn name(&self) -> String {
        self.settings.name()
    }

    /// Whether no estimation is from maneuvers of several flights: then every flight is estimated by
    /// itself. Whole records are not, as they may be cut.
    pub fn is_by_flight(&self) -> bool {
        self.settings.group != super::settings::Group::All && self.settings.input.is_some()
    }

    /// A note of this estimate, which it names.
    pub fn note(
        &self,
        flight: &str,
        severity: Severity,
        subject: String,
        count: usize,
        text: String,
    ) -> Note {
        let name = self.name();
        let is_of_word = |c: char| c.is_alphanumeric() || "_-.".contains(c);
        let mut words = text.split(|c| !is_of_word(c)).map(|word| word.trim_end_matches('.'));
        let text = if words.any(|word| word == name) { text } else { format!("{name}: {text}") };
        Note {
            flight: flight.to_string(),
            stage: NAME.to_string(),
            severity,
            subject,
            count: count as u64,
            text,
        }
    }

    /// Columns of the samples table that drive the model.
    pub fn columns(&self) -> Vec<String> {
        self.inputs
            .iter()
            .filter_map(|d| if let Driver::Column(name) = d { Some(name.clone()) } else { None })
            .collect()
    }

    /// Checks the settings of one estimate, which stand at `key`, against its model, the inputs in
    /// which maneuvers are searched, the flights, the columns and the channel map; none where they have mistakes
    /// that leave nothing to hold others against.
    pub fn read(
        settings: Settings,
        (given, key): (&mut Given, &str),
        (searched, flights): (&[String], &[String]),
        columns: &Columns,
        channels: Option<&Channels>,
    ) -> Option<Config> {
        for input in
            settings.input.iter().flat_map(Used::names).filter(|input| !searched.contains(input))
        {
            given.unknown(&format!("{key}.input"), "[[segment.input]]", input, searched);
        }
        if settings.alone && settings.input.is_none() {
            given.push(&format!("{key}.alone"), "`alone` belongs to `input`, which is missing", "");
        }
        if settings.window_s != 0.0 && settings.input.is_some() {
            given.push(
                &format!("{key}.window_s"),
                "`window_s` cuts whole records, and this estimate takes maneuvers by `input`",
                "leave one of them out; `pre_s` and `post_s` say how long a maneuver's segment is",
            );
        }
        if settings.window_s != 0.0 && !(settings.window_s >= SHORTEST_WINDOW) {
            given.push(
                &format!("{key}.window_s"),
                format!(
                    "a record is cut into segments of {SHORTEST_WINDOW} s or more, not {}",
                    settings.window_s
                ),
                "0 leaves it whole",
            );
        }
        settings.chosen().check((given, key), flights, columns, settings.input.is_some());
        let kinds = Kind::ALL.map(Kind::name);
        for (i, kind) in
            settings.kinds.iter().enumerate().filter(|(_, kind)| !kinds.contains(&kind.as_str()))
        {
            given.unknown(&format!("{key}.kinds.{i}"), "kind of maneuver", kind, &kinds);
        }
        let times = [
            ("pre_s", settings.pre_s),
            ("post_s", settings.post_s),
            ("preroll_s", settings.preroll_s),
            ("settle_s", settings.settle_s),
        ];
        for (name, value) in times {
            if !(value >= 0.0 && value.is_finite()) {
                given.push(
                    &format!("{key}.{name}"),
                    format!("{name} is a time of zero or more seconds, not {value}"),
                    "",
                );
            }
        }
        let model = given.model(&format!("{key}.model"), &settings.model)?;
        let inputs = names::inputs(&model, &settings, columns, &given.doc, key, &mut given.errors);
        let names_of: Vec<&str> = model.inputs.iter().map(|q| q.name.as_str()).collect();
        for input in settings.interpolation.named().filter(|name| !names_of.contains(name)) {
            let at = format!("{key}.interpolation.{input}");
            given.unknown(&at, "input of the model", input, &names_of);
        }
        let outputs =
            names::outputs(&model, &settings, columns, &given.doc, key, &mut given.errors);
        if let Some(channels) = channels {
            names::itself(
                &model,
                (&inputs, &outputs),
                columns,
                channels,
                &given.doc,
                key,
                &mut given.errors,
            );
        }
        names::levels(&settings, columns, &given.doc, key, &mut given.errors);
        match crate::estimate::extended(&model, &settings.method) {
            Ok(extended) => {
                method::names(&extended, &settings, &given.doc, key, &mut given.errors);
                method::search(&extended, &outputs, &settings, &given.doc, key, &mut given.errors);
            }
            Err(errors) => given.errors.0.extend(
                errors.0.into_iter().map(|e| placed(&given.doc, &format!("{key}.method"), e)),
            ),
        }
        Some(Config { settings, model, inputs, outputs })
    }
}
