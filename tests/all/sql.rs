//! Queries of a run's tables: what is answered in which form, and what is said where nothing can be.

use crate::campaign::{Campaign, Outcome};
use std::io::Read;
use std::process::{Command, Stdio};

fn ask(c: &Campaign, run: &str, query: &str, form: &[&str]) -> Outcome {
    c.command("sql", &[&[run, query], form].concat())
}

#[test]
fn a_run_answers_a_query_as_a_table_as_csv_and_as_json() {
    let c = Campaign::new();
    c.run().ended(0);
    let count = "SELECT flight, count(*) AS n FROM segments GROUP BY flight ORDER BY flight";
    let told = ask(&c, "pipeline.toml", count, &[]).ended(0);
    assert_eq!(told.out, "flight    n\nflight-1  4\nflight-2  4\nflight-3  4\n");
    let csv = ask(&c, "out", count, &["--csv"]).ended(0);
    assert_eq!(csv.out, "flight,n\nflight-1,4\nflight-2,4\nflight-3,4\n");
    assert_eq!(ask(&c, "out", count, &["--quiet", "--csv"]).ended(0).out, csv.out);

    let joined = "SELECT e.segment, e.value, e.sd, c.value AS V FROM estimates AS e \
         JOIN conditions AS c ON e.segment = c.segment \
         WHERE e.parameter = 'K' AND c.signal = 'V' ORDER BY e.segment";
    let json = ask(&c, "out", joined, &["--json"]).ended(0);
    let rows: serde_json::Value = serde_json::from_str(&json.out).expect("JSON");
    let table = koehler::table::read_dataset(&c.path("out"), "estimates").expect("estimates");
    let of_k = table.strings("parameter").expect("column").iter().position(|p| *p == "K");
    let value = table.f64("value").expect("column")[of_k.expect("a K")];
    assert_eq!(rows.as_array().map(Vec::len), Some(12), "{}", json.out);
    // as a text: who reads JSON may round the last digit
    assert!(
        json.out.contains(&format!("\"value\": {value},")),
        "every digit of {value}: {}",
        json.out
    );
    assert!(rows[0]["V"].as_f64().is_some_and(|v| (v - 60.0).abs() < 1.0), "{}", json.out);
    let null = "SELECT reason, included FROM segments LIMIT 1";
    assert_eq!(ask(&c, "out", null, &["--csv"]).ended(0).out, "reason,included\n,true\n");
    assert_eq!(ask(&c, "out", "SELECT * FROM samples WHERE false", &[]).ended(0).code, 0);
}

#[test]
fn fault_what_cannot_be_answered_is_said_with_what_to_do() {
    let c = Campaign::new();
    let none = ask(&c, "pipeline.toml", "SELECT * FROM fits", &[]).ended(2);
    assert!(none.err.contains("out: this is no output folder"), "{}", none.err);
    c.run().ended(0);
    let table = ask(&c, "out", "SELECT * FROM fit", &[]).ended(2);
    for wanted in ["error: the run has no table \"fit\"", "did you mean \"fits\"?", " segments"] {
        assert!(table.err.contains(wanted), "{}", table.err);
    }
    let column = ask(&c, "out", "SELECT slop FROM fits", &["--json"]).ended(2);
    assert!(column.err.contains("did you mean \"slope\"?"), "{}", column.err);
    let said: serde_json::Value = serde_json::from_str(&column.out).expect("JSON");
    assert_eq!(said["exit_code"], 2, "{}", column.out);
    let syntax = ask(&c, "out", "SELECT slope FORM fits x", &[]).ended(2);
    assert!(syntax.err.contains("error: query:1:"), "{}", syntax.err);
    let change = "/* first a comment */ DELETE FROM fits";
    for query in ["SELECT slope FROM fits ORDER BY 0", "DELETE FROM fits", change] {
        let run = ask(&c, "out", query, &[]).ended(2);
        assert!(run.err.contains("a query is one SELECT"), "{query}: {}", run.err);
    }
    c.koehler("verify", &[]).ended(0);
}

#[test]
fn fault_files_that_no_record_names_are_left_out_and_told() {
    let c = Campaign::new();
    c.run().ended(0);
    let count = "SELECT count(*) AS n FROM fits";
    let sound = ask(&c, "out", count, &[]).ended(0);
    assert_eq!(sound.err, "");
    std::fs::copy(c.path("out/fits/part-0.parquet"), c.path("out/fits/part-7.parquet"))
        .expect("copied");
    let told = ask(&c, "out", count, &[]).ended(0);
    assert_eq!(told.out, sound.out);
    assert!(told.err.contains("no record of a run names it: fits/part-7.parquet"), "{}", told.err);
    // A query of other tables has nothing to do with it.
    assert_eq!(ask(&c, "out", "SELECT count(*) FROM notes", &[]).ended(0).err, "");
    // Nor is a table there of which no file is named.
    std::fs::create_dir_all(c.path("out/recommended")).expect("made");
    std::fs::copy(c.path("out/fits/part-0.parquet"), c.path("out/recommended/part-0.parquet"))
        .expect("copied");
    let none = ask(&c, "out", "SELECT * FROM recommended", &[]).ended(2);
    for wanted in ["the run has no table \"recommended\"", "names it: recommended/part-0.parquet"] {
        assert!(none.err.contains(wanted), "{}", none.err);
    }
    c.run().ended(0);
    assert_eq!(ask(&c, "out", count, &[]).ended(0).err, "");
}

/// A reader who has seen enough closes the pipe: that is no fault.
#[test]
fn a_reader_who_leaves_is_no_fault() {
    let c = Campaign::new();
    c.run().ended(0);
    let mut child = Command::new(env!("CARGO_BIN_EXE_koehler"))
        .current_dir(c.folder.path())
        .args(["sql", "out", "SELECT * FROM samples", "--csv"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    drop(child.stdout.take());
    let mut said = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut said).expect("UTF-8");
    assert_eq!((child.wait().expect("ended").code(), said.as_str()), (Some(0), ""));
}
