//! Logs whose clock was set back, and whose stamps are whole ns, in; the samples that come out, and what is
//! said of the others.

use super::tests::{START, one_signal, raw, read, regular, texts};
use super::{Note, Severity};

/// 1000 messages; from the one at `at` on their times are so many s earlier.
fn set_back(at: usize, by_s: u64) -> Vec<(&'static str, u64, u64, String)> {
    let mut messages = regular(1000);
    for (_, log, publish, _) in &mut messages[at..] {
        *log -= by_s * 1_000_000_000;
        *publish -= by_s * 1_000_000_000;
    }
    messages
}

#[test]
fn fault_a_log_of_two_clocks_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let both = one_signal("log") + &one_signal("log").replace("signal.x", "signal.again");
    // to before the record, and to before it and from there into it
    for (at, by) in [(600, 100), (600, 8)] {
        raw(&path, "json", &set_back(at, by), 4000);
        let e = read(&path, &both).expect_err("two clocks");
        assert!(e.contains("topic \"/t\" of a.mcap: the clock was set back by"), "{at} {by}: {e}");
        assert!(e.contains("make a log of each part"), "{e}");
        assert_eq!(e.matches("set back").count(), 1, "once for all signals of the topic: {e}");
    }
}

#[test]
fn fault_what_another_clock_gave_is_dropped_and_counted_where_it_is_little() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    raw(&path, "json", &set_back(960, 100), 4000);
    let flight = read(&path, &one_signal("log")).expect("most is of one clock");
    let x = &flight.signals["x"];
    assert_eq!((x.account.count, x.account.dropped_times, x.account.dropped_clock), (960, 40, 40));
    assert_eq!(x.series.value.last(), Some(&959.0));
    let said = texts(&flight);
    let of =
        |text: &&str| text.contains("of the one that gave fewer, dropped (4 %; up to 10 % are)");
    assert!(said.iter().any(of), "{said:?}");
    assert!(!said.iter().any(|text| text.contains("more than a day")), "{said:?}");
    // where the record ends before the clock is there again, only the time that came twice goes
    raw(&path, "json", &set_back(900, 5), 4000);
    let flight = read(&path, &one_signal("log")).expect("a second came twice");
    let x = &flight.signals["x"].account;
    assert_eq!((x.count, x.dropped_twice, x.dropped_clock), (800, 200, 0));
    let said = texts(&flight);
    let of = |text: &&str| {
        text.contains("at 1 place (by 4.990 s")
            && text.contains("200 of 1000 messages (20 %) are of a time that came twice")
            && text.contains("however many they are")
    };
    assert!(said.iter().any(of), "{said:?}");
}

#[test]
fn fault_of_two_clocks_that_take_turns_the_rarer_one_is_dropped_or_the_flight_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let read_with = |is_other: &dyn Fn(usize) -> bool, by: i64| {
        let mut messages = regular(1000);
        for (_, log, publish, _) in messages
            .iter_mut()
            .enumerate()
            .filter(|(k, _)| is_other(*k))
            .map(|(_, message)| message)
        {
            *log = log.saturating_add_signed(by * 1_000_000_000);
            *publish = *log;
        }
        raw(&path, "json", &messages, 4000);
        read(&path, &one_signal("log"))
    };
    for by in [-5000, 5000] {
        let block = |k: usize| (300..350).contains(&k);
        for is_other in [&(|k: usize| k % 20 == 7) as &dyn Fn(usize) -> bool, &block] {
            let flight = read_with(is_other, by).expect("most is of one clock");
            let x = &flight.signals["x"];
            assert_eq!((x.account.count, x.account.dropped_clock), (950, 50), "{by}");
            let length = x.series.t_s[949] - x.series.t_s[0];
            assert!((length - 9.99).abs() < 1e-6, "{length} s");
        }
        let e = read_with(&|k| k % 5 == 3, by).expect_err("a fifth");
        assert!(e.contains("forth and back by") && e.contains("200 times: two clocks gave"), "{e}");
    }
    // over one and the same time
    for by in [-3, 3] {
        let flight = read_with(&|k| k % 20 == 7, by).expect("most is of one clock");
        let x = &flight.signals["x"];
        assert_eq!((x.account.count, x.account.dropped_clock), (950, 50), "{by}");
        let length = x.series.t_s[949] - x.series.t_s[0];
        assert!((length - 9.99).abs() < 1e-6, "{length} s");
        let e = read_with(&|k| k % 2 == 1, by).expect_err("half");
        for words in [
            "topic \"/t\" of a.mcap: the clock went forth and back by 3.000 s, 500 times: two clocks",
            "500 of 1000 messages (50 %) are of the one that gave fewer",
        ] {
            assert!(e.contains(words), "{e}");
        }
    }
    // a pause is none of these
    let flight = read_with(&|k| k >= 500, 600).expect("a pause");
    assert_eq!(flight.signals["x"].account.count, 1000);
}

#[test]
fn fault_times_that_go_forth_and_back_by_little_are_sorted_with_a_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    // 505 ms ahead: every other message, every twentieth, and one
    for (every, severity) in
        [(2, Severity::Warning), (20, Severity::Warning), (1000, Severity::Info)]
    {
        let mut messages = regular(1000);
        for (_, log, publish, _) in messages.iter_mut().skip(7).step_by(every) {
            *log += 505_000_000;
            *publish = *log;
        }
        raw(&path, "json", &messages, 4000);
        let flight = read(&path, &one_signal("log")).expect("read");
        assert_eq!(flight.signals["x"].account.count, 1000);
        let of = |n: &&Note| n.text.contains("of 1000 messages out of order, sorted");
        let said: Vec<&Note> = flight.notes.iter().filter(of).collect();
        assert!(said.len() == 1 && said[0].severity == severity, "{every}: {:?}", flight.notes);
        let why = said[0].text.contains("two clocks or two sources may have given the times");
        assert_eq!(why, severity == Severity::Warning, "{}", said[0].text);
    }
}

#[test]
fn stamps_in_whole_ns_are_read_to_the_ns() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let after = |i: u64| i * 10_000_000 + 37 + i;
    let messages: Vec<_> = (0..300)
        .map(|i| {
            let ns = START + after(i);
            let text =
                format!("{{\"t\":{{\"ns\":{ns},\"text\":\"{ns}\",\"f\":{ns}.0}},\"x\":{i}}}");
            ("/t", START + i * 10_000_000, 0, text)
        })
        .collect();
    raw(&path, "json", &messages, 4000);
    let times = |field: &str| {
        let map = one_signal(field) + "time_unit = \"ns\"\n";
        read(&path, &map).expect("read").signals["x"].series.t_s.clone()
    };
    let exact: Vec<f64> = (0..300).map(|i| after(i) as f64 / 1e9).collect();
    assert_eq!(times("t.ns"), exact);
    assert_eq!(times("t.text"), exact);
    // a number with a point is what it is
    let near = times("t.f").iter().zip(&exact).all(|(a, b)| (a - b).abs() <= 129e-9);
    assert!(near);
}

#[test]
fn fault_a_signal_without_a_sample_is_missing_unless_it_may_be_lacking() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let mut messages = regular(100);
    messages[..90].iter_mut().for_each(|m| m.3 = "{\"x\":NaN}".into());
    messages[90..].iter_mut().for_each(|m| m.3 = "{\"x\":7}".into());
    raw(&path, "json", &messages, 4000);
    let outside = one_signal("log") + "range = [0.0, 1.0]\n";
    let text = "/t x: no sample is left: of 100 messages 90 hold NaN, 10 are outside its range";
    for (map, severity) in
        [(outside.clone(), Severity::Missing), (outside + "optional = true\n", Severity::Warning)]
    {
        let flight = read(&path, &map).expect("the flight goes on");
        assert_eq!(flight.signals["x"].series.value.len(), 0);
        let of = |n: &&Note| n.severity == severity && n.text.starts_with(text);
        assert_eq!(flight.notes.iter().filter(of).count(), 1, "{:?}", flight.notes);
    }
}
