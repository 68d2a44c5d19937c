//! What a candidate adds to a model in; the text of its `[[effect]]` block out.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::added::Added;
use crate::model::Scope;

/// Filled lines of an effect.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Block {
    pub title: String,
    /// Name, unit, value where the aircraft file does not give one.
    pub constants: Vec<(String, String, Option<f64>)>,
    /// What each added parameter means, in their order.
    pub docs: Vec<String>,
    pub equations: Vec<(String, String)>,
    /// Name, and its keys with their values as TOML.
    pub states: Vec<(String, Vec<(&'static str, String)>)>,
    pub add: Vec<(String, String)>,
    pub replace: Vec<(String, String)>,
}

impl Block {
    /// Names of equations and states.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let equations = self.equations.iter().map(|(name, _)| name.as_str());
        equations.chain(self.states.iter().map(|(name, ..)| name.as_str()))
    }

    /// `found`: as the model goes on with it (switches held) instead of as it is tried (everything
    /// free at null). `held`: further parameters that are held.
    pub fn text(
        &self,
        added: &[Added],
        values: &BTreeMap<String, f64>,
        found: bool,
        held: &[&str],
        provenance: &str,
    ) -> String {
        let mut out = String::new();
        for line in provenance.lines() {
            let _ = writeln!(out, "# {line}");
        }
        let _ = writeln!(out, "[[effect]]\ntitle = {}", quoted(&self.title));
        if !self.constants.is_empty() {
            out += "\n[effect.constants]\n";
        }
        for (name, unit, value) in &self.constants {
            let _ = match value {
                Some(value) => writeln!(
                    out,
                    "{} = {{ unit = {}, value = {value:?} }}",
                    key(name),
                    quoted(unit)
                ),
                None => writeln!(out, "{} = {}", key(name), quoted(unit)),
            };
        }
        out += "\n[effect.parameters]\n";
        for (a, doc) in added.iter().zip(&self.docs) {
            let fixed = (found && a.is_held()) || held.contains(&a.name.as_str());
            out += &parameter(a, values.get(&a.name).copied(), found, fixed, doc);
        }
        section(&mut out, "equations", &self.equations);
        if !self.states.is_empty() {
            out += "\n[effect.states]\n";
        }
        for (name, keys) in &self.states {
            let keys: Vec<String> = keys.iter().map(|(key, x)| format!("{key} = {x}")).collect();
            let _ = writeln!(out, "{} = {{ {} }}", key(name), keys.join(", "));
        }
        section(&mut out, "add", &self.add);
        section(&mut out, "replace", &self.replace);
        out
    }
}

fn parameter(a: &Added, value: Option<f64>, found: bool, fixed: bool, doc: &str) -> String {
    // Where it is held it is at null.
    let value = value.filter(|_| a.held_in.is_none());
    let start =
        value.or(a.hold.filter(|_| found)).or(a.null).or(a.starts.first().copied()).unwrap_or(0.0);
    let mut line = format!("{} = {{ unit = {}, start = {start:?}", key(&a.name), quoted(&a.unit));
    for (bound, x) in [("min", a.min), ("max", a.max)] {
        if x.is_finite() {
            let _ = write!(line, ", {bound} = {x:?}");
        }
    }
    if a.scope != Scope::Campaign {
        let _ = write!(line, ", per = {}", quoted(a.scope.name()));
    }
    if let Some(value) = &a.held_in {
        let _ = write!(line, ", held_in = {}", quoted(value));
    }
    if fixed {
        line += ", fixed = true";
    }
    if !doc.is_empty() {
        let _ = write!(line, ", doc = {}", quoted(doc));
    }
    line + " }\n"
}

fn section(out: &mut String, name: &str, lines: &[(String, String)]) {
    if !lines.is_empty() {
        let _ = writeln!(out, "\n[effect.{name}]");
    }
    for (target, text) in lines {
        let _ = writeln!(out, "{} = {}", key(target), quoted(text));
    }
}

pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', " "))
}

fn key(name: &str) -> String {
    let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if plain && !name.is_empty() { name.to_string() } else { quoted(name) }
}
