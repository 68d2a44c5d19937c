//! The table `tolerances` in; what validated maneuvers use of their tolerances, as a table and as a
//! sentence, out.

use super::columns::Columns;
use super::format::{count, display_unit, few, number, plain};
use super::grid::{Cell, Grid, Level, Row};

/// One test of one maneuver of one validation: its rows, and whether it is passed.
struct Test {
    name: String,
    rows: Vec<usize>,
    verdict: &'static str,
}

/// All tests, in the order of the table.
fn tests(rows: &Columns) -> Vec<Test> {
    let all = rows.groups(["validation", "segment", "test"]);
    let test = |([validation, segment, test], of): ([String; 3], Vec<usize>)| {
        let is = |verdict: &str| of.iter().any(|&row| rows.text("group_verdict", row) == verdict);
        let verdict = match (is("outside"), is("not determined")) {
            (true, _) => "outside",
            (_, true) => "not determined",
            _ => "within",
        };
        Test { name: format!("{test} of {segment} ({validation})"), rows: of, verdict }
    };
    all.into_iter().map(test).collect()
}

/// How many tests are passed, and which are not: a problem where an error is too large.
pub fn summary(rows: Option<&Columns>) -> Option<(Level, String)> {
    let rows = rows.filter(|rows| rows.rows() > 0)?;
    let tests = tests(rows);
    let of = |verdict: &str| -> Vec<String> {
        tests.iter().filter(|test| test.verdict == verdict).map(|test| test.name.clone()).collect()
    };
    let (outside, open) = (of("outside"), of("not determined"));
    let passed = tests.len() - outside.len() - open.len();
    let mut text =
        format!("{passed} of {} are within their tolerances.", count(tests.len(), "test"));
    if !outside.is_empty() {
        text.push_str(&format!(" Outside: {}.", few(&outside)));
    }
    if !open.is_empty() {
        text.push_str(&format!(" Not determined: {}.", few(&open)));
    }
    let level = match (outside.is_empty(), open.is_empty()) {
        (false, _) => Level::Bad,
        (_, false) => Level::Warn,
        _ => Level::Good,
    };
    Some((level, text))
}

/// One row per tolerance of a maneuver.
pub fn grid(rows: &Columns) -> Grid {
    let mut table = Grid::new([
        "validation",
        "maneuver",
        "test",
        "output",
        "~verdict",
        "#error",
        "#tolerance",
        "#used|%",
        "#measured / modelled",
    ]);
    table.note = Some(
        "A test is passed where every group of its tolerances is; of the alternatives of a group one suffices. Period and damping are those of \
         the damped oscillation that fits best what follows the last input, measured and modelled."
            .into(),
    );
    let lines = tests(rows).into_iter().flat_map(|test| test.rows).map(|row| line(rows, row));
    table.rows.extend(lines);
    table
}

fn line(rows: &Columns, row: usize) -> Row {
    let (factor, unit) = display_unit(&rows.unit_in("unit", row));
    let of = |name: &str| rows.number(name, row);
    let unit = if unit == "-" { String::new() } else { format!(" {unit}") };
    let with_unit = |value: f64| match value.is_finite() {
        true => format!("{}{unit}", number(factor * value, 3)),
        false => "none".to_string(),
    };
    let (verdict, group) = (rows.text("verdict", row), rows.text("group_verdict", row));
    let level = match group.as_str() {
        "within" => Level::Good,
        "outside" => Level::Bad,
        _ => Level::Warn,
    };
    let alternatives = (verdict != group).then(|| format!("the group is {group}"));
    let sub = Some(rows.text("why", row)).filter(|why| !why.is_empty()).or(alternatives);
    let both = match of("measured").is_finite() {
        true => format!("{} / {}", with_unit(of("measured")), with_unit(of("modelled"))),
        false => String::new(),
    };
    let cells = vec![
        rows.text("validation", row).into(),
        rows.text("segment", row).into(),
        Cell {
            text: rows.text("test", row),
            sub: Some(rows.text("group", row)).filter(|group| !group.is_empty()),
            level: None,
        },
        Cell { text: rows.text("output", row), sub: Some(rows.text("of", row)), level: None },
        Cell { text: verdict, sub, level: Some(level) },
        with_unit(of("error")).into(),
        with_unit(of("tolerance")).into(),
        plain(100.0 * of("used"), 0).into(),
        both.into(),
    ];
    Row { level: None, pick: None, cells }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    fn table(verdicts: &[(&str, &str, &str)]) -> Columns {
        let n = verdicts.len();
        let table = Table::build("tolerances")
            .repeat("validation", "v")
            .repeat("flight", "f")
            .repeat("segment", "f.01")
            .strings("test", verdicts.iter().map(|v| v.0))
            .opt_strings("group", vec![Some("pitch"); n])
            .repeat("output", "q")
            .repeat("of", "response")
            .repeat("unit", "rad/s")
            .f64("measured", vec![f64::NAN; n])
            .f64("modelled", vec![f64::NAN; n])
            .f64("error", vec![0.02; n])
            .f64("tolerance", vec![0.04; n])
            .f64("used", vec![0.5; n])
            .strings("verdict", verdicts.iter().map(|v| v.1))
            .strings("group_verdict", verdicts.iter().map(|v| v.2))
            .opt_strings("why", vec![None::<&str>; n])
            .finish()
            .expect("a table");
        Columns::of(&table)
    }

    #[test]
    fn the_sentence_counts_tests_and_names_those_that_fail() {
        let passed = [("a", "outside", "within"), ("a", "within", "within")];
        let (level, text) = summary(Some(&table(&passed))).expect("a sentence");
        assert_eq!(
            (level, text.as_str()),
            (Level::Good, "1 of 1 test are within their tolerances.")
        );
        let failed = [passed[0], ("b", "outside", "outside"), ("c", "within", "not determined")];
        let (level, text) = summary(Some(&table(&failed))).expect("a sentence");
        assert_eq!(level, Level::Bad);
        assert!(
            text.contains("1 of 3 tests") && text.contains("Outside: b of f.01 (v)."),
            "{text}"
        );
        assert!(text.contains("Not determined: c of f.01 (v)."), "{text}");
    }

    #[test]
    fn an_alternative_that_is_outside_says_how_its_group_is() {
        let shown = grid(&table(&[("a", "outside", "within")]));
        let cell = &shown.rows[0].cells[4];
        assert_eq!((cell.text.as_str(), cell.level), ("outside", Some(Level::Good)));
        assert_eq!(cell.sub.as_deref(), Some("the group is within"));
        assert_eq!(shown.rows[0].cells[5].text, "1.15 deg/s");
    }
}
