//! What a reader wants of a table in; the mask and the filter that leave the rest of its file unread
//! out.

use arrow_array::{Array, BooleanArray, RecordBatch, StringArray};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{ArrowPredicateFn, RowFilter};
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
    /// Of neighbours that are alike the first and the last one, and some between them where they are many.
    Ends(&'static str),
}

impl fmt::Debug for Rows {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Rows::Of(column, _) => write!(f, "rows of {column}"),
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
        let (Rows::Of(column, _) | Rows::Ends(column)) = &rows;
        let mask = ProjectionMask::columns(file, [*column]);
        let keep = move |batch: RecordBatch| Ok(rows.kept(&batch));
        Some(RowFilter::new(vec![Box::new(ArrowPredicateFn::new(mask, keep))]))
    }
}

impl Rows {
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
                Rows::Of(_, is) => kept[from..end].fill(is(text(from))),
                Rows::Ends(_) => (kept[from], kept[end - 1]) = (true, true),
            }
            from = end;
        }
        BooleanArray::from(kept)
    }
}
