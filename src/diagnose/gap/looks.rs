//! Thresholds and a characteristic time in; how the gap is described beside the verdict, in s and
//! Hz, out.

use crate::diagnose::thresholds::Thresholds;

/// Windows, lags, bands and gains of the description.
#[derive(Debug, Clone, PartialEq)]
pub struct Looks {
    /// Gain by which states follow their measurements, 1/s.
    pub feedback: f64,
    pub half_window: f64,
    pub repeats: usize,
    pub distinguishable: f64,
    pub longest_lag: f64,
    pub relation_p: f64,
    pub coherence_bands: Vec<f64>,
    pub gap_bands: Vec<f64>,
    pub gap_times: Vec<f64>,
    pub moving: f64,
}

impl Looks {
    /// At this characteristic time. What is printed has two digits.
    pub fn of(thresholds: &Thresholds, time: f64) -> Looks {
        let all = |values: &[f64], by: f64| -> Vec<f64> {
            values.iter().map(|v| two_digits(v * by)).collect()
        };
        Looks {
            feedback: thresholds.feedback / time,
            half_window: thresholds.half_window * time,
            repeats: thresholds.repeats,
            distinguishable: thresholds.distinguishable,
            longest_lag: two_digits(thresholds.longest_lag * time),
            relation_p: thresholds.relation_p,
            coherence_bands: all(&thresholds.coherence_bands, time.recip()),
            gap_bands: all(&thresholds.gap_bands, time.recip()),
            gap_times: all(&thresholds.gap_times, time),
            moving: thresholds.moving,
        }
    }
}

fn two_digits(v: f64) -> f64 {
    format!("{v:.1e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transport_aircraft_is_looked_at_in_round_numbers() {
        let looks = Looks::of(&Thresholds::default(), 0.6);
        assert_eq!(
            (looks.gap_bands, looks.gap_times),
            (vec![0.3, 1.0, 3.0, 8.0], vec![0.5, 1.0, 2.0, 4.0])
        );
        assert_eq!(
            (looks.coherence_bands, looks.longest_lag),
            (vec![0.1, 0.3, 1.0, 2.0, 4.0, 8.0], 2.0)
        );
        assert!((looks.feedback - 8.0).abs() < 1e-9 && (looks.half_window - 0.25).abs() < 0.01);
    }
}
