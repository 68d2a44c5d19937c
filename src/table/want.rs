//! What a reader wants of a table in; the mask and the filter that leave the rest of its file unread
//! out.

use arrow_array::{Array, BooleanArray, RecordBatch, StringArray};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{ArrowPredicateFn, RowFilter};
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, RowGroupMetaData};
use parquet::file::statistics::Statistics;
use parquet::schema::types::SchemaDescriptor;
use std::fmt;
use std::sync::Arc;

/// What is wanted of a table; the default is all of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Want<'a> {
    /// Columns besides those of the table's schema; all of them without a choice.
    pub columns: Option<&'a [String]>,
    /// Columns of the table's schema; all of them without a choice.
    pub own: Option<&'a [String]>,
    /// Rows; all of them without a choice.
    pub rows: Option<&'a Rows>,
}

/// Says yes or no to a text.
pub type Is = Arc<dyn Fn(&str) -> bool + Send + Sync>;

/// Rows of a table by the text in a column (empty where there is none).
#[derive(Clone)]
pub enum Rows {
    /// Those whose text is wanted.
    Of(&'static str, Is),
    /// The same; none is wanted that comes before the first or behind the last of these texts, so
    /// that row groups outside of them are left alone.
    Within(&'static str, [String; 2], Is),
    /// Of neighbours that are alike the first and the last one, and some between them where they are many.
    Ends(&'static str),
}

impl fmt::Debug for Rows {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Rows::Of(column, _) | Rows::Within(column, ..) => write!(f, "rows of {column}"),
            Rows::Ends(column) => write!(f, "ends of {column}"),
        }
    }
}

impl Want<'_> {
    /// Whether the whole table is wanted.
    pub fn is_all(&self) -> bool {
        self.columns.is_none() && self.own.is_none() && self.rows.is_none()
    }

    /// The rows that are read; of the other columns nothing else is decoded.
    pub(super) fn filter(&self, file: &SchemaDescriptor) -> Option<RowFilter> {
        let rows = self.rows?.clone();
        let mask = ProjectionMask::columns(file, [rows.column()]);
        let keep = move |batch: RecordBatch| Ok(rows.kept(&batch));
        Some(RowFilter::new(vec![Box::new(ArrowPredicateFn::new(mask, keep))]))
    }
}

impl Rows {
    fn column(&self) -> &'static str {
        let (Rows::Of(column, _) | Rows::Within(column, ..) | Rows::Ends(column)) = self;
        column
    }

    /// The row groups in which a row may be wanted: those whose texts, by the file's own statistics,
    /// are not all outside.
    pub(super) fn groups(&self, file: &ParquetMetaData) -> Option<Vec<usize>> {
        let Rows::Within(column, [first, last], _) = self else { return None };
        let is_it = |c: &ColumnChunkMetaData| c.column_path().string() == *column;
        let may_be = |group: &RowGroupMetaData| {
            let statistics = group.columns().iter().find(|c| is_it(c)).and_then(|c| c.statistics());
            let Some(Statistics::ByteArray(texts)) = statistics else { return true };
            let before = texts.max_opt().is_some_and(|max| max.data() < first.as_bytes());
            let behind = texts.min_opt().is_some_and(|min| min.data() > last.as_bytes());
            !before && !behind
        };
        Some((0..file.num_row_groups()).filter(|&i| may_be(file.row_group(i))).collect())
    }

    /// All rows where the column is not there, or no text: whoever reads the table says so.
    fn kept(&self, batch: &RecordBatch) -> BooleanArray {
        let texts = (batch.num_columns() > 0).then(|| batch.column(0).as_any());
        let Some(texts) = texts.and_then(|column| column.downcast_ref::<StringArray>()) else {
            return BooleanArray::from(vec![true; batch.num_rows()]);
        };
        let text = |row: usize| if texts.is_null(row) { "" } else { texts.value(row) };
        let mut kept = vec![false; texts.len()];
        let mut from = 0;
        // A run of equal texts is asked about once.
        while from < kept.len() {
            let end = (from..kept.len()).find(|&row| text(row) != text(from)).unwrap_or(kept.len());
            match self {
                Rows::Of(_, is) | Rows::Within(_, _, is) => kept[from..end].fill(is(text(from))),
                Rows::Ends(_) => (kept[from], kept[end - 1]) = (true, true),
            }
            from = end;
        }
        BooleanArray::from(kept)
    }
}
