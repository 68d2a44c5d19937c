//! A made-up campaign in; checks of its index, of the pages of its flights, and of what they weigh, out.
//! `KOEHLER_REPORT_PAGE=/some/folder/page.html cargo test --release --lib report` writes them below that folder.

use super::tests::{Tables, all_of, campaign, frame};
use super::*;
use crate::table::Table;
use std::collections::BTreeSet;

fn ids(n: usize) -> Vec<String> {
    (1..=n).map(|i| format!("flight-{i}")).collect()
}

/// What the stage `page` brings for a flight.
fn of_flight(tables: &Tables, flight: &str) -> Tables {
    let mine = |name: &str| {
        let rows = tables.get(name)?;
        let of = rows.strings("flight").expect("flights");
        Some(rows.filter(|row| of[row] == flight).expect("rows"))
    };
    let owners = Owners::of_flight(flight, mine("segments").as_ref()).expect("segments");
    let wanted = super::tables(&Form::Flight(Turn::default()), &[]);
    let part = |(name, table): (&String, &Table)| {
        (name.clone(), owners.part(table.clone(), flight).expect("rows"))
    };
    let those = tables.iter().filter(|(name, _)| wanted.contains(&name.as_str())).map(part);
    those.filter(|(_, table)| table.rows() > 0).collect()
}

/// What the stage `report` brings.
fn of_index(mut tables: Tables) -> Tables {
    HISTORIES.iter().for_each(|name| drop(tables.remove(*name)));
    tables
}

/// Every file of a report of several pages, by its path.
fn folder(tables: &Tables, flights: &[String]) -> BTreeMap<String, String> {
    let made =
        |form: Form, tables: Tables| page(&ReportInput { form, ..frame(tables) }).expect("a page");
    let mut files: BTreeMap<String, String> = flights
        .iter()
        .map(|f| {
            let form = Form::Flight(Turn::of(f, flights));
            (super::of_flight(f), made(form, of_flight(tables, f)))
        })
        .collect();
    let index = made(Form::Index(flights.to_vec()), of_index(tables.clone()));
    files.insert(INDEX.to_string(), index);
    let (path, text) = script();
    files.insert(path.to_string(), text.to_string());
    files
}

/// Writes a report for a look, below a folder beside the one page where that is wanted.
fn written(files: &BTreeMap<String, String>, below: &str) {
    let Some(page) = std::env::var_os("KOEHLER_REPORT_PAGE") else { return };
    let folder = std::path::Path::new(&page).parent().expect("a folder").join(below);
    for (path, text) in files {
        crate::table::write_atomic(&folder.join(path), text.as_bytes()).expect("written");
    }
}

/// A link of a page as a path relative to the output folder.
fn resolved(page: &str, link: &str) -> String {
    let mut at: Vec<&str> = page.split('/').collect();
    at.pop();
    for step in link.split('/') {
        match step {
            ".." => drop(at.pop()),
            step => at.push(step),
        }
    }
    at.join("/")
}

#[test]
fn every_link_of_every_page_leads_somewhere_and_nowhere_outside() {
    let files = folder(&campaign(), &ids(3));
    written(&files, "");
    let mut reached = BTreeSet::new();
    for (path, html) in files.iter().filter(|(path, _)| path.ends_with(".html")) {
        let text = html.split("<script type=\"application/json\"").next().expect("a page");
        assert!(!text.contains("://"), "{path} points outside");
        let ids = all_of(text, " id=\"");
        assert_eq!(ids.iter().collect::<BTreeSet<_>>().len(), ids.len(), "{path}: {ids:?}");
        for link in all_of(html, "href=\"").into_iter().chain(all_of(html, "src=\"")) {
            match link.strip_prefix('#') {
                Some(id) => assert!(ids.contains(&id), "{path}: #{id} among {ids:?}"),
                None => {
                    let to = resolved(path, link);
                    assert!(files.contains_key(&to), "{path}: {link} is no file");
                    reached.insert((path.as_str(), to));
                }
            }
        }
    }
    let leads = |from: &str, to: &str| reached.contains(&(from, to.to_string()));
    for flight in ids(3) {
        let page = super::of_flight(&flight);
        assert!(leads(INDEX, &page) && leads(&page, INDEX) && leads(&page, script().0), "{flight}");
    }
    let [first, second, third] = [1, 2, 3].map(|i| super::of_flight(&format!("flight-{i}")));
    assert!(leads(&first, &second) && leads(&second, &first) && leads(&second, &third));
    assert!(!leads(&first, &third), "no flight is beside the one after the next");
    assert_eq!(files, folder(&campaign(), &ids(3)), "not the same bytes twice");
}

#[test]
fn a_page_of_a_flight_is_about_that_flight_and_the_index_about_all() {
    let files = folder(&campaign(), &ids(3));
    let (index, second) = (&files[INDEX], &files[&super::of_flight("flight-2")]);
    let has = |html: &str, id: &str| html.contains(&format!("<section id=\"{id}\""));
    for section in ["checks", "list", "lines", "fits", "estimates", "uncertainty", "notes"] {
        assert!(has(index, section), "{section} is not on the index");
    }
    for section in ["checks", "maneuvers", "estimates", "flights", "channels", "notes"] {
        assert!(has(second, section), "{section} is not on the page of a flight");
    }
    for section in ["maneuvers", "flights", "channels", "consistency", "biases"] {
        assert!(!has(index, section), "{section} is on the index");
    }
    for section in ["list", "lines", "fits", "provenance"] {
        assert!(!has(second, section), "{section} is on the page of a flight");
    }
    // Its maneuvers and no others; those of the links beside it are no maneuvers.
    assert!(second.contains("flight-2-s1") && second.contains("\"inputs\":[{\"name\""));
    assert!(!second.contains("flight-1-s1") && !second.contains("flight-3-s1"));
    // The index has a row of every flight, and says what is wrong with the first one.
    let row = index.split("<tr>").find(|row| row.contains("flights/flight-1.html")).expect("a row");
    assert!(row.contains(">problem<") && row.contains("q_imu (sign reversed)"), "{row}");
    assert_eq!(all_of(index, "<a href=\"flights/").len(), 3);
}

#[test]
fn the_index_calls_a_problem_what_the_one_page_does() {
    let one = report(&frame(campaign())).expect("a report");
    let form = Form::Index(ids(3));
    let index = report(&ReportInput { form, ..frame(of_index(campaign())) }).expect("a report");
    assert!(!one.problems.is_empty());
    assert_eq!(index.problems, one.problems);
    let list = index.page.split("<ul class=\"checks\">").nth(1).expect("checks");
    let list = list.split("</ul>").next().expect("their end");
    assert_eq!(list.matches(">problem<").count(), index.problems.len());
}

#[test]
fn fault_a_damaged_flight_has_its_row_and_its_page_and_one_without_a_page_no_link() {
    let lost = |stage: &str, flight: &str| {
        Table::build("notes")
            .strings("flight", [flight])
            .strings("stage", [stage])
            .strings("severity", ["missing"])
            .strings("subject", [flight])
            .i64("count", [1])
            .strings("text", ["the log ends in the middle of a chunk"])
            .finish()
            .expect("notes")
    };
    let mut all = campaign();
    let notes = [super::tests::notes(), lost("ingest", "flight-4"), lost("page", "flight-5")];
    all.insert("notes".into(), Table::concat("notes", &notes).expect("notes"));
    let files = folder(&all, &ids(5));
    let index = &files[INDEX];
    let row = |flight: &str| {
        index.split("<tr>").find(|row| {
            row.starts_with(&format!("<td>{flight}")) || row.contains(&format!("\">{flight}</a>"))
        })
    };
    let damaged = row("flight-4").expect("a row");
    assert!(damaged.contains("flights/flight-4.html"), "{damaged}");
    assert!(damaged.contains("ingest: the log ends in the middle of a chunk"), "{damaged}");
    assert!(files[&super::of_flight("flight-4")].contains("the log ends in the middle of a chunk"));
    let without = row("flight-5").expect("a row");
    assert!(without.contains("(no page)") && !without.contains("href"), "{without}");
    assert!(index.contains("<b>5</b><span>flights</span>"), "those without rows count too");
}

/// The made-up campaign's tables again and again, as flights of other names; without histories.
fn many(n: usize) -> Tables {
    let renamed = |table: &Table, k: usize| {
        let new = |old: &str| match old.strip_prefix("flight-") {
            Some(rest) => {
                let (number, segment) =
                    rest.split_once('-').map_or((rest, None), |(a, b)| (a, Some(b)));
                let number = 3 * k + number.parse::<usize>().expect("a number");
                segment.map_or(format!("flight-{number}"), |s| format!("flight-{number}-{s}"))
            }
            None => old.to_string(),
        };
        let mut built = Table::build(table.name());
        for column in table.columns() {
            let name = column.name.as_str();
            built = match column.kind {
                crate::table::Kind::F64 => built.f64(name, table.f64(name).expect("numbers")),
                crate::table::Kind::I64 => built.i64(name, table.i64(name).expect("counts")),
                crate::table::Kind::Bool => built.bools(name, table.bools(name).expect("flags")),
                crate::table::Kind::String => built.opt_strings(
                    name,
                    table.opt_strings(name).expect("texts").into_iter().map(|t| t.map(new)),
                ),
            };
        }
        built.finish().expect("a table")
    };
    let again = |(name, table): (&String, &Table)| {
        let of_all = ["fits", "bands", "repeats", "budget", "profiles"].contains(&name.as_str());
        let copies: Vec<Table> =
            (0..if of_all { 1 } else { n / 3 }).map(|k| renamed(table, k)).collect();
        (name.clone(), Table::concat(name, &copies).expect("a table"))
    };
    of_index(campaign()).iter().map(again).collect()
}

#[test]
fn the_index_of_a_thousand_flights_is_below_a_megabyte_and_has_them_all() {
    let n = 999;
    let form = Form::Index(ids(n));
    let index = page(&ReportInput { form, ..frame(many(n)) }).expect("a page");
    println!("{} bytes", index.len());
    let (path, script) = script();
    let files = [(INDEX, index.as_str()), (path, script)].map(|(p, t)| (p.into(), t.into()));
    written(&files.into(), "many");
    assert!(index.len() < 1_000_000, "{} bytes", index.len());
    assert_eq!(all_of(&index, "<a href=\"flights").len(), n);
    assert!(index.contains("id=\"list-filter\"") && index.contains("999 of 999"));
    // What is left out is said.
    assert!(index.contains("points is drawn") && index.contains("are not drawn, whose largest"));
    let rows =
        "rows, what is remarkable before the rest. The others stand on the pages of their flights";
    assert!(index.contains(rows));
    assert!(index.contains("Channels that do not fit with the others"), "a problem is said");
}

#[test]
fn a_page_of_a_flight_is_below_a_megabyte_and_among_many_below_what_all_of_them_may_take() {
    let all = campaign();
    let inputs = [("elevator".to_string(), vec!["servo_torque".to_string(), "alpha".to_string()])];
    let size = |flights: usize| {
        let form = Form::Flight(Turn::of("flight-2", &ids(flights)));
        let tables = of_flight(&all, "flight-2");
        let inputs = inputs.clone().into();
        let page = page(&ReportInput { form, inputs, ..frame(tables) }).expect("a page");
        println!("{} bytes among {flights}", page.len());
        // The maneuvers fit as they are, twelve minutes do not.
        assert!(page.contains("Every sample is drawn") && page.contains("thinned for display"));
        page.len()
    };
    assert!(size(200) < 1_000_000);
    assert!(size(1000) < 290_000);
}
