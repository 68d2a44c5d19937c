use super::*;
use crate::config::{Doc, parse};

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Settings {
    #[serde(default)]
    flights: Vec<String>,
    #[serde(default)]
    except: Vec<String>,
    #[serde(default)]
    r#where: IndexMap<String, Range>,
}

impl Settings {
    fn chosen(&self) -> Chosen<'_> {
        Chosen { flights: &self.flights, except: &self.except, conditions: &self.r#where }
    }
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    stage: Settings,
}

fn settings(text: &str) -> (Settings, Doc) {
    let (file, doc) = parse::<File>("p.toml", &format!("[stage]\n{text}")).expect("settings");
    (file.stage, doc)
}

/// The mistakes in settings, held against three flights with the columns V and alpha.
fn mistakes(text: &str, maneuvers: bool) -> Vec<String> {
    mistakes_of(text, &["calm-1", "calm-2", "rough-1"].map(String::from), maneuvers)
}

fn mistakes_of(text: &str, flights: &[String], maneuvers: bool) -> Vec<String> {
    let (settings, doc) = settings(text);
    let mut columns = Columns::default();
    ["V", "alpha"].iter().for_each(|name| columns.put(name, "-"));
    let mut given = Given::new(doc, "".into());
    settings.chosen().check((&mut given, "stage"), flights, &columns, maneuvers);
    given.errors.0.iter().map(ToString::to_string).collect()
}

#[test]
fn a_star_stands_for_any_characters() {
    for (pattern, name, is) in [
        ("calm-1", "calm-1", true),
        ("calm-1", "calm-10", false),
        ("calm-*", "calm-1", true),
        ("*", "", true),
        ("*-1", "calm-1", true),
        ("c*m*1", "calm-1", true),
        ("c*m*m*1", "calm-1", false),
        ("ab*b", "ab", false),
        ("*a*a*a*a*a*a*a*b", "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", false),
    ] {
        assert_eq!(matches(pattern, name), is, "{pattern} {name}");
    }
}

#[test]
fn flights_and_maneuvers_are_chosen_by_name_and_by_condition() {
    let (settings, _) = settings(
        "flights = [\"calm-*\", \"rough-1\"]\nexcept = [\"calm-2\", \"calm-1.02\", \"*.07\"]\nwhere = { alpha = [0.02, 0.06], V = { min = 80.0 } }",
    );
    let chosen = settings.chosen();
    let flights = ["calm-1", "calm-2", "rough-1", "rough-2"].map(|id| chosen.flight(id));
    assert_eq!(flights, [true, false, true, false]);
    let at = |alpha: f64, v: f64| move |name: &str| Some(if name == "V" { v } else { alpha });
    assert_eq!(chosen.maneuver(&["calm-1.02"], at(0.04, 90.0)), Verdict::Excepted);
    assert_eq!(chosen.maneuver(&["calm-1.01", "calm-1.02"], at(0.04, 90.0)), Verdict::Excepted);
    assert_eq!(chosen.maneuver(&["rough-1.07"], at(0.04, 90.0)), Verdict::Excepted);
    for (alpha, v, verdict) in [
        (0.02, 80.0, Verdict::Used),
        (0.06, 1e9, Verdict::Used),
        (0.0601, 80.0, Verdict::Outside),
        (0.04, 79.9, Verdict::Outside),
        (0.04, f64::NAN, Verdict::Unknown("V")),
        (f64::NAN, 70.0, Verdict::Outside),
    ] {
        assert_eq!(chosen.maneuver(&["calm-1.01"], at(alpha, v)), verdict, "{alpha} {v}");
    }
    assert_eq!(chosen.maneuver(&["calm-1.01"], |_| None), Verdict::Unknown("V"));
}

#[test]
fn names_that_match_nothing_are_mistakes() {
    assert!(mistakes("flights = [\"calm-*\"]\nexcept = [\"rough-1\", \"calm-1.03\", \"calm-2-007\", \"*.01\", \"rough-*\"]\nwhere = { V = { max = 90.0 } }", true).is_empty());
    assert_eq!(
        mistakes("flights = [\"calm-3\", \"gusty-*\"]\nexcept = [\"clam-1.02\", \"x*\"]", true),
        [
            "p.toml:2:12: there is no flight \"calm-3\"\n    did you mean \"calm-1\"? the flights are calm-1, calm-2, rough-1",
            "p.toml:2:22: no flight matches \"gusty-*\"\n    the flights are calm-1, calm-2, rough-1",
            "p.toml:3:11: there is no flight or maneuver \"clam-1.02\"\n    did you mean \"calm-1\"? the flights are calm-1, calm-2, rough-1",
            "p.toml:3:24: no flight or maneuver matches \"x*\"\n    the flights are calm-1, calm-2, rough-1",
        ]
    );
    // Which flights there are is not known.
    assert!(mistakes_of("flights = [\"calm-3\"]\nexcept = [\"x*\"]", &[], true).is_empty());
    assert_eq!(
        mistakes("flights = [\"calm-*\"]\nexcept = [\"calm-*\"]", true),
        ["p.toml:3:10: no flight is left: `except` takes away all of them"]
    );
}

#[test]
fn ranges_that_hold_nothing_are_mistakes() {
    let text = "[stage.where]\nV = [90.0, 80.0]\nalpha = {}\nalfa = [0.0, 1.0]";
    assert_eq!(
        mistakes(text, true),
        [
            "p.toml:3:5: no value is in a range from 90 to 80\n    the smaller end comes first",
            "p.toml:4:9: the range has no end, so it leaves nothing out\n    give it `min`, `max` or both: { min = 0.02 }",
            "p.toml:5:8: there is no signal or column \"alfa\"\n    did you mean \"alpha\"? there are V, alpha",
        ]
    );
    assert_eq!(
        mistakes("where = { V = [80.0, 90.0] }", false),
        [
            "p.toml:2:9: there is no quiet time before a whole record, so it has no conditions\n    give `input`, so that maneuvers are used"
        ]
    );
    let wrong = |text: &str| {
        let read = parse::<File>("p.toml", &format!("[stage]\n{text}"));
        read.expect_err("a mistake").0.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert_eq!(
        wrong("where = { V = [80.0] }"),
        ["p.toml:2:15: \"stage.where.V\" must have 2 items, not 1"]
    );
    assert_eq!(
        wrong("where = { V = { mn = 80.0 } }"),
        [
            "p.toml:2:17: unknown key \"mn\" in \"stage.where.V\"\n    did you mean \"min\"? the keys here are: min, max"
        ]
    );
    assert_eq!(
        wrong("where = { V = 80.0 }"),
        ["p.toml:2:15: \"stage.where.V\" must be a list or a table, not 80.0"]
    );
}

#[test]
fn what_is_left_out_is_counted() {
    let (settings, _) = settings(
        "except = [\"b\", \"a.02\", \"a.09\", \"b.01\", \"d.01\"]\nwhere = { V = [80.0, 90.0] }",
    );
    let mut tally = Tally::new(settings.chosen());
    let used = ["a", "b", "c", "d"].map(|id| tally.flight(id));
    assert_eq!(used, [true, false, true, true]);
    tally.empty("d");
    let v = |v: f64| move |_: &str| Some(v);
    let used = [
        tally.maneuver(&["a.01"], v(85.0)),
        tally.maneuver(&["a.02"], v(85.0)),
        tally.maneuver(&["c.01"], v(95.0)),
        tally.maneuver(&["c.02"], v(f64::NAN)),
    ];
    assert_eq!(used, [true, false, false, false]);
    let notes: Vec<String> = tally
        .notes("estimate", "lag")
        .into_iter()
        .map(|n| format!("{} {} {}: {}", n.severity.as_str(), n.subject, n.count, n.text))
        .collect();
    assert_eq!(
        notes,
        [
            "info lag 1: lag: 1 of 4 flights left out by choice: b",
            "info lag 2: lag: 2 of 4 segments left out by choice: 1 by `except`, 1 by `where`",
            "missing c.02 1: lag: c.02 is not used: V, which `where` asks for, has no value before it",
            "missing a.09 1: lag: `except` names a.09, and there is no such maneuver",
        ]
    );
}
