//! Paths come in; their folders are made and read and files removed, and what an output folder holds
//! goes out.

use super::hashed::cannot;
use crate::error::Result;
use crate::guard::MARK;
use std::path::{Path, PathBuf};

/// How the names of files begin that are being written (`table::write_atomic`).
pub const UNFINISHED: &str = ".unfinished-";

/// Makes the folder of a file.
pub fn make_parent(path: &Path) -> Result<PathBuf> {
    let folder = path.parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf);
    std::fs::create_dir_all(&folder).map_err(|e| cannot("make the folder", &folder, &e))?;
    Ok(folder)
}

/// Removes a file, where there is one.
pub fn remove_file(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(cannot("remove", path, &e)),
        _ => Ok(()),
    }
}

/// The entries of a folder in order of name; none where there is no such folder.
pub fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    all.sort();
    all
}

/// Every file of an output folder but hidden ones and those of output folders that stand in it.
pub fn all(root: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for path in entries(&folder).into_iter().filter(|path| !is_hidden(path)) {
            match path.is_dir() {
                false => all.push(path),
                true if path.join(MARK).is_dir() || path.is_symlink() => {}
                true => folders.push(path),
            }
        }
    }
    all.sort();
    all
}

/// The files in the hidden folder that marks an output folder.
pub fn in_the_mark(root: &Path) -> Vec<PathBuf> {
    let (folders, mut files): (Vec<_>, Vec<_>) =
        entries(&root.join(MARK)).into_iter().partition(|path| path.is_dir());
    files.extend(folders.iter().flat_map(|folder| entries(folder)));
    files
}

/// The name of a file, without its folder.
pub fn name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Whether the name begins with a point, and is not that of a file that was being written.
fn is_hidden(path: &Path) -> bool {
    let name = name(path);
    name.starts_with('.') && !name.starts_with(UNFINISHED)
}
