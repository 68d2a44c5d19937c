//! The README of the ATTAS records: is what it says what comes out?

use crate::attas::{STEPS, results, steps};
use crate::flightdata::{copy, data, in_the_readme, koehler};
use crate::real::diagnose;
use koehler::table::{Table, read_dataset};

/// The steps, for the README.
fn told_steps(out: &std::path::Path) -> String {
    let mut rows = "| record | surface | steps |\n|---|---|---|\n".to_string();
    for (flight, input, _) in STEPS {
        let found = steps(out, flight, input);
        let each: Vec<String> = found
            .iter()
            .map(|s| format!("{:.2} to {:.2} s ({:+.1} deg)", s.from, s.to, s.level))
            .collect();
        rows += &format!("| `{flight}` | {input} | {} |\n", each.join(", "));
    }
    rows
}

/// The values of the coupled model, for the README.
fn coefficients(out: &std::path::Path) -> String {
    let table = read_dataset(out, "estimates").expect("estimates");
    let text = |name: &str| table.strings(name).expect("column");
    let of = table.opt_strings("of").expect("column");
    let number = |name: &str, i: usize| table.f64(name).expect("column")[i];
    let mut rows = "| | value | sd | CRLB | total |\n|---|---|---|---|---|\n".to_string();
    for i in 0..table.rows() {
        let name = text("parameter")[i];
        if text("model")[i] != "coupled" || name.ends_with("(0)") {
            continue;
        }
        assert_eq!(text("stop")[i], "converged");
        let (value, sd, crlb) = (number("value", i), number("sd", i), number("sd_crlb", i));
        let place = of[i].map_or(String::new(), |of| format!(" of `{of}`"));
        rows += &format!(
            "| `{name}`{place} | {value:.5} | {sd:.5} | {crlb:.5} | {:.5} |\n",
            number("sd_total", i)
        );
    }
    rows
}

/// The verdicts on the record held out, for the README.
fn verdicts(out: &std::path::Path) -> String {
    let table = read_dataset(out, "validation").expect("validation");
    let text = |name: &str| table.strings(name).expect("column");
    let number = |name: &str, i: usize| table.f64(name).expect("column")[i];
    let mut rows =
        "| channel | r.m.s. | fit | Theil | within | verdict |\n|---|---|---|---|---|---|\n"
            .to_string();
    for i in 0..table.rows() {
        assert_eq!(text("flight")[i], "fAttasElv2");
        rows += &format!(
            "| {}, {} | {:.4} | {:.2} | {:.3} | {:.0}% | {} |\n",
            text("output")[i],
            text("unit")[i],
            number("rms", i),
            number("fit", i),
            number("theil", i),
            100.0 * number("within", i),
            text("verdict")[i]
        );
    }
    rows
}

#[test]
fn the_readme_of_the_attas_records_says_what_comes_out() {
    let Some(out) = results() else { return };
    let by = "`UPDATE_DOCS=1 cargo test --release --test all attas_readme::`";
    in_the_readme(
        "attas-real",
        by,
        &[
            ("steps", told_steps(&out)),
            ("coefficients", coefficients(&out)),
            ("validation", verdicts(&out)),
        ],
    );
}

#[test]
fn the_readme_of_the_attas_records_says_what_the_coupled_model_lacks() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (a minute in release mode)");
        return;
    }
    let Some(data) = data("attas/fAttasElv1.mat") else { return };
    let folder = copy("attas-real");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    let code = diagnose(folder.path(), &data, &["pipeline.toml", "--estimate", "coupled"]);
    assert_eq!(code, Some(3));
    let out = folder.path().join("out");
    let findings = read_dataset(&out, "findings").expect("findings");
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let by = "`KOEHLER_SLOW=1 UPDATE_DOCS=1 cargo test --release --test all attas_readme::`";
    in_the_readme("attas-real", by, &[("diagnosis", lacks(&findings) + &changes(&estimates))]);
}

/// The verdict of a diagnosis and every effect named, for the README.
fn lacks(findings: &Table) -> String {
    let text = |name: &str| findings.strings(name).expect("column");
    let effects = findings.opt_strings("candidate").expect("column");
    let number = |name: &str, i: usize| findings.f64(name).expect("column")[i];
    let mut rows = format!("**{}**\n\n", text("verdict")[0]);
    rows += "| effect | what was found | gain | chance gives | held out: predicted | realised |\n|---|---|---|---|---|---|\n";
    for i in 0..findings.rows() {
        let Some(effect) = effects[i].filter(|name| !name.is_empty()) else { continue };
        let told = text("text")[i];
        let told = told.split(" log-likelihood gains").next().unwrap_or(told);
        rows += &format!(
            "| `{effect}` | {} | {:.0} | {:.1} | {:.0} | {:.0} |\n",
            told.trim_end_matches(';'),
            number("gain", i),
            number("limit", i),
            number("held_out_predicted", i),
            number("held_out_realised", i)
        );
    }
    rows
}

/// What the effects do to the estimates: what is added, and what moves by more than its sd. Nothing where none
/// was named: there is no model with them then.
fn changes(table: &Table) -> String {
    let text = |name: &str| table.strings(name).expect("column");
    let number = |name: &str, i: usize| table.f64(name).expect("column")[i];
    let of = table.opt_strings("of").expect("column");
    let common = |model: &str| -> Vec<(String, f64, f64)> {
        let (models, names) = (text("model"), text("parameter"));
        let rows = (0..table.rows()).filter(|&i| models[i] == model && of[i].is_none());
        rows.map(|i| (names[i].to_string(), number("value", i), number("sd", i))).collect()
    };
    let before = common("coupled");
    assert!(!before.is_empty());
    let after = common("coupled.next");
    if after.is_empty() {
        return String::new();
    }
    let mut rows =
        "\n| estimated again with them | `coupled` | with |\n|---|---|---|\n".to_string();
    for (name, value, sd) in after {
        let known = before.iter().find(|(known, ..)| *known == name);
        if known.is_some_and(|(_, value_then, sd_then)| (value - value_then).abs() < *sd_then) {
            continue;
        }
        let then = known.map_or("-".to_string(), |(_, v, sd)| format!("{v:.4} ± {sd:.4}"));
        let sd = if sd.is_finite() { format!("± {sd:.4}") } else { "on its bound".into() };
        rows += &format!("| `{name}` | {then} | {value:.4} {sd} |\n");
    }
    rows
}
