//! Texts of a column in; an Arrow array that holds each of them once, and its texts again, out.
//!
//! A column of texts has few of them, each in many rows (the flight, the signal): four bytes a row
//! instead of a text each. Files have plain texts, which every reader knows.

use std::sync::Arc;

use arrow_array::builder::{Int32Builder, StringBuilder};
use arrow_array::types::Int32Type;
use arrow_array::{Array, ArrayRef, DictionaryArray, StringArray};
use indexmap::IndexSet;

/// A column of texts in memory.
pub type Texts = DictionaryArray<Int32Type>;

/// Takes up texts row by row.
pub struct Collector {
    keys: Int32Builder,
    texts: IndexSet<String>,
    /// The text of the last row, and all their bytes.
    last: usize,
    bytes: usize,
}

impl Collector {
    /// None yet, and room for so many rows.
    pub fn of(rows: usize) -> Collector {
        let keys = Int32Builder::with_capacity(rows);
        Collector { keys, texts: IndexSet::new(), last: 0, bytes: 0 }
    }

    pub fn push(&mut self, text: Option<&str>) {
        let Some(text) = text else { return self.keys.append_null() };
        if self.texts.get_index(self.last).is_none_or(|last| last != text) {
            self.last = self.texts.get_index_of(text).unwrap_or_else(|| {
                self.bytes += text.len();
                self.texts.insert_full(text.to_string()).0
            });
        }
        self.keys.append_value(self.last as i32);
    }

    /// One text in so many rows.
    pub fn run(&mut self, text: &str, rows: usize) {
        if let Some(more) = rows.checked_sub(1) {
            self.push(Some(text));
            (0..more).for_each(|_| self.keys.append_value(self.last as i32));
        }
    }

    /// The texts of another column.
    pub fn extend(&mut self, texts: &StringArray) {
        texts.iter().for_each(|text| self.push(text));
    }

    /// The column; `None` when its texts are too many for an Arrow array (2 GiB).
    pub fn finish(mut self) -> Option<ArrayRef> {
        i32::try_from(self.bytes).ok()?;
        let texts = StringArray::from_iter_values(self.texts);
        let keys = self.keys.finish();
        DictionaryArray::try_new(keys, Arc::new(texts)).ok().map(|column| Arc::new(column) as _)
    }
}

/// Texts as a column.
pub fn column<S: AsRef<str>>(values: impl IntoIterator<Item = Option<S>>) -> Option<ArrayRef> {
    let values = values.into_iter();
    let mut all = Collector::of(values.size_hint().0);
    values.for_each(|text| all.push(text.as_ref().map(AsRef::as_ref)));
    all.finish()
}

/// One text in all of `rows` rows.
pub fn repeated(text: &str, rows: usize) -> Option<ArrayRef> {
    let mut all = Collector::of(rows);
    all.run(text, rows);
    all.finish()
}

/// The text of every row.
pub fn each(texts: &Texts) -> impl Iterator<Item = Option<&str>> {
    (0..texts.len()).map(move |row| at(texts, row))
}

/// The text of a row.
pub fn at(texts: &Texts, row: usize) -> Option<&str> {
    let all = texts.values().as_any().downcast_ref::<StringArray>()?;
    texts.key(row).map(|key| all.value(key))
}

/// As files have it.
pub fn plain(texts: &Texts) -> ArrayRef {
    let mut all = StringBuilder::new();
    each(texts).for_each(|text| all.append_option(text));
    Arc::new(all.finish())
}
