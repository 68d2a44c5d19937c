//! A table in, Parquet bytes out, and back: the same table gives the same bytes.
//!
//! Readers matter more than bytes: f64 is `PLAIN`, because `BYTE_STREAM_SPLIT` (a third smaller) is
//! refused by fastparquet and by older polars and, with nulls, misread by pyarrow 11. Integers are
//! deltas, and only texts have a dictionary; zstd level 1 throughout.

use std::io::Write;
use std::sync::Arc;

use arrow_array::{Array, ArrayRef, Float64Array, RecordBatchReader, StringArray, new_null_array};
use arrow_schema::{DataType, Field, Schema as ArrowSchema};
use parquet::arrow::arrow_reader::{ParquetRecordBatchReaderBuilder, RowFilter};
use parquet::arrow::{ArrowWriter, ProjectionMask};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::ChunkReader;
use parquet::schema::types::ColumnPath;

use super::version::{self, SCHEMA_VERSION};
use super::{Column, Kind, Schema, Table, Want, schema, texts};
use crate::error::{Error, Result};

/// Rows of a row group, fixed so that the bytes depend on the rows alone; a writer holds one.
const ROW_GROUP: usize = 1 << 17;
/// Rows that are made ready to be written, or decoded, at a time.
const PIECE: usize = 1 << 16;

/// Stands in every file as its author; fixed, so that a rebuilt program with the same sources gives
/// the same bytes.
const CREATED_BY: &str = concat!("koehler ", env!("CARGO_PKG_VERSION"));

impl Table {
    /// The table as the bytes of a Parquet file; the flight of a per-flight table is left to the
    /// file's path.
    ///
    /// Units and meanings stand in the metadata of the columns and, for readers that do not look
    /// there, as `unit.<column>` and `doc.<column>` in the metadata of the file, beside `table`, `doc`
    /// and `schema_version`.
    ///
    /// # Errors
    /// The Parquet writer fails.
    pub fn to_parquet(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.write_parquet(&mut bytes)?;
        Ok(bytes)
    }

    /// The same, piece by piece into what takes it.
    ///
    /// # Errors
    /// The Parquet writer fails, or what it writes to.
    pub fn write_parquet(&self, to: impl Write + Send) -> Result<()> {
        let schema = super::schema::in_file(self.file_columns());
        let fail = |e: parquet::errors::ParquetError| {
            Error::new(format!("table \"{}\" cannot be written: {e}", self.name()))
        };
        let properties = self.properties(&schema)?;
        let mut writer =
            ArrowWriter::try_new(to, schema.clone(), Some(properties)).map_err(fail)?;
        for from in (0..self.rows()).step_by(PIECE) {
            let rows = from..(from + PIECE).min(self.rows());
            writer.write(&self.in_file(&schema, rows)?).map_err(fail)?;
        }
        writer.close().map_err(fail).map(|_| ())
    }

    fn properties(&self, schema: &ArrowSchema) -> Result<WriterProperties> {
        let level = ZstdLevel::try_new(1).map_err(|e| Error::new(e.to_string()))?;
        let mut pairs = vec![
            ("table".to_string(), self.name().to_string()),
            ("doc".to_string(), self.schema.doc.clone()),
            (version::KEY.to_string(), SCHEMA_VERSION.to_string()),
        ];
        let mut builder = WriterProperties::builder()
            .set_created_by(CREATED_BY.to_string())
            .set_max_row_group_row_count(Some(ROW_GROUP))
            .set_compression(Compression::ZSTD(level));
        for field in schema.fields() {
            let path = ColumnPath::new(vec![field.name().clone()]);
            let encoding = match field.data_type() {
                DataType::Float64 | DataType::Boolean => Some(Encoding::PLAIN),
                DataType::Int64 => Some(Encoding::DELTA_BINARY_PACKED),
                _ => None,
            };
            if let Some(encoding) = encoding {
                builder = builder
                    .set_column_dictionary_enabled(path.clone(), false)
                    .set_column_encoding(path, encoding);
            }
            for key in ["unit", "doc"] {
                pairs.push((
                    format!("{key}.{}", field.name()),
                    field.metadata().get(key).cloned().unwrap_or_default(),
                ));
            }
        }
        let pairs = pairs.into_iter().map(|(key, value)| KeyValue::new(key, value)).collect();
        Ok(builder.set_key_value_metadata(Some(pairs)).build())
    }

    /// Reads the bytes of a Parquet file back; `flight` is what the file's path says, for a
    /// per-flight table.
    ///
    /// # Errors
    /// The bytes are no Parquet file, or not one of the table `name`.
    pub fn from_parquet(name: &str, bytes: Vec<u8>, flight: Option<&str>) -> Result<Table> {
        Table::part_of_parquet(name, bytes::Bytes::from(bytes), flight, Want::default())
    }

    /// The same with what is wanted of the table alone.
    ///
    /// # Errors
    /// As `from_parquet`. A column that is not there is left out.
    pub fn part_of_parquet(
        name: &str,
        source: impl ChunkReader + 'static,
        flight: Option<&str>,
        want: Want,
    ) -> Result<Table> {
        let mut file = TableFile::open(name, source)?;
        let own = |c: &Column| file.schema.columns.iter().any(|own| own.name == c.name);
        let kept = |c: &&Column| {
            let asked = if own(c) { want.own } else { want.columns };
            asked.is_none_or(|only| only.contains(&c.name))
        };
        file.columns = file.columns.iter().filter(kept).cloned().collect();
        file.filter = want.filter(file.reader.parquet_schema());
        if let Some(groups) = want.rows.and_then(|rows| rows.groups(file.reader.metadata())) {
            file.reader = file.reader.with_row_groups(groups);
        }
        let (schema, columns) = (file.schema, file.columns.clone());
        let arrays = file.read(flight)?;
        Table::from_arrays(schema, columns, arrays)
    }
}

/// A file of a table, opened and not read: its columns are known to be those of the schema.
pub(super) struct TableFile<T: ChunkReader> {
    reader: ParquetRecordBatchReaderBuilder<T>,
    schema: &'static Schema,
    /// What is read: all columns, unless some are taken out.
    pub columns: Vec<Column>,
    /// Which rows are read; all of them without one.
    filter: Option<RowFilter>,
}

impl<T: ChunkReader + 'static> TableFile<T> {
    /// A file of the table `name`.
    ///
    /// # Errors
    /// It is no Parquet file, of a later version, or not one of that table.
    pub fn open(name: &str, source: T) -> Result<TableFile<T>> {
        let schema = schema(name)?;
        let reader =
            ParquetRecordBatchReaderBuilder::try_new(source).map_err(|e| unreadable(schema, &e))?;
        version::check(reader.metadata().file_metadata().key_value_metadata())?;
        let columns =
            columns(schema, reader.schema().fields()).map_err(|what| unreadable(schema, &what))?;
        Ok(TableFile { reader, schema, columns, filter: None })
    }

    /// How many rows it has.
    pub fn rows(&self) -> usize {
        usize::try_from(self.reader.metadata().file_metadata().num_rows()).unwrap_or(0)
    }

    /// The values of its columns, in their order; that of the flight, which is not in the file, is
    /// `flight` throughout. What has no value is NaN, or null where it is no number.
    ///
    /// # Errors
    /// The file is damaged, or wants a flight.
    pub fn read(self, flight: Option<&str>) -> Result<Vec<ArrayRef>> {
        let room = if self.filter.is_none() { self.rows() } else { 0 };
        let (schema, columns) = (self.schema, self.columns);
        let fail = |e: &dyn std::fmt::Display| unreadable(schema, e);
        let names = columns.iter().map(|column| column.name.as_str());
        let mask = ProjectionMask::columns(self.reader.parquet_schema(), names);
        let reader = match self.filter {
            Some(filter) => self.reader.with_row_filter(filter),
            None => self.reader,
        };
        let reader = reader.with_projection(mask).with_batch_size(PIECE);
        let batches = reader.build().map_err(|e| fail(&e))?;
        let in_file = batches.schema();
        let field = |column: &Column| in_file.index_of(&column.name).ok();
        let mut gathered: Vec<(Option<usize>, Gathered)> =
            columns.iter().map(|c| (field(c), Gathered::of(c.kind, room))).collect();
        let mut rows = 0;
        for batch in batches {
            let batch = batch.map_err(|e| fail(&e))?;
            rows += batch.num_rows();
            for (field, gathered) in &mut gathered {
                field.iter().for_each(|&field| gathered.take(batch.column(field)));
            }
        }
        let array = |(field, gathered): (Option<usize>, Gathered)| match (field, flight) {
            (Some(_), _) => gathered.array(rows).map_err(|e| fail(&e)),
            (None, Some(id)) => {
                texts::repeated(id, rows).ok_or_else(|| fail(&"it has too many rows"))
            }
            (None, None) => Err(fail(&"its path does not say which flight it is of")),
        };
        gathered.into_iter().map(array).collect()
    }
}

/// A column while it is read, piece by piece.
enum Gathered {
    Numbers(Vec<f64>),
    Texts(texts::Collector),
    Others(Kind, Vec<ArrayRef>),
}

impl Gathered {
    /// Nothing yet, and room for so many rows.
    fn of(kind: Kind, rows: usize) -> Gathered {
        match kind {
            Kind::F64 => Gathered::Numbers(Vec::with_capacity(rows)),
            Kind::String => Gathered::Texts(texts::Collector::of(rows)),
            Kind::I64 | Kind::Bool => Gathered::Others(kind, Vec::new()),
        }
    }

    /// A piece; its type is known to be the column's.
    fn take(&mut self, array: &ArrayRef) {
        let any = array.as_any();
        match self {
            Gathered::Numbers(all) => match any.downcast_ref::<Float64Array>() {
                Some(numbers) if numbers.null_count() > 0 => {
                    all.extend(numbers.iter().map(|v| v.unwrap_or(f64::NAN)));
                }
                numbers => numbers.iter().for_each(|numbers| all.extend(numbers.values().iter())),
            },
            Gathered::Texts(all) => {
                any.downcast_ref::<StringArray>().iter().for_each(|texts| all.extend(texts));
            }
            Gathered::Others(_, all) => all.push(array.clone()),
        }
    }

    fn array(self, rows: usize) -> std::result::Result<ArrayRef, String> {
        match self {
            Gathered::Numbers(all) => Ok(Arc::new(Float64Array::from(all))),
            Gathered::Texts(all) => all.finish().ok_or_else(|| "it has too many texts".into()),
            Gathered::Others(kind, all) if all.is_empty() => {
                Ok(new_null_array(&kind.data_type(), rows))
            }
            Gathered::Others(_, all) => {
                let all: Vec<&dyn Array> = all.iter().map(AsRef::as_ref).collect();
                arrow_select::concat::concat(&all).map_err(|e| e.to_string())
            }
        }
    }
}

fn unreadable(schema: &Schema, why: &dyn std::fmt::Display) -> Error {
    Error::new(format!("this is no readable file of the table \"{}\": {why}", schema.name))
        .help("delete the file and run again")
}

/// The table's columns, those of the schema first; says what does not fit.
fn columns(schema: &Schema, fields: &[Arc<Field>]) -> std::result::Result<Vec<Column>, String> {
    for column in &schema.columns {
        let in_path = schema.per_flight && column.name == "flight";
        match fields.iter().find(|f| *f.name() == column.name) {
            Some(field) if *field.data_type() == column.kind.data_type() => {
                // Where other programs have written it, it may have none.
                if let Some(unit) = field.metadata().get("unit").filter(|u| **u != column.unit) {
                    return Err(format!(
                        "its column \"{}\" is in {unit}, not {}",
                        column.name, column.unit
                    ));
                }
            }
            Some(field) => {
                return Err(format!(
                    "its column \"{}\" is {}, not {}",
                    column.name,
                    field.data_type(),
                    column.kind.word()
                ));
            }
            None if in_path => {}
            None => return Err(format!("it lacks the column \"{}\"", column.name)),
        }
    }
    let mut columns = schema.columns.clone();
    for field in fields.iter().filter(|f| !schema.columns.iter().any(|c| c.name == **f.name())) {
        if schema.dynamic.is_none() || *field.data_type() != DataType::Float64 {
            return Err(format!("it has a column \"{}\" that the table has not", field.name()));
        }
        let text = |key: &str| field.metadata().get(key).cloned().unwrap_or_default();
        columns.push(Column {
            name: field.name().clone(),
            kind: Kind::F64,
            unit: text("unit"),
            nullable: true,
            doc: text("doc"),
        });
    }
    Ok(columns)
}
