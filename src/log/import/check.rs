//! The settings of an import in; every mistake in them that needs no data to be seen out.

use super::clock::Clock;
use super::settings::{ALL, Column, Decimal, Import, Separator, Time, Topic};
use crate::config::Doc;
use crate::error::{Error, Errors};
use crate::units::Unit;
use std::collections::BTreeSet;

impl Import {
    /// Mistakes that are seen without data; `one_output` where a command names the log.
    ///
    /// # Errors
    /// All of them.
    pub fn check(&self, doc: &Doc, one_output: bool) -> Result<(), Errors> {
        let mut errors = Errors::default();
        self.check_names(doc, one_output, &mut errors);
        if self.names_line.is_some_and(|n| n == 0 || n > self.header_lines) {
            let what = format!("the names stand in one of the {} header_lines", self.header_lines);
            errors.push(doc.error("names_line", what).help("lines count from 1"));
        }
        if self.decimal == Decimal::Comma && self.separator == Separator::Comma {
            errors.push(
                doc.error("decimal", "a comma stands both in numbers and between columns")
                    .help("what separates the columns then: separator = \"semicolon\" or \"tab\"?"),
            );
        }
        let messages = self.topic.iter().any(|topic| topic.from.is_some());
        let shared = self.topic.iter().any(|topic| topic.time.is_none());
        match &self.time {
            Some(time) => errors.0.extend(time.mistakes(doc, "time", messages)),
            None if shared && !messages => errors.push(
                doc.error("time", "nothing says what the time of the rows is")
                    .help("[time] with `column` and `unit`, or with `rate_hz`"),
            ),
            None => {}
        }
        let mut names = BTreeSet::new();
        for (i, topic) in self.topic.iter().enumerate() {
            if !names.insert(&topic.name) {
                errors.push(doc.error(
                    &format!("topic.{i}.name"),
                    format!("there are two topics \"{}\"", topic.name),
                ));
            }
            topic.check(doc, i, messages, &mut errors);
        }
        errors.or(())
    }

    fn check_names(&self, doc: &Doc, one_output: bool, errors: &mut Errors) {
        let all = self.names.iter().any(|name| name == ALL);
        if (all || self.names.len() > 1) && (one_output || !self.output.contains("{name}")) {
            errors.push(
                doc.error("output", "several files are imported into one log")
                    .help("put {name} into `output`, and give no --out"),
            );
        }
        if all && self.names.len() > 1 {
            errors.push(doc.error("names", "\"*\" stands for all names, and there are others"));
        }
        for (i, input) in self.input.iter().enumerate() {
            if all && input.matches("{name}").count() != 1 {
                let what =
                    "\"*\" needs {name} once in every `input`: it says which part is the name";
                errors.push(doc.error(&format!("input.{i}"), what));
            }
        }
        let mut seen = BTreeSet::new();
        for (i, name) in self.names.iter().enumerate() {
            if !seen.insert(name) {
                errors.push(doc.error(&format!("names.{i}"), format!("\"{name}\" is named twice")));
            }
        }
    }
}

impl Topic {
    fn check(&self, doc: &Doc, i: usize, messages: bool, errors: &mut Errors) {
        let topic = |key: &str| format!("topic.{i}.{key}");
        if messages && self.from.is_none() {
            let what = format!(
                "topic \"{}\" does not say which messages it is made from, as others do",
                self.name
            );
            errors.push(doc.error(&topic("name"), what).help("from = \"vehicle_attitude\""));
        }
        if self.from.is_none() && self.instance > 0 {
            errors.push(
                doc.error(&topic("instance"), "there is no `from` that it is an instance of"),
            );
        }
        if let Some(time) = &self.time {
            errors.0.extend(time.mistakes(doc, &topic("time"), messages));
        }
        let mut names = BTreeSet::new();
        for (k, field) in self.fields.iter().enumerate() {
            let at = |key: &str| format!("topic.{i}.fields.{k}.{key}");
            errors.take(Unit::parse(&field.unit).map_err(|e| doc.error(&at("unit"), e)));
            if !names.insert(&field.name) {
                errors.push(doc.error(
                    &at("name"),
                    format!("topic \"{}\" has two fields \"{}\"", self.name, field.name),
                ));
            }
            let matrix = field.matrix.is_some();
            errors.take(
                field.column.check(matrix, messages).map_err(|e| doc.error(&at("column"), e)),
            );
        }
    }
}

impl Column {
    fn check(&self, matrix: bool, messages: bool) -> Result<(), &'static str> {
        match self {
            Column::Number(_) if messages => Err("fields of messages have names, no numbers"),
            Column::Number(0) => Err("columns count from 1"),
            Column::Name(_) if matrix => {
                Err("columns of a matrix have numbers; a vector is named without `matrix`")
            }
            _ => Ok(()),
        }
    }
}

impl Time {
    /// Mistakes in the time that stands at `key`, of a file of messages or of columns.
    fn mistakes(&self, doc: &Doc, key: &str, messages: bool) -> Vec<Error> {
        let mut found = Vec::new();
        let at = |name: &str| format!("{key}.{name}");
        match (&self.column, self.rate_hz) {
            (Some(_), Some(_)) => {
                found.push(doc.error(&at("rate_hz"), "there is a column of time as well"));
            }
            (None, Some(_)) if messages => {
                found.push(doc.error(&at("rate_hz"), "messages bear their own time"));
            }
            (None, Some(rate)) if !(rate > 0.0 && rate.is_finite()) => {
                found.push(doc.error(&at("rate_hz"), "a rate is a number of Hz above zero"));
            }
            (None, None) if !messages => found.push(
                doc.error(key, "nothing says what the time of the rows is")
                    .help("`column` with `unit`, or `rate_hz`"),
            ),
            _ => {}
        }
        if let Some(column) = &self.column {
            let checked = column.check(self.matrix.is_some(), messages);
            found.extend(checked.err().map(|e| doc.error(&at("column"), e)));
        }
        if let Some(unit) = &self.unit {
            let wrong = match Clock::new(unit, self.start_s) {
                _ if self.rate_hz.is_some() => Some("a rate in Hz needs no unit".to_string()),
                Ok(clock) if clock.is_written() && messages => {
                    Some("times of messages are numbers".to_string())
                }
                Ok(_) => None,
                Err(e) => Some(e),
            };
            found.extend(wrong.map(|what| doc.error(&at("unit"), what)));
        }
        if !self.start_s.is_finite() {
            found.push(doc.error(&at("start_s"), "the start is a finite number of seconds"));
        }
        found
    }
}
