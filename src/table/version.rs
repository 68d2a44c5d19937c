//! What a file says of its version in; whether this program reads it out.

use parquet::file::metadata::KeyValue;

use crate::error::{Error, Result};

/// The version of all tables together: what stands under `schema_version` in the metadata of every
/// file.
///
/// It is raised by one in the commit that adds, removes or renames a column of any table, or changes
/// its type, its unit, or whether it may be without a value; a test holds the schemas against it. A
/// column that is to mean something else gets another name. So a file of an earlier version, or of
/// none (programs before the first version), is read where its columns are those of now, in name,
/// type and unit, and refused by the column that is not; a file of a later version is refused.
pub const SCHEMA_VERSION: u32 = 2;

/// The name of the version in the metadata of a file.
pub(super) const KEY: &str = "schema_version";

/// Whether the version that the metadata of a file tell is one that this program knows.
///
/// # Errors
/// It is a later one, or no number.
pub(super) fn check(metadata: Option<&Vec<KeyValue>>) -> Result<()> {
    let said = metadata.into_iter().flatten().find(|pair| pair.key == KEY);
    match said.and_then(|pair| pair.value.as_deref()) {
        Some(said) => known(said, "this file of a table has"),
        None => Ok(()),
    }
}

/// Whether tables of the version `said` are read; `whose` says what has them.
///
/// # Errors
/// They are not.
pub fn known(said: &str, whose: &str) -> Result<()> {
    match said.trim().parse::<u32>() {
        Ok(version) if version <= SCHEMA_VERSION => Ok(()),
        _ => Err(Error::new(format!(
            "{whose} {KEY} {}; this program reads those up to {SCHEMA_VERSION}",
            said.trim()
        ))
        .help(
            "a later koehler wrote it: use that one, or run again into another folder with --out",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{Schema, schemas};

    /// The first digits of the hash of what [`SCHEMA_VERSION`] stands for.
    const SCHEMAS: &str = "ba549ec77c01";

    /// Everything by which programs tell one table's files from another's.
    fn form(schema: &Schema) -> String {
        let columns = schema.columns.iter();
        let columns =
            columns.map(|c| format!("{} {} {} {}\n", c.name, c.kind.word(), c.unit, c.nullable));
        let (flights, more) = (schema.per_flight, schema.dynamic.is_some());
        format!("{} {flights} {more}\n{}", schema.name, columns.collect::<String>())
    }

    #[test]
    fn the_version_is_that_of_the_schemas() {
        let text: String = schemas().iter().map(form).collect();
        let hash = blake3::hash(text.as_bytes()).to_hex();
        assert_eq!(
            &hash[..12],
            SCHEMAS,
            "the tables' columns have changed: raise SCHEMA_VERSION, unless a commit since the last release did, and put this hash here"
        );
    }

    #[test]
    fn fault_a_later_version_is_refused_and_an_earlier_or_none_is_not() {
        let pairs = |said: &str| vec![KeyValue::new(KEY.to_string(), said.to_string())];
        assert!(check(None).is_ok() && check(Some(&Vec::new())).is_ok());
        assert!(check(Some(&pairs("0"))).is_ok());
        assert!(check(Some(&pairs(&SCHEMA_VERSION.to_string()))).is_ok());
        let later = (SCHEMA_VERSION + 1).to_string();
        let e = check(Some(&pairs(&later))).unwrap_err().to_string();
        assert!(e.contains(&format!("schema_version {later}; this program reads")), "{e}");
        assert!(e.contains("--out"), "{e}");
        assert!(check(Some(&pairs("next"))).is_err());
    }
}
