//! Is the report a folder whose pages follow the flights, and one page where that is asked for?

use crate::campaign::Campaign;

fn page(c: &Campaign, flight: &str) -> Option<String> {
    std::fs::read_to_string(c.path(&format!("out/report/flights/{flight}.html"))).ok()
}

fn index(c: &Campaign) -> String {
    std::fs::read_to_string(c.path("out/report/index.html")).expect("the index")
}

/// Names of the files in the report's folder.
fn scripts(c: &Campaign) -> Vec<String> {
    let entries = std::fs::read_dir(c.path("out/report")).expect("a folder");
    let names = entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned());
    names.filter(|name| name.ends_with(".js")).collect()
}

#[test]
fn every_flight_has_its_page_and_the_records_know_all_files() {
    let c = Campaign::new();
    let run = c.run().ended(0);
    assert_eq!((run.stage("page"), run.stage("report")), ((3, 0), (1, 0)));
    let [script] = &scripts(&c)[..] else { panic!("one script") };
    for flight in ["flight-1", "flight-2", "flight-3"] {
        let page = page(&c, flight).expect("a page");
        assert!(page.contains(&format!("src=\"../{script}\"")) && page.len() < 1_000_000);
        // A fit of its own and none of the others.
        assert!(page.contains(&format!("{flight}.01")), "{flight}");
        let others = ["flight-1", "flight-2", "flight-3"].into_iter().filter(|f| *f != flight);
        others
            .for_each(|other| assert!(!page.contains(&format!("{other}.01")), "{flight} {other}"));
        assert!(index(&c).contains(&format!("href=\"flights/{flight}.html\"")));
    }
    assert!(index(&c).contains(&format!("src=\"{script}\"")));
    c.koehler("verify", &[]).ended(0);
    assert!(c.koehler("gc", &[]).ended(0).out.contains("nothing to remove"));
    assert!(c.run().ended(0).out.contains("nothing to do"));

    // A page that is gone or changed is made again, alone.
    std::fs::write(c.path("out/report/flights/flight-2.html"), b"mine").expect("written");
    let run = c.run().ended(0);
    assert_eq!((run.stage("page"), run.stage("report")), ((1, 2), (0, 1)));

    // A flight that goes takes its page along.
    std::fs::remove_file(c.path("logs/flight-3.mcap")).expect("removed");
    c.run().ended(0);
    assert!(page(&c, "flight-3").is_none() && !index(&c).contains("flight-3.html"));
    assert!(!page(&c, "flight-2").expect("a page").contains("flight-3.html"));
}

#[test]
fn a_report_in_a_single_file_is_one_and_says_the_same() {
    let c = Campaign::new();
    c.run().ended(0);
    let several = index(&c);
    c.edit("pipeline.toml", "[report]", "[report]\nsingle_file = true");
    c.run().ended(0);
    let one = index(&c);
    assert!(!c.path("out/report/flights").exists() && scripts(&c).is_empty());
    assert!(one.len() > 1_500_000 && several.len() < 1_000_000);
    assert!(one.contains("id=\"maneuvers\"") && !one.contains("<script src="));
    let equation = |html: &str| {
        let text = html.split("<p class=\"equation\">").nth(1).expect("a line");
        text.split("</p>").next().expect("its end").to_string()
    };
    assert_eq!(equation(&one), equation(&several));
    c.koehler("verify", &[]).ended(0);
    c.edit("pipeline.toml", "single_file = true", "");
    c.run().ended(0);
    assert_eq!(index(&c), several, "not the same bytes again");
}

#[test]
fn fault_a_damaged_flight_has_a_page_that_says_why() {
    let c = Campaign::new();
    std::fs::write(c.path("logs/flight-2.mcap"), b"this is no log").expect("written");
    c.run().ended(1);
    let page = page(&c, "flight-2").expect("a page");
    let index = index(&c);
    let row = index.split("<tr>").find(|row| row.contains(">flight-2<")).expect("a row");
    assert!(row.contains(">problem<") && row.contains("ingest: "), "{row}");
    assert!(
        page.contains("<section id=\"notes\"") && page.contains("ingest"),
        "it does not say why"
    );
}
