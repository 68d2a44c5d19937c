//! `repeats` in; whether estimates at one condition scatter as their standard deviations say, as a table and
//! as a sentence, out.

use super::columns::Columns;
use super::format::{count, few, number};
use super::grid::{Cell, Grid, Level};
use crate::math::distribution::chi2_cdf;

/// A table of comparisons is remarked where, all claims being honest, it would be as rarely as
/// this. The page asks some ten such questions, and is read after every run: at one in twenty each,
/// every other page would point at nothing.
const RARE: f64 = 0.01;

/// Whether a probability is rare although so many comparisons were made, however they hang together
/// (Bonferroni).
fn is_rare(p: f64, comparisons: usize) -> bool {
    p < RARE / comparisons.max(1) as f64
}

/// The scatter of repeats: every condition at which there are some, then all maneuvers whatever
/// their condition.
pub fn repeats(table: Option<&Columns>) -> Grid {
    let none = "No two maneuvers were estimated each by itself, so there is nothing to compare.";
    let Some(table) = table.filter(|t| t.rows() > 0) else { return Grid::missing(none) };
    let columns = [
        "model",
        "parameter",
        "unit",
        "input",
        "kind",
        "~condition",
        "#n",
        "#mean",
        "#scatter sd",
        "#rms sd",
        "#ratio",
        "#p",
    ];
    let mut grid = Grid::new(columns);
    // Of many pairs some are far apart by chance.
    let conditions = (0..table.rows()).filter(|&row| table.text("set", row) == "condition").count();
    let pooled = pooled(table);
    for p in &pooled {
        let words = format!("the same, {} of them together", p.conditions);
        let mut cells = vec![
            Cell::new(p.model.clone()),
            Cell::new(p.parameter.clone()),
            Cell::new(p.unit.clone()),
        ];
        cells.extend(["", ""].map(Cell::new));
        cells.extend([Cell::new(words), Cell::new(format!("{:.0}", p.n))]);
        cells.extend(["", "", ""].map(Cell::new));
        cells.extend([
            Cell::new(number(p.ratio(), 2)),
            probability(p.p(), is_rare(p.p(), pooled.len())),
        ]);
        grid.push(cells);
    }
    for row in 0..table.rows() {
        let repeated = table.text("set", row) == "condition";
        let mut cells: Vec<Cell> =
            ["model", "parameter"].map(|c| Cell::new(table.text(c, row))).to_vec();
        cells.push(table.unit_in("unit", row).into());
        let kind = table.text("kind", row);
        cells.push(table.text("input", row).into());
        cells.push(Cell::new(match (kind.as_str(), table.text("set", row).as_str()) {
            (_, "flights") => "one value per flight".to_string(),
            ("", _) => "all".to_string(),
            _ => kind,
        }));
        cells.push(if repeated {
            table.text("condition", row).into()
        } else {
            Cell::new("all").level(Level::Dim)
        });
        cells.push(format!("{:.0}", table.number("n", row)).into());
        cells.extend(
            [("mean", 4), ("scatter_sd", 2), ("rms_sd", 2), ("ratio", 2)]
                .map(|(c, digits)| Cell::new(number(table.number(c, row), digits))),
        );
        let p = table.number("p", row);
        cells.push(probability(p, repeated && is_rare(p, conditions)));
        grid.push(cells);
    }
    grid.note = Some(
        "A ratio near 1 says that the standard deviations are honest. At one condition a small p says that they are too small; marked is \
         what honest ones show in less than 1% of campaigns, all such comparisons together. Over all conditions a small p may as well \
         say that the parameter differs between them, for example with the angle of attack: then a fitted line is the answer. What one \
         condition is, the table repeats says."
            .into(),
    );
    grid.or_missing(none)
}

fn probability(p: f64, rare: bool) -> Cell {
    Cell::new(if p < 1e-4 { "< 0.0001".to_string() } else { number(p, 2) })
        .level_if(rare, Level::Warn)
}

/// The scatter at every condition of one parameter of one model, all conditions together.
struct Pooled {
    model: String,
    parameter: String,
    unit: String,
    conditions: usize,
    /// Maneuvers.
    n: f64,
    chi2: f64,
    freedom: f64,
}

impl Pooled {
    /// Probability of so large a sum where the standard deviations are honest.
    fn p(&self) -> f64 {
        1.0 - chi2_cdf(self.chi2, self.freedom)
    }

    /// Scatter over what is claimed of it.
    fn ratio(&self) -> f64 {
        (self.chi2 / self.freedom).sqrt()
    }
}

/// One per model and parameter that was estimated at least twice at some condition.
fn pooled(table: &Columns) -> Vec<Pooled> {
    let one = |([model, parameter, set], rows): ([String; 3], Vec<usize>)| {
        let sum = |of: &dyn Fn(usize) -> f64| rows.iter().map(|&row| of(row)).sum::<f64>();
        let n = sum(&|row| table.number("n", row));
        let unit = rows.first().map_or(String::new(), |&row| table.unit_in("unit", row));
        let (chi2, freedom) = (sum(&|row| table.number("chi2", row)), n - rows.len() as f64);
        (set == "condition").then_some(Pooled {
            model,
            parameter,
            unit,
            conditions: rows.len(),
            n,
            chi2,
            freedom,
        })
    };
    table.groups(["model", "parameter", "set"]).into_iter().filter_map(one).collect()
}

/// The sentence of the checks about the scatter of repeats, of those at the same condition only.
/// Parameters are judged over all conditions: a claim that is too small is so everywhere, and one
/// pair that is far apart among many tells little.
pub fn honesty(table: Option<&Columns>) -> Option<(Level, String)> {
    let pooled = pooled(table?);
    let most = pooled.iter().map(|p| p.conditions).max()?;
    let words =
        |p: &Pooled| format!("{} of {}, {} times", p.parameter, p.model, number(p.ratio(), 2));
    let rare: Vec<String> =
        pooled.iter().filter(|p| is_rare(p.p(), pooled.len())).map(words).collect();
    let at = format!("Maneuvers repeated at the same condition ({})", count(most, "condition"));
    Some(if rare.is_empty() {
        let least =
            pooled.iter().min_by(|a, b| a.p().total_cmp(&b.p())).map(words).unwrap_or_default();
        let among = count(pooled.len(), "parameter");
        (
            Level::Good,
            format!(
                "{at} scatter as their standard deviations say (the least likely of {among}: {least})."
            ),
        )
    } else {
        (
            Level::Warn,
            format!("{at} scatter more than their standard deviations say: {}.", few(&rare)),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    /// Rows of one parameter: set, chi-square of two estimates.
    fn repeats(rows: &[(&str, f64)]) -> Columns {
        table(&rows.iter().map(|(set, chi2)| (*set, "a", *chi2)).collect::<Vec<_>>())
    }

    /// Rows of two estimates at one condition: parameter, chi-square.
    fn parameters(rows: &[(&str, f64)]) -> Columns {
        table(
            &rows
                .iter()
                .map(|(parameter, chi2)| ("condition", *parameter, *chi2))
                .collect::<Vec<_>>(),
        )
    }

    fn table(rows: &[(&str, &str, f64)]) -> Columns {
        let n = rows.len();
        let table = Table::build("repeats")
            .repeat("model", "m")
            .strings("parameter", rows.iter().map(|r| r.1))
            .repeat("unit", "s");
        let table = table
            .strings("set", rows.iter().map(|r| r.0))
            .opt_strings("condition", rows.iter().map(|_| Some("V 80.0 m/s")));
        let table = table
            .opt_strings("input", vec![Some("de"); n])
            .opt_strings("kind", vec![Some("3211"); n])
            .i64("n", vec![2; n]);
        let table = table
            .f64("mean", vec![1.0; n])
            .f64("scatter_sd", vec![0.1; n])
            .f64("rms_sd", vec![0.1; n]);
        let table = table
            .f64("ratio", vec![1.0; n])
            .f64("chi2", rows.iter().map(|r| r.2).collect::<Vec<_>>())
            .f64("p", vec![0.5; n]);
        Columns::of(&table.finish().expect("repeats"))
    }

    #[test]
    fn other_conditions_are_no_repeats_and_one_far_pair_among_many_is_no_alarm() {
        let level = |rows: &[(&str, f64)]| honesty(Some(&repeats(rows))).map(|(level, _)| level);
        assert_eq!(level(&[("all", 900.0), ("kind", 900.0)]), None);
        assert_eq!(
            level(&[("condition", 1.0), ("condition", 0.3), ("all", 900.0)]),
            Some(Level::Good)
        );
        let mut many = vec![("condition", 0.8); 12];
        many.push(("condition", 11.0));
        assert_eq!(level(&many), Some(Level::Good));
        // what one campaign in a hundred shows by chance is no alarm where five parameters are
        // compared
        let five = |chi2: f64| {
            let rows = [("a", chi2), ("b", 1.0), ("c", 1.0), ("d", 1.0), ("e", 1.0)];
            honesty(Some(&parameters(&rows))).expect("a sentence")
        };
        let (level_of_few, text) = five(7.0);
        assert_eq!(level_of_few, Level::Good, "p = 0.008 among five");
        assert!(text.contains("1 condition") && text.contains("a of m, 2.6 times"), "{text}");
        assert_eq!(five(10.0).0, Level::Warn, "p = 0.0016 among five");
        // sd too small by half: chi-square of four per pair
        assert_eq!(level(&[("condition", 4.0); 12]), Some(Level::Warn));
    }
}
