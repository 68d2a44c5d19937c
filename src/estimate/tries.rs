//! Further starts in; the estimate from the best of all, and what became of the others, out.
//!
//! The cost has more than one minimum where a parameter decides whether something happens at all:
//! friction (a stop of the surface comes or goes), thresholds, limits, delays. The one with the
//! lowest cost is the estimate; that others were there is said.

use super::estimation::Tried;
use super::{Asked, Estimation, Settings, Stop};
use crate::error::{Error, Errors};

/// Starts of one estimation, at most.
const MOST: usize = 64;
/// Ends whose tried parameters differ by less than this many standard deviations are the same.
const SAME: f64 = 0.1;

/// Estimates from every start that the settings ask for, and keeps the best.
///
/// # Errors
/// Those of an estimation; too many starts.
pub fn best_of(
    settings: &Settings,
    run: &dyn Fn(&Settings) -> Result<Estimation, Errors>,
) -> Result<Estimation, Errors> {
    if settings.tries.is_empty() {
        return run(settings);
    }
    let all = starts(settings)?;
    let names: Vec<&String> = settings.tries.keys().collect();
    let mut runs: Vec<(Settings, Estimation)> = Vec::new();
    for start in &all {
        let mut once = settings.clone();
        // Profiles are those of the best alone, and only that is asked more.
        once.profile.clear();
        if once.asked == Asked::All {
            once.asked = Asked::Minimum;
        }
        once.tried = start.iter().cloned().collect();
        let estimation = run(&once)?;
        runs.push((once, estimation));
    }
    let rank = |e: &Estimation| (e.stop != Stop::Converged, e.left_out.len(), cost(e));
    let order = |a: &Estimation, b: &Estimation| {
        let (a, b) = (rank(a), rank(b));
        (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2))
    };
    let best = (0..runs.len()).min_by(|&a, &b| order(&runs[a].1, &runs[b].1)).unwrap_or(0);
    let tried: Vec<Tried> = all
        .into_iter()
        .zip(&runs)
        .map(|(starts, (_, e))| Tried {
            stop: e.stop,
            cost: cost(e),
            ends: names.iter().map(|name| end(e, name).0).collect(),
            there: same(e, &runs[best].1, &names),
            starts,
        })
        .collect();
    let (mut from, estimation) = runs.swap_remove(best);
    let estimation = match settings.profile.is_empty() && from.asked == settings.asked {
        true => estimation,
        false => {
            from.profile.clone_from(&settings.profile);
            from.asked = settings.asked;
            run(&from)?
        }
    };
    Ok(Estimation { tried, ..estimation })
}

/// Every combination of the starts, with that of the model (or of `starts`) first.
fn starts(settings: &Settings) -> Result<Vec<Vec<(String, f64)>>, Errors> {
    if let Some(error) = too_many(settings) {
        return Err(error.into());
    }
    let mut all: Vec<Vec<(String, f64)>> = vec![Vec::new()];
    for (name, values) in &settings.tries {
        let with = |start: &Vec<(String, f64)>| -> Vec<Vec<(String, f64)>> {
            let one = |value: &f64| [&start[..], &[(name.clone(), *value)]].concat();
            values.iter().map(one).collect()
        };
        all = all.iter().flat_map(with).collect();
    }
    all.insert(0, Vec::new());
    Ok(all)
}

/// More starts than are tried.
pub fn too_many(settings: &Settings) -> Option<Error> {
    let count = settings.tries.values().map(Vec::len).fold(1, usize::saturating_mul);
    let what = format!("`tries` makes {count} starts, and {MOST} are the most");
    (count > MOST).then(|| Error::new(what).help("give fewer parameters, or fewer values"))
}

fn cost(estimation: &Estimation) -> f64 {
    estimation.iterations.last().map_or(f64::NAN, |last| last.cost)
}

/// Where a parameter ended, and its standard deviation; NaN without one.
fn end(estimation: &Estimation, name: &str) -> (f64, f64) {
    let row = estimation.rows.iter().find(|row| row.name == *name);
    row.map_or((f64::NAN, f64::NAN), |row| (row.value, row.sd.unwrap_or(f64::NAN)))
}

fn same(one: &Estimation, best: &Estimation, names: &[&String]) -> bool {
    one.stop == best.stop
        && names.iter().all(|name| {
            let ((a, _), (b, sd)) = (end(one, name), end(best, name));
            a == b || (a - b).abs() < SAME * sd
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_all_combinations_and_not_too_many() {
        let with = |tries: &[(&str, &[f64])]| Settings {
            tries: tries.iter().map(|(n, v)| (n.to_string(), v.to_vec())).collect(),
            ..Settings::default()
        };
        let all = starts(&with(&[("a", &[1.0, 2.0]), ("b", &[3.0, 4.0, 5.0])])).expect("starts");
        assert_eq!((all.len(), all[0].len()), (7, 0));
        assert_eq!(all[6], [("a".to_string(), 2.0), ("b".to_string(), 5.0)]);
        let many = starts(&with(&[("a", &[0.0; 9]), ("b", &[0.0; 9])])).expect_err("too many");
        assert!(many.to_string().contains("81 starts"));
    }
}
