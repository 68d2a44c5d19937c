//! A field of a ULog message in; its number, and all digits of it where it is a whole one, out.

use px4_ulog::stream_parser::model::{FlattenedField, FlattenedFieldType};

fn bytes_at<const N: usize>(field: &FlattenedField, data: &[u8]) -> Option<[u8; N]> {
    let from = usize::from(field.offset);
    data.get(from..from + N)?.try_into().ok()
}

/// The whole number in a field of 64 bits, of which an `f64` may not have all digits.
pub fn whole(field: &FlattenedField, data: &[u8]) -> Option<i128> {
    match field.field_type {
        FlattenedFieldType::Int64 => Some(i64::from_le_bytes(bytes_at(field, data)?).into()),
        FlattenedFieldType::UInt64 => Some(u64::from_le_bytes(bytes_at(field, data)?).into()),
        _ => None,
    }
}

/// The number in a field. The parser has seen that the message is as long as its format.
pub fn number(field: &FlattenedField, data: &[u8]) -> f64 {
    macro_rules! of {
        ($t:ty) => {
            bytes_at(field, data).map_or(f64::NAN, |b| <$t>::from_le_bytes(b) as f64)
        };
    }
    match field.field_type {
        FlattenedFieldType::Int8 => of!(i8),
        FlattenedFieldType::UInt8 | FlattenedFieldType::Bool | FlattenedFieldType::Char => of!(u8),
        FlattenedFieldType::Int16 => of!(i16),
        FlattenedFieldType::UInt16 => of!(u16),
        FlattenedFieldType::Int32 => of!(i32),
        FlattenedFieldType::UInt32 => of!(u32),
        FlattenedFieldType::Int64 => of!(i64),
        FlattenedFieldType::UInt64 => of!(u64),
        FlattenedFieldType::Float => of!(f32),
        FlattenedFieldType::Double => of!(f64),
    }
}
