//! A file of tolerances that a validation names comes in; those that it is judged by, in SI, or the
//! mistakes, go out.

use super::file::{File, Of, Tolerance};
use super::settings::Settings;
use crate::config::{self, Doc};
use crate::model::Quantity;
use crate::stage::check::{Columns, Found, Given, unknown};
use crate::stage::estimate::chosen::{Chosen, Verdict};
use crate::units::Unit;
use std::collections::BTreeMap;

/// A tolerance that is judged by.
#[derive(Debug, Clone)]
pub struct Checked {
    pub told: Tolerance,
    pub limit: Limit,
    /// SI unit of what is compared.
    pub unit: String,
}

/// How large an error may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// SI.
    Within(f64),
    Share(f64),
}

impl Checked {
    /// Whether it is for a maneuver with this input, kind and conditions before it.
    pub fn is_for(&self, input: &str, kind: &str, conditions: &BTreeMap<&str, f64>) -> bool {
        let one_of = |all: &[String], own: &str| all.is_empty() || all.iter().any(|one| one == own);
        let chosen = Chosen { flights: &[], except: &[], conditions: &self.told.conditions };
        let verdict = chosen.maneuver(&[], |name| conditions.get(name).copied());
        one_of(&self.told.input, input)
            && one_of(&self.told.kinds, kind)
            && verdict == Verdict::Used
    }

    /// What it is about, in words.
    pub fn about(&self) -> String {
        match self.told.of {
            Of::Response => self.told.output.clone(),
            Of::Period => format!("period of {}", self.told.output),
            Of::HalfTime => format!("time to half amplitude of {}", self.told.output),
            Of::DampingRatio => format!("damping ratio of {}", self.told.output),
        }
    }
}

/// The tolerances of the tests that a validation names, for a model with these scored outputs; none
/// where it names no file.
pub fn check(
    (given, key): (&mut Given, &str),
    settings: &Settings,
    scored: &[Quantity],
    (columns, searched): (&Columns, &[String]),
) -> Vec<Checked> {
    let Some(path) = &settings.tolerances else {
        if !settings.tests.is_empty() {
            let help = "name the file that has them: tolerances = \"file.toml\"";
            given.push(&format!("{key}.tests"), "tests without a file of tolerances", help);
        }
        return Vec::new();
    };
    if !given.names_a_file(&format!("{key}.tolerances"), path) {
        return Vec::new();
    }
    let loaded = config::load::<File>(&given.path(path));
    let Some((file, doc)) = given.errors.take(loaded) else { return Vec::new() };
    let tests: Vec<&str> = file.tolerance.iter().map(|one| one.test.as_str()).collect();
    for (i, test) in settings.tests.iter().enumerate() {
        if !tests.contains(&test.as_str()) {
            let mut known = tests.clone();
            known.dedup();
            given.unknown(&format!("{key}.tests.{i}"), "test in the file", test, &known);
        }
    }
    if file.tolerance.is_empty() {
        let error = doc.error("tolerance", "there is no tolerance");
        given.errors.push(error.help("write one `[[tolerance]]` at least"));
    }
    let wanted = |one: &Tolerance| settings.tests.is_empty() || settings.tests.contains(&one.test);
    let all = file.tolerance.into_iter().enumerate().filter(|(_, one)| wanted(one));
    all.filter_map(|(i, one)| {
        let at = format!("tolerance.{i}");
        chosen((given, &doc, &at), &one, (columns, searched));
        checked((given, &doc, &at), one, scored)
    })
    .collect()
}

/// Checks which maneuvers a tolerance is for.
fn chosen(
    (given, doc, at): (&mut Given, &Doc, &str),
    one: &Tolerance,
    (columns, searched): (&Columns, &[String]),
) {
    for (i, name) in one.input.iter().enumerate().filter(|(_, name)| !searched.contains(name)) {
        let key = format!("{at}.input.{i}");
        given.errors.push(unknown(doc, &key, "[[segment.input]]", name, searched));
    }
    for (name, range) in &one.conditions {
        let key = format!("{at}.where.{name}");
        if matches!(columns.find(name), Found::Missing) {
            given.errors.push(unknown(doc, &key, "signal or column", name, &columns.names()));
        }
        if let Some((what, help)) = range.fault() {
            given.errors.push(doc.error(&key, what).help(help));
        }
    }
}

/// One tolerance with its limit in SI.
fn checked(
    (given, doc, at): (&mut Given, &Doc, &str),
    one: Tolerance,
    scored: &[Quantity],
) -> Option<Checked> {
    let output = scored.iter().find(|output| output.name == one.output);
    let unit = output.map(|output| match one.of {
        Of::Response => output.unit.clone(),
        Of::Period | Of::HalfTime => "s".into(),
        Of::DampingRatio => "-".into(),
    });
    let names: Vec<&str> = scored.iter().map(|output| output.name.as_str()).collect();
    if unit.is_none() {
        let key = format!("{at}.output");
        let mut error = unknown(doc, &key, "scored output of the model", &one.output, &names);
        if let Some(help) = &mut error.help {
            help.push_str("; tests of other models are left out by `tests` of the validation");
        }
        given.errors.push(error);
    }
    let limit = limit((given, doc, at), &one, unit.as_deref());
    Some(Checked { limit: limit?, unit: unit?, told: one })
}

/// The limit in SI; none where it is said in no way, or wrongly.
fn limit(
    (given, doc, at): (&mut Given, &Doc, &str),
    one: &Tolerance,
    wanted: Option<&str>,
) -> Option<Limit> {
    let mut push = |key: &str, what: String, help: &str| {
        given.errors.push(doc.error(&format!("{at}{key}"), what).help(help));
    };
    let both = "say how large an error may be: within = 1.5 with unit = \"deg\", or share = 0.1";
    let (key, value) = match (one.within, one.share) {
        (Some(value), None) => (".within", value),
        (None, Some(value)) => (".share", value),
        (Some(_), Some(_)) => {
            push(
                "",
                "a tolerance has both `within` and `share`".into(),
                "write two tolerances of one `group`, of which one suffices",
            );
            return None;
        }
        (None, None) => {
            push("", "a tolerance without a size".into(), both);
            return None;
        }
    };
    if !(value > 0.0 && value.is_finite()) {
        push(key, format!("a tolerance of {value}"), "it must be larger than 0");
        return None;
    }
    if key == ".share" && value > 1.0 {
        push(key, format!("a share of {value}"), "it is a part of what is measured: 0.1 is 10%");
        return None;
    }
    let text = match (&one.unit, one.within) {
        (Some(text), Some(_)) => text,
        (None, Some(_)) => {
            push(key, "a tolerance without a unit".into(), both);
            return None;
        }
        (Some(_), None) => {
            push(".unit", "a share has no unit".into(), "leave `unit` out");
            return None;
        }
        (None, None) => return Some(Limit::Share(value)),
    };
    match Unit::parse(text) {
        Err(what) => {
            push(".unit", what, "write it as a channel map does: deg, deg/s, m/s^2, g");
            None
        }
        Ok(unit) => {
            let wanted = wanted?;
            if !crate::stage::check::agree(text, wanted) {
                let what = format!(
                    "{} \"{}\" is in {wanted}, its tolerance in {text}",
                    one.of.as_str(),
                    one.output
                );
                push(".unit", what, "give the tolerance in a unit of the same dimension");
                return None;
            }
            // A difference: the zero of the scale does not count.
            Some(Limit::Within(value * unit.scale))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemars::JsonSchema;
    use serde::Deserialize;
    use std::path::Path;

    const HEAD: &str = "title = \"t\"\nsource = \"s\"\n";
    const Q: &str = "[[tolerance]]\ntest = \"pitch\"\noutput = \"q\"\n";

    /// What is found, and the messages, for a validation that says `more` besides the estimate.
    fn found(folder: &Path, more: &str) -> (Vec<Checked>, String) {
        #[derive(Deserialize, JsonSchema)]
        struct Pipeline {
            validate: Vec<Settings>,
        }
        let text = format!("[[validate]]\nestimate = \"e\"\n{more}\n");
        let (told, doc) =
            config::parse::<Pipeline>("pipeline.toml", &text).expect("a pipeline file");
        let mut given = Given::new(doc, folder.to_path_buf());
        let mut columns = Columns::default();
        columns.put("V", "m/s");
        let output = |name: &str, unit: &str| Quantity {
            name: name.into(),
            unit: unit.into(),
            ..Quantity::default()
        };
        let scored = [output("q", "rad/s"), output("az", "m/s^2")];
        let searched = ["elevator".to_string()];
        let at = (&mut given, "validate.0");
        let all = check(at, &told.validate[0], &scored, (&columns, &searched));
        (all, given.errors.to_string())
    }

    /// As `found`, with a file of this text.
    fn with(text: &str, more: &str) -> (Vec<Checked>, String) {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("a.toml"), format!("{HEAD}{text}")).expect("written");
        found(folder.path(), &format!("tolerances = \"a.toml\"\n{more}"))
    }

    #[test]
    fn tolerances_are_in_si_and_for_the_maneuvers_they_name() {
        let text = format!(
            "{Q}within = 2.0\nunit = \"deg/s\"\ninput = [\"elevator\"]\nwhere = {{ V = {{ min = 90.0 }} }}\n\
             {Q}of = \"half-time\"\nshare = 0.1\n"
        );
        let (all, errors) = with(&text, "");
        assert_eq!((all.len(), errors.as_str()), (2, ""));
        assert_eq!(all[0].limit, Limit::Within(2.0_f64 * std::f64::consts::PI / 180.0));
        assert_eq!((all[1].limit, all[1].unit.as_str()), (Limit::Share(0.1), "s"));
        let at = |v: f64| BTreeMap::from([("V", v)]);
        assert!(all[0].is_for("elevator", "3211", &at(100.0)));
        assert!(!all[0].is_for("elevator", "3211", &at(80.0)));
        assert!(!all[0].is_for("rudder", "3211", &at(100.0)));
        assert!(all[1].is_for("rudder", "doublet", &BTreeMap::new()));
    }

    #[test]
    fn fault_each_mistake_of_a_file_is_said_at_its_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let (_, errors) = found(folder.path(), "tolerances = \"none.toml\"");
        assert!(
            errors.contains("pipeline.toml:3") && errors.contains("there is no file"),
            "{errors}"
        );
        let (_, errors) = found(folder.path(), "tests = [\"pitch\"]");
        assert!(errors.contains("tests without a file of tolerances"), "{errors}");
        let good = format!("{Q}share = 0.1\n");
        let (_, errors) = with(&good, "tests = [\"pich\"]");
        assert!(
            errors.contains("\"pich\"") && errors.contains("did you mean \"pitch\""),
            "{errors}"
        );
        for (more, wanted) in [
            ("within = 1.0\nunit = \"degg\"", "degg"),
            ("within = 1.0\nunit = \"m/s\"", "response \"q\" is in rad/s, its tolerance in m/s"),
            ("within = 1.0", "a tolerance without a unit"),
            ("share = 0.1\nunit = \"deg/s\"", "a share has no unit"),
            ("share = 0.1\nwithin = 1.0\nunit = \"deg/s\"", "both `within` and `share`"),
            ("", "a tolerance without a size"),
            ("share = -0.1", "a tolerance of -0.1"),
            ("share = 10.0", "a share of 10"),
            ("share = 0.1\ninput = [\"rudder\"]", "there is no [[segment.input]] \"rudder\""),
            ("share = 0.1\nwhere = { W = [0.0, 1.0] }", "there is no signal or column \"W\""),
            ("share = 0.1\nwhere = { V = [2.0, 1.0] }", "no value is in a range from 2 to 1"),
        ] {
            let (_, errors) = with(&format!("{Q}{more}\n"), "");
            assert!(errors.contains(wanted) && errors.contains("a.toml:"), "{wanted}: {errors}");
        }
        let (_, errors) = with(&good.replace("\"q\"", "\"p\""), "");
        assert!(errors.contains("there is no scored output of the model \"p\""), "{errors}");
        let (_, errors) = with("tolerance = []\n", "");
        assert!(errors.contains("there is no tolerance"), "{errors}");
    }

    #[test]
    fn the_example_of_the_page_and_the_shipped_file_are_read() {
        let page = include_str!("../../../docs/tolerances.md");
        let example = page.split("```toml\n").nth(2).and_then(|rest| rest.split("```").next());
        let shipped = include_str!("../../../pipelines/attas/part60.tolerances.toml");
        for (text, n) in [(example.expect("an example"), 5), (shipped, 12)] {
            let (file, _) = config::parse::<File>("tolerances.toml", text).expect("it is read");
            assert_eq!(file.tolerance.len(), n);
            assert!(file.tolerance.iter().all(|one| one.within.is_some() != one.share.is_some()));
        }
    }

    #[test]
    fn a_test_that_is_not_asked_for_needs_no_output() {
        let text = format!("{Q}share = 0.1\n{Q}share = 0.1\n").replacen("pitch", "roll", 1);
        let (all, errors) = with(&text.replacen("\"q\"", "\"p\"", 1), "tests = [\"pitch\"]");
        assert_eq!((all.len(), errors.as_str()), (1, ""));
    }
}
