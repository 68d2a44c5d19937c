//! A Parquet file in; the rows of topics that are columns of it out.

use super::rows::{Columns, Read, Wanted, gather, named};
use super::settings::{Column, Import};
use super::values::Values;
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use arrow_array::cast::AsArray;
use arrow_array::types;
use arrow_array::{Array, RecordBatch};
use arrow_schema::{DataType, TimeUnit};
use bytes::Bytes;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

/// How a Parquet file begins, and ends.
pub const MAGIC: &[u8] = b"PAR1";

/// Is this a Parquet file?
pub fn is_parquet(bytes: &[u8]) -> bool {
    bytes.len() > MAGIC.len() && bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC)
}

/// Reads the columns that the description names. Values that are null are NaN.
///
/// # Errors
/// The file is damaged or packed in a way that is not read; columns that it lacks, or that are no
/// numbers.
pub fn read(settings: &Import, doc: &Doc, (file, bytes): (&str, Vec<u8>)) -> Result<Read, Errors> {
    if settings.header_lines > 0 {
        return Err(doc
            .error("header_lines", format!("{file} is Parquet: it has no lines"))
            .into());
    }
    let bytes = Bytes::from(bytes);
    let opened = ParquetRecordBatchReaderBuilder::try_new(bytes.clone())
        .map_err(|e| Error::at(Place::file(file), format!("no readable Parquet file: {e}")))?;
    let fields = opened.schema().fields();
    let names = fields.iter().map(|f| f.name().clone()).collect();
    gather(settings, doc, file, &mut File { bytes, names })
}

struct File {
    bytes: Bytes,
    names: Vec<String>,
}

impl Columns for File {
    fn column(&mut self, wanted: Wanted) -> Result<Values, String> {
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let index = match wanted.column {
            _ if wanted.matrix.is_some() => Err("a Parquet file has no matrices".to_string()),
            Column::Number(n) => n
                .checked_sub(1)
                .filter(|n| *n < names.len())
                .ok_or_else(|| format!("column {n} is wanted, the file has {}", names.len())),
            Column::Name(name) => named(name, &names, "the file"),
        }?;
        let name = names.get(index).copied().unwrap_or_default();
        let read = || -> Result<Vec<RecordBatch>, String> {
            let reader = ParquetRecordBatchReaderBuilder::try_new(self.bytes.clone());
            let reader = reader.map_err(|e| e.to_string())?;
            let only = ProjectionMask::roots(reader.parquet_schema(), [index]);
            let batches = reader.with_projection(only).build().map_err(|e| e.to_string())?;
            batches.collect::<Result<_, _>>().map_err(|e| e.to_string())
        };
        let mut all: Option<Values> = None;
        for batch in read().map_err(|e| format!("column \"{name}\" cannot be read: {e}"))? {
            let Some(array) = batch.columns().first() else { continue };
            let more = values(array.as_ref()).ok_or_else(|| {
                format!("column \"{name}\" is of type {}, no numbers", array.data_type())
            })?;
            all = Some(match all {
                Some(all) => Values::and(all, more),
                None => more,
            });
        }
        Ok(all.unwrap_or(Values::Numbers(Vec::new())))
    }
}

/// Numbers, or stamps in ns; none for other types.
fn values(array: &dyn Array) -> Option<Values> {
    macro_rules! numbers {
        ($t:ident) => {{
            let all = array.as_primitive_opt::<types::$t>()?;
            Values::Numbers(all.iter().map(|v| v.map_or(f64::NAN, |v| v as f64)).collect())
        }};
    }
    macro_rules! whole {
        ($t:ident) => {{
            let all = array.as_primitive_opt::<types::$t>()?;
            Values::Whole(all.iter().map(|n| n.map(i128::from)).collect())
        }};
    }
    macro_rules! stamps {
        ($t:ident, $ns:expr) => {{
            let all = array.as_primitive_opt::<types::$t>()?;
            // A stamp that does not fit into 64 bits of ns is as good as none.
            Values::Stamps(all.iter().map(|v| v.and_then(|v| v.checked_mul($ns))).collect())
        }};
    }
    Some(match array.data_type() {
        DataType::Int8 => numbers!(Int8Type),
        DataType::Int16 => numbers!(Int16Type),
        DataType::Int32 => numbers!(Int32Type),
        DataType::Int64 => whole!(Int64Type),
        DataType::UInt8 => numbers!(UInt8Type),
        DataType::UInt16 => numbers!(UInt16Type),
        DataType::UInt32 => numbers!(UInt32Type),
        DataType::UInt64 => whole!(UInt64Type),
        DataType::Float32 => numbers!(Float32Type),
        DataType::Float64 => numbers!(Float64Type),
        DataType::Boolean => {
            let all = array.as_boolean_opt()?.iter();
            Values::Numbers(all.map(|v| v.map_or(f64::NAN, |v| f64::from(u8::from(v)))).collect())
        }
        DataType::Timestamp(TimeUnit::Second, _) => stamps!(TimestampSecondType, 1_000_000_000),
        DataType::Timestamp(TimeUnit::Millisecond, _) => {
            stamps!(TimestampMillisecondType, 1_000_000)
        }
        DataType::Timestamp(TimeUnit::Microsecond, _) => stamps!(TimestampMicrosecondType, 1_000),
        DataType::Timestamp(TimeUnit::Nanosecond, _) => stamps!(TimestampNanosecondType, 1),
        _ => return None,
    })
}
