//! `estimates` in; the parameters whose sign is not that which the model file starts them with, as a sentence,
//! out.
//!
//! Who writes a start knows its sign: where the data turn it beyond doubt, a sensor, a record or a definition
//! may have the other one.

use super::columns::Columns;
use super::format::{few, number};
use super::grid::Level;

/// An estimate has a sign beyond doubt from so many standard deviations on.
const CLEAR: f64 = 10.0;
/// And is as large as a share of its start: what starts small starts anywhere.
const SHARE: f64 = 0.5;
/// In this share of the estimates of a parameter, at least.
const OFTEN: f64 = 0.75;

/// The sentence of the checks; none where all signs are as they start.
pub fn summary(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table?;
    let turned = |([model, parameter], rows): ([String; 2], Vec<usize>)| {
        let of = |name: &str, row: usize| table.number(name, row);
        let is_turned = |row: &&usize| {
            let (value, start, sd) = (of("value", **row), of("start", **row), of("sd", **row));
            value * start < 0.0 && value.abs() > CLEAR * sd && value.abs() > SHARE * start.abs()
        };
        let known = rows.iter().filter(|row| of("sd", **row) > 0.0).count();
        let all: Vec<&usize> = rows.iter().filter(is_turned).collect();
        let first = **all.first()?;
        (all.len() as f64 >= OFTEN * known as f64 && !parameter.ends_with("(0)")).then(|| {
            format!(
                "{parameter} of {model} ({} from {}, {:.0} sd from zero)",
                number(of("value", first), 3),
                number(of("start", first), 3),
                (of("value", first) / of("sd", first)).abs()
            )
        })
    };
    let all: Vec<String> =
        table.groups(["model", "parameter"]).into_iter().filter_map(turned).collect();
    (!all.is_empty()).then(|| {
        let text = format!(
            "Estimates have another sign than the model file starts them with: {}. Has a sensor, a record or a definition the other sign?",
            few(&all)
        );
        (Level::Warn, text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;
    use crate::table::Table;

    fn estimates(rows: &[(&str, f64, f64, f64)]) -> Result<Columns> {
        let n = rows.len();
        let of = |f: fn(&(&str, f64, f64, f64)) -> f64| rows.iter().map(f).collect::<Vec<f64>>();
        let nothing = || vec![f64::NAN; n];
        let table = Table::build("estimates")
            .repeat("model", "six")
            .repeat("group", "all")
            .opt_strings("flight", vec![None::<&str>; n])
            .opt_strings("segment", vec![None::<&str>; n])
            .strings("parameter", rows.iter().map(|r| r.0))
            .repeat("per", "campaign")
            .opt_strings("of", vec![None::<&str>; n])
            .repeat("unit", "-")
            .f64("value", of(|r| r.2))
            .f64("sd", of(|r| r.3))
            .f64("sd_crlb", of(|r| r.3))
            .f64("sd_total", of(|r| r.3))
            .f64("lower", nothing())
            .f64("upper", nothing())
            .opt_strings("interval", vec![None::<&str>; n])
            .f64("start", of(|r| r.1))
            .bools("at_bound", vec![false; n])
            .repeat("stop", "converged");
        Ok(Columns::of(&table.finish()?))
    }

    #[test]
    fn signs_that_turn_beyond_doubt_are_told() {
        let rows = [
            ("C_l_da", 0.12, -0.16, 1e-4),
            ("C_n_p", 0.01, -0.01, 0.005),
            ("C_Y_p", 0.0, -0.05, 1e-4),
            ("C_L_q", 3.0, -0.2, 1e-3),
        ];
        let (level, text) = summary(Some(&estimates(&rows).unwrap())).unwrap();
        assert_eq!(level, Level::Warn);
        assert!(text.contains(": C_l_da of six (-0.160 from 0.120, 1600 sd from zero)."), "{text}");
        assert_eq!(summary(Some(&estimates(&rows[1..]).unwrap())), None);
    }
}
