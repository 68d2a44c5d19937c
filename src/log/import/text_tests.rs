//! Texts of columns in; the rows that must come out, and what must be said of mistakes.

use super::rows::Rows;
use super::settings::{Column, Import};
use super::text;
use crate::config::Doc;

fn settings(more: &str) -> (Import, Doc) {
    let text = format!(
        "input = [\"a.csv\"]\noutput = \"a.mcap\"\n{more}\n[[topic]]\nname = \"/t\"\nfields = [{{ column = \"v\", name = \"v\", unit = \"1\" }}]\n"
    );
    crate::config::parse::<Import>("import.toml", &text).unwrap()
}

fn read_all((settings, doc): &(Import, Doc), text: &str) -> Result<Rows, String> {
    text::read(settings, doc, "a.csv", text)
        .map(|mut read| read.topics.remove(0))
        .map_err(|e| e.to_string())
}

#[test]
fn quotes_a_byte_order_mark_decimal_commas_a_row_of_units_and_words_for_missing() {
    let settings = settings(
        "separator = \"semicolon\"\ndecimal = \"comma\"\nheader_lines = 2\nnames_line = 1\nmissing = [\"n/a\", \"-9999\"]\ntime = { column = \"t\", unit = \"s\" }",
    );
    let text = "\u{feff}\"t\";\"a; b\";\"v\"\r\ns;-;-\r\n0,5;\"x;y\";1,25\r\n\r\n1,0;;n/a\r\n1,5;;-9999\r\n2,0;;\r\n2,5;;\"3,5\"\r\n";
    let rows = read_all(&settings, text).unwrap();
    assert_eq!(
        rows.stamp,
        [500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000, 2_500_000_000]
    );
    let v = &rows.values;
    assert!(v[0] == 1.25 && v[4] == 3.5 && v[1..4].iter().all(|x| x.is_nan()), "{v:?}");
    let e = read_all(&settings, &text.replace("\"3,5\"", "\"3,5x\"")).err().unwrap();
    assert!(e.contains("a.csv:8:6: column 3: \"3,5x\" is no number"), "{e}");
    let e = read_all(&settings, &text.replace("\"3,5\"", "1.234")).err().unwrap();
    assert!(e.contains("\"1.234\" is no number"), "{e}");
}

#[test]
fn blank_lines_keep_their_place_in_time_at_a_rate_and_have_no_meaning_beside_a_column_of_time() {
    let with = |more: &str| {
        settings(&format!("separator = \"comma\"\nheader_lines = 1\ntime = {{ {more} }}"))
    };
    for blank in ["", "  ", "\"\"", "NaN"] {
        let text = format!("v\n1\n2\n{blank}\n4\n{blank}\n{blank}\n7\n");
        let rows = read_all(&with("rate_hz = 50"), &text).unwrap();
        let at: Vec<u64> = (0..7).map(|k| 20_000_000 * k).collect();
        assert_eq!(rows.stamp, at, "{blank:?}");
        let known: Vec<usize> = (0..7).filter(|k| !rows.values[*k].is_nan()).collect();
        assert_eq!((known, rows.values[6]), (vec![0, 1, 3, 6], 7.0), "{blank:?}");
    }
    let rows = read_all(&with("rate_hz = 50"), "v\n\n1\n2\n\n\n").unwrap();
    assert_eq!((rows.stamp, rows.values), (vec![0, 20_000_000], vec![1.0, 2.0]));
    let rows = read_all(&with("column = \"t\", unit = \"s\""), "t,v\n0,1\n\n1,2\n").unwrap();
    assert_eq!((rows.stamp, rows.values), (vec![0, 1_000_000_000], vec![1.0, 2.0]));
}

#[test]
fn whole_numbers_in_a_column_of_time_keep_all_their_digits() {
    let text = "t,v\n1700000000123456789,1\n1700000000123456790,2\n1.700000000123456791e18,3\n";
    let with = |unit: &str| {
        settings(&format!(
            "separator = \"comma\"\nheader_lines = 1\ntime = {{ column = \"t\", unit = \"{unit}\" }}"
        ))
    };
    let stamp = read_all(&with("ns"), text).expect("read").stamp;
    assert_eq!(stamp[..2], [1_700_000_000_123_456_789, 1_700_000_000_123_456_790]);
    assert!(stamp[2].abs_diff(1_700_000_000_123_456_791) <= 1000, "{stamp:?}");
    let stamp = read_all(&with("us"), "t,v\n1700000000123457,1\n").expect("read").stamp;
    assert_eq!(stamp, [1_700_000_000_123_457_000]);
    let e = read_all(&with("ns"), "t,v\n-5,1\n").expect_err("before 1970");
    assert!(e.contains("a.csv:2:1: the time is negative"), "{e}");
}

#[test]
fn fault_a_header_in_other_units_is_refused_unless_it_says_despite() {
    let with = |field: &str, time: &str, lines: &str| {
        let (mut import, doc) = settings(&format!(
            "separator = \"comma\"\n{lines}\ntime = {{ column = 1, unit = \"{time}\" }}"
        ));
        let topic = import.topic.first_mut().expect("a topic");
        topic.fields = vec![toml::from_str(field).expect("a field")];
        (import, doc)
    };
    let field = |more: &str| format!("column = 2\nname = \"v\"\nunit = \"rad\"\n{more}");
    let (one, two) = ("header_lines = 1", "header_lines = 2\nnames_line = 1");
    for (lines, text) in [(one, "t,v [deg]\n0,1\n"), (two, "t,v\ns,deg\n0,1\n")] {
        let e = read_all(&with(&field(""), "s", lines), text).expect_err("another unit");
        assert!(
            e.contains("column \"v\" is in \"deg\" by the header")
                || e.contains("column 2 is in \"deg\" by the header"),
            "{e}"
        );
        assert!(e.contains("unit = \"rad\"") && e.contains("despite = \"deg\""), "{e}");
        let rows = read_all(&with(&field("despite = \"deg\""), "s", lines), text);
        assert_eq!(rows.expect("it is said").values, [1.0]);
    }
    let e = read_all(&with(&field(""), "s", one), "t (ms),v\n0,1\n").expect_err("ms");
    assert!(e.contains("the column of time is in \"ms\" by the header, not in \"s\""), "{e}");
}

#[test]
fn fault_a_file_that_ends_within_a_row_is_said_to_be_cut() {
    let settings = settings(
        "separator = \"comma\"\nheader_lines = 1\ntime = { column = \"t\", unit = \"s\" }",
    );
    let told = |text: &str| read_all(&settings, text).expect_err("a mistake");
    for last in ["2", "2,-", "2,1e"] {
        assert!(told(&format!("t,v\n0,1\n{last}")).contains("cut short"), "{last}");
        let whole = told(&format!("t,v\n0,1\n{last}\n"));
        assert!(!whole.contains("cut short"), "{whole}");
    }
    assert!(!told("t,v\n0,x\n1,2").contains("cut short"));
}

#[test]
fn fault_a_header_that_is_not_there_is_named() {
    let by = |column: &str| {
        let more = format!(
            "separator = \"comma\"\nheader_lines = 1\ntime = {{ column = {column}, unit = \"s\" }}"
        );
        let (mut import, doc) = settings(&more);
        if column == "1" {
            let topic = import.topic.first_mut().expect("a topic");
            topic.fields.iter_mut().for_each(|f| f.column = Column::Number(2));
        }
        text::read(&import, &doc, "a.csv", "0,1\n1,2\n2,3\n")
    };
    let e = by("\"t\"").expect_err("no names").to_string();
    assert!(e.contains("line 1, which should have the names of the columns, has numbers"), "{e}");
    assert!(e.contains("header_lines = 0"), "{e}");
    let told = by("1").expect("two rows");
    assert_eq!(told.topics[0].values, [2.0, 3.0]);
    assert_eq!(
        told.notes,
        [
            "line 1 is left out by header_lines = 1, and has numbers as the rows have: header_lines = 0 reads it"
        ]
    );
}

#[test]
fn dates_with_times_are_read_with_and_without_a_zone() {
    let settings = settings(
        "separator = \"comma\"\nheader_lines = 1\ntime = { column = \"t\", unit = \"iso8601\" }",
    );
    let text = "t,v\n1970-01-01T00:00:01.5Z,1\n1970-01-01 01:00:02+01:00,2\n1970-01-01T00:00:03.000000001,3\n";
    let rows = read_all(&settings, text).unwrap();
    assert_eq!(rows.stamp, [1_500_000_000, 2_000_000_000, 3_000_000_001]);
    let e = read_all(
        &settings,
        "t,v\n1970-01-01T00:00:01Z,1\n1970-01-01T00:00:02Z,\"2\n1970-01-01T00:00:03Z,3\n",
    );
    assert!(e.as_ref().is_err_and(|e| e.contains("a.csv:3:1: a quoted cell of 2 lines")), "{e:?}");
    for (bad, wanted) in [("noon", "is no date with time"), ("1969-12-31T00:00:00Z", "before 1970")]
    {
        let e = read_all(&settings, &format!("t,v\n{bad},1\n")).err().unwrap();
        assert!(e.contains("a.csv:2:1: ") && e.contains(wanted), "{e}");
    }
}
