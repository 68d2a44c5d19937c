//! Text files of one column and more in; the notes that come with their logs out.

use super::run;
use crate::log::file::LogFile;

/// What an import of this text says. `time` and `topics` as in a description.
fn notes(time: &str, topics: &str, text: &str) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let description = folder.path().join("import.toml");
    let settings = format!(
        "input = [\"a.csv\"]\noutput = \"a.mcap\"\nseparator = \"comma\"\nheader_lines = 1\ntime = {{ {time} }}\n{topics}"
    );
    std::fs::write(&description, settings).expect("written");
    std::fs::write(folder.path().join("a.csv"), text).expect("written");
    let (mut done, errors) = run(&description, None, false).expect("described");
    assert!(errors.0.is_empty(), "{errors}");
    let said = done.remove(0).notes;
    // Who reads the log is told the same.
    let log = LogFile::open(&folder.path().join("a.mcap")).expect("a log");
    let read: Vec<&str> = log.notes.iter().map(|note| note.text.as_str()).collect();
    let written: Vec<String> = said.iter().map(|note| format!("at its import: {note}")).collect();
    assert_eq!(read, written);
    said
}

const V: &str =
    "[[topic]]\nname = \"/a\"\nfields = [{ column = \"v\", name = \"v\", unit = \"m\" }]\n";
const W: &str = "[[topic]]\nname = \"/g\"\ntime = { column = \"g\", unit = \"hh:mm:ss\" }\nfields = [{ column = \"w\", name = \"w\", unit = \"m\" }]\n";

fn clock(second: u32) -> String {
    format!("{:02}:{:02}:{:02}", second / 3600 % 24, second / 60 % 60, second % 60)
}

#[test]
fn a_blank_line_at_a_rate_is_a_row_without_a_value() {
    let text: String =
        (0..100).map(|k| if k == 50 { "\n".into() } else { format!("{k}\n") }).collect();
    let said = notes("rate_hz = 50", V, &format!("v\n{text}"));
    assert_eq!(said, ["topic /a: 1 of 100 rows have no value of it where one was due"]);
}

#[test]
fn a_pause_over_midnight_is_carried_on() {
    let text: String = (0..100)
        .map(|k| format!("{},{k}\n", clock(if k < 50 { 72_000 } else { 100_800 } + k)))
        .collect();
    let said = notes("column = \"t\", unit = \"hh:mm:ss\"", V, &format!("t,v\n{text}"));
    assert_eq!(
        said,
        [
            "topic /a: the time falls by 57599.000 s behind row 50, as a clock does that begins anew: a day is added from there on"
        ]
    );
}

#[test]
fn a_clock_that_began_after_midnight_is_told() {
    let row = |k: u32| {
        let t = clock(86_350 + k);
        let of_g = if k < 60 { ",".into() } else { format!("{t},{k}") };
        format!("{t},{k},{of_g}\n")
    };
    let text: String = (0..100).map(row).collect();
    let time = "column = \"t\", unit = \"hh:mm:ss\"";
    let said = notes(time, &format!("{V}{W}"), &format!("t,v,g,w\n{text}"));
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[1].starts_with(
            "topics \"/g\" (10.000 to 49.000 s) and \"/a\" (86350.000 to 86449.000 s) have no time in common: \"/g\" may have begun after midnight"
        ),
        "{said:?}"
    );
}

#[test]
fn cells_without_a_value_are_counted_and_a_slower_signal_lacks_none() {
    let said = |is_missing: fn(u32) -> bool| {
        let row =
            |k| format!("{k},{}\n", if is_missing(k) { String::new() } else { k.to_string() });
        let text: String = (0..200).map(row).collect();
        notes("column = \"t\", unit = \"s\"", V, &format!("t,v\n{text}"))
    };
    assert_eq!(
        said(|k| (22..179).contains(&k) && (k - 22) % 3 == 0),
        ["topic /a: 53 of 200 rows have no value of it where one was due"]
    );
    assert_eq!(said(|k| k % 5 > 0), Vec::<String>::new());
}

#[test]
fn fault_a_clock_set_back_by_a_step_or_less_than_three_is_told_with_its_row() {
    let said = |rate_hz: f64, back: f64| {
        let time = |k: i32| f64::from(k) / rate_hz + 7.0 - if k < 200 { 0.0 } else { back };
        let text: String = (0..400).map(|k| format!("{:.4},{k}\n", time(k))).collect();
        notes("column = \"t\", unit = \"s\"", V, &format!("t,v\n{text}"))
    };
    let starts = |said: &[String], with: &[&str]| {
        let is_so = said.iter().zip(with).all(|(said, with)| said.starts_with(with));
        assert!(is_so && said.len() == with.len(), "{said:?}");
    };
    // so many steps and more are left out, as in a log
    let out = "topic /a: after row 200 of its data the time goes back by 0.080 s: what came twice then is left out, 10 of 400 rows";
    starts(&said(50.0, 0.1), &[out]);
    let set = "topic /a: the clock was set back behind row 200 of its data by 0.050 s (from 16.950 to 16.900 s) and goes on from there";
    let twice = "topic /a: 2 of 400 rows have the time of an earlier row, first row 201 of its data (16.900 s)";
    starts(&said(20.0, 0.1), &[set, twice]);
    let twice = "topic /a: 1 of 400 rows have the time of an earlier row, first row 201 of its data (26.900 s)";
    starts(&said(10.0, 0.1), &[twice]);
    assert_eq!(said(10.0, 0.0), Vec::<String>::new());
}

#[test]
fn fault_two_clocks_that_take_turns_in_one_file_are_told_with_rows_and_counts() {
    let text = |every: i32| -> String {
        let time = |k: i32| 0.02 * f64::from(k) + if k % every == 3 { 5.01 } else { 0.0 };
        (0..1000).map(|k| format!("{:.3},{k}\n", time(k))).collect()
    };
    let few = notes("column = \"t\", unit = \"s\"", V, &format!("t,v\n{}", text(20)));
    let wanted = "topic /a: behind row 3: the clock went forth and back by 5.010 s, 50 times: two clocks gave";
    assert!(few.len() == 1 && few[0].starts_with(wanted), "{few:?}");
    assert!(
        few[0].contains("50 of 1000 rows, of the one that gave fewer, are left out"),
        "{few:?}"
    );
}

#[test]
fn fault_whole_numbers_that_lose_digits_are_told_with_their_line() {
    let row = |k: u64| format!("{k},{}\n", 9_007_199_254_740_990 + k);
    let text: String = (0..6).map(row).collect();
    let said = notes("column = \"t\", unit = \"s\"", V, &format!("t,v\n{text}"));
    let wanted = "topic /a: 2 of 6 whole numbers of \"v\" have more digits";
    assert!(said.len() == 1 && said[0].starts_with(wanted), "{said:?}");
    let first = "first in line 5, 9007199254740992 for 9007199254740993;";
    assert!(said[0].contains(first), "{said:?}");
}
