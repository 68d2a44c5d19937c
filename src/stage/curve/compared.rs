//! Curves with their bands and a prediction come in; where they differ by more than the band, and what is flown but not
//! predicted, go out.

use super::config::Config;
use super::family::Family;
use super::points::Point;
use super::prediction::Prediction;
use crate::error::Result;
use crate::stage::Severity;

/// A prediction of one equation beside what flight says of it.
pub struct Against {
    pub group: String,
    pub label: String,
    pub equation: usize,
    pub rows: Vec<Row>,
    /// Ranges of the input that are flown and not predicted.
    pub unpredicted: Vec<[f64; 2]>,
    flown: Option<[f64; 2]>,
}

/// One predicted value.
pub struct Row {
    pub predicted: f64,
    /// What flight says there.
    pub point: Point,
    pub flown: bool,
}

impl Row {
    /// Whether the simultaneous band leaves it out.
    pub fn is_beyond(&self) -> bool {
        let [lower, upper] = self.point.simultaneous();
        !(lower..=upper).contains(&self.predicted)
    }
}

/// What is predicted of the equations under the conditions of one family of curves. Each row of the file belongs to the
/// curve whose conditions are nearest.
pub fn all(
    config: &Config,
    (family, prediction): (&Family, &Prediction),
    flown: Option<[f64; 2]>,
    at: &dyn Fn(&[f64]) -> Result<Vec<Point>>,
) -> Result<Vec<Against>> {
    let is = |name: &str, value: f64| {
        let (own, all): (Option<f64>, Vec<f64>) = match &config.levels {
            Some(levels) if levels.name == name => (family.level, levels.values.clone()),
            _ => {
                let all = config.settings.all_at().iter().filter_map(|at| at.get(name).copied());
                (family.at.get(name).copied(), all.collect())
            }
        };
        let nearest = all.iter().min_by(|a, b| (*a - value).abs().total_cmp(&(*b - value).abs()));
        nearest.copied() == own
    };
    let mut found = Vec::new();
    for equation in 0..config.model.outputs.len() {
        if prediction.rows.iter().all(|row| row.values[equation].is_nan()) {
            continue;
        }
        let predicted = prediction.of(equation, is);
        let x: Vec<f64> = predicted.iter().map(|[x, _]| *x).collect();
        let is_flown = |x: f64| flown.is_some_and(|[from, to]| (from..=to).contains(&x));
        let of_it = at(&x)?.into_iter().filter(|point| point.equation == equation);
        let row = |([_, predicted], point): (&[f64; 2], Point)| Row {
            predicted: *predicted,
            flown: is_flown(point.x),
            point,
        };
        found.push(Against {
            group: family.group.to_string(),
            label: family.label.clone(),
            equation,
            rows: predicted.iter().zip(of_it).map(row).collect(),
            unpredicted: unpredicted(flown, &x),
            flown,
        });
    }
    Ok(found)
}

/// What of the flown range lies beyond the ends of the prediction.
fn unpredicted(flown: Option<[f64; 2]>, x: &[f64]) -> Vec<[f64; 2]> {
    let Some([from, to]) = flown else { return Vec::new() };
    let (Some(first), Some(last)) = (x.first(), x.last()) else { return vec![[from, to]] };
    let ends = [[from, first.min(to)], [last.max(from), to]];
    ends.into_iter().filter(|[from, to]| from < to).collect()
}

impl Against {
    /// What the reader should know of it.
    pub fn note(&self, config: &Config) -> Option<(Severity, String)> {
        let equation = config.model.outputs[self.equation].name.clone();
        let parts = [config.settings.name(), equation, self.label.clone()];
        let parts: Vec<String> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let (what, along) = (parts.join(", "), &config.settings.along);
        let Some([from, to]) = self.flown else {
            let text = format!(
                "{what}: nothing of it is flown, so nothing is held against the prediction"
            );
            return Some((Severity::Warning, text));
        };
        if self.unpredicted.is_empty() {
            return None;
        }
        let unit = config.unit_along();
        let flown = format!("{along} from {from:.4} to {to:.4} {unit} is flown");
        let text = match (self.rows.first(), self.rows.last()) {
            (Some(first), Some(last)) => format!(
                "{what}: {flown}, the prediction goes from {:.4} to {:.4} {unit}: what is beyond is not compared",
                first.point.x, last.point.x
            ),
            _ => format!("{what}: {flown}, nothing of it is predicted"),
        };
        Some((Severity::Warning, text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_beyond_a_prediction_is_at_its_ends() {
        let flown = Some([-0.3, 0.2]);
        assert_eq!(unpredicted(flown, &[-0.2, 0.0, 0.25]), [[-0.3, -0.2]]);
        assert_eq!(unpredicted(flown, &[-0.2, 0.1]), [[-0.3, -0.2], [0.1, 0.2]]);
        assert!(unpredicted(flown, &[-0.4, 0.4]).is_empty());
        assert_eq!(unpredicted(flown, &[]), [[-0.3, 0.2]]);
        assert!(unpredicted(None, &[0.0]).is_empty());
    }
}
