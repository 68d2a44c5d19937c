//! Work that reads configuration files comes in; what it returns, and the text of every file that
//! it read, go out.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Text by path.
pub type Texts = BTreeMap<PathBuf, String>;

thread_local! {
    // A file is read deep inside whatever names it; only this keeps count of all of them.
    static READ: RefCell<Option<Texts>> = const { RefCell::new(None) };
}

/// Does `work` and says which files it read on this thread.
pub fn watched<T>(work: impl FnOnce() -> T) -> (T, Texts) {
    let outer = READ.replace(Some(Texts::new()));
    let done = work();
    let read = READ.replace(outer).unwrap_or_default();
    read.iter().for_each(|(path, text)| seen(path, text));
    (done, read)
}

/// Takes note of a file that was read.
pub(super) fn seen(path: &Path, text: &str) {
    READ.with_borrow_mut(|read| {
        if let Some(read) = read {
            read.insert(path.to_path_buf(), text.to_string());
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::read_text;

    #[test]
    fn files_are_named_by_who_read_them_and_by_whoever_asked_that() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let [a, b, c] = ["a", "b", "c"].map(|name| {
            let path = dir.path().join(name);
            std::fs::write(&path, name).expect("written");
            path
        });
        let ((_, inner), outer) = watched(|| {
            read_text(&a).expect("read");
            watched(|| read_text(&b).expect("read"))
        });
        read_text(&c).expect("read");
        assert_eq!(inner.keys().collect::<Vec<_>>(), [&b]);
        assert_eq!(outer, Texts::from([(a, "a".to_string()), (b, "b".to_string())]));
    }
}
