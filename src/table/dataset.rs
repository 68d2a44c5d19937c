//! Tables in, files of a Parquet dataset out, and back:
//! `DIR/<table>/[flight=<id>/]part-<n>.parquet`, or `part-<n>-<id>.parquet` for what one flight has of
//! a part.
//!
//! A file appears whole or not at all: it is written beside its place, flushed to disk and renamed.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{Table, Want, check_flight, schema};
use crate::error::{Error, Errors, Place, Result};

/// The path of a part below the output folder, with `/` between folders.
///
/// # Errors
/// There is no such table, or it is per flight and `flight` is no id, or it is not and there is
/// one.
pub fn part_path(table: &str, flight: Option<&str>, part: usize) -> Result<String> {
    match (schema(table)?.per_flight, flight) {
        (true, Some(id)) => {
            check_flight(id).map(|()| format!("{table}/flight={id}/part-{part}.parquet"))
        }
        (false, None) => Ok(format!("{table}/part-{part}.parquet")),
        (true, None) => Err(Error::new(format!(
            "table \"{table}\" is written flight by flight, and no flight is given"
        ))),
        (false, Some(id)) => Err(Error::new(format!(
            "table \"{table}\" is not written flight by flight, and {id} is given"
        ))),
    }
}

/// Writes one part of a table below the folder `dir`, and says where.
///
/// # Errors
/// As [`part_path`]; a row is of another flight than the part; the file cannot be written.
pub fn write_part(dir: &Path, table: &Table, flight: Option<&str>, part: usize) -> Result<PathBuf> {
    let path = dir.join(part_path(table.name(), flight, part)?);
    if let Some(id) = flight
        && let Some((other, _)) = table.runs("flight")?.into_iter().find(|(f, _)| *f != id)
    {
        return Err(Error::new(format!(
            "table \"{}\" of flight {id} has a row of flight \"{other}\"",
            table.name()
        )));
    }
    // Bytes first: where a disk is full, the table's writer would say so without the file.
    write_atomic(&path, &table.to_parquet()?)?;
    Ok(path)
}

/// Writes a file so that it is there whole or not at all, and makes its folder.
///
/// # Errors
/// The file system refuses.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = Unfinished::beside(path)?;
    file.0.write_all(bytes).map_err(|e| refused(path, &e))?;
    file.finish(path)
}

fn refused(path: &Path, e: &std::io::Error) -> Error {
    Error::at(Place::file(path.to_string_lossy()), format!("cannot write the file: {e}"))
}

/// A file that is being written beside its place; it is gone when it is not finished.
pub struct Unfinished(pub tempfile::NamedTempFile);

impl Unfinished {
    /// One beside `path`, whose folder is made.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn beside(path: &Path) -> Result<Unfinished> {
        let folder = folder(path);
        std::fs::create_dir_all(folder).map_err(|e| refused(path, &e))?;
        let file = tempfile::Builder::new().prefix(".unfinished-").tempfile_in(folder);
        file.map(Unfinished).map_err(|e| refused(path, &e))
    }

    /// Puts it into its place.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn finish(self, path: &Path) -> Result<()> {
        let fail = |e: std::io::Error| refused(path, &e);
        self.0.as_file().sync_all().map_err(fail)?;
        self.pass_on(path)?;
        // The rename itself is on disk only once the folder is.
        std::fs::File::open(folder(path)).and_then(|f| f.sync_all()).map_err(fail)
    }

    /// The same for a file that nobody wants after this run, and whose bytes are checked by those who
    /// read it: it need not outlive the machine.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn pass_on(self, path: &Path) -> Result<()> {
        let fail = |e: std::io::Error| refused(path, &e);
        readable(self.0.as_file()).map_err(fail)?;
        self.0.persist(path).map(drop).map_err(|e| fail(e.error))
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Temporary files are for their owner alone; results are for everybody.
#[cfg(unix)]
fn readable(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn readable(_file: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

/// Reads one part of a table.
///
/// # Errors
/// The file is not there, or is not a part of that table.
pub fn read_part(dir: &Path, table: &str, flight: Option<&str>, part: usize) -> Result<Table> {
    read_file(&dir.join(part_path(table, flight, part)?), table, flight)
}

/// Reads a part of a table by its path; `flight` is what the path says of one that is per flight.
///
/// # Errors
/// The file is not there, or is not a part of that table.
pub fn read_file(path: &Path, table: &str, flight: Option<&str>) -> Result<Table> {
    read_wanted(path, table, flight, Want::default())
}

/// The same with what is wanted of it alone.
///
/// # Errors
/// As [`read_file`].
pub fn read_wanted(path: &Path, table: &str, flight: Option<&str>, want: Want) -> Result<Table> {
    let place = || Some(Place::file(path.to_string_lossy()));
    let file = std::fs::File::open(path).map_err(|e| Error {
        place: place(),
        what: format!("cannot read the file: {e}"),
        help: None,
    })?;
    Table::part_of_parquet(table, file, flight, want).map_err(|e| Error { place: place(), ..e })
}

/// A file of a table.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct PartFile {
    /// The flight in its path, of a table that is written flight by flight.
    pub flight: Option<String>,
    /// From 0, in the order of the estimates or fits that the parts are of.
    pub number: usize,
    /// The flight in its name, of one that has what a flight has of a numbered part.
    pub of: Option<String>,
}

impl PartFile {
    /// Its path below the output folder.
    ///
    /// # Errors
    /// As [`part_path`].
    pub fn path(&self, table: &str) -> Result<String> {
        let path = part_path(table, self.flight.as_deref(), self.number)?;
        Ok(match (&self.of, path.strip_suffix(".parquet")) {
            (Some(of), Some(stem)) => format!("{stem}-{of}.parquet"),
            _ => path,
        })
    }
}

/// The parts of a table below `dir`, sorted by flight, then number; empty when there are none.
///
/// # Errors
/// There is no such table, or a folder cannot be read.
pub fn parts(dir: &Path, table: &str) -> Result<Vec<PartFile>> {
    let folder = dir.join(table);
    let mut found = Vec::new();
    if !schema(table)?.per_flight {
        found.extend(files(&folder, None)?);
    } else {
        for name in names(&folder)? {
            let Some(id) = name.strip_prefix("flight=") else { continue };
            found.extend(files(&folder.join(&name), Some(id))?);
        }
    }
    found.sort();
    Ok(found)
}

fn files(folder: &Path, flight: Option<&str>) -> Result<Vec<PartFile>> {
    let file = |name: &String| {
        let name = name.strip_prefix("part-")?.strip_suffix(".parquet")?;
        let (number, of) = name.split_once('-').map_or((name, None), |(n, id)| (n, Some(id)));
        let (flight, of) = (flight.map(String::from), of.map(String::from));
        Some(PartFile { flight, number: number.parse().ok()?, of })
    };
    Ok(names(folder)?.iter().filter_map(file).collect())
}

fn names(folder: &Path) -> Result<Vec<String>> {
    let fail = |e: std::io::Error| {
        Error::at(Place::file(folder.to_string_lossy()), format!("cannot read the folder: {e}"))
    };
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(fail(e)),
    };
    entries
        .map(|e| e.map(|e| e.file_name().to_string_lossy().into_owned()))
        .collect::<std::io::Result<_>>()
        .map_err(fail)
}

/// Reads a whole table: all parts in the order of [`parts`]. A table without parts has no rows.
///
/// # Errors
/// Every part that cannot be read, or parts that do not fit together.
pub fn read_dataset(dir: &Path, table: &str) -> std::result::Result<Table, Errors> {
    read_dataset_of(dir, table, &mut |_| true)
}

/// The same of the parts that are wanted, by their paths below `dir`.
///
/// # Errors
/// As [`read_dataset`].
pub fn read_dataset_of(
    dir: &Path,
    table: &str,
    is_wanted: &mut dyn FnMut(&str) -> bool,
) -> std::result::Result<Table, Errors> {
    let mut errors = Errors::default();
    let mut tables = Vec::new();
    for part in parts(dir, table)? {
        let path = part.path(table)?;
        if is_wanted(&path) {
            let file = dir.join(path);
            tables.extend(errors.take(read_file(&file, table, part.flight.as_deref())));
        }
    }
    errors.or(())?;
    Ok(Table::concat(table, &tables)?)
}
