//! A flight's id in; the file of its page, and which sections belong on which page, out.
//!
//! Files are named relative to the output folder, links relative to the page they stand on: a folder
//! that is copied elsewhere still works.

use super::room::Room;

/// The page that is opened first: all there is, or the index.
pub const INDEX: &str = "report/index.html";
/// The stage that makes the flights' pages: the list has no link to one that failed.
pub const STAGE: &str = "page";
/// The folder of the flights' pages.
const FLIGHTS: &str = "report/flights/";

/// Where a section stands in a report of several pages. A report of one page has all sections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum On {
    /// What is of the campaign.
    Index,
    /// What is of one flight.
    Flights,
    /// What both have: the index of all flights, the page of a flight of this one.
    Both,
}

/// Which page is made.
#[derive(Debug, Clone, Default)]
pub enum Form {
    /// All in one, the script too.
    #[default]
    One,
    /// The campaign, with links to the pages of these flights.
    Index(Vec<String>),
    /// One flight.
    Flight(Turn),
}

/// A flight, and those before and behind it.
#[derive(Debug, Clone, Default)]
pub struct Turn {
    pub flight: String,
    pub previous: Option<String>,
    pub next: Option<String>,
    /// Whether there are so many flights that each has less room.
    pub crowded: bool,
}

/// More flights than this have small pages.
const CROWD: usize = 300;

impl Turn {
    /// That of one of these flights.
    pub fn of(flight: &str, flights: &[String]) -> Turn {
        let at = flights.iter().position(|id| id == flight);
        let beside = |step: isize| flights.get(at?.checked_add_signed(step)?).cloned();
        Turn {
            flight: flight.to_string(),
            previous: beside(-1),
            next: beside(1),
            crowded: flights.len() > CROWD,
        }
    }
}

impl Form {
    /// Whether a section of this place is on the page.
    pub(super) fn shows(&self, on: On) -> bool {
        match self {
            Form::One => true,
            Form::Index(_) => on != On::Flights,
            Form::Flight(_) => on != On::Index,
        }
    }

    /// What the page has room for.
    pub(super) fn room(&self) -> Room {
        match self {
            Form::One => Room::ALL,
            Form::Index(_) => Room::INDEX,
            Form::Flight(turn) if turn.crowded => Room::SMALL,
            Form::Flight(_) => Room::FLIGHT,
        }
    }
}

/// The page of a flight. Ids of flights are safe in paths and links (`table::check_flight`).
pub fn of_flight(flight: &str) -> String {
    format!("{FLIGHTS}{flight}.html")
}

/// The script that pages share; its name has the hash of its bytes, so that no page runs another.
pub(super) fn of_script(hash: &str) -> String {
    format!("report/plots-{hash}.js")
}

/// Whether a file has the name of one of a report's.
pub fn is_of_report(path: &str) -> bool {
    let within = |text: &str, end: &str| text.strip_suffix(end).is_some_and(|t| !t.contains('/'));
    path == INDEX
        || path.strip_prefix(FLIGHTS).is_some_and(|name| within(name, ".html"))
        || path.strip_prefix("report/plots-").is_some_and(|name| within(name, ".js"))
}

/// The link from one page to another.
pub(super) fn link(from: &Form, to: &str) -> String {
    let below = to.strip_prefix("report/").unwrap_or(to);
    match from {
        Form::Flight(_) => format!("../{below}"),
        _ => below.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_from_any_page_to_any_other() {
        let flight = Form::Flight(Turn::of("b", &["a", "b", "c"].map(String::from)));
        let Form::Flight(turn) = &flight else { panic!("a flight") };
        assert_eq!((turn.previous.as_deref(), turn.next.as_deref()), (Some("a"), Some("c")));
        assert_eq!(link(&flight, INDEX), "../index.html");
        assert_eq!(link(&flight, &of_flight("a")), "../flights/a.html");
        assert_eq!(link(&Form::Index(Vec::new()), &of_flight("a")), "flights/a.html");
    }

    #[test]
    fn files_of_a_report_are_known_by_their_names() {
        for path in [INDEX, &of_flight("a.b"), &of_script("0f")] {
            assert!(is_of_report(path), "{path}");
        }
        for path in ["report/mine.html", "report/flights/mine/a.html", "report/plots.txt"] {
            assert!(!is_of_report(path), "{path}");
        }
    }
}
