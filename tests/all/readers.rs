//! What readers of the results and writers of a pipeline file meet: columns that no reader takes
//! for one, the flight and segment of every estimate, logs found from anywhere, windows and scored
//! outputs as asked for, a folder of effects of one's own.

use crate::campaign::Campaign;
use koehler::table::read_dataset;
use std::collections::BTreeSet;

#[test]
fn fault_signals_that_differ_by_case_only_are_refused_before_any_log_is_read() {
    let c = Campaign::new();
    let channels = std::fs::read_to_string(c.path("channels.toml")).expect("readable");
    let more = "\n[signal.v]\ntopic = \"/air\"\nfield = \"speed\"\nunit = \"m/s\"\n\n[signal.T_s]\ntopic = \"/air\"\nfield = \"speed\"\nunit = \"m/s\"\n";
    c.write("channels.toml", &(channels + more));
    std::fs::write(c.path("logs/flight-1.mcap"), b"no log").expect("written");
    let check = c.koehler("check", &[]).ended(2);
    for wanted in [
        "channels.toml:17:",
        "\"V\" and \"v\"",
        "channels.toml:22:",
        "\"t_s\" and \"T_s\"",
        "give one of them another name",
    ] {
        assert!(check.err.contains(wanted), "{wanted} is not in\n{}", check.err);
    }
    assert!(!check.err.contains("call the signal"), "V is a signal as well\n{}", check.err);
    assert!(!c.run().ended(2).err.contains("no log"));

    // The flight path has a column "Mach", and a V beside its v_body.
    let c = Campaign::new();
    let inputs = [
        "ax_imu",
        "ay_imu",
        "az_imu",
        "p_imu",
        "q_imu",
        "r_imu",
        "temperature",
        "static_pressure",
        "mach",
    ];
    let units = ["m/s^2", "m/s^2", "m/s^2", "rad/s", "rad/s", "rad/s", "K", "Pa", "1"];
    let mut text = std::fs::read_to_string(c.path("channels.toml")).expect("readable");
    for (name, unit) in inputs.iter().zip(units) {
        let despite = if unit == "m/s" { "" } else { "despite = \"m/s\"\n" };
        text += &format!(
            "\n[signal.{name}]\ntopic = \"/air\"\nfield = \"speed\"\nunit = \"{unit}\"\n{despite}"
        );
    }
    text += "\n[signal.phi]\ntopic = \"/sensor\"\nfield = \"angle\"\nunit = \"deg\"\n";
    c.write("channels.toml", &text);
    c.edit("channels.toml", "[signal.u]", "[signal.command]");
    c.edit("pipeline.toml", "signal = \"u\"", "signal = \"command\"");
    c.edit(
        "pipeline.toml",
        "kinds = [\"3211\"]",
        "kinds = [\"3211\"]\ninputs = { u = \"command\" }",
    );
    c.edit("pipeline.toml", "[derive]", "[reconstruct]\n\n[derive]");
    c.edit("pipeline.toml", "channels = ", "aircraft = \"aircraft.toml\"\nchannels = ");
    let places = ["x_imu", "y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"];
    let given = |name: &str, unit: &str| {
        format!("{name} = {{ value = 0.0, unit = \"{unit}\", sd = 0.0, source = \"test\" }}\n")
    };
    let constants: String =
        places.iter().map(|name| given(name, "m")).chain([given("upwash", "-")]).collect();
    c.write("aircraft.toml", &constants);
    let check = c.koehler("check", &[]).ended(2);
    assert!(
        check.err.contains("\"mach\" and \"Mach\"")
            && check.err.contains("call the signal \"Mach\""),
        "{}",
        check.err
    );
    assert_eq!(check.err.matches("take them for one").count(), 1, "{}", check.err);
    c.edit("channels.toml", "[signal.mach]", "[signal.Mach]");
    c.koehler("check", &[]).ended(0);

    // A model that wants v hears where it is now.
    c.write("side.model.toml", "title = \"Side\"\n[inputs]\nv = \"m/s\"\n[outputs]\nside = { unit = \"m/s\", value = \"v\" }\n");
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 100.0\nmodel = \"side.model.toml\"");
    let check = c.koehler("check", &[]).ended(2);
    assert!(check.err.contains("inputs = { v = \"v_body\" }"), "{}", check.err);
    c.edit("pipeline.toml", "side.model.toml\"", "side.model.toml\"\ninputs = { v = \"v_body\" }");
    c.koehler("check", &[]).ended(0);
}

/// (group, flight, segment, parameter) of all rows.
fn rows(c: &Campaign) -> BTreeSet<[String; 4]> {
    let table = read_dataset(&c.path("out"), "estimates").expect("estimates");
    let column = |name: &str| table.strings(name).expect("column");
    let of = ["group", "flight", "segment", "parameter"].map(column);
    (0..table.rows()).map(|i| of.each_ref().map(|column| column[i].to_string())).collect()
}

#[test]
fn every_estimate_says_of_which_flight_and_segment_it_is() {
    let c = Campaign::new();
    let row = |row: [&str; 4]| row.map(str::to_string);
    c.run().ended(0);
    let found = rows(&c);
    assert_eq!(found.len(), 36);
    for [group, flight, segment, _] in &found {
        assert!(
            group == segment && segment.starts_with(&format!("{flight}.")),
            "{group}: {flight} {segment}"
        );
    }
    for (group, name) in [("flight", "flight-2"), ("all", "all")] {
        let c = Campaign::new();
        c.edit(
            "pipeline.toml",
            "kinds = [\"3211\"]",
            &format!("kinds = [\"3211\"]\ngroup = \"{group}\"\n[estimate.method]\nper = {{ T = \"flight\" }}"),
        );
        let text = std::fs::read_to_string(c.path("pipeline.toml")).expect("readable");
        c.write("pipeline.toml", text.split("[[fit]]").next().expect("text"));
        c.run().ended(0);
        let found = rows(&c);
        let shared = if group == "flight" { "flight-2" } else { "" };
        assert!(found.contains(&row([name, shared, "", "K"])), "{found:?}");
        assert!(found.contains(&row([name, "flight-2", "", "T"])), "{found:?}");
        assert!(found.contains(&row([name, "flight-2", "flight-2.03", "y_0"])), "{found:?}");
    }
}

#[test]
fn an_absolute_pattern_finds_the_logs_from_anywhere() {
    let c = Campaign::new();
    let logs = c.path("logs").canonicalize().expect("a folder");
    let elsewhere = tempfile::tempdir().expect("a temporary folder");
    let flights = |pattern: &str, from: &std::path::Path| {
        c.write("pipeline.toml", &crate::campaign::PIPELINE.replace("logs/*.mcap", pattern));
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
        command
            .current_dir(from)
            .arg("check")
            .arg(c.path("pipeline.toml").canonicalize().expect("a file"));
        let output = command.output().expect("started");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout) + &text(&output.stderr))
    };
    for pattern in ["flight-*.mcap", "*.mcap", "flight-[123].mcap"].map(|p| logs.join(p)) {
        let pattern = pattern.to_string_lossy();
        for from in [c.folder.path(), elsewhere.path()] {
            let (code, told) = flights(&pattern, from);
            assert!(
                code == Some(0) && told.contains("3 flights"),
                "{pattern} from {}: {told}",
                from.display()
            );
        }
    }
    let (code, told) = flights(&logs.join("none-*.mcap").to_string_lossy(), elsewhere.path());
    assert!(
        code == Some(2) && told.contains(&*logs.join("none-*.mcap").to_string_lossy()),
        "{told}"
    );
}

#[test]
fn windows_scored_outputs_and_least_amplitudes_are_those_asked_for() {
    let c = Campaign::new();
    c.write("plain.model.toml", crate::campaign::MODEL);
    c.edit("lag.model.toml", "u = \"rad\"", "u = \"rad\"\nV_0 = \"m/s\"");
    c.edit("lag.model.toml", "[states]", "[equations]\nslow = \"V_0\"\n[states]");
    c.edit(
        "lag.model.toml",
        "value = \"x + y_0\" }",
        "value = \"x + y_0\" }\nslow = { unit = \"m/s\", value = \"slow\" }",
    );
    c.edit(
        "pipeline.toml",
        "kinds = [\"3211\"]",
        "kinds = [\"3211\"]\nheld = { V_0 = \"V\" }\nunscored = [\"slow\"]\nsettle_s = 1.0",
    );
    let whole = "[[estimate]]\nname = \"windows\"\nmodel = \"plain.model.toml\"\nwindow_s = 25.0\n\n[[fit]]";
    c.edit("pipeline.toml", "[[fit]]", whole);
    c.run().ended(0);
    let responses = read_dataset(&c.path("out"), "responses").expect("responses");
    let text = |name: &str| responses.strings(name).expect("column");
    assert!(text("output").iter().all(|output| *output == "y"), "only what is scored");
    let of = |model: &str| -> BTreeSet<&str> {
        (0..responses.rows())
            .filter(|&i| text("model")[i] == model)
            .map(|i| text("segment")[i])
            .collect()
    };
    assert_eq!(of("lag").len(), 12);
    // Flights of 80 s in windows of at most 25 s.
    assert!(
        of("windows").contains("flight-3-004") && of("windows").len() == 12,
        "{:?}",
        of("windows")
    );

    // The maneuvers have 2 deg: a least amplitude of 3 deg leaves none.
    c.edit(
        "pipeline.toml",
        "signal = \"u\"",
        "signal = \"u\"\n[segment.input.method]\nmin_amplitude = 0.052",
    );
    let run = c.run().ended(1);
    assert!(
        run.err.contains("no maneuver") || run.out.contains("no maneuver"),
        "{}\n{}",
        run.out,
        run.err
    );
}

#[test]
fn effects_of_ones_own_are_one_folder_or_several() {
    let c = Campaign::new();
    let text = std::fs::read_to_string(c.path("pipeline.toml")).expect("readable");
    for (name, file) in [("mine", "a"), ("yours", "b")] {
        std::fs::create_dir(c.path(name)).expect("made");
        c.write(&format!("{name}/{file}.toml"), "title = 3\n");
    }
    for (given, wanted) in [
        ("\"mine\"", &["mine/a.toml"][..]),
        ("[\"mine\", \"yours\"]", &["mine/a.toml", "yours/b.toml"]),
    ] {
        c.write(
            "pipeline.toml",
            &format!("{text}\n[[diagnose]]\nestimate = \"lag\"\neffects = {given}\n"),
        );
        let check = c.koehler("check", &[]).ended(2);
        assert!(wanted.iter().all(|w| check.err.contains(w)), "{}", check.err);
        assert_eq!(check.err.contains("yours/b.toml"), wanted.len() == 2, "{}", check.err);
    }
    c.write(
        "pipeline.toml",
        &format!("{text}\n[[diagnose]]\nestimate = \"lag\"\neffects = \"theirs\"\n"),
    );
    let check = c.koehler("check", &[]).ended(2);
    assert!(
        check.err.contains("pipeline.toml:29:11") && check.err.contains("there is no folder"),
        "{}",
        check.err
    );
}
