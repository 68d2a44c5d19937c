//! Samples that many hold and nobody changes: a copy is another holder of the same memory, and who
//! changes one that others hold gets samples of their own.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// A column or a table of samples. Segments of an estimation, the problem made of them and those
/// who look at either share them: 8 bytes a number, however many hold it.
#[derive(Debug, Clone, Default, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(from = "Vec<f64>", into = "Vec<f64>")]
pub struct Numbers(Arc<Vec<f64>>);

impl Numbers {
    /// More of them behind these.
    pub fn append(&mut self, more: &[f64]) {
        Arc::make_mut(&mut self.0).extend_from_slice(more);
    }
}

impl Deref for Numbers {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        &self.0
    }
}

impl DerefMut for Numbers {
    fn deref_mut(&mut self) -> &mut [f64] {
        Arc::make_mut(&mut self.0).as_mut_slice()
    }
}

impl From<Vec<f64>> for Numbers {
    fn from(numbers: Vec<f64>) -> Numbers {
        Numbers(Arc::new(numbers))
    }
}

impl From<Numbers> for Vec<f64> {
    fn from(numbers: Numbers) -> Vec<f64> {
        Arc::unwrap_or_clone(numbers.0)
    }
}

impl FromIterator<f64> for Numbers {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Numbers {
        Vec::from_iter(numbers).into()
    }
}

impl<'a> IntoIterator for &'a Numbers {
    type Item = &'a f64;
    type IntoIter = std::slice::Iter<'a, f64>;
    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_share_samples_until_one_is_changed() {
        let numbers = Numbers::from(vec![1.0, 2.0]);
        let mut other = numbers.clone();
        assert!(std::ptr::eq(numbers.as_ptr(), other.as_ptr()));
        other[1] = 3.0;
        assert_eq!((&numbers[..], &other[..]), (&[1.0, 2.0][..], &[1.0, 3.0][..]));
    }
}
