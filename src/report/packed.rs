//! Numbers of a time history in, a third of the bytes that they take as text out; `page.js` unpacks
//! them.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// A curve in 65534 steps from its least to its largest value: finer than any plot shows.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Packed {
    /// The least value.
    low: f64,
    /// What one level is.
    step: f64,
    /// The level of every value, [`NONE`] where there is none: 16 bits, the lower ones first, in
    /// base 64.
    levels: String,
    #[serde(skip)]
    len: usize,
}

const NONE: u16 = u16::MAX;
const TOP: f64 = 65534.0;

impl Packed {
    /// These values times `factor`.
    pub fn of(values: impl IntoIterator<Item = f64>, factor: f64) -> Packed {
        let values: Vec<f64> = values.into_iter().map(|v| v * factor).collect();
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        // Two halves, because the span of the largest numbers is none.
        let step = high / TOP - low / TOP;
        let level = |v: &f64| match v.is_finite() {
            // Halves go up, as anywhere.
            true if step > 0.0 => ((v - low) / step).round().clamp(0.0, TOP) as u16,
            true => 0,
            false => NONE,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| level(v).to_le_bytes()).collect();
        let known = |v: f64| if v.is_finite() { v } else { 0.0 };
        Packed {
            low: known(low),
            step: known(step),
            levels: STANDARD.encode(bytes),
            len: values.len(),
        }
    }

    /// How many values there are.
    pub fn len(&self) -> usize {
        self.len
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `page.js` reads it.
    fn unpacked(packed: &Packed) -> Vec<f64> {
        let bytes = STANDARD.decode(&packed.levels).expect("base 64");
        let level = |pair: &[u8]| u16::from_le_bytes([pair[0], pair[1]]);
        let value =
            |k: u16| if k == NONE { f64::NAN } else { packed.low + f64::from(k) * packed.step };
        bytes.chunks(2).map(|pair| value(level(pair))).collect()
    }

    #[test]
    fn values_come_back_to_a_step() {
        let values = [0.1, f64::NAN, -3.0, 7.25, f64::INFINITY, 7.0];
        let packed = Packed::of(values, 2.0);
        let back = unpacked(&packed);
        for (value, back) in values.iter().zip(&back) {
            assert_eq!(value.is_finite(), back.is_finite());
            assert!(!value.is_finite() || (2.0 * value - back).abs() <= 0.51 * packed.step);
        }
        assert_eq!((packed.len(), back[2]), (6, -6.0));
        assert!(packed.levels.len() <= 16);
    }

    #[test]
    fn a_curve_may_be_level_or_empty_or_unknown() {
        assert_eq!(unpacked(&Packed::of([5.0, 5.0], 1.0)), [5.0, 5.0]);
        assert!(unpacked(&Packed::of([f64::NAN], 1.0))[0].is_nan());
        assert_eq!(unpacked(&Packed::of([], 1.0)), [0.0; 0]);
    }
}
