//! A topic of the recorder in; what is wrong with its fields, units and gaps out.

use super::{Checker, same_kind};
use crate::simulate::settings::Topic;
use crate::units::Unit;

impl Checker<'_> {
    pub(super) fn topic(&mut self, name: &str, topic: &Topic) {
        let path = format!("topics.{name}");
        if topic.fields.is_empty() {
            self.push(&path, format!("the topic \"{name}\" has no field"), "");
        }
        if let Some(field) = topic.time_field.as_ref().filter(|f| topic.fields.contains_key(*f)) {
            self.push(
                &format!("{path}.time_field"),
                format!("\"{field}\" is also a sensor's field"),
                "give the time another name",
            );
        }
        for (i, gap) in topic.gaps.iter().enumerate() {
            let settings = self.settings;
            if !settings.flights.contains_key(&gap.flight) {
                self.unknown(
                    &format!("{path}.gaps.{i}.flight"),
                    &gap.flight,
                    "flight",
                    settings.flights.keys(),
                );
            }
            if gap.to_s <= gap.from_s {
                self.push(
                    &format!("{path}.gaps.{i}.to_s"),
                    format!("the gap ends at {} s, before it begins", gap.to_s),
                    "",
                );
            }
        }
        for (field, sensor) in &topic.fields {
            let path = format!("{path}.fields.{field}");
            if sensor.sign.abs() != 1.0 {
                self.push(
                    &format!("{path}.sign"),
                    format!("the sign must be 1 or -1, not {}", sensor.sign),
                    "",
                );
            }
            let Some(truth) = self.truth else { continue };
            let Some(unit) = truth.unit(&sensor.truth) else {
                self.unknown(
                    &format!("{path}.truth"),
                    &sensor.truth,
                    "truth-model output or input",
                    truth.outputs.keys().chain(truth.inputs.keys()),
                );
                continue;
            };
            match Unit::parse(&sensor.unit) {
                Err(what) => self.push(&format!("{path}.unit"), what, ""),
                Ok(_) if same_kind(unit, &sensor.unit) => {}
                Ok(_) => {
                    let what = format!(
                        "\"{}\" has unit \"{unit}\" in the truth model, which cannot be recorded in \"{}\"",
                        sensor.truth, sensor.unit
                    );
                    self.push(&format!("{path}.unit"), what, "");
                }
            }
        }
    }
}
