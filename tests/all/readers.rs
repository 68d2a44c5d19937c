//! What readers of the results meet: columns that no reader takes for one, the flight and segment of every estimate, logs found from anywhere.

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
    for wanted in
        ["channels.toml:17:", "\"V\" and \"v\"", "channels.toml:22:", "\"t_s\" and \"T_s\"", "give one of them another name"]
    {
        assert!(check.err.contains(wanted), "{wanted} is not in\n{}", check.err);
    }
    assert!(!c.run().ended(2).err.contains("no log"));

    // The flight path has a column "Mach", and a V beside its v_body.
    let c = Campaign::new();
    let inputs = ["ax_imu", "ay_imu", "az_imu", "p_imu", "q_imu", "r_imu", "temperature", "static_pressure", "mach"];
    let units = ["m/s^2", "m/s^2", "m/s^2", "rad/s", "rad/s", "rad/s", "K", "Pa", "1"];
    let mut text = std::fs::read_to_string(c.path("channels.toml")).expect("readable");
    for (name, unit) in inputs.iter().zip(units) {
        text += &format!("\n[signal.{name}]\ntopic = \"/air\"\nfield = \"speed\"\nunit = \"{unit}\"\n");
    }
    c.write("channels.toml", &text);
    c.edit("pipeline.toml", "[derive]", "[reconstruct]\n\n[derive]");
    c.edit("pipeline.toml", "channels = ", "aircraft = \"aircraft.toml\"\nchannels = ");
    let places = ["x_imu", "y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"];
    let given = |name: &str, unit: &str| format!("{name} = {{ value = 0.0, unit = \"{unit}\", sd = 0.0, source = \"test\" }}\n");
    let constants: String = places.iter().map(|name| given(name, "m")).chain([given("upwash", "-")]).collect();
    c.write("aircraft.toml", &constants);
    let check = c.koehler("check", &[]).ended(2);
    assert!(check.err.contains("\"mach\" and \"Mach\"") && check.err.contains("call the signal \"Mach\""), "{}", check.err);
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
        assert!(group == segment && segment.starts_with(&format!("{flight}.")), "{group}: {flight} {segment}");
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
        command.current_dir(from).arg("check").arg(c.path("pipeline.toml").canonicalize().expect("a file"));
        let output = command.output().expect("started");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout) + &text(&output.stderr))
    };
    for pattern in ["flight-*.mcap", "*.mcap", "flight-[123].mcap"].map(|p| logs.join(p)) {
        let pattern = pattern.to_string_lossy();
        for from in [c.folder.path(), elsewhere.path()] {
            let (code, told) = flights(&pattern, from);
            assert!(code == Some(0) && told.contains("3 flights"), "{pattern} from {}: {told}", from.display());
        }
    }
    let (code, told) = flights(&logs.join("none-*.mcap").to_string_lossy(), elsewhere.path());
    assert!(code == Some(2) && told.contains(&*logs.join("none-*.mcap").to_string_lossy()), "{told}");
}
