//! The lines before the data of a text in; the names of its columns, and what they say of units, out.

use super::cells::{each_row, plain};
use super::settings::Import;
use crate::units::Unit;

/// What says nothing of a unit: an index, or that there is none.
const NO_UNIT: [&str; 3] = ["", "1", "-"];

/// The names of the columns of a text, and the lines below them.
#[derive(Debug, Default)]
pub struct Head {
    /// Empty without a line of names.
    pub names: Vec<String>,
    /// Lines that may have units, each with as many cells as there are names.
    below: Vec<Vec<String>>,
}

impl Head {
    /// What stands in front of the data.
    pub fn of(settings: &Import, text: &str) -> Head {
        let line = settings.names_line.unwrap_or(settings.header_lines);
        let Some(first) = line.checked_sub(1) else { return Head::default() };
        let lines = plain(text).lines().take(settings.header_lines);
        let mut rows = lines.skip(first).map(|line| cells(settings, line));
        let names = rows.next().unwrap_or_default();
        let below = rows.filter(|row| row.len() == names.len()).collect();
        Head { names, below }
    }

    /// The unit that the head says column `at` (from 0) is in, where that is another than `unit` and no
    /// `despite` says that it is wrong.
    pub fn other_unit(&self, at: usize, unit: &str, despite: Option<&str>) -> Option<String> {
        // A name that is taken apart at its blanks stands for another column.
        if self.names.iter().any(|name| name.starts_with(['[', '('])) {
            return None;
        }
        let below = self.below.iter().filter_map(|row| row.get(at)).map(|cell| {
            let inner = bracketed(cell).filter(|_| cell.starts_with(['[', '(']));
            Said { text: inner.unwrap_or(cell), sure: true }
        });
        let beside = self.names.get(at).and_then(|name| beside(name));
        beside.into_iter().chain(below).find_map(|said| said.other(unit, despite))
    }

    /// Whether the line of names has nothing but numbers.
    pub fn is_numbers(&self) -> bool {
        !self.names.is_empty()
            && self.names.iter().all(|name| fast_float2::parse::<f64, _>(name).is_ok())
    }
}

fn cells(settings: &Import, line: &str) -> Vec<String> {
    let mut cells = Vec::new();
    each_row(settings.separator, line, &mut |row| {
        cells = row.cells.iter().map(|name| name.to_string()).collect();
        true
    });
    cells
}

/// The unit in brackets at the end of a column's name, where that is another than `unit` and no `despite`
/// says that it is wrong.
pub fn other_unit(name: &str, unit: &str, despite: Option<&str>) -> Option<String> {
    beside(name)?.other(unit, despite)
}

/// What may be a unit.
struct Said<'a> {
    text: &'a str,
    /// A letter in round brackets may be anything: `V (A)` is that of sensor A.
    sure: bool,
}

impl Said<'_> {
    fn other(&self, unit: &str, despite: Option<&str>) -> Option<String> {
        let text = self.text.trim();
        if NO_UNIT.contains(&text) || despite.map(str::trim) == Some(text) {
            return None;
        }
        let (said, declared) = (Unit::parse(text).ok()?, Unit::parse(unit).ok()?);
        let counts = self.sure || text.chars().count() > 1 || said.dim == declared.dim;
        (counts && !said.same(&declared)).then(|| text.to_string())
    }
}

/// What stands in brackets at the end of a name.
fn beside(name: &str) -> Option<Said<'_>> {
    let text = bracketed(name).filter(|text| text.len() + 2 < name.trim().len())?;
    Some(Said { text, sure: name.trim_end().ends_with(']') })
}

/// The inside of the brackets that a text ends with.
fn bracketed(text: &str) -> Option<&str> {
    let text = text.trim();
    let close = text.chars().next_back().filter(|c| [']', ')'].contains(c))?;
    let open = if close == ']' { '[' } else { '(' };
    let mut depth = 0;
    let start = text.char_indices().rev().find(|(_, c)| {
        depth += i32::from(*c == close) - i32::from(*c == open);
        depth == 0
    })?;
    text.get(start.0 + 1..text.len() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_in_brackets_is_held_against_the_one_that_is_declared() {
        for (name, unit, other) in [
            ("alpha [deg]", "rad", Some("deg")),
            ("alpha[deg]", "rad", Some("deg")),
            ("tas (kt)", "m/s", Some("kt")),
            ("q (1/(rad s))", "deg", Some("1/(rad s)")),
            ("az (g)", "m/s^2", Some("g")),
            ("V [A]", "m/s", Some("A")),
            // the same by another name, no unit, a sensor, an item of a list, brackets elsewhere
            ("alpha [degrees]", "deg", None),
            ("tas (kts)", "kt", None),
            ("V (A)", "m/s", None),
            ("q[1]", "deg", None),
            ("alpha (left)", "deg", None),
            ("alpha [deg] left", "rad", None),
            ("[deg]", "rad", None),
            ("alpha", "rad", None),
            ("alpha ]", "rad", None),
        ] {
            assert_eq!(other_unit(name, unit, None).as_deref(), other, "{name} {unit}");
        }
        assert_eq!(other_unit("alpha [deg]", "rad", Some("deg")), None);
        assert_eq!(other_unit("alpha [deg]", "rad", Some("grad")).as_deref(), Some("deg"));
    }

    fn head(settings: &str, text: &str) -> Head {
        let text_of = format!(
            "input = [\"a.csv\"]\noutput = \"a.mcap\"\n{settings}\ntime = {{ rate_hz = 1 }}\n[[topic]]\nname = \"/t\"\nfields = []\n"
        );
        let (settings, _) = crate::config::parse::<Import>("import.toml", &text_of).expect("read");
        Head::of(&settings, text)
    }

    #[test]
    fn a_row_of_units_stands_below_the_names() {
        let comma = "separator = \"comma\"\nnames_line = 2\nheader_lines = 4";
        let of = head(comma, "made today\nt,V,alpha\ns,kt,(deg)\na remark\n1,2,3\n");
        assert_eq!(of.names, ["t", "V", "alpha"]);
        assert_eq!(of.other_unit(1, "m/s", None).as_deref(), Some("kt"));
        assert_eq!(of.other_unit(2, "rad", None).as_deref(), Some("deg"));
        assert_eq!(of.other_unit(0, "ms", None).as_deref(), Some("s"));
        assert_eq!((of.other_unit(1, "kt", None), of.other_unit(7, "kt", None)), (None, None));
        // the data are none of it
        let of = head("separator = \"comma\"\nheader_lines = 1", "t,V\n1,m\n");
        assert_eq!(of.other_unit(1, "kt", None), None);
        // a blank in a name makes two of it: nothing is known of what stands where
        let blanks = head("header_lines = 1", "t V [kt] alpha [deg]\n0 1 2\n");
        assert_eq!(blanks.other_unit(2, "rad", None), None);
    }

    #[test]
    fn a_line_of_numbers_is_no_line_of_names() {
        let of = |text: &str| head("separator = \"comma\"\nheader_lines = 1", text).is_numbers();
        assert!(of("0.0,1.5\n0.1,2\n"));
        assert!(!of("t,1\n0.1,2\n") && !of("") && !of("t,v\n"));
    }
}
