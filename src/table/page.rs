//! The table schemas in; the reference part of `docs/tables.md` out.

use super::{Schema, schemas};

/// The reference of all tables, as Markdown.
pub fn page() -> String {
    schemas().iter().map(section).collect::<Vec<_>>().join("\n")
}

fn section(schema: &Schema) -> String {
    let place = if schema.per_flight {
        format!("{}/flight=<id>/", schema.name)
    } else {
        format!("{}/", schema.name)
    };
    let mut text = format!("### `{}`\n\n{}\n\nIn `{place}`", schema.name, schema.doc);
    if !schema.sorted_by.is_empty() {
        let names: Vec<String> = schema.sorted_by.iter().map(|s| format!("`{s}`")).collect();
        text += &format!(", sorted by {}", names.join(", "));
    }
    text += ".\n\n| column | type | unit | meaning |\n|---|---|---|---|\n";
    for column in &schema.columns {
        let null = if column.nullable { " or null" } else { "" };
        text += &format!(
            "| `{}` | {}{null} | {} | {} |\n",
            column.name,
            column.kind.word(),
            column.unit,
            column.doc
        );
    }
    if let Some(dynamic) = &schema.dynamic {
        text += &format!("| ... | f64 or null | in the metadata | {dynamic} |\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_in_docs_is_that_of_the_schemas() {
        const START: &str =
            "<!-- from here on written by `UPDATE_DOCS=1 cargo test --release docs_is_that` -->\n";
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/tables.md");
        let text = std::fs::read_to_string(&path).unwrap();
        let (head, _) = text.split_once(START).expect("the page's marker");
        let wanted = format!("{head}{START}\n{}", page());
        if std::env::var_os("UPDATE_DOCS").is_some() {
            std::fs::write(&path, &wanted).unwrap();
        } else {
            assert!(
                text == wanted,
                "docs/tables.md is behind the schemas: UPDATE_DOCS=1 cargo test --release docs_is_that"
            );
        }
    }
}
