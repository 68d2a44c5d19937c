use super::*;
use crate::table::{Table, write_part};

/// Two flights with samples of unlike signals, and a table of the campaign.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (flight, signal, n) in [("f1", "alpha", 3), ("f2", "beta", 2)] {
        let t: Vec<f64> = (0..n).map(|i| 0.1 * i as f64).collect();
        let table = Table::build("samples").repeat("flight", flight).f64("t_s", t.clone());
        let table = table.dynamic(signal, "rad", "An angle.", t).finish().expect("a table");
        write_part(dir.path(), &table, Some(flight), 0).expect("written");
    }
    let conditions = Table::build("conditions")
        .strings("flight", ["f1"; 2])
        .strings("segment", ["f1.01"; 2])
        .strings("signal", ["V", "alpha"])
        .strings("unit", ["m/s", "rad"])
        .f64("value", vec![90.0, f64::NAN]);
    let conditions = conditions.finish().expect("a table");
    write_part(dir.path(), &conditions, Some("f1"), 0).expect("written");
    dir
}

fn ask(sql: &str) -> Answer {
    query(folder().path(), sql).unwrap_or_else(|e| panic!("{sql}: {e}"))
}

fn refusal(sql: &str) -> String {
    query(folder().path(), sql).expect_err(sql).to_string()
}

#[test]
fn parts_of_a_table_are_one_and_the_flight_is_a_column() {
    let counted = ask("SELECT flight, count(*) AS n FROM samples GROUP BY flight ORDER BY flight");
    assert_eq!(counted.columns, ["flight", "n"]);
    let row = |flight: &str, n| vec![Cell::Text(flight.into()), Cell::Whole(n)];
    assert_eq!(counted.rows, [row("f1", 3), row("f2", 2)]);
    assert_eq!(ask("SELECT count(*) FROM samples").rows, [[Cell::Whole(5)]]);
    // What a flight lacks is null, and so is a number that is not there.
    let all = ask("SELECT * FROM samples WHERE t_s > 0.05 ORDER BY flight, t_s LIMIT 2 OFFSET 1");
    assert_eq!(all.columns, ["flight", "t_s", "alpha", "beta"]);
    assert_eq!(all.rows[0][2..], [Cell::Number(0.2), Cell::Null]);
    assert_eq!(all.rows[1][2..], [Cell::Null, Cell::Number(0.1)]);
    let null = ask("SELECT signal FROM conditions WHERE value IS NULL");
    assert_eq!(null.rows, [[Cell::Text("alpha".into())]]);
}

#[test]
fn queries_join_filter_and_nest() {
    let joined = "SELECT s.flight, max(s.alpha) AS most, c.value FROM samples s \
         JOIN conditions AS c ON s.flight = c.flight WHERE c.signal = 'V' GROUP BY s.flight, c.value";
    let number = Cell::Number;
    assert_eq!(ask(joined).rows, [[Cell::Text("f1".into()), number(0.2), number(90.0)]]);
    let nested = "WITH late AS (SELECT flight FROM samples WHERE t_s > 0.15) \
         SELECT count(*) AS n FROM samples WHERE flight IN (SELECT flight FROM late)";
    assert_eq!(ask(nested).rows, [[Cell::Whole(3)]]);
    let ranked = "SELECT flight, row_number() OVER (PARTITION BY flight ORDER BY t_s) AS k FROM samples \
         ORDER BY flight, k DESC LIMIT 1";
    assert_eq!(ask(ranked).rows[0][1], Cell::Whole(3));
    let tables = ask("SHOW TABLES").rows;
    assert_eq!(tables, ["conditions", "samples"].map(|name| [Cell::Text(name.into())]));
    assert_eq!(ask("SELECT alpha FROM samples LIMIT 4").rows.len(), 4);
}

#[test]
fn no_file_is_read_that_the_query_does_not_want() {
    let dir = folder();
    let path = dir.path().join("conditions/flight=f1/part-0.parquet");
    std::fs::write(path, b"no table").expect("written");
    assert!(query(dir.path(), "SELECT t_s FROM samples").is_ok());
    let e = query(dir.path(), "SELECT * FROM conditions").expect_err("damaged").to_string();
    assert!(
        e.contains("part-0.parquet: this is no readable file") && e.contains("run again"),
        "{e}"
    );
    // Bytes of a column that is not wanted may be damaged as well.
    let path = dir.path().join("samples/flight=f1/part-0.parquet");
    let mut bytes = std::fs::read(&path).expect("readable");
    bytes[8..40].fill(0xff);
    std::fs::write(path, bytes).expect("written");
    assert!(query(dir.path(), "SELECT t_s FROM samples").is_err(), "its first column");
    assert!(query(dir.path(), "SELECT alpha FROM samples").is_ok());
}

#[test]
fn fault_a_wrong_query_is_told_with_what_to_do() {
    let table = refusal("SELECT * FROM sample");
    assert_eq!(
        table,
        "the run has no table \"sample\"\n    did you mean \"samples\"? its tables are conditions, samples"
    );
    for query in ["SELECT alhpa FROM samples", "SELECT * FROM samples WHERE alhpa > 0"] {
        let column = refusal(query);
        assert!(column.starts_with("no table of the query has a column \"alhpa\"\n"), "{column}");
        assert!(
            column.contains("did you mean \"alpha\"? the columns are alpha, beta, f"),
            "{column}"
        );
    }
    let syntax = refusal("SELECT flight\nFROM samples WHERE");
    assert!(syntax.starts_with("Expected: an expression, found: EOF\n"), "{syntax}");
    let change = refusal("delete FROM samples");
    assert!(change.starts_with("a query changes no table, and this one has DELETE\n"));
    let typo = refusal("SELECT flight FORM samples x");
    assert!(typo.starts_with("query:1:") && typo.contains("a query is one SELECT"), "{typo}");
    for query in
        ["", "SELECT 1; SELECT 2", "INSERT INTO samples VALUES (1)", "SELECT foo(t_s) FROM samples"]
    {
        assert!(refusal(query).lines().count() <= 2, "{query}");
    }
}
