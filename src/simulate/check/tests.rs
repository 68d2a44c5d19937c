//! Mistakes of campaign files, with their places.

use super::*;

const GOOD: &str = r#"
title = "t"
seed = 1
truth = "truth.model.toml"
start_unix_s = 1245052800

[drive]
speed = "V_cmd"
hold = "hold"
noise = ["n_w"]
turbulence = "sigma_w"
constant = { wind = 0.0 }

[maneuvers.lateral]
input = "aileron"
kind = "3211"
unit_time_s = 1.0
amplitude = 2.5

[flights.flight-01]
altitude_ft = 17000
speeds_kt = [160, 150]
at_each = ["lateral"]
constant = { wind = 3.0 }

[topics."/air"]
rate_hz = 50

[topics."/air".fields]
tas = { truth = "V", unit = "kt", noise = 0.1 }
cmd = { truth = "aileron", unit = "V" }
"#;

fn interface() -> Interface {
    let map =
        |list: &[(&str, &str)]| list.iter().map(|(n, u)| (n.to_string(), u.to_string())).collect();
    Interface {
        inputs: map(&[
            ("V_cmd", "m/s"),
            ("hold", "-"),
            ("n_w", "-"),
            ("sigma_w", "m/s"),
            ("wind", "m/s"),
            ("aileron", "V"),
        ]),
        outputs: map(&[("V", "m/s"), ("alpha", "rad")]),
    }
}

fn mistakes(text: &str) -> Vec<String> {
    let (settings, doc) = crate::config::parse::<Settings>("campaign.toml", text).unwrap();
    check(&settings, &doc, Some(&interface())).0.iter().map(|e| e.to_string()).collect()
}

#[test]
fn a_good_file_has_no_mistakes() {
    assert_eq!(mistakes(GOOD), Vec::<String>::new());
}

#[test]
fn all_mistakes_are_found_at_once_with_their_places() {
    let text = GOOD
        .replace("speed = \"V_cmd\"", "speed = \"V_cdm\"")
        .replace("kind = \"3211\"", "kind = \"32-1\"")
        .replace("at_each = [\"lateral\"]", "at_each = [\"latteral\"]")
        .replace("constant = { wind = 3.0 }", "constant = { wnd = 3.0 }")
        .replace("unit = \"kt\"", "unit = \"deg\"")
        .replace("truth = \"aileron\"", "truth = \"ailerons\"");
    let found = mistakes(&text);
    let expected = [
        "campaign.toml:8:9: there is no truth-model input \"V_cdm\"\n    did you mean \"V_cmd\"?",
        "campaign.toml:7:1: nothing drives these inputs of the truth model: V_cmd",
        "campaign.toml:16:8: \"32-1\" is no kind of maneuver",
        "campaign.toml:23:12: there is no maneuver \"latteral\"\n    did you mean \"lateral\"?",
        "campaign.toml:24:14: there is no input in [drive.constant] \"wnd\"\n    did you mean \"wind\"?",
        "campaign.toml:30:29: \"V\" has unit \"m/s\" in the truth model, which cannot be recorded in \"deg\"",
        "campaign.toml:31:17: there is no truth-model output or input \"ailerons\"\n    did you mean \"aileron\"?",
    ];
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (found, expected) in found.iter().zip(expected) {
        assert!(found.starts_with(expected), "{found}\n{expected}");
    }
}

#[test]
fn maneuvers_that_overlap_or_begin_too_early_are_refused() {
    let with = |events: &str| {
        mistakes(&GOOD.replace(
            "at_each = [\"lateral\"]",
            &format!("at_each = [\"lateral\"]\nevents = [{events}]"),
        ))
    };
    assert_eq!(with("{ at_s = 20, maneuver = \"lateral\" }"), Vec::<String>::new());
    let early = with("{ at_s = 1, maneuver = \"lateral\" }");
    assert!(early.len() == 1 && early[0].contains("begins before the flight"), "{early:?}");
    let overlap = with("{ at_s = 35, maneuver = \"lateral\" }");
    assert!(
        overlap.len() == 1 && overlap[0].contains("begins before \"lateral\" is over"),
        "{overlap:?}"
    );
}

#[test]
fn maneuvers_flown_together_are_known_and_bring_no_others() {
    let with = |own: &str| {
        let text = GOOD.replace("at_each = [\"lateral\"]", "at_each = [\"pair\"]");
        let second = "[maneuvers.lateral_late]\ninput = \"aileron\"\nkind = \"step\"\nunit_time_s = 1.0\namplitude = 1.0\n";
        let pair = format!(
            "[maneuvers.pair]\ninput = \"aileron\"\nkind = \"step\"\nunit_time_s = 9.0\namplitude = 1.0\nwith = [{own}]\n"
        );
        mistakes(
            &text.replace("[flights.flight-01]", &format!("{second}{pair}[flights.flight-01]")),
        )
    };
    assert_eq!(
        with("{ maneuver = \"lateral\" }, { maneuver = \"lateral_late\", after_s = 8.0 }"),
        Vec::<String>::new()
    );
    let unknown = with("{ maneuver = \"latteral\" }");
    assert!(unknown.len() == 1 && unknown[0].contains("did you mean \"lateral\""), "{unknown:?}");
    let itself = with("{ maneuver = \"pair\" }");
    assert!(itself.len() == 1 && itself[0].contains("brings others itself"), "{itself:?}");
}

#[test]
fn an_input_is_driven_once_and_in_its_own_unit() {
    let twice = mistakes(&GOOD.replace("hold = \"hold\"", "hold = \"V_cmd\""));
    assert!(twice.iter().any(|e| e.contains("what it is given here has \"-\"")), "{twice:?}");
    assert!(
        twice.iter().any(|e| e.contains("already driven"))
            && twice.iter().any(|e| e.contains("nothing drives")),
        "{twice:?}"
    );
    let both = mistakes(
        &GOOD.replace("constant = { wind = 0.0 }", "constant = { wind = 0.0, aileron = 0.0 }"),
    );
    assert!(
        both.len() == 1 && both[0].contains("driven by [drive] and by this maneuver"),
        "{both:?}"
    );
}

/// A file whose one flight is `flight`, without anything that asks for an altitude.
fn flown(flight: &str) -> String {
    let from = GOOD.find("altitude_ft").unwrap();
    let to = GOOD.find("[topics.\"/air\"]\n").unwrap();
    format!("{}{flight}\n\n{}", &GOOD[..from], &GOOD[to..])
}

#[test]
fn a_flight_without_test_points_has_events_or_a_length() {
    let event = "events = [{ at_s = 10, maneuver = \"lateral\" }]";
    for good in [event, "duration_s = 60", "altitude_ft = 0\nduration_s = 60"] {
        assert_eq!(mistakes(&flown(good)), Vec::<String>::new(), "{good}");
    }
    assert_eq!(mistakes(&flown(&format!("{event}\nduration_s = 20"))), Vec::<String>::new());
    for (flight, wanted) in [
        ("", "campaign.toml:20:1: the flight has no test point\n    give `speeds_kt`"),
        ("duration_s = -1", "campaign.toml:21:14: `duration_s` must be more than 0 and at most"),
        (
            "events = [{ at_s = 10, maneuver = \"lateral\" }]\nduration_s = 19.9",
            "campaign.toml:22:14: the flight ends at 19.9 s, before \"lateral\" is over at 20.0 s",
        ),
        (
            "altitude_ft = 0\nspeeds_kt = [100]\nduration_s = 60",
            "campaign.toml:23:14: `duration_s` is for a flight without test points",
        ),
    ] {
        let found = mistakes(&flown(flight));
        assert!(found.len() == 1 && found[0].starts_with(wanted), "{found:#?}\n{wanted}");
    }
}

#[test]
fn an_altitude_is_asked_for_where_it_is_needed() {
    let speeds = mistakes(&flown("speeds_kt = [100]"));
    assert!(
        speeds.len() == 1
            && speeds[0].contains("20:1: the test points of `speeds_kt` have no altitude"),
        "{speeds:?}"
    );
    let points = "points = [{ speed_kt = 100, altitude_ft = 0 }, { speed_kt = 110 }]";
    let found = mistakes(&flown(points));
    assert!(
        found.len() == 1 && found[0].contains("21:48: the test point has no altitude"),
        "{found:?}"
    );
    assert_eq!(mistakes(&flown(&format!("altitude_ft = 0\n{points}"))), Vec::<String>::new());
    let driven = flown("duration_s = 60")
        .replace("hold = \"hold\"", "hold = \"hold\"\naltitude = \"wind\"")
        .replace("constant = { wind = 0.0 }", "");
    let found = mistakes(&driven);
    assert!(
        found.iter().any(|e| e.contains("the flight has no altitude for the input \"wind\"")),
        "{found:?}"
    );
}

#[test]
fn mistakes_of_a_maneuver_stand_at_its_keys() {
    let with = |more: &str| mistakes(&GOOD.replace("amplitude = 2.5", more));
    for (more, wanted) in [
        ("cycles = 2\namplitude = 2.5", "campaign.toml:18:10: `cycles` belongs to a sweep, not to"),
        (
            "amplitudes = [1, 2]",
            "campaign.toml:18:14: \"3211\" has 4 steps: `amplitudes` must have as many values, not 2",
        ),
        ("polarity = 1", "campaign.toml:14:1: a multistep needs `amplitude`"),
        (
            "amplitude = 1\namplitudes = [1, 2, 3, 4]",
            "campaign.toml:19:14: the maneuver has both `amplitude` and `amplitudes`",
        ),
    ] {
        let found = with(more);
        assert!(found.len() == 1 && found[0].starts_with(wanted), "{found:#?}\n{wanted}");
    }
    let profile = GOOD
        .replace("kind = \"3211\"\nunit_time_s = 1.0\namplitude = 2.5", "kind = \"profile\"")
        .replace("input = \"aileron\"", "input = \"aileron\"\ntimes_s = [0, 2, 1]\nvalues = [1]");
    let found = mistakes(&profile);
    let wanted = [
        "campaign.toml:16:11: the times must ascend: 1 s follows 2 s",
        "campaign.toml:17:10: `values` must have one value for each of the 3 times, not 1",
    ];
    assert_eq!(found, wanted);
}
