//! Tables of estimates and their correlations come in; the values that a curve is drawn with, and their covariance, go
//! out.

use super::config::Config;
use crate::error::Result;
use crate::stage::validate::correlated;
use crate::table::Table;
use std::collections::BTreeMap;

/// Values of all parameters of the model, and the covariance `[n][n]` of those that are estimated.
#[derive(Debug, Clone, Default)]
pub struct Values {
    pub parameters: Vec<f64>,
    /// Places of those that are estimated.
    pub estimated: Vec<usize>,
    pub covariance: Vec<f64>,
    /// What the errors of assumed constants add to it, `[n][n]`.
    pub assumed: Vec<f64>,
}

/// The values of a group of the estimate, where some have one per level those of this level; why there are none, in
/// words.
pub fn values(
    config: &Config,
    (group, level): (&str, Option<&str>),
    [estimates, correlations, budget]: [Option<&Table>; 3],
) -> Result<std::result::Result<Values, String>> {
    let Some(table) = estimates else { return Ok(Err("there are no estimates".into())) };
    let (names, groups) = (table.strings("parameter")?, table.strings("group")?);
    let (of, stops) = (table.opt_strings("of")?, table.strings("stop")?);
    let (found, sds) = (table.f64("value")?, table.f64("sd")?);
    let mut values = Values::default();
    let mut rows: Vec<usize> = Vec::new();
    for (place, p) in config.model.parameters.iter().enumerate() {
        let name = &p.quantity.name;
        let mine = |&i: &usize| {
            names[i] == name && groups[i] == group && (of[i].is_none() || of[i] == level)
        };
        let row = (0..names.len()).find(mine);
        let value = match (config.held.get(name), row) {
            (Some(held), _) => *held,
            (None, Some(i)) if stops[i] == "converged" && found[i].is_finite() => {
                values.estimated.push(place);
                rows.push(i);
                found[i]
            }
            (None, Some(i)) => return Ok(Err(format!("the estimate ended with \"{}\"", stops[i]))),
            (None, None) if config.model.uses(name) => {
                return Ok(Err(format!("the estimate has no single value of {name}")));
            }
            (None, None) => p.start,
        };
        values.parameters.push(value);
    }
    let n = rows.len();
    values.covariance = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let between = match correlations {
                Some(correlations) => correlated(table, correlations, [rows[i], rows[j]])?,
                None if i == j => sds[rows[i]] * sds[rows[i]],
                None => 0.0,
            };
            // What is held has no standard deviation.
            let between = if between.is_finite() { between } else { 0.0 };
            (values.covariance[i * n + j], values.covariance[j * n + i]) = (between, between);
        }
    }
    if let Some(budget) = budget {
        let of: Vec<Option<&str>> = rows.iter().map(|&row| of[row]).collect();
        let names = values.estimated.iter().map(|&p| &config.model.parameters[p].quantity.name[..]);
        let estimated: Vec<(&str, Option<&str>)> = names.zip(of).collect();
        values.assumed = assumed(budget, group, &estimated)?;
    }
    Ok(Ok(values))
}

/// What two taken values add because their errors are correlated is told as `a with b`.
const WITH: &str = " with ";

/// The covariance that the errors of assumed constants give estimates (name, level): `sum s_ia s_jb r_ab sd_a sd_b` over
/// all pairs of constants, with the sensitivities `s` of the estimates to them and `r_aa = 1`.
fn assumed(budget: &Table, group: &str, estimated: &[(&str, Option<&str>)]) -> Result<Vec<f64>> {
    let (names, groups) = (budget.strings("parameter")?, budget.strings("group")?);
    let (of, constants) = (budget.opt_strings("of")?, budget.opt_strings("constant")?);
    let (told, sds) = (budget.f64("constant_value")?, budget.f64("constant_sd")?);
    let sensitivities = budget.f64("sensitivity")?;
    let n = estimated.len();
    // Per constant: what an error of one sd moves, estimate by estimate.
    let mut moved: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    let mut correlated: BTreeMap<(&str, &str), f64> = BTreeMap::new();
    for row in (0..names.len()).filter(|row| groups[*row] == group) {
        let Some(i) = estimated.iter().position(|one| *one == (names[row], of[row])) else {
            continue;
        };
        match constants[row].map(|name| (name, name.split_once(WITH))) {
            Some((_, Some(pair))) => drop(correlated.insert(pair, told[row])),
            Some((name, None)) => {
                moved.entry(name).or_insert_with(|| vec![0.0; n])[i] =
                    sensitivities[row] * sds[row];
            }
            None => {}
        }
    }
    let own = moved.values().map(|all| (all, all, 1.0));
    let both = correlated.iter().filter_map(|((a, b), r)| Some((moved.get(a)?, moved.get(b)?, *r)));
    let pairs: Vec<_> = own.chain(both.flat_map(|(a, b, r)| [(a, b, r), (b, a, r)])).collect();
    let sum = |i: usize, j: usize| pairs.iter().map(|(a, b, r)| r * a[i] * b[j]).sum::<f64>();
    Ok((0..n * n).map(|k| sum(k / n, k % n)).collect())
}
