//! Held values flown through maneuvers that they were not found from: what is refused, and what the
//! table says.

use crate::campaign::{Campaign, INTERCEPT, LAG, SLOPE, write_log_seen};
use koehler::table::read_dataset;

/// Lines through the maneuvers of two flights, flown through those of the third one.
fn validated(more: &str) -> Campaign {
    let c = Campaign::new();
    c.edit("pipeline.toml", "kinds = [\"3211\"]", "except = [\"flight-3\"]");
    let section = format!(
        "[[validate]]\nestimate = \"lag\"\nlines = [\"lag-V\"]\nfree = [\"y_0\"]\n{more}\n[report]"
    );
    c.edit("pipeline.toml", "[report]", &section);
    c
}

#[test]
fn lines_tell_a_flight_that_they_have_not_seen() {
    let c = validated("flights = [\"flight-3\"]\nshifts = { outputs = [] }");
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "validation").expect("a table");
    assert_eq!(table.strings("flight").expect("column"), ["flight-3"; 4]);
    assert_eq!(table.strings("verdict").expect("column"), ["good"; 4]);
    let within = table.f64("within").expect("column");
    assert!(within.iter().all(|share| *share > 0.9), "{within:?}");
    let parts = ["theil_bias", "theil_variance", "theil_covariance"]
        .map(|name| table.f64(name).expect("column"));
    assert!((0..4).all(|k| (parts.iter().map(|p| p[k]).sum::<f64>() - 1.0).abs() < 1e-9));
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a page");
    assert!(page.contains("id=\"validation\"") && page.contains("4 of 4 outputs are good"));
    // The last one, at 117 m/s, is faster than all maneuvers that the lines go through.
    assert!(page.contains("100% of it outside the lines&#x27; points"));
    let traces = read_dataset(&c.path("out"), "validation_traces").expect("a table");
    let segments = traces.strings("segment").expect("column");
    let beyond = traces.bools("beyond").expect("column");
    assert!((0..traces.rows()).all(|k| beyond[k] == (segments[k] == "flight-3.04")));
    let values = read_dataset(&c.path("out"), "validation_values").expect("a table");
    let text = |name: &str| values.strings(name).expect("column");
    let (names, sources, units) = (text("parameter"), text("source"), text("unit"));
    let (value, sd) = (values.f64("value").expect("column"), values.f64("sd").expect("column"));
    let of = |name: &str| (0..values.rows()).filter(|k| names[*k] == name).collect::<Vec<_>>();
    // K is the line's value at each of the four maneuvers' airspeeds; the shift is found in each of them.
    let (gain, shift) = (of("K"), of("y_0"));
    assert!(gain.len() == 4 && shift.len() == 4, "{names:?}");
    assert!(gain.iter().all(|&k| sources[k] == "line" && units[k] == "-" && sd[k] > 0.0));
    assert!(gain.windows(2).all(|k| value[k[0]] != value[k[1]]));
    assert!(shift.iter().all(|&k| sources[k] == "maneuver" && value[k].is_finite()));
}

#[test]
fn fault_what_did_not_converge_validates_nothing() {
    let c = validated("flights = [\"flight-3\"]");
    let method = "except = [\"flight-3\"]\nmethod = { max_iterations = 1 }";
    c.edit("pipeline.toml", "except = [\"flight-3\"]", method);
    let run = c.run().ended(1);
    let wanted = "flight-3.01 is not validated: there is no line of K";
    assert!(run.out.contains(wanted), "{}", run.out);
    assert_eq!(read_dataset(&c.path("out"), "validation").map_or(0, |table| table.rows()), 0);
}

#[test]
fn a_model_that_is_wrong_is_not_good() {
    let c = validated("flights = [\"flight-3\"]\nmodel = \"other.model.toml\"");
    let other = crate::campaign::MODEL
        .replace(
            "K = { unit = \"-\", start = 1.0 }",
            "K = { unit = \"-\", start = 1.0, fixed = true }",
        )
        .replace("(K*u - x)/T", "(0.5*K*u - x)/T");
    c.write("other.model.toml", &other);
    // Half the motion is no small error.
    let run = c.run().ended(1);
    assert!(run.out.contains("within the predicted interval"), "{}", run.out);
    let table = read_dataset(&c.path("out"), "validation").expect("a table");
    assert!(table.strings("verdict").expect("column").iter().all(|v| v.contains("Theil")));
    // Half the gain is half the motion: an error of another size, not of another form.
    assert!(table.f64("theil_variance").expect("column").iter().all(|share| *share > 0.5));
}

#[test]
fn a_line_gives_its_own_numbers_to_a_model_that_follows_the_condition() {
    let more = "flights = [\"flight-3\"]\nmodel = \"other.model.toml\"\n\
                take = { K_0 = \"K.intercept\", K_V = \"K.slope\" }";
    let c = validated(more);
    let other = crate::campaign::MODEL
        .replace("u = \"rad\"", "u = \"rad\"\nV = \"m/s\"")
        .replace(
            "K = { unit = \"-\", start = 1.0 }",
            "K_0 = { unit = \"-\", start = 0.0 }\nK_V = { unit = \"s/m\", start = 0.0 }",
        )
        .replace("K*u", "(K_0 + K_V*V)*u");
    c.write("other.model.toml", &other);
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "validation").expect("a table");
    assert_eq!(table.strings("verdict").expect("column"), ["good"; 4]);
    let fits = read_dataset(&c.path("out"), "fits").expect("lines");
    assert!((fits.f64("slope").expect("column")[0] - SLOPE).abs() < 0.002);
    assert!((fits.f64("intercept").expect("column")[0] - INTERCEPT).abs() < 0.2);
}

#[test]
fn fault_a_maneuver_that_was_used_is_refused_by_name() {
    let c = validated("");
    let run = c.run().ended(1);
    assert!(
        run.out.contains("flight-1.01 is refused: its data are among those of the estimate lag"),
        "{}",
        run.out
    );
    let table = read_dataset(&c.path("out"), "validation").expect("a table");
    assert_eq!(table.strings("flight").expect("column"), ["flight-3"; 4]);
}

#[test]
fn fault_mistakes_of_a_validation_are_told_at_once() {
    let c = validated("band = { y = \"z\" }\nwithin = 95.0\ntake = { Q = \"K\", T = \"tau\" }");
    let run = c.koehler("check", &[]).ended(2);
    for wanted in ["\"z\"", "must be at most 1, not 95", "\"Q\"", "\"tau\""] {
        assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
    }
    let c = validated("");
    c.edit("pipeline.toml", "lines = [\"lag-V\"]", "lines = [\"lag-W\"]");
    let run = c.koehler("check", &[]).ended(2);
    assert!(
        run.err.contains("\"lag-W\"") && run.err.contains("did you mean \"lag-V\""),
        "{}",
        run.err
    );
    let c = validated("");
    c.edit("pipeline.toml", "lines = [\"lag-V\"]", "");
    let run = c.koehler("check", &[]).ended(2);
    assert!(
        run.err.contains("no value is found for K, T") && run.err.contains("`[[fit]]`"),
        "{}",
        run.err
    );
}

/// Standard deviation of the gusts that [`gusty`] adds to what moves, deg.
const GUST: f64 = 0.5;

/// What the model says of it: in gusts nobody starts at rest.
const DRIVEN: &str = ", noise = \"F\", start_sd = \"F*sqrt(T/2)\"";

/// Flights whose state is driven by white noise as well, estimated by a model that knows it (or,
/// with `noise` empty, not), of all maneuvers of two flights together; the third one is held out.
fn gusty(noise: &str, more: &str) -> Campaign {
    let c = validated(&format!("flights = [\"flight-3\"]\nmodel = \"gain.model.toml\"\n{more}"));
    c.edit("pipeline.toml", "lines = [\"lag-V\"]\n", "");
    c.edit(
        "pipeline.toml",
        "model = \"lag.model.toml\"",
        "model = \"gain.model.toml\"\ngroup = \"all\"",
    );
    c.edit(
        "pipeline.toml",
        "[[fit]]\nestimate = \"lag\"\nparameters = [\"K\", \"T\"]\nagainst = \"V\"\n",
        "",
    );
    let model = crate::campaign::MODEL
        .replace("u = \"rad\"", "u = \"rad\"\nV = \"m/s\"")
        .replace(
            "K = { unit = \"-\", start = 1.0 }",
            "K_0 = { unit = \"-\", start = 0.3 }\nK_V = { unit = \"s/m\", start = 0.01 }\nF = { unit = \"rad/s^0.5\", start = 0.01, min = 0.0 }",
        )
        .replace("K*u", "(K_0 + K_V*V)*u")
        .replace("start = 0.0 }\n\n[outputs]", &format!("start = 0.0{noise} }}\n\n[outputs]"));
    let model =
        if noise.is_empty() { model.replace("F = {", "F = { fixed = true,") } else { model };
    c.write("gain.model.toml", &model);
    for flight in 0..3u64 {
        let mut random = rand_pcg::Pcg64::new(u128::from(flight) + 7, 1);
        let (mut gust, mut before) = (0.0, f64::NAN);
        let path = c.path(&format!("logs/flight-{}.mcap", flight + 1));
        write_log_seen(&path, flight, 4, |t, y| {
            // Exact over any step: first order, of standard deviation GUST.
            let stays = if before.is_nan() { 0.0 } else { libm::exp((before - t) / LAG) };
            let fresh: f64 =
                rand_distr::Distribution::sample(&rand_distr::StandardNormal, &mut random);
            gust = stays * gust + GUST * (1.0 - stays * stays).sqrt() * fresh;
            before = t;
            y + gust
        });
    }
    c
}

#[test]
fn recovery_a_model_that_noise_drives_is_validated_by_its_motion_and_by_its_filter() {
    let c = gusty(DRIVEN, "");
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "validation").expect("a table");
    assert_eq!(table.strings("flight").expect("column"), ["flight-3"; 4]);
    let of = |name: &str| table.f64(name).expect("column");
    assert_eq!(table.strings("verdict").expect("column"), ["good"; 4]);
    assert_eq!(table.opt_strings("noise_verdict").expect("column"), [Some("noise"); 4]);
    let mean = of("within").iter().sum::<f64>() / 4.0;
    assert!((mean - 0.95).abs() < 0.06, "{mean}");
    // The gusts begin with the record, and are all there after a few time constants.
    let gust = of("driven_sd").iter().sum::<f64>() / 4.0;
    assert!((gust / GUST.to_radians() - 1.0).abs() < 0.15, "{gust}");
    let traces = read_dataset(&c.path("out"), "validation_traces").expect("a table");
    let [z, y, sd] = ["measured", "ahead", "ahead_sd"].map(|n| traces.f64(n).expect("column"));
    let e: Vec<f64> =
        (0..z.len()).map(|k| (z[k] - y[k]) / sd[k]).filter(|e| e.is_finite()).collect();
    let square = e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64;
    assert!(e.len() > 1000 && (square - 1.0).abs() < 0.2, "{square} of {}", e.len());
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a page");
    assert!(page.contains(", driven "), "what the noise does is on the page");
}

#[test]
fn a_gust_that_the_model_does_not_know_is_not_good_and_neither_is_a_wrong_gain() {
    let c = gusty("", "");
    let run = c.run();
    assert!(run.out.contains("within the predicted interval"), "{}", run.out);
    let c = gusty(DRIVEN, "take = { K_0 = \"F_0\" }");
    let run = c.koehler("check", &[]).ended(2);
    assert!(run.err.contains("\"F_0\""), "{}", run.err);
    let c = gusty(DRIVEN, "");
    let model = std::fs::read_to_string(c.path("gain.model.toml")).expect("readable");
    c.write("half.model.toml", &model.replace("(K_0 + K_V*V)*u", "0.3*(K_0 + K_V*V)*u"));
    c.edit(
        "pipeline.toml",
        "flights = [\"flight-3\"]\nmodel = \"gain.model.toml\"",
        "flights = [\"flight-3\"]\nmodel = \"half.model.toml\"",
    );
    let run = c.run();
    assert!(run.out.contains("within the predicted interval"), "{}", run.out);
}

/// Tolerances of `y`, one of them for a test that the flights do not have.
const TOLERANCES: &str = r#"
title  = "A match"
source = "a specification"

[[tolerance]]
test   = "response"
group  = "size"
output = "y"
share  = 0.0001

[[tolerance]]
test   = "response"
group  = "size"
output = "y"
within = 3.0
unit   = "deg"

[[tolerance]]
test   = "oscillation"
output = "y"
of     = "period"
share  = 0.1

[[tolerance]]
test   = "doublets"
kinds  = ["doublet"]
output = "y"
within = 3.0
unit   = "deg"
"#;

#[test]
fn tolerances_are_held_against_the_largest_error() {
    let more = "flights = [\"flight-3\"]\ntolerances = \"a.toml\"\ntests = [\"response\"]";
    let c = validated(more);
    c.write("a.toml", TOLERANCES);
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "tolerances").expect("a table");
    let verdicts = table.strings("verdict").expect("column");
    assert_eq!(verdicts, ["outside", "within"].repeat(4));
    assert_eq!(table.strings("group_verdict").expect("column"), ["within"; 8]);
    let largest = read_dataset(&c.path("out"), "validation").expect("a table");
    let (error, limit) =
        (table.f64("error").expect("column"), table.f64("tolerance").expect("column"));
    let largest = largest.f64("largest").expect("column");
    assert!((0..4).all(|k| error[2 * k] == largest[k] && error[2 * k + 1] == largest[k]));
    assert!((limit[1] - 3.0_f64.to_radians()).abs() < 1e-12);
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a page");
    assert!(page.contains("4 of 4 tests are within their tolerances"));
}

#[test]
fn what_is_outside_its_tolerance_is_a_problem_and_what_is_not_there_is_said() {
    let c = validated("flights = [\"flight-3\"]\ntolerances = \"a.toml\"");
    c.write("a.toml", &TOLERANCES.replace("within = 3.0", "within = 0.0001"));
    let run = c.run().ended(1);
    for wanted in [
        "response of flight-3.01 is outside its tolerances: y is off by",
        "1.00e-4 deg allowed",
        "no maneuver for the tolerances of doublets (y)",
    ] {
        assert!(run.out.contains(wanted), "{wanted} is not in\n{}", run.out);
    }
}

#[test]
fn what_is_left_is_noise_or_more_and_what_followed_is_named() {
    let c = validated("flights = [\"flight-3\"]");
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "validation").expect("a table");
    let verdicts = table.opt_strings("noise_verdict").expect("column");
    let smoothed = table.f64("smoothed").expect("column");
    assert!((0..4).all(|k| (verdicts[k] == Some("noise")) == (smoothed[k] >= 0.95)));
    let followed = table.opt_strings("followed").expect("column");
    assert!(
        followed.iter().all(|text| text.is_some_and(|text| text.contains("y_0 = "))),
        "{followed:?}"
    );
}
