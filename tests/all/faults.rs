//! Bad input: one clear message or a counted note, results for the rest, a non-zero exit when
//! anything asked for is missing.

use crate::campaign::{Campaign, write_log, write_log_seen};

#[test]
fn mistakes_of_all_files_are_reported_at_once_and_before_any_log_is_read() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = -1.0");
    c.edit("pipeline.toml", "against = \"V\"", "against = \"Mach\"");
    c.edit("channels.toml", "unit = \"m/s\"", "unit = \"furlong\"");
    c.edit("lag.model.toml", "(K*u - x)/T", "(K*uu - x)/T");
    c.edit("lag.model.toml", "x + y_0", "x + T");
    // A log that cannot be read would be an error of its own, were it read.
    std::fs::write(c.path("logs/flight-1.mcap"), b"no log").expect("written");
    let run = c.run().ended(2);
    for wanted in ["pipeline.toml:7:11", "channels.toml:", "furlong", "lag.model.toml:", "uu"] {
        assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
    }
    assert!(!run.err.contains("no log"), "{}", run.err);
    assert!(!c.path("out").exists());
}

#[test]
fn fault_absurd_settings_are_refused_by_name() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 1e12");
    let run = c.koehler("check", &[]).ended(2);
    for wanted in ["pipeline.toml:7:11", "10000 at most", "1000000000000"] {
        assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
    }
    const N: usize = 100_000;
    let deep = format!("{}x{}", "(".repeat(N), ")".repeat(N));
    for (value, wanted) in [(deep, "nested deeper"), (vec!["x"; N].join("+"), "1000 operations")] {
        let c = Campaign::new();
        c.edit("lag.model.toml", "x + y_0", &value);
        let run = c.koehler("check", &[]).ended(2);
        for wanted in ["lag.model.toml:16:", wanted] {
            assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
        }
    }
}

#[test]
fn a_key_that_does_not_fit_does_not_hide_a_name_that_is_not_there() {
    let c = Campaign::new();
    c.edit(
        "pipeline.toml",
        "kinds = [\"3211\"]",
        "kinds = [\"3211\"]\npre_s = \"fast\"\nspeed = 3",
    );
    c.edit("pipeline.toml", "against = \"V\"", "against = \"Mach\"");
    let run = c.koehler("check", &[]).ended(2);
    for wanted in ["\"fast\"", "\"speed\"", "\"Mach\""] {
        assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
    }
}

#[test]
fn mistakes_of_the_channel_map_do_not_hide_a_name_that_is_not_there() {
    for (old, new, wanted) in [
        ("unit = \"m/s\"", "unit = \"furlong\"", "\"furlong\""),
        ("unit = \"m/s\"", "unit = \"m/s\"\nscale = \"2\"", "the text \"2\""),
        ("unit = \"m/s\"", "unit = \"m/s\"\nsgin = 1", "\"sgin\""),
    ] {
        let c = Campaign::new();
        c.edit("channels.toml", old, new);
        c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = \"100\"");
        c.edit("pipeline.toml", "against = \"V\"", "against = \"Mach\"");
        c.edit("channels.toml", "topic = \"/air\"", "topic = \"/airs\"");
        let run = c.koehler("check", &[]).ended(2);
        for wanted in [wanted, "the text \"100\"", "\"Mach\"", "\"/airs\"", "4 errors"] {
            assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
        }
    }
}

/// The shipped campaign, whose flight path drives `[derive]`, which drives its model: a mistake at
/// the beginning touches all behind it.
fn chained() -> Campaign {
    let c = Campaign { folder: tempfile::tempdir().expect("a temporary folder") };
    let from = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation");
    for entry in std::fs::read_dir(from).expect("readable") {
        let path = entry.expect("readable").path();
        if path.extension().is_some_and(|e| e == "toml") {
            std::fs::copy(&path, c.path(&path.file_name().expect("a name").to_string_lossy()))
                .expect("copied");
        }
    }
    // Without the joint fit of the same lines, which would be a second place for every mistake.
    let text = std::fs::read_to_string(c.path("pipeline.toml")).expect("readable");
    let (before, rest) = text.split_once("# --- the same lines in one fit").expect("the joint fit");
    let (_, report) = rest.split_once("[report]").expect("a report");
    c.write("pipeline.toml", &format!("{before}[report]{report}"));
    c
}

/// The first lines of the mistakes that a check finds.
fn mistakes(c: &Campaign) -> Vec<String> {
    let run = c.koehler("check", &[]).ended(2);
    run.err.lines().filter_map(|line| line.strip_prefix("error: ")).map(str::to_string).collect()
}

#[test]
fn a_mistake_is_told_without_those_that_only_follow_from_it() {
    let g = "field = \"acceleration.x\", unit = \"g\"";
    for (file, old, new, wanted) in [
        // signals, the flight path, what is derived, what drives the model, the model
        ("channels.toml", g, "field = \"acceleration.x\", unit = \"kg\"", "\"ax_imu\" is in kg"),
        ("channels.toml", g, "field = \"acceleration.x\", unit = \"furlong\"", "\"furlong\""),
        (
            "pipeline.toml",
            "[reconstruct.method]",
            "[reconstruct]\nfragment = \"kinematic\"\n\n[reconstruct.method]",
            "\"kinematic\"",
        ),
        ("derived.model.toml", "\"alphadot_w\"", "\"alphadot_ww\"", "\"alphadot_ww\""),
        ("derived.model.toml", "title  =", "title  ", "derived.model.toml:1"),
        (
            "channels.toml",
            "field = \"elevator\", unit = \"deg\"",
            "field = \"elevator\", unit = \"kg\"",
            "in kg",
        ),
        (
            "channels.toml",
            "field = \"elevator\", unit = \"deg\"",
            "field = \"elevator\", unit = \"furlong\"",
            "\"furlong\" is not a known unit",
        ),
        (
            "elevator-linkage.model.toml",
            "unit = \"rad\", value = \"delta_e\"",
            "unit = \"rad\", value = \"delta\"",
            "\"delta\"",
        ),
    ] {
        let c = chained();
        c.edit(file, old, new);
        let found = mistakes(&c);
        assert!(found.len() == 1 && found[0].contains(wanted), "{file}, {new}: {found:#?}");
    }
}

#[test]
fn a_wrong_unit_is_told_once_where_it_is_stated_with_all_that_want_the_signal() {
    for (signal, unit, wanted) in [("ax_imu", "g", "m/s^2"), ("temperature", "degC", "K")] {
        let c = chained();
        let map = std::fs::read_to_string(c.path("channels.toml")).expect("the channel map");
        let line = map.lines().find(|l| l.starts_with(signal)).expect("the signal's line");
        let wrong = line.replace(&format!("unit = \"{unit}\""), "unit = \"kg\"");
        c.edit("channels.toml", line, &wrong);
        let err = c.koehler("check", &[]).ended(2).err;
        let told = format!("signal \"{signal}\" is in kg, {wanted} is wanted");
        assert!(
            err.starts_with("error: channels.toml:") && err.matches(&told).count() == 1,
            "{err}"
        );
        assert!(err.contains("the kinematic model wants it at pipeline.toml:"), "{err}");
        let input = format!("input \"{signal}\" of the model wants it at pipeline.toml:");
        assert_eq!(err.contains(&input), signal == "temperature", "{err}");
        assert!(!err.contains("errors"), "{err}");
    }
}

/// The same with several sections for each file, model and signal.
fn shared() -> Campaign {
    let c = chained();
    let more = r#"
[[estimate]]
name = "joint"
model = "elevator.model.toml"
input = "elevator"
group = "all"

[[estimate]]
name = "both"
model = "elevator.model.toml"
input = ["elevator", "aileron"]
levels = { V = [80.0, 120.0] }

[[fit]]
name = "gain"
estimate = "elevator"
parameters = ["C_h_delta"]
against = "alpha"

[[diagnose]]
estimate = "joint"

[[diagnose]]
estimate = "both"
"#;
    let text = std::fs::read_to_string(c.path("pipeline.toml")).expect("readable");
    c.write("pipeline.toml", &(text + more));
    c
}

/// The first lines of the mistakes that a check finds, with the other places of each.
fn told(c: &Campaign) -> Vec<String> {
    let run = c.koehler("check", &[]).ended(2);
    let mut all: Vec<String> = Vec::new();
    for line in run.err.lines() {
        match (line.strip_prefix("error: "), all.last_mut()) {
            (Some(error), _) => all.push(error.to_string()),
            (None, Some(last)) if line.trim_start().starts_with("the same at") => {
                *last += &format!("; {}", line.trim_start());
            }
            _ => (),
        }
    }
    all
}

#[test]
fn a_constant_by_another_name_is_asked_for() {
    let c = chained();
    c.edit("aircraft.toml", "\nS_e  ", "\nS_ee ");
    let err = c.koehler("check", &[]).ended(2).err;
    assert!(err.contains("did you mean this by \"S_ee\" of the aircraft file?"), "{err}");
}

#[test]
fn a_mistake_in_what_many_sections_use_is_told_once() {
    let mut wrong = String::new();
    for (file, old, new, wanted) in [
        (
            "aircraft.toml",
            "\nS_e  ",
            "\nS_ee ",
            &[
                "elevator-controls.model.toml:21:1: constant \"S_e\" has no value; the same at elevator.model.toml:16:1",
            ][..],
        ),
        (
            "aircraft.toml",
            "\nI_xz ",
            "\nI_zx ",
            &["<rigid_body_6dof>:19:1: constant \"I_xz\" has no value"],
        ),
        (
            "aircraft.toml",
            "\nS        = { value = 30.0",
            "\nS        = { valu = 30.0",
            &["aircraft.toml:11:14: unknown key \"valu\" in \"S\""],
        ),
        (
            "aircraft.toml",
            "\nS        = { value",
            "\nS        = value",
            &[
                "aircraft.toml:11:12: this is not TOML: string values must be quoted, expected literal string",
            ],
        ),
        (
            "aircraft.toml",
            "value = 30.0, unit = \"m^2\"",
            "value = 30.0, unit = \"kg\"",
            &["aerodynamics.model.toml:14:5: \"S\" is in m^2 here, and in kg in the aircraft file"],
        ),
        (
            "elevator.model.toml",
            "\nC_h_alpha ",
            "\nC_h_alfa ",
            &["elevator.model.toml:30:60: unknown name \"C_h_alpha\""],
        ),
        (
            "elevator.model.toml",
            "\nC_h_delta ",
            "\nC_h_dleta ",
            &["elevator.model.toml:30:13: unknown name \"C_h_delta\""],
        ),
        (
            "elevator-controls.model.toml",
            "\nS_e ",
            "\nS_f ",
            &[
                "elevator-controls.model.toml:56:14: unknown name \"S_e\"; the same at leveller.model.toml:50:35",
            ],
        ),
        (
            "derived.model.toml",
            "\"alphadot_w\"",
            "\"alphadot_ww\"",
            &["derived.model.toml:41:43: unknown name \"alphadot_ww\""],
        ),
        (
            "channels.toml",
            "\ndelta_e  =",
            "\ndelta_ee =",
            &[
                "pipeline.toml:30:1: output \"delta_e\" of the model has no signal of this name, and none is mapped to it; the same at pipeline.toml:186:1, pipeline.toml:192:1",
            ],
        ),
        (
            "channels.toml",
            "\nservo_current_e",
            "\nservo_current_f",
            &["pipeline.toml:15:37: there is no signal \"servo_current_e\""],
        ),
        (
            "channels.toml",
            "\nq_imu",
            "\nq_imuu",
            &["pipeline.toml:7:2: the kinematic model needs the signal \"q_imu\" (pitch rate)"],
        ),
        ("campaign.toml", "truth.model", "trth.model", &["trth.model.toml: there is no such file"]),
        (
            "pipeline.toml",
            "\"campaign.toml\"",
            "\"campain.toml\"",
            &["pipeline.toml:5:12: there is no file campain.toml"],
        ),
        (
            "pipeline.toml",
            "\"aircraft.toml\"",
            "\"aircrft.toml\"",
            &["pipeline.toml:2:12: there is no file aircrft.toml"],
        ),
        (
            "pipeline.toml",
            "name   = \"elevator\"\nsignal",
            "name   = \"elevatr\"\nsignal",
            &[
                "pipeline.toml:33:10: there is no [[segment.input]] \"elevator\"; the same at pipeline.toml:189:9, pipeline.toml:195:9",
            ],
        ),
        (
            "pipeline.toml",
            "name   = \"elevator\"\nmodel",
            "name   = \"elevatr\"\nmodel",
            &[
                "pipeline.toml:49:14: there is no [[estimate]] \"elevator\"; the same at pipeline.toml:56:14, pipeline.toml:200:12",
            ],
        ),
        (
            "pipeline.toml",
            "name   = \"elevator\"\nmodel",
            "name   = 3\nmodel",
            &["pipeline.toml:31:10: \"estimate.0.name\" must be a text, not 3"],
        ),
        (
            "pipeline.toml",
            "\nmodel  = \"elevator.model.toml\"",
            "\nmodel  = 3",
            &["pipeline.toml:32:10: \"estimate.0.model\" must be a text, not 3"],
        ),
        (
            "pipeline.toml",
            "\n[derive]",
            "\n[derive",
            &["pipeline.toml:12:8: this is not TOML: unclosed table, expected `]`"],
        ),
        (
            "pipeline.toml",
            "\nsimulate = ",
            "\nsimlate = ",
            &["pipeline.toml:5:1: unknown key \"simlate\""],
        ),
        (
            "pipeline.toml",
            "\naircraft = ",
            "\naircrafft = ",
            &["pipeline.toml:2:1: unknown key \"aircrafft\""],
        ),
        (
            "pipeline.toml",
            "name   = \"elevator\"\nsignal",
            "nam    = \"elevator\"\nsignal",
            &["pipeline.toml:20:1: unknown key \"nam\" in \"segment.input.0\""],
        ),
        (
            "pipeline.toml",
            "name = \"joint\"",
            "nmae = \"joint\"",
            &["pipeline.toml:187:1: unknown key \"nmae\" in \"estimate.1\""],
        ),
        (
            "channels.toml",
            "\ntemperature",
            "\ntemperatur_",
            &[
                "pipeline.toml:7:2: the kinematic model needs the signal \"temperature\" (static air temperature)",
            ],
        ),
        (
            "pipeline.toml",
            "\npre_s  = 1.0",
            "\npre_s  = 1.0\noutputs = { delta_f = \"delta_e\" }",
            &["pipeline.toml:37:23: there is no output of the model \"delta_f\""],
        ),
    ] {
        let c = shared();
        c.edit(file, old, new);
        let said = told(&c);
        if said != *wanted {
            wrong.push_str(&format!("{file}: {new}\n  said:   {said:?}\n  wanted: {wanted:?}\n"));
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn a_mistake_at_the_beginning_hides_none_behind_it() {
    let wrong = ["\"comand_a\"", "\"alfa\"", "\"C_h_O\"", "\"3212\""];
    for (file, old, new) in [
        (
            "channels.toml",
            "field = \"acceleration.x\", unit = \"g\"",
            "field = \"acceleration.x\", unit = \"kg\"",
        ),
        (
            "pipeline.toml",
            "[reconstruct.method]",
            "[reconstruct]\nfragment = \"kinematic\"\n\n[reconstruct.method]",
        ),
        ("derived.model.toml", "\"alphadot_w\"", "\"alphadot_ww\""),
    ] {
        let c = chained();
        c.edit("pipeline.toml", "\"command_a\"", wrong[0]);
        c.edit("pipeline.toml", "= \"alpha\"", &format!("= {}", wrong[1]));
        c.edit("pipeline.toml", "\"C_h_0\"", wrong[2]);
        c.edit("pipeline.toml", "\"3211\"", wrong[3]);
        c.edit(file, old, new);
        let found = mistakes(&c);
        let told = |name: &&str| found.iter().any(|line| line.contains(*name));
        assert!(found.len() == 1 + wrong.len() && wrong.iter().all(told), "{file}: {found:#?}");
    }
}

#[test]
fn a_role_that_is_none_and_one_that_nothing_plays_are_refused() {
    let c = Campaign::new();
    let roles = "[[diagnose]]\nestimate = \"lag\"\nroles = { elevatr = [\"u\"], elevator = [\"uu\"], surface = [\"u\"], airspeed = [\"u\"] }\n\n[[fit]]";
    c.edit("pipeline.toml", "[[fit]]", roles);
    let run = c.koehler("check", &[]).ended(2);
    assert!(
        run.err.contains("\"elevatr\"") && run.err.contains("\"uu\" is nothing of the model"),
        "{}",
        run.err
    );
    assert!(!run.err.contains("\"surface\""), "{}", run.err);
    assert!(run.err.contains("u has unit rad, and \"airspeed\" has m/s"), "{}", run.err);
}

#[test]
fn an_effect_of_ones_own_that_no_model_can_have_is_a_mistake_of_its_file() {
    let c = Campaign::new();
    c.edit(
        "pipeline.toml",
        "[[fit]]",
        "[[diagnose]]\nestimate = \"lag\"\neffects = \"mine\"\n\n[[fit]]",
    );
    std::fs::create_dir(c.path("mine")).expect("a folder");
    let effect = "title = \"t\"\nfamily = \"sensor\"\nsignature = \"s\"\n[bind]\ny = \"sensor\"\n[parameters]\n\
                  k = { unit = \"rad\", null = 0.0 }\n[add]\n\"{y}\" = \"{k}\"\n";
    c.write("mine/zero.toml", effect);
    c.koehler("check", &[]).ended(0);
    for (sound, wrong) in [("unit = \"rad\"", "unit = \"m\""), ("= \"{k}\"", "= \"{k}*qq\"")] {
        c.write("mine/zero.toml", &effect.replace(sound, wrong));
        let check = c.koehler("check", &[]).ended(2);
        let told = "zero.toml: the model lag cannot be had with this effect";
        assert!(check.err.contains(told), "{}", check.err);
    }
    // What the model has nothing of is no mistake: a folder may serve several aircraft.
    c.write("mine/zero.toml", &effect.replace("\"sensor\"\n[p", "\"elevator\"\n[p"));
    c.koehler("check", &[]).ended(0);
}

#[test]
fn settings_of_an_estimate_that_do_not_go_together_are_refused_by_check() {
    let c = Campaign::new();
    let many: Vec<String> = (0..70).map(|k| format!("{}.0", k + 1)).collect();
    let method = format!(
        "window_s = 5.0\nkinds = [\"3211\"]\n[estimate.method]\ntries = {{ K = [{}] }}\n",
        many.join(", ")
    );
    c.edit("pipeline.toml", "kinds = [\"3211\"]\n", &method);
    let check = c.koehler("check", &[]).ended(2);
    let both = ["`tries` makes 70 starts, and 64 are the most", "`window_s` cuts whole records"];
    assert!(both.iter().all(|what| check.err.contains(what)), "{}", check.err);
}

#[test]
fn a_missing_file_is_named_where_it_is_asked_for() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "lag.model.toml", "lead.model.toml");
    c.edit("pipeline.toml", "logs/*.mcap", "logs/flight-9.mcap");
    let run = c.run().ended(2);
    assert!(
        run.err.contains("lead.model.toml") && run.err.contains("flight-9.mcap"),
        "{}",
        run.err
    );
    let none = c.koehler("check", &[]).ended(2);
    assert!(none.err.contains("pipeline.toml:"), "{}", none.err);
}

#[test]
fn a_unit_error_in_a_model_has_line_and_column() {
    let c = Campaign::new();
    c.edit("lag.model.toml", "x + y_0", "x + T");
    let run = c.koehler("check", &[]).ended(2);
    assert!(run.err.contains("lag.model.toml:16:"), "{}", run.err);
}

#[test]
fn a_column_in_another_unit_is_refused() {
    let c = Campaign::new();
    c.edit(
        "channels.toml",
        "field = \"command\"\nunit = \"deg\"",
        "field = \"command\"\nunit = \"m\"",
    );
    let run = c.koehler("check", &[]).ended(2);
    assert!(run.err.contains("\"u\""), "{}", run.err);
}

/// The other flights have results, the exit code is 1, and the message says what is wrong.
fn partial(c: &Campaign, wanted: &[&str]) {
    let run = c.run().ended(1);
    for text in wanted {
        assert!(
            run.err.contains(text) || run.out.contains(text),
            "{text} is not in\n{}\n{}",
            run.err,
            run.out
        );
    }
    let estimates = koehler::table::read_dataset(&c.path("out"), "estimates").expect("estimates");
    assert!(estimates.rows() > 0);
    let notes = koehler::table::read_dataset(&c.path("out"), "notes").expect("notes");
    assert!(notes.strings("severity").expect("column").contains(&"missing"));
    // The second run remembers what is missing.
    c.run().ended(1);
}

#[test]
fn an_empty_log_and_a_log_that_is_none_stop_only_their_flights() {
    let c = Campaign::new();
    std::fs::write(c.path("logs/flight-1.mcap"), b"").expect("written");
    partial(&c, &["flight-1.mcap"]);
    std::fs::write(c.path("logs/flight-1.mcap"), b"this is a text file").expect("written");
    partial(&c, &["flight-1.mcap"]);
    assert!(!c.path("out/signals/flight=flight-1").exists());
}

#[test]
fn fault_a_log_that_is_named_and_not_there_stops_only_its_flight() {
    let c = Campaign::new();
    let named = "[\"logs/flight-1.mcap\", \"logs/flight-9.mcap\", \"logs/flight-2.mcap\"]";
    c.edit("pipeline.toml", "[\"logs/*.mcap\"]", named);
    let missing = "there is no log logs/flight-9.mcap";
    let check = c.koehler("check", &[]).ended(2);
    assert!(check.err.contains("pipeline.toml:4:") && check.err.contains(missing), "{}", check.err);
    partial(&c, &[missing]);
    let status = c.koehler("status", &[]).ended(0);
    assert!(status.out.ends_with("a run would do 1 unit of work\n"), "{}", status.out);
    c.fly("flight-9", 5, 2);
    c.run().ended(0);
    // Where none is there, the list is wrong.
    c.edit("pipeline.toml", "logs/flight-", "log/flight-");
    let run = c.run().ended(2);
    for log in ["log/flight-1.mcap", "log/flight-9.mcap", "log/flight-2.mcap"] {
        assert!(run.err.contains(log), "{}", run.err);
    }
}

#[test]
fn a_log_cut_short_gives_what_is_intact_and_a_note() {
    let c = Campaign::new();
    let path = c.path("logs/flight-2.mcap");
    let bytes = std::fs::read(&path).expect("readable");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    let run = c.run();
    assert!(run.code < 2, "{}\n{}", run.out, run.err);
    let notes = koehler::table::read_dataset(&c.path("out"), "notes").expect("notes");
    let flights = notes.strings("flight").expect("column");
    assert!(flights.contains(&"flight-2"), "{}\n{}", run.out, run.err);
}

#[test]
fn a_topic_or_field_that_is_not_there_is_named() {
    let c = Campaign::new();
    c.fly("flight-4", 5, 2);
    // Flight 5 is from another recorder.
    let mut writer =
        koehler::log::LogWriter::create(&c.path("logs/flight-5.mcap")).expect("created");
    let topic = writer
        .add_topic("/sensors", &[koehler::log::FieldSpec::new("angel", "deg", "")])
        .expect("topic");
    writer.write(topic, 1, 1, &[0.0]).expect("written");
    writer.finish().expect("finished");
    partial(&c, &["channels.toml", "/sensors"]);

    let c = Campaign::new();
    c.edit("channels.toml", "field = \"angle\"", "field = \"angel\"");
    // in no log: a mistake of the channel map, found before work starts
    let run = c.run().ended(2);
    assert!(run.err.contains("channels.toml:9") && run.err.contains("angle"), "{}", run.err);
    assert!(!c.path("out/signals").exists());
}

#[test]
fn a_unit_that_is_not_the_logs_is_found_before_work_starts() {
    let c = Campaign::new();
    c.edit(
        "channels.toml",
        "field = \"speed\"\nunit = \"m/s\"",
        "field = \"speed\"\nunit = \"kt\"",
    );
    c.edit("channels.toml", "\"/drive\"", "\"/drives\"");
    for verb in ["check", "run"] {
        let said = c.koehler(verb, &[]).ended(2);
        for wanted in [
            "\"kt\"",
            "\"m/s\"",
            "despite = ",
            "it has \"/drive\"",
            "flight-1.mcap, flight-2.mcap, flight-3.mcap",
        ] {
            assert!(said.err.contains(wanted), "{wanted} is not in\n{}", said.err);
        }
        assert!(!c.path("out/signals").exists());
    }
    c.edit("channels.toml", "\"/drives\"", "\"/drive\"");
    c.edit("channels.toml", "unit = \"kt\"", "unit = \"kt\"\ndespite = \"m/s\"");
    c.koehler("check", &[]).ended(0);
    // a log without a summary is no mistake, and is said
    let path = c.path("logs/flight-2.mcap");
    let bytes = std::fs::read(&path).expect("readable");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    let said = c.koehler("check", &[]).ended(0);
    assert!(
        said.err.contains("flight-2.mcap") && said.out.contains("2 logs"),
        "{}\n{}",
        said.out,
        said.err
    );
}

#[test]
fn an_output_that_is_its_own_input_is_refused() {
    let c = Campaign::new();
    c.edit(
        "lag.model.toml",
        "[outputs]\n",
        "[outputs]\ndrive = { unit = \"rad\", value = \"u\" }\n",
    );
    c.edit(
        "pipeline.toml",
        "kinds = [\"3211\"]",
        "kinds = [\"3211\"]\noutputs = { drive = \"u\" }",
    );
    let said = c.koehler("check", &[]).ended(2);
    assert!(
        said.err.contains("compared with itself") && said.err.contains("unscored"),
        "{}",
        said.err
    );
    c.edit("pipeline.toml", "outputs = { drive = \"u\" }", "unscored = [\"drive\"]");
    c.koehler("check", &[]).ended(0);
}

#[test]
fn fault_a_stamp_years_after_all_others_is_dropped_and_told() {
    let c = Campaign::new();
    let mut writer =
        koehler::log::LogWriter::create(&c.path("logs/flight-4.mcap")).expect("created");
    let fields =
        [("/drive", "command", "deg"), ("/sensor", "angle", "deg"), ("/air", "speed", "m/s")];
    let topics = fields.map(|(topic, field, unit)| {
        writer.add_topic(topic, &[koehler::log::FieldSpec::new(field, unit, "")]).expect("a topic")
    });
    for k in 0..400u64 {
        let at =
            1_000_000_000 + 25_000_000 * k + if k == 399 { 1_000_000_000_000_000_000 } else { 0 };
        topics.iter().for_each(|&topic| writer.write(topic, at, at, &[k as f64]).expect("written"));
    }
    writer.finish().expect("finished");
    let run = c.run();
    assert!(run.code < 2, "{}\n{}", run.out, run.err);
    let notes = koehler::table::read_dataset(&c.path("out"), "notes").expect("notes");
    let told = notes.strings("text").expect("texts");
    assert!(told.iter().any(|text| text.contains("more than a day from the others")), "{told:?}");
    let channels = koehler::table::read_dataset(&c.path("out"), "channels").expect("channels");
    assert_eq!(channels.i64("dropped_times").expect("counts").iter().sum::<i64>(), 3);
}

#[test]
fn a_burst_of_nan_is_counted_and_the_rest_is_used() {
    let c = Campaign::new();
    write_log(&c.path("logs/flight-2.mcap"), 1, 4, |t| (26.0..26.5).contains(&t));
    c.run().ended(0);
    let channels = koehler::table::read_part(&c.path("out"), "channels", Some("flight-2"), 0)
        .expect("channels");
    let row =
        channels.strings("signal").expect("column").iter().position(|s| *s == "y").expect("a row");
    assert_eq!(channels.i64("dropped_nan").expect("column")[row], 20);
    let fits = koehler::table::read_dataset(&c.path("out"), "fits").expect("fits");
    assert_eq!(fits.i64("n").expect("column"), [12, 12]);
}

#[test]
fn fault_a_sensor_that_froze_is_a_problem_that_is_named() {
    let c = Campaign::new();
    let sound = c.run();
    assert!(
        !sound.err.contains("still") && !sound.out.contains("still"),
        "{}\n{}",
        sound.out,
        sound.err
    );
    let mut last = 0.0;
    write_log_seen(&c.path("logs/flight-2.mcap"), 1, 4, |t, y| {
        if t < 40.0 {
            last = y;
        }
        last
    });
    // What it repeats is left out by itself, and what it lacks then is missing.
    let run = c.run().ended(1);
    let said = format!("{}\n{}", run.out, run.err);
    assert!(said.contains("/sensor angle: stands still from 40.0 to 80.0 s"), "{said}");
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a page");
    assert!(page.contains("stood still, and are left out there: flight-2 y (from 40.0 s"));
    let fits = koehler::table::read_dataset(&c.path("out"), "fits").expect("fits");
    assert_eq!(fits.i64("n").expect("column"), [10, 10]);
    // A setting keeps it; then it is estimated from, which is a problem.
    c.edit("channels.toml", "[signal.y]\n", "[signal.y]\nstill = \"keep\"\n");
    let run = c.run().ended(1);
    let said = format!("{}\n{}", run.out, run.err);
    assert!(
        said.contains("stand still in what is estimated: flight-2 y (from 40.0 s for 40.0 s, a tenth or more of 2 maneuvers)"),
        "{said}"
    );
}

/// `w` is made with a signal that no log has: the search finds maneuvers, and no estimate can be made.
#[test]
fn fault_an_optional_signal_that_is_missing_is_told_with_the_stages_that_miss_it() {
    let c = Campaign::new();
    let optional =
        "[signal.q]\ntopic = \"/imu\"\nfield = \"rate\"\nunit = \"deg/s\"\noptional = true\n";
    c.edit("channels.toml", "[signal.V]", &format!("{optional}\n[signal.V]"));
    assert!(c.run().code < 2);
    c.write(
        "derived.model.toml",
        "title = \"Turning\"\n[inputs]\nu = \"rad\"\nq = \"rad/s\"\n[outputs]\nw = { unit = \"rad\", value = \"u\" }\nturn = { unit = \"rad/s\", value = \"q\" }\n",
    );
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 100.0\nmodel = \"derived.model.toml\"");
    c.edit("pipeline.toml", "kinds = [\"3211\"]", "kinds = [\"3211\"]\ninputs = { u = \"w\" }");
    let run = c.run().ended(1);
    for wanted in [
        "q: no sample in flight-1, flight-2, flight-3; missed by estimate",
        "nothing is derived in this flight: no value of q",
    ] {
        assert!(run.out.contains(wanted), "{wanted} is not in\n{}", run.out);
    }
    // What is searched may be lacking as well: the other inputs go on.
    let other = "[[segment.input]]\nname = \"turn\"\nsignal = \"q\"\n\n[[estimate]]";
    c.edit("pipeline.toml", "[[estimate]]", other);
    let run = c.run().ended(1);
    for wanted in
        ["missed by segment, estimate", "no maneuver in `q`: this flight has no sample of it"]
    {
        assert!(run.out.contains(wanted), "{wanted} is not in\n{}", run.out);
    }
    let segments = koehler::table::read_dataset(&c.path("out"), "segments").expect("segments");
    assert_eq!(segments.rows(), 12);
}

#[test]
fn a_flight_without_a_maneuver_is_noted_and_the_others_are_estimated() {
    let c = Campaign::new();
    c.fly("flight-2", 1, 0);
    partial(&c, &["no maneuver"]);
}

#[test]
fn usage_errors_have_their_own_exit_code() {
    let c = Campaign::new();
    c.koehler("runn", &[]).ended(2);
    c.koehler("run", &["--jobs", "many"]).ended(2);
}
