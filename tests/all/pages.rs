//! The examples of the documentation are what they say: configuration files that are read without a
//! complaint.

use koehler::stage::diagnose;
use koehler::{config, pipeline, simulate};

#[test]
fn the_pipeline_files_of_the_pages_are_read() {
    let pages = [include_str!("../../docs/pipeline.md"), include_str!("../../docs/flight-path.md")];
    let examples: Vec<&str> = pages
        .iter()
        .flat_map(|page| page.split("```toml\n").skip(1))
        .filter_map(|b| b.split("```").next())
        .collect();
    assert!(examples.len() >= 7);
    for text in examples {
        let (settings, _) = config::parse::<pipeline::Settings>("pipeline.md", text)
            .unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert!(!settings.title.is_empty());
    }
}

#[test]
fn the_campaign_files_of_the_page_are_read() {
    let page = include_str!("../../docs/campaign.md");
    let examples: Vec<&str> =
        page.split("```toml\n").skip(1).filter_map(|b| b.split("```").next()).collect();
    assert_eq!(examples.len(), 2);
    for text in examples {
        let (settings, doc) = config::parse::<simulate::Settings>("campaign.md", text)
            .unwrap_or_else(|e| panic!("{e}\n{text}"));
        let found = simulate::check(&settings, &doc, None);
        assert!(found.0.is_empty(), "{found}");
    }
}

#[test]
fn the_diagnoses_of_the_pages_are_read() {
    let pages = [include_str!("../../docs/diagnose.md"), include_str!("../../docs/effects.md")];
    let blocks = pages
        .iter()
        .flat_map(|page| page.split("```toml\n").skip(1))
        .filter_map(|b| b.split("```").next());
    let examples: Vec<&str> = blocks.filter(|block| block.contains("[[diagnose]]")).collect();
    assert!(examples.len() >= 2);
    for text in examples {
        let whole = format!(
            "title = \"A page\"\nchannels = \"c.toml\"\nlogs = [\"*.mcap\"]\n[derive]\nrate_hz = 1.0\n{text}"
        );
        let (settings, _) = config::parse::<pipeline::Settings>("page.md", &whole)
            .unwrap_or_else(|e| panic!("{e}\n{text}"));
        let diagnoses: Vec<diagnose::Settings> = settings.read("diagnose").expect("as its schema");
        assert!(!diagnoses.is_empty() && diagnoses.iter().all(|d| !d.effects.is_empty()));
    }
}
