//! The one error type: where it is, what is wrong (what was wanted, what was there), and what to do
//! about it.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A position in a file that a person wrote. Line and column count from 1; 0 means "the whole
/// file".
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Place {
    /// Path of the file, as the user gave it.
    pub file: String,
    /// From 1; 0 for the file as a whole.
    pub line: usize,
    /// From 1; 0 for the file as a whole.
    pub column: usize,
}

impl Place {
    /// A file as a whole.
    pub fn file(file: impl Into<String>) -> Self {
        Place { file: file.into(), line: 0, column: 0 }
    }

    /// The place of byte `offset` in `text`.
    pub fn in_text(file: &str, text: &str, offset: usize) -> Self {
        let before = &text[..offset.min(text.len())];
        let line = before.matches('\n').count() + 1;
        let start = before.rfind('\n').map_or(0, |i| i + 1);
        Place { file: file.to_string(), line, column: before[start..].chars().count() + 1 }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        if self.line == 0 {
            write!(f, "{}", self.file)
        } else {
            write!(f, "{}:{}:{}", self.file, self.line, self.column)
        }
    }
}

/// One mistake: `channels.toml:14:9: topic "/airdata" is not in flight-03.mcap; it has
/// "/air_data"`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Error {
    /// Where; none where no file is concerned.
    pub place: Option<Place>,
    /// What is wrong: what was wanted and what was there.
    pub what: String,
    /// What to do.
    pub help: Option<String>,
}

impl Error {
    /// Says what is wrong, without a place.
    pub fn new(what: impl Into<String>) -> Self {
        Error { place: None, what: what.into(), help: None }
    }

    /// Says what is wrong and where.
    pub fn at(place: Place, what: impl Into<String>) -> Self {
        Error { place: Some(place), what: what.into(), help: None }
    }

    /// With what to do about it.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        write!(f, "{}", self.what)?;
        match &self.help {
            Some(help) => write!(f, "\n    {help}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for Error {}

/// One or more mistakes, in the order in which a reader meets them.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Errors(pub Vec<Error>);

impl Errors {
    /// Takes one more.
    pub fn push(&mut self, error: Error) {
        self.0.push(error);
    }

    /// Whether nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Keeps the value of a success and files the errors of a failure.
    pub fn take<T, E: Into<Errors>>(&mut self, result: std::result::Result<T, E>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(e) => {
                self.0.extend(e.into().0);
                None
            }
        }
    }

    /// `Err(self)` if anything was filed.
    pub fn or<T>(self, value: T) -> std::result::Result<T, Errors> {
        if self.is_empty() { Ok(value) } else { Err(self) }
    }
}

impl From<Error> for Errors {
    fn from(e: Error) -> Self {
        Errors(vec![e])
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (i, e) in self.0.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{e}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Errors {}

/// A value, or what is wrong.
pub type Result<T> = std::result::Result<T, Error>;
