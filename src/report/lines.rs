//! `fits`, `bands` and `points` in, the plots of coefficients versus angle of attack and the table
//! of fitted lines out.

use super::columns::Columns;
use super::format::{bracketed, display_unit, number, plain, shorts, slope_unit, with_half};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::room::Room;
use super::section::FlightStyle;
use super::section::{Body, Given, Section};
use crate::error::Result;
use crate::fit::half_95;
use crate::math::distribution::INTERVAL_95;
use serde::Serialize;
use std::collections::BTreeMap;

pub const PLOTS: Section = Section {
    id: "lines",
    heading: "Coefficients versus angle of attack",
    on: On::Index,
    tables: &["fits", "bands", "points"],
    build,
};

pub const TABLE: Section = Section {
    id: "fits",
    heading: "Fitted lines",
    on: On::Index,
    tables: &["fits"],
    build: |given| Ok(Some(Body::grid(table(given.get("fits"))))),
};

#[derive(Serialize)]
struct Shown<'a> {
    lines: Lines,
    /// Whether every flight has a name beside the plots.
    named: bool,
    flights: &'a [FlightStyle],
}

fn build(given: &Given) -> Result<Option<Body>> {
    let (mut lines, mut plots) = lines(given.get("fits"), given.get("bands"), given.get("points"));
    let flights = given.flights;
    let named = flights.len() <= NAMED;
    if !named {
        plots.iter_mut().for_each(LinePlot::together);
    }
    lines.levels.extend(sampled(&mut plots, given.room()));
    Body::new(include_str!("html/lines.html"), Shown { lines, named, flights })
        .plot("lines", &plots)
        .map(Some)
}

/// What the plot of one line is drawn from (JSON).
#[derive(Debug, Serialize)]
pub struct LinePlot {
    pub index: usize,
    pub parameter: String,
    pub unit: String,
    pub against: String,
    pub x_unit: String,
    pub band: Option<Band>,
    pub points: Vec<Points>,
}

type Limits = [Vec<Option<f64>>; 2];

/// The fitted line over a grid of x, with lower and upper limits.
#[derive(Debug, Serialize)]
pub struct Band {
    pub x: Vec<Option<f64>>,
    pub value: Vec<Option<f64>>,
    pub pointwise: Option<Limits>,
    pub simultaneous: Option<Limits>,
    pub prediction: Option<Limits>,
}

/// The estimates of one flight; `bar` is half of the 95% interval.
#[derive(Debug, Serialize)]
pub struct Points {
    pub flight: String,
    pub segment: Vec<String>,
    pub x: Vec<Option<f64>>,
    pub value: Vec<Option<f64>>,
    pub bar: Vec<Option<f64>>,
}

/// The text around the plots (template).
#[derive(Debug, Default, Serialize)]
pub struct Lines {
    pub missing: Option<String>,
    pub levels: String,
    pub models: Vec<LinesOfModel>,
}

#[derive(Debug, Serialize)]
pub struct LinesOfModel {
    pub model: String,
    pub plots: Vec<Caption>,
}

#[derive(Debug, Serialize)]
pub struct Caption {
    pub index: usize,
    pub parameter: String,
    pub against: String,
    pub equation: String,
    pub facts: String,
}

/// More flights than this are not told apart in a plot.
const NAMED: usize = 24;

impl LinePlot {
    /// The points of all flights as one.
    fn together(&mut self) {
        let all = std::mem::take(&mut self.points);
        self.points = vec![Points {
            flight: String::new(),
            segment: all.iter().flat_map(|p| p.segment.clone()).collect(),
            x: all.iter().flat_map(|p| p.x.clone()).collect(),
            value: all.iter().flat_map(|p| p.value.clone()).collect(),
            bar: all.iter().flat_map(|p| p.bar.clone()).collect(),
        }];
    }
}

impl Points {
    fn take_every(&mut self, step: usize) {
        let mut k = 0..;
        let mut taken = || k.next().is_some_and(|k: usize| k.is_multiple_of(step));
        self.segment.retain(|_| taken());
        for column in [&mut self.x, &mut self.value, &mut self.bar] {
            let mut k = 0..;
            column.retain(|_| k.next().is_some_and(|k: usize| k.is_multiple_of(step)));
        }
    }
}

/// Leaves out points for which the page has no room, and says so. Every so many-th is drawn, not the
/// extremes, which would look like more scatter than there is.
fn sampled(plots: &mut [LinePlot], room: Room) -> Option<String> {
    // A point is three numbers, and a name that is as long as two.
    let most = room.count(4, 5);
    let all: usize = plots.iter().flat_map(|plot| &plot.points).map(|p| p.x.len()).sum();
    let step = all.div_ceil(most);
    if step < 2 {
        return None;
    }
    plots.iter_mut().flat_map(|plot| &mut plot.points).for_each(|points| points.take_every(step));
    Some(format!(
        " One of {step} points is drawn; the lines are through all of them, which the table points has."
    ))
}

/// A reduced chi-square above this says that the points scatter more than their standard deviations
/// explain.
pub const EXCESS: f64 = 2.5;

const KEY: [&str; 3] = ["model", "parameter", "against"];

/// The plots and their captions, in the order of `fits`.
pub fn lines(
    fits: Option<&Columns>,
    bands: Option<&Columns>,
    points: Option<&Columns>,
) -> (Lines, Vec<LinePlot>) {
    let Some(fits) = fits.filter(|f| f.rows() > 0) else {
        let missing = Some(
            "No fitted line: the fit stage has not run, or no coefficient had enough estimates."
                .into(),
        );
        return (Lines { missing, ..Lines::default() }, Vec::new());
    };
    let mut models: Vec<LinesOfModel> = Vec::new();
    let mut plots = Vec::new();
    for row in 0..fits.rows() {
        let [model, parameter, against] = KEY.map(|name| fits.text(name, row));
        let index = plots.len();
        plots.push(plot(index, fits, row, bands, points));
        let (equation, facts) = (equation(fits, row), facts(fits, row));
        let caption = Caption { index, parameter, against, equation, facts };
        match models.iter_mut().find(|m| m.model == model) {
            Some(m) => m.plots.push(caption),
            None => models.push(LinesOfModel { model, plots: vec![caption] }),
        }
    }
    let level = number(100.0 * fits.number("level", 0), 4)
        .trim_end_matches('0')
        .trim_end_matches('.')
        .to_string();
    let levels = format!(
        "Bands at {level}%: the narrow one holds at each single abscissa, the wide one over the whole range at once (Working-Hotelling); \
         the prediction band is where the estimate of one more maneuver is expected."
    );
    (Lines { missing: None, levels, models }, plots)
}

fn plot(
    index: usize,
    fits: &Columns,
    row: usize,
    bands: Option<&Columns>,
    points: Option<&Columns>,
) -> LinePlot {
    let key = KEY.map(|name| fits.text(name, row));
    let rows_of = |table: &Columns, names: &[&str]| -> Vec<usize> {
        (0..table.rows())
            .filter(|&r| {
                names.iter().zip(&key).all(|(name, wanted)| table.text(name, r) == *wanted)
            })
            .collect()
    };
    let (factor, x_unit) = display_unit(&fits.unit_in("unit_x", row));
    let band = bands.and_then(|table| {
        let rows = rows_of(table, &KEY);
        (!rows.is_empty()).then(|| Band {
            x: shorts(rows.iter().map(|&r| table.number("x", r)), factor),
            value: shorts(rows.iter().map(|&r| table.number("value", r)), 1.0),
            pointwise: limits(table, &rows, "pointwise"),
            simultaneous: limits(table, &rows, "simultaneous"),
            prediction: limits(table, &rows, "prediction"),
        })
    });
    let points = points.map_or(Vec::new(), |table| points_of(table, &rows_of(table, &KEY), factor));
    let [_, parameter, against] = key;
    LinePlot { index, parameter, unit: fits.unit_in("unit", row), against, x_unit, band, points }
}

fn limits(table: &Columns, rows: &[usize], name: &str) -> Option<Limits> {
    let [lower, upper] = ["lower", "upper"].map(|side| format!("{name}_{side}"));
    (table.has(&lower) && table.has(&upper)).then(|| {
        [&lower, &upper].map(|column| shorts(rows.iter().map(|&r| table.number(column, r)), 1.0))
    })
}

fn points_of(table: &Columns, rows: &[usize], factor: f64) -> Vec<Points> {
    let mut flights: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    rows.iter().for_each(|&r| flights.entry(table.text("flight", r)).or_default().push(r));
    let of_flight = |(flight, rows): (String, Vec<usize>)| Points {
        segment: rows.iter().map(|&r| table.text("segment", r)).collect(),
        x: shorts(rows.iter().map(|&r| table.number("x", r)), factor),
        value: shorts(rows.iter().map(|&r| table.number("value", r)), 1.0),
        bar: shorts(rows.iter().map(|&r| table.number("sd", r)), INTERVAL_95),
        flight,
    };
    flights.into_iter().map(of_flight).collect()
}

/// `C_h_alpha = (-0.00738 ± 0.00021) [1/rad per deg] * alpha + (-0.0107 ± 0.0041) [1/rad]`, in the
/// units of the axes.
fn equation(fits: &Columns, row: usize) -> String {
    let [_, parameter, against] = KEY.map(|name| fits.text(name, row));
    if !fits.number("slope", row).is_finite() {
        return format!("{parameter}: no line ({})", fits.text("stop", row));
    }
    let (factor, x_unit) = display_unit(&fits.unit_in("unit_x", row));
    let unit = fits.unit_in("unit", row);
    let slope = coefficient(fits, "slope", row, factor);
    let intercept = coefficient(fits, "intercept", row, 1.0);
    let of_slope = bracketed(&slope_unit(&unit, &x_unit));
    format!(
        "{parameter} = ({slope}){of_slope} * {against}{} + ({intercept}){}",
        bracketed(&x_unit),
        bracketed(&unit)
    )
}

/// Slope or intercept over `factor`, with half of its interval.
fn coefficient(fits: &Columns, name: &str, row: usize, factor: f64) -> String {
    let half = half_95(fits.number("n", row)) * fits.number(&format!("{name}_sd"), row);
    with_half(fits.number(name, row) / factor, half / factor)
}

fn facts(fits: &Columns, row: usize) -> String {
    let mut facts = vec![format!("n = {}", plain(fits.number("n", row), 0))];
    let tau = fits.number("scatter_sd", row);
    if tau.is_finite() {
        facts.push(format!(
            "scatter between maneuvers, sd {}{}",
            number(tau, 2),
            bracketed(&fits.unit_in("unit", row))
        ));
    }
    let chi = reduced_chi2(fits, row);
    if chi.is_finite() {
        facts.push(format!("reduced chi-square {}", number(chi, 2)));
    }
    facts.extend(told(fits, row));
    facts.join(" · ")
}

/// How well one maneuver tells the parameter, where that is poor.
fn told(fits: &Columns, row: usize) -> Option<String> {
    let share = 100.0 * fits.number("relative_sd", row);
    (fits.flag("poor", row) == Some(true))
        .then(|| format!("poorly determined: one maneuver tells it to {} %", number(share, 2)))
}

/// Weighted sum of squares about the line over its degrees of freedom; NaN where there are none.
pub fn reduced_chi2(fits: &Columns, row: usize) -> f64 {
    let freedom = fits.number("n", row) - 2.0;
    if freedom > 0.0 { fits.number("chi2", row) / freedom } else { f64::NAN }
}

/// The maneuver whose point is furthest from a line, by the table `points`.
pub fn furthest(fits: &Columns, row: usize, points: &Columns) -> Option<String> {
    let of = ["model", "parameter", "against"];
    let is_of = |point: &usize| of.iter().all(|c| points.text(c, *point) == fits.text(c, row));
    let (slope, start) = (fits.number("slope", row), fits.number("intercept", row));
    let off = |point: usize| {
        (points.number("value", point) - start - slope * points.number("x", point)).abs()
    };
    let known = (0..points.rows()).filter(is_of).filter(|point| off(*point).is_finite());
    let furthest = known.max_by(|&a, &b| off(a).total_cmp(&off(b)))?;
    Some(points.text("segment", furthest))
}

/// Correlation of slope and intercept of a fitted line; NaN where it is not defined.
fn correlation(fits: &Columns, row: usize) -> f64 {
    fits.number("covariance", row)
        / (fits.number("slope_sd", row) * fits.number("intercept_sd", row))
}

/// The table of fitted lines.
pub fn table(fits: Option<&Columns>) -> Grid {
    let Some(fits) = fits.filter(|f| f.rows() > 0) else { return Grid::missing("No fitted line.") };
    let columns = [
        "model",
        "parameter",
        "against",
        "#slope",
        "#the same|per SI unit",
        "#intercept",
        "#correlation",
        "#n",
        "#sd of one|maneuver, %",
        "#scatter sd",
        "#reduced chi-square",
    ];
    let mut grid = Grid::new(columns);
    for row in 0..fits.rows() {
        let (unit, unit_x) = (fits.unit_in("unit", row), fits.unit_in("unit_x", row));
        let slope = |factor: f64, x: &str| {
            Cell::new(coefficient(fits, "slope", row, factor)).under(slope_unit(&unit, x))
        };
        let (factor, shown_x) = display_unit(&unit_x);
        let chi = reduced_chi2(fits, row);
        let mut cells: Vec<Cell> = KEY.iter().map(|name| Cell::new(fits.text(name, row))).collect();
        cells.extend([
            slope(factor, &shown_x),
            slope(1.0, &unit_x),
            Cell::new(coefficient(fits, "intercept", row, 1.0)).under(&unit),
            plain(correlation(fits, row), 3).into(),
            Cell::new(plain(fits.number("n", row), 0))
                .level_if(fits.number("n", row) < 5.0, Level::Warn),
            Cell::new(number(100.0 * fits.number("relative_sd", row), 2))
                .level_if(fits.flag("poor", row) == Some(true), Level::Warn),
            Cell::new(number(fits.number("scatter_sd", row), 2)).under(&unit),
            Cell::new(number(chi, 2)).level_if(chi > EXCESS, Level::Warn),
        ]);
        grid.push(cells);
    }
    grid.note = Some(
        "Coefficient = slope * against + intercept: as drawn above, and in the units of the table fits. The covariance of slope and intercept includes the scatter \
         between maneuvers; reduced chi-square is against the estimates' own sd, before that scatter is added."
            .into(),
    );
    grid
}
