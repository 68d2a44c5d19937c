use super::*;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Settings with one of everything.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// One line.
    title: String,
    #[serde(default)]
    level: Option<f64>,
    #[serde(default = "three")]
    #[schemars(range(min = 1, max = 10))]
    count: u32,
    #[serde(default)]
    kind: Kind,
    #[serde(default)]
    noise: Vec<Noise>,
    #[serde(default)]
    units: IndexMap<String, Input>,
    #[serde(default)]
    shape: Option<Shape>,
    #[serde(default)]
    pair: Option<[f64; 2]>,
    #[serde(default)]
    weights: BTreeMap<String, f64>,
}

fn three() -> u32 {
    3
}

#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema, PartialEq)]
enum Kind {
    /// Steps of 3, 2, 1 and 1.
    #[default]
    #[serde(rename = "3211")]
    K3211,
    #[serde(rename = "doublet")]
    Doublet,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
enum Noise {
    White {
        sd: f64,
    },
    Bias {
        value: f64,
        #[serde(default)]
        drift: f64,
    },
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(untagged)]
enum Input {
    Unit(String),
    Full(Full),
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(deny_unknown_fields)]
struct Full {
    unit: String,
    #[serde(default)]
    doc: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Shape {
    Flat,
    Step { at: f64 },
    Ramp(Full),
}

fn errors(text: &str) -> String {
    match parse::<Settings>("s.toml", text) {
        Ok((value, _)) => panic!("accepted: {value:?}"),
        Err(e) => e.to_string(),
    }
}

fn accepted(text: &str) -> (Settings, Doc) {
    parse("s.toml", text).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn good_text_is_accepted_with_every_representation() {
    let text = "title = 'a'\nlevel = 2\ncount = 4\nkind = \"doublet\"\npair = [1, 2.5]\nnoise = [{ kind = \"bias\", value = 1 }]\n\
                shape = { step = { at = 1 } }\nweights = { x = 1 }\n[units]\nu = \"rad\"\nv = { unit = \"m\" }\n";
    let (s, _) = accepted(text);
    assert_eq!((s.level, s.count, s.kind, s.pair), (Some(2.0), 4, Kind::Doublet, Some([1.0, 2.5])));
    assert_eq!(s.noise, vec![Noise::Bias { value: 1.0, drift: 0.0 }]);
    assert_eq!(s.shape, Some(Shape::Step { at: 1.0 }));
    assert_eq!(s.units.keys().collect::<Vec<_>>(), ["u", "v"]);
    assert_eq!(accepted("title='a'\nshape = \"flat\"").0.shape, Some(Shape::Flat));
    assert_eq!(
        accepted("title='a'\n[shape.ramp]\nunit = 'm'").0.shape,
        Some(Shape::Ramp(Full { unit: "m".into(), doc: "".into() }))
    );
}

#[test]
fn all_mistakes_come_at_once_in_the_order_of_the_text() {
    let text = "titel = 'a'\nlevel = \"high\"\ncount = 12\n\n[[noise]]\nkind = \"white\"\nsd = true\n\n[units]\nv = { unti = \"m\" }\n";
    let wanted = "s.toml:1:1: unknown key \"titel\"\n    did you mean \"title\"? the keys here are: title, level, count, kind, noise, units, shape, pair, weights\n\
        s.toml:2:9: \"level\" must be a number, not the text \"high\"\n\
        s.toml:3:9: \"count\" must be at most 10, not 12\n\
        s.toml:7:6: \"noise.0.sd\" must be a number, not true\n\
        s.toml:10:7: unknown key \"unti\" in \"units.v\"\n    did you mean \"unit\"? the keys here are: unit, doc";
    assert_eq!(errors(text), wanted);
}

#[test]
fn tagged_enums_point_at_the_wrong_key() {
    let noise = |line: &str| errors(&format!("title = 'a'\nnoise = [{{ {line} }}]"));
    assert_eq!(
        noise("sd = 1.0"),
        "s.toml:2:10: \"noise.0\" lacks the key \"kind\"\n    add kind = one of \"white\", \"bias\""
    );
    assert_eq!(
        noise("kind = \"wite\", sd = 1.0"),
        "s.toml:2:19: \"noise.0.kind\" must be one of \"white\", \"bias\", not the text \"wite\"\n    did you mean \"white\"?"
    );
    assert_eq!(
        noise("kind = \"white\", sd = 1.0, drift = 1"),
        "s.toml:2:38: unknown key \"drift\" in \"noise.0\"\n    the keys here are: kind, sd"
    );
    assert_eq!(
        noise("kind = 3"),
        "s.toml:2:19: \"noise.0.kind\" must be one of \"white\", \"bias\", not 3"
    );
}

#[test]
fn enums_named_by_a_key_and_plain_ones_list_their_variants() {
    let with = |line: &str| errors(&format!("title = 'a'\n{line}"));
    assert_eq!(
        with("kind = \"3212\""),
        "s.toml:2:8: \"kind\" must be one of \"doublet\", \"3211\", not the text \"3212\"\n    did you mean \"3211\"?"
    );
    assert_eq!(
        with("shape = { stp = 1 }"),
        "s.toml:2:11: unknown key \"stp\" in \"shape\"\n    did you mean \"step\"? one key of these is wanted: step, ramp"
    );
    assert_eq!(
        with("shape = { step = { } }"),
        "s.toml:2:18: \"shape.step\" lacks the key \"at\"\n    add at = <a number>"
    );
    assert_eq!(
        with("shape = { step = { at = 1, by = 2 } }"),
        "s.toml:2:28: unknown key \"by\" in \"shape.step\"\n    the keys here are: at"
    );
    assert_eq!(
        with("shape = \"steep\""),
        "s.toml:2:9: \"shape\" must be \"flat\", not the text \"steep\""
    );
    assert_eq!(with("units.u = 3"), "s.toml:2:11: \"units.u\" must be a text or a table, not 3");
}

#[test]
fn lists_and_numbers_are_checked() {
    let with = |line: &str| errors(&format!("title = 'a'\n{line}"));
    assert_eq!(with("pair = [1.0]"), "s.toml:2:8: \"pair\" must have 2 items, not 1");
    assert_eq!(
        with("level = nan"),
        "s.toml:2:9: \"level\" must be a finite number within range, not nan"
    );
    assert_eq!(with("count = 2.0"), "s.toml:2:9: \"count\" must be a whole number, not 2.0");
    assert_eq!(with("count = 0x0"), "s.toml:2:9: \"count\" must be at least 1, not 0x0");
    assert_eq!(
        with("weights.x = 'q'"),
        "s.toml:2:13: \"weights.x\" must be a number, not the text \"q\""
    );
    assert_eq!(with("noise = 3"), "s.toml:2:9: \"noise\" must be a list, not 3");
    assert_eq!(
        with("level = 1979-05-27"),
        "s.toml:2:9: \"level\" must be a number, not the date 1979-05-27"
    );
}

#[test]
fn syntax_errors_have_line_and_column() {
    let e = errors("title = \"a\nlevel = 3\n");
    assert!(e.starts_with("s.toml:1:11: this is not TOML: "), "{e}");
    let e = errors("title = \"a\"\nlevel = \ncount = 3\nkind == 3\n");
    assert!(e.contains("s.toml:2:") && e.contains("s.toml:4:"), "{e}");
    let e = errors("title = 'a'\ntitle = 'b'\n");
    assert_eq!(e, "s.toml:2:1: this is not TOML: duplicate key");
}

#[test]
fn a_missing_or_broken_file_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.toml");
    let e = load::<Settings>(&path).unwrap_err().to_string();
    assert!(e.starts_with(&format!("{}: there is no such file", path.display())), "{e}");
    std::fs::write(&path, b"title = 'a'\n# \xff").unwrap();
    let e = load::<Settings>(&path).unwrap_err().to_string();
    assert!(e.starts_with(&format!("{}:2:3: the text is not UTF-8", path.display())), "{e}");
    std::fs::write(&path, "title = 'a'").unwrap();
    assert_eq!(load::<Settings>(&path).unwrap().0.title, "a");
}

fn line_column(place: Place) -> (usize, usize) {
    (place.line, place.column)
}

#[test]
fn every_key_has_its_place_and_a_missing_one_that_of_its_parent() {
    let text = "title = 'a'\nnoise = [{ kind = 'white', sd = 1 },\n  { kind = 'white', sd = 2 }]\n[units]\nu = 'rad'\n[shape.ramp]\nunit = 'm'\n";
    let doc = accepted(text).1;
    assert_eq!(line_column(doc.place("title")), (1, 9));
    assert_eq!(line_column(doc.key_place("title")), (1, 1));
    assert_eq!(line_column(doc.place("noise.1.sd")), (3, 26));
    assert_eq!(line_column(doc.place("noise.1")), (3, 3));
    assert_eq!(line_column(doc.place("units")), (4, 1));
    assert_eq!(line_column(doc.place("units.gone")), (4, 1));
    assert_eq!(line_column(doc.place("shape")), (6, 2));
    assert_eq!(line_column(doc.place("shape.ramp")), (6, 1));
    assert_eq!(line_column(doc.place("nowhere.at.all")), (1, 1));
    assert!(doc.has("units.u") && !doc.has("units.gone"));
}

#[test]
fn places_inside_strings_account_for_quotes_escapes_and_lines() {
    let at = |text: &str, offset: usize| {
        let text = format!("title = {text}\n");
        let (settings, doc) = accepted(&text);
        (settings.title, line_column(doc.place_in("title", offset)))
    };
    assert_eq!(at("\"a + b\"", 4), ("a + b".into(), (1, 14)));
    assert_eq!(at("'a + b'", 0).1, (1, 10));
    assert_eq!(at("'a + b'", 5).1, (1, 15));
    assert_eq!(at("'a + b'", 99).1, (1, 15));
    let (value, place) = at("\"\\u00e9\\n\\tx + y\"", 4);
    assert_eq!((value.find('x'), place), (Some(4), (1, 20)));
    let (value, place) = at("\"\"\"\na +\n  b\"\"\"", 6);
    assert_eq!((value.find('b'), place), (Some(6), (3, 3)));
    let (value, place) = at("'''\na +\n  b'''", 6);
    assert_eq!((value.find('b'), place), (Some(6), (3, 3)));
    let (value, place) = at("\"\"\"a + \\\n   b\"\"\"", 4);
    assert_eq!((value.as_str(), place), ("a + b", (2, 4)));
    let (value, place) = at("\"\u{1F600}b\"", 4);
    assert_eq!((value.find('b'), place), (Some(4), (1, 11)));
    let (_, doc) = accepted("title = 'a'\ncount = 3\n");
    assert_eq!(line_column(doc.place_in("count", 7)), (2, 9));
    assert_eq!(line_column(doc.place_in("gone", 7)), (1, 1));
}

#[test]
fn schema_text_is_a_titled_draft_2020_12_schema() {
    let schema: serde_json::Value =
        serde_json::from_str(&schema_text::<Settings>("Settings")).unwrap();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    assert_eq!(schema["title"], "Settings");
    assert_eq!(schema["additionalProperties"], false);
    assert_eq!(schema["properties"]["title"]["description"], "One line.");
}

proptest::proptest! {
    /// Whatever the text, the answer is a value or errors with places, never a panic.
    #[test]
    fn any_text_ends_in_a_value_or_errors(text in "[a-z0-9 =\"'\\[\\]{}.,\\\\\n#é]{0,60}") {
        if let Err(e) = parse::<Settings>("s.toml", &text) {
            assert!(!e.is_empty() && e.0.iter().all(|e| e.place.as_ref().is_some_and(|p| p.line > 0)));
        }
    }
}
