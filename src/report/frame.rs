//! Sections and what they are built from in, a page as HTML out: its frame, its navigation, the
//! numbers of its plots, and the script that draws them.

use super::checks::{SECTION as CHECKS, Tile, tiles};
use super::columns::Columns;
use super::format;
use super::place::{self, Form};
use super::room;
use super::section::{Given, ReportInput, Section, fault, flight_styles, json};
use crate::error::Result;
use serde::Serialize;
use std::sync::LazyLock;

/// What the frame is filled with.
#[derive(Serialize)]
struct Page<'a> {
    title: &'a str,
    heading: &'a str,
    subtitle: &'a str,
    tiles: Vec<Tile>,
    /// What an interval is, and which units stand where.
    meaning: &'static str,
    around: Around,
    sections: Vec<Built>,
    /// JSON: what the plots are drawn from, by name.
    data: String,
    style: &'static str,
    /// The script, where it stands in the page.
    inside: Option<&'static str>,
}

/// Links from a page to the others.
#[derive(Default, Serialize)]
struct Around {
    index: Option<String>,
    previous: Option<String>,
    next: Option<String>,
    script: Option<String>,
}

impl Around {
    fn of(form: &Form) -> Around {
        let to = |path: &str| Some(place::link(form, path));
        let flight = |id: &Option<String>| to(&place::of_flight(id.as_ref()?));
        match form {
            Form::One => Around::default(),
            Form::Index(_) => Around { script: to(&SCRIPT.path), ..Around::default() },
            Form::Flight(turn) => Around {
                index: to(place::INDEX),
                previous: flight(&turn.previous),
                next: flight(&turn.next),
                script: to(&SCRIPT.path),
            },
        }
    }
}

/// A section as it stands on the page.
#[derive(Serialize)]
struct Built {
    id: &'static str,
    heading: &'static str,
    body: String,
}

/// The page that `input` asks for, of these sections; links lead to all that are `known`. With the
/// counts of a campaign and what its numbers mean at the top, or without.
pub fn page(
    sections: impl IntoIterator<Item = &'static Section>,
    known: &'static [Section],
    input: &ReportInput,
    of_campaign: bool,
) -> Result<String> {
    let sections: Vec<&'static Section> =
        sections.into_iter().filter(|section| input.form.shows(section.on)).collect();
    let named: Vec<&str> = sections.iter().flat_map(|s| s.tables).copied().collect();
    let tables = Columns::of_all(&named, &input.tables);
    let flights = flight_styles(&tables);
    let given = |section: &'static Section| Given {
        input,
        flights: &flights,
        tables: &tables,
        named: section.tables,
        sections: known,
    };
    let environment = environment(&input.form)?;
    let mut built = Vec::new();
    let mut plots = vec![("flights", json(&flights)?)];
    for section in sections.into_iter().filter(|s| input.has(s)) {
        if let Some(mut body) = (section.build)(&given(section))? {
            built.push(Built {
                id: section.id,
                heading: section.heading,
                body: body.html(&environment)?,
            });
            plots.append(&mut body.plots);
        }
    }
    let heading = if let Form::Flight(turn) = &input.form { &turn.flight } else { &input.title };
    let page = Page {
        title: &input.title,
        heading,
        subtitle: &input.subtitle,
        tiles: if of_campaign { tiles(&given(&CHECKS)) } else { Vec::new() },
        meaning: if of_campaign { format::MEANING } else { "" },
        around: Around::of(&input.form),
        sections: built,
        data: object(&plots),
        style: include_str!("html/page.css"),
        inside: matches!(input.form, Form::One).then_some(SCRIPT.text.as_str()),
    };
    environment
        .get_template("page.html")
        .and_then(|template| template.render(minijinja::value::Serde(&page)))
        .map_err(fault)
}

fn environment(form: &Form) -> Result<minijinja::Environment<'static>> {
    let mut environment = minijinja::Environment::new();
    environment.add_filter("most", room::most);
    environment.add_global("room", form.room().rows);
    let elsewhere = match form {
        Form::One | Form::Flight(_) => "The others stand in the tables.",
        Form::Index(_) => "The others stand on the pages of their flights or in the tables.",
    };
    environment.add_global("elsewhere", elsewhere);
    for (name, text) in [
        ("grid.html", include_str!("html/grid.html")),
        ("page.html", include_str!("html/page.html")),
    ] {
        environment.add_template(name, text).map_err(fault)?;
    }
    Ok(environment)
}

/// JSON that may stand inside a script element: no `<` can end the element.
fn object(plots: &[(&str, String)]) -> String {
    let fields: Vec<String> =
        plots.iter().map(|(name, text)| format!("\"{name}\":{text}")).collect();
    format!("{{{}}}", fields.join(",")).replace('<', "\\u003c")
}

/// The plotting library and what draws with it, as one file.
pub struct Script {
    /// Relative to the output folder.
    pub path: String,
    pub text: String,
}

/// Lines, markers and heat maps of plotly.js: `html/plotly/README.md`.
const PLOTLY: &str = include_str!("html/plotly/plotly-cartesian.min.js");

pub static SCRIPT: LazyLock<Script> = LazyLock::new(|| {
    let text = format!("{PLOTLY}\n{}", include_str!("html/page.js"));
    let hash = blake3::hash(text.as_bytes()).to_hex();
    Script { path: place::of_script(&hash[..16]), text }
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plotting_library_is_the_published_one_and_ends_no_script_element() {
        let hash = blake3::hash(PLOTLY.as_bytes()).to_hex();
        assert_eq!(
            hash.as_str(),
            "881efbd133719726dbeadec2527758fc0ae25e17fe9d25f198f6570ecd6b8e21"
        );
        assert!(!SCRIPT.text.contains("</script"));
    }
}
