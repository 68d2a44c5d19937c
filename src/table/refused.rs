//! What polars says of a query that it refuses in; where the mistake is and what to do about it out.

use polars::prelude::PolarsError;

use crate::config;
use crate::error::{Error, Place};

/// How the place of a mistake in a query begins.
const QUERY: &str = "query";

/// What to do where a query is none.
pub const HELP: &str = "a query is one SELECT, as SELECT flight, count(*) FROM segments GROUP BY flight; \
     columns that are words of SQL stand in double quotes: \"group\", \"interval\", \"from\", \"to\", \"of\"";

/// The error of a query of the tables `there`; those it names have these columns.
pub(super) fn refused(e: &PolarsError, there: &[&str], columns: &[String]) -> Error {
    match e {
        PolarsError::ColumnNotFound(said) => column(said, columns),
        PolarsError::SQLSyntax(said) | PolarsError::SQLInterface(said) => sql(said, there),
        PolarsError::Context { error, .. } | PolarsError::ExprContext { error, .. } => {
            refused(error, there, columns)
        }
        other => Error::new(format!("the query cannot be answered: {}", first(&other.to_string()))),
    }
}

/// polars names the column first, in quotes.
fn column(said: &str, columns: &[String]) -> Error {
    let Some(name) = said.split('"').nth(1) else {
        return Error::new(format!("the query cannot be answered: {}", first(said)));
    };
    let mut all: Vec<&str> = columns.iter().map(String::as_str).collect();
    all.sort_unstable();
    all.dedup();
    if all.contains(&name) {
        return Error::new(format!("column \"{name}\" is not known where the query asks for it"))
            .help(
                "ON compares columns of both tables; a comparison with a value belongs into WHERE",
            );
    }
    Error::new(format!("no table of the query has a column \"{name}\"")).help(among(
        name,
        &all,
        "the columns are",
    ))
}

fn sql(said: &str, there: &[&str]) -> Error {
    let missing =
        said.strip_prefix("relation '").and_then(|rest| rest.split_once("' was not found"));
    if let Some((name, _)) = missing {
        return Error::new(format!("the run has no table \"{name}\"")).help(among(
            name,
            there,
            "its tables are",
        ));
    }
    let said = first(said.strip_prefix("sql parser error: ").unwrap_or(said));
    // What the parser has made of it says nothing to whoever wrote it.
    let said = said.split_once(" { value: ").map_or(said, |(what, _)| what);
    let (what, place) = match said.rsplit_once(" at Line: ") {
        Some((what, at)) => (what, place(at)),
        None => (said, None),
    };
    Error { place, what: what.to_string(), help: Some(HELP.into()) }
}

/// What stands behind `at Line: `, as `1, Column: 8`.
fn place(at: &str) -> Option<Place> {
    let (line, column) = at.split_once(", Column: ")?;
    Some(Place { file: QUERY.into(), line: line.parse().ok()?, column: column.parse().ok()? })
}

fn among(name: &str, known: &[&str], are: &str) -> String {
    // All of them: a person who asks has no other list.
    let all = known.join(", ");
    match config::nearest(name, known.iter().copied()) {
        Some(near) => format!("did you mean \"{near}\"? {are} {all}"),
        None => format!("{are} {all}"),
    }
}

/// Without the plan and the tree of the query, which polars appends.
fn first(said: &str) -> &str {
    said.lines().next().unwrap_or(said).trim_end_matches(':')
}
