//! The results of a study in; the numbers of its figures, and the page that draws them, out.

use super::judged::Judged;
use super::results::Results;
use super::study::Study;
use crate::error::Result;
use crate::report::{self, ReportInput};
use crate::table::Table;
use indexmap::IndexMap;

/// Designs that are drawn alike, by what the legend calls them, with their places in the study.
type Alike<'a> = IndexMap<String, Vec<(usize, &'a Judged)>>;

/// One point: number and names of the figure, number and label of the series, x, y.
struct Point {
    figure: (usize, String, String),
    series: (usize, String),
    x: f64,
    y: f64,
    x_title: &'static str,
    x_unit: &'static str,
}

/// The page with the figures of a study: of every estimate the traces by the designs' numbers, as
/// in Fig. 9 of AIAA 2009-5692, and against the excursion of airspeed where it is watched.
///
/// # Errors
/// A fault of the program.
pub fn page(study: &Study, results: &Results) -> Result<String> {
    report::of_figures(&ReportInput {
        title: study.settings.title.clone(),
        subtitle: study.settings.source.clone(),
        tables: [("figures".to_string(), table(results)?)].into(),
        ..ReportInput::default()
    })
}

fn table(results: &Results) -> Result<Table> {
    let mut points = Vec::new();
    for (i, judged) in results.estimates.iter().enumerate() {
        let alike = alike(judged);
        let name = judged.first().map_or("", |j| j.estimate.as_str());
        let of = |what: &str| format!("{name}: trace of the Cramer-Rao bound{what}");
        let by_number = |k: usize, _: &Judged| (k + 1) as f64;
        let figure = (2 * i + 1, format!("{name}_designs"), of(", by design"));
        points.extend(drawn(&alike, figure, ("number of the design", ""), &by_number));
        let airspeed =
            |_: usize, j: &Judged| j.facts.as_ref().map_or(f64::NAN, |f| f.excursions.0[0]);
        let figure =
            (2 * i + 2, format!("{name}_airspeed"), of(" against the excursion of airspeed"));
        points.extend(drawn(&alike, figure, ("excursion of airspeed", "m/s"), &airspeed));
    }
    let number =
        |of: &dyn Fn(&Point) -> usize| points.iter().map(|p| of(p) as i64).collect::<Vec<_>>();
    let value = |of: &dyn Fn(&Point) -> f64| points.iter().map(of).collect::<Vec<f64>>();
    Table::build("figures")
        .i64("number", number(&|p| p.figure.0))
        .strings("figure", points.iter().map(|p| &p.figure.1))
        .strings("title", points.iter().map(|p| &p.figure.2))
        .i64("series", number(&|p| p.series.0))
        .strings("label", points.iter().map(|p| &p.series.1))
        .repeat("kind", "points")
        .f64("x", value(&|p| p.x))
        .f64("y", value(&|p| p.y))
        .f64("lower", value(&|_| f64::NAN))
        .f64("upper", value(&|_| f64::NAN))
        .strings("x_title", points.iter().map(|p| p.x_title))
        .strings("x_unit", points.iter().map(|p| p.x_unit))
        .repeat("y_title", "trace x 10^6")
        .repeat("y_unit", "")
        .finish()
}

/// The points of one figure; without those that have no trace or no abscissa.
fn drawn(
    alike: &Alike,
    figure: (usize, String, String),
    (x_title, x_unit): (&'static str, &'static str),
    x: &dyn Fn(usize, &Judged) -> f64,
) -> Vec<Point> {
    let mut points = Vec::new();
    for (s, (label, designs)) in alike.iter().enumerate() {
        for (k, judged) in designs {
            let (x, y) = (x(*k, judged), 1e6 * judged.trace);
            if x.is_finite() && y.is_finite() {
                let (figure, series) = (figure.clone(), (s + 1, label.clone()));
                points.push(Point { figure, series, x, y, x_title, x_unit });
            }
        }
    }
    points
}

/// Designs of one kind and amplitude.
fn alike(judged: &[Judged]) -> Alike<'_> {
    let mut all = Alike::new();
    for (k, one) in judged.iter().enumerate() {
        let m = &one.design.maneuver;
        let label = match (&m.amplitude, &m.amplitudes) {
            _ if m.kind == "profile" => one.design.name.clone(),
            (Some(a), _) => format!("{} {}", m.kind, f64::from(m.polarity) * a),
            (None, Some(_)) => format!("{} var", m.kind),
            (None, None) => m.kind.clone(),
        };
        all.entry(label).or_default().push((k, one));
    }
    all
}
