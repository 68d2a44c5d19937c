//! Names of flights in; ids that are safe in paths and stay texts for every Parquet reader out.

use crate::error::{Error, Result};

/// Checks a flight id: a letter, then up to 63 letters, digits, `.`, `_` or `-`.
///
/// The id stands in folder names (`flight=<id>`). Readers guess the type of a partition from its
/// text, so an id must not look like a number, a date or a truth value.
///
/// # Errors
/// The id is something else.
pub fn check_flight(id: &str) -> Result<()> {
    let letter = id.chars().next().is_some_and(|c| c.is_ascii_alphabetic());
    let clean = id.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c));
    if letter && clean && id.len() <= 63 && !id.ends_with('.') && !word(id) {
        return Ok(());
    }
    Err(Error::new(format!("\"{}\" is no flight id", id.escape_debug())).help(format!(
        "an id begins with a letter and goes on with letters, digits, '.', '_' or '-' (63 at most): \"{}\" would do",
        flight_id(id)
    )))
}

/// Ids that some reader takes for a value of another type.
fn word(id: &str) -> bool {
    ["true", "false", "null", "nan", "inf", "infinity", "none", "na"]
        .contains(&id.to_ascii_lowercase().as_str())
}

/// A flight id made of any name, as of a log's file name without its ending: other characters
/// become `-`, and what does not begin with a letter is put behind `flight-`.
pub fn flight_id(name: &str) -> String {
    let clean: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' })
        .collect();
    let letter = clean.chars().next().is_some_and(|c| c.is_ascii_alphabetic());
    let id = if letter && !word(&clean) { clean } else { format!("flight-{clean}") };
    let id: String = id.chars().take(63).collect();
    id.trim_end_matches(['.', '-']).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_checked() {
        for good in ["flight-01", "F3", "hfb320", "a.b_c-d"] {
            assert_eq!(check_flight(good), Ok(()));
        }
        for bad in [
            "",
            "01",
            "2024-05-06",
            "../x",
            "a/b",
            "a b",
            "a=b",
            "é",
            "true",
            "NaN",
            "a.",
            "_x",
            &"x".repeat(64),
        ] {
            assert!(check_flight(bad).is_err(), "{bad}");
        }
        let e = check_flight("2024/05").unwrap_err().to_string();
        assert!(
            e.starts_with("\"2024/05\" is no flight id\n")
                && e.ends_with("\"flight-2024-05\" would do"),
            "{e}"
        );
    }

    proptest::proptest! {
        #[test]
        fn an_id_made_of_anything_is_an_id(name in ".{0,90}") {
            proptest::prop_assert_eq!(check_flight(&flight_id(&name)), Ok(()));
        }
    }
}
