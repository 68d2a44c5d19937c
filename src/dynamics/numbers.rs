//! Samples that many hold and nobody changes: a copy is another holder of the same memory, and who
//! changes one that others hold gets samples of their own.

use super::filed::Filed;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// A column or a table of samples. Segments of an estimation, the problem made of them and those
/// who look at either share them: 8 bytes a number, however many hold it; in memory, or in a scratch
/// file ([`Scratch`](super::Scratch)).
#[derive(Debug, Clone, Default, serde::Deserialize, serde::Serialize)]
#[serde(from = "Vec<f64>", into = "Vec<f64>")]
pub struct Numbers {
    here: Arc<Vec<f64>>,
    /// They stand there, and none is here.
    filed: Option<Filed>,
}

impl Numbers {
    /// More of them behind these.
    pub fn append(&mut self, more: &[f64]) {
        self.own().extend_from_slice(more);
    }

    /// Those that stand in a file now.
    pub(super) fn filed(filed: Filed) -> Numbers {
        Numbers { filed: Some(filed), ..Numbers::default() }
    }

    /// Whether they take memory of their own.
    pub(super) fn is_here(&self) -> bool {
        self.filed.is_none()
    }

    /// Samples that may be changed.
    fn own(&mut self) -> &mut Vec<f64> {
        if let Some(filed) = self.filed.take() {
            self.here = Arc::new(filed.to_vec());
        }
        Arc::make_mut(&mut self.here)
    }
}

impl PartialEq for Numbers {
    fn eq(&self, other: &Numbers) -> bool {
        self[..] == other[..]
    }
}

impl Deref for Numbers {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        match &self.filed {
            Some(filed) => filed,
            None => &self.here,
        }
    }
}

impl DerefMut for Numbers {
    fn deref_mut(&mut self) -> &mut [f64] {
        self.own().as_mut_slice()
    }
}

impl From<Vec<f64>> for Numbers {
    fn from(numbers: Vec<f64>) -> Numbers {
        Numbers { here: Arc::new(numbers), filed: None }
    }
}

impl From<Numbers> for Vec<f64> {
    fn from(numbers: Numbers) -> Vec<f64> {
        match numbers.filed {
            Some(filed) => filed.to_vec(),
            None => Arc::unwrap_or_clone(numbers.here),
        }
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
