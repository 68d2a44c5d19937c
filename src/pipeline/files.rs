//! Paths come in; their folders are made and read and files removed, and what an output folder holds
//! goes out.

use super::hashed::cannot;
use crate::error::Result;
use crate::guard::MARK;
use std::fs::DirEntry;
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
    listed(folder).into_iter().map(|(path, _)| path).collect()
}

/// The same, each with whether it is a folder or leads to one.
pub fn listed(folder: &Path) -> Vec<(PathBuf, bool)> {
    let mut all: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().collect();
    all.sort_by_cached_key(DirEntry::file_name);
    let entry = |entry: DirEntry| {
        let path = entry.path();
        // Only of links the disk has to be asked.
        let is_folder = match entry.file_type() {
            Ok(kind) if !kind.is_symlink() => kind.is_dir(),
            _ => path.is_dir(),
        };
        (path, is_folder)
    };
    all.into_iter().map(entry).collect()
}

/// Every file of an output folder but hidden ones and those of output folders that stand in it.
pub fn all(root: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for (path, is_folder) in listed(&folder) {
            match is_folder {
                _ if is_hidden(&path) => {}
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
    let (folders, files): (Vec<_>, Vec<_>) =
        listed(&root.join(MARK)).into_iter().partition(|(_, is_folder)| *is_folder);
    let inside = folders.iter().flat_map(|(folder, _)| entries(folder));
    files.into_iter().map(|(path, _)| path).chain(inside).collect()
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
