//! Values to bytes and back, every bit of a number kept: NaN with its payload, the sign of zero.

use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The bytes of a value (MessagePack; fields by name, since settings leave out what is as usual).
///
/// # Errors
/// A part of it cannot be written as bytes.
pub fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>> {
    rmp_serde::to_vec_named(value).map_err(|e| Error::new(format!("cannot encode: {e}")))
}

/// The value that these bytes are.
///
/// # Errors
/// They are none of this type.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    rmp_serde::from_slice(bytes).map_err(|e| Error::new(format!("cannot decode: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_of_a_number_is_kept() {
        let odd = [0.0, -0.0, f64::from_bits(0x7ff8_0000_dead_beef), f64::NEG_INFINITY, 5e-324];
        let back: Vec<f64> = decode(&encode(&odd.to_vec()).expect("bytes")).expect("numbers");
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(&odd));
    }
}
