//! The embedded fragments in; the reference part of `docs/fragments.md` out.

use super::fragments::EMBEDDED;
use super::functions::is_reserved;
use std::collections::BTreeSet;
use std::path::Path;
use toml::{Table, Value};

const START: &str =
    "<!-- from here on written by `UPDATE_DOCS=1 cargo test --release fragments_page` -->\n";

/// Kinds of quantities, by their sections, in the order of a model file.
const SECTIONS: [(&str, &str); 6] = [
    ("inputs", "input"),
    ("constants", "constant"),
    ("parameters", "parameter"),
    ("states", "state"),
    ("equations", "equation"),
    ("outputs", "output"),
];

fn parsed(name: &str) -> (Table, &'static str) {
    let (_, text) = EMBEDDED.iter().find(|(n, _)| *n == name).expect("an embedded fragment");
    (text.parse().expect("TOML"), text)
}

fn section<'a>(table: &'a Table, name: &str) -> impl Iterator<Item = (&'a String, &'a Value)> {
    table.get(name).and_then(Value::as_table).into_iter().flatten()
}

fn uses(table: &Table) -> Vec<String> {
    let names = table.get("use").and_then(Value::as_array).into_iter().flatten();
    names.filter_map(Value::as_str).map(str::to_string).collect()
}

/// Every name that a fragment and those it uses declare.
fn declared(table: &Table) -> BTreeSet<String> {
    let own =
        SECTIONS.iter().flat_map(|(name, _)| section(table, name)).map(|(name, _)| name.clone());
    let tables = section(table, "tables").map(|(name, _)| name.clone());
    let used = uses(table).into_iter().flat_map(|name| declared(&parsed(&name).0));
    own.chain(tables).chain(used).collect()
}

/// The names in an expression.
fn names(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_' && c != '.')
        .filter(|word| word.starts_with(char::is_alphabetic))
}

/// What a fragment reads and nobody in it declares: the model has it.
fn asked(table: &Table) -> BTreeSet<String> {
    let known = declared(table);
    let expressions =
        ["equations", "states", "outputs"].into_iter().flat_map(|s| section(table, s));
    let texts = expressions.flat_map(|(_, value)| match value {
        Value::String(text) => vec![text.as_str()],
        Value::Table(all) => all
            .iter()
            .filter(|(key, _)| *key != "unit" && *key != "doc")
            .filter_map(|(_, v)| v.as_str())
            .collect(),
        _ => Vec::new(),
    });
    let all = texts.flat_map(names).filter(|n| !is_reserved(n) && *n != "measured");
    all.filter(|n| !known.contains(*n)).map(str::to_string).collect()
}

/// The comments at the head of a file, as paragraphs.
fn said(text: &str) -> String {
    let head = text.lines().take_while(|line| !line.starts_with('['));
    let comments: Vec<&str> =
        head.filter_map(|line| line.strip_prefix('#')).map(str::trim).collect();
    comments.join("\n")
}

fn row(kind: &str, name: &str, value: &Value) -> String {
    let field = |key: &str| {
        value.get(key).map(|v| v.as_str().map_or_else(|| v.to_string(), str::to_string))
    };
    let unit = if kind == "equation" {
        String::new()
    } else {
        field("unit").or_else(|| value.as_str().map(str::to_string)).unwrap_or_default()
    };
    let is = match kind {
        "equation" | "output" => {
            value.as_str().map(str::to_string).or_else(|| field("value")).map(|t| format!("`{t}`"))
        }
        "state" => field("rate").map(|rate| format!("rate `{rate}`")),
        "parameter" => field("start").map(|start| format!("start {start}")),
        _ => field("value"),
    };
    format!(
        "| `{name}` | {kind} | {unit} | {} | {} |\n",
        is.unwrap_or_default(),
        field("doc").unwrap_or_default()
    )
}

fn of(name: &str) -> String {
    let (table, text) = parsed(name);
    let head = |key: &str| table.get(key).and_then(Value::as_str).unwrap_or_default();
    let mut page = format!(
        "## `{name}`\n\n{}. Source: {}.\n\n{}\n\n",
        head("title"),
        head("source").trim_end_matches('.'),
        said(text)
    );
    let list = |all: &[String]| all.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    let (used, asked) = (uses(&table), asked(&table).into_iter().collect::<Vec<_>>());
    if !used.is_empty() {
        page += &format!("Uses: {}.\n\n", list(&used));
    }
    if !asked.is_empty() {
        page += &format!("The model has to have: {}.\n\n", list(&asked));
    }
    let rows: String = SECTIONS
        .iter()
        .flat_map(|(of, kind)| section(&table, of).map(|(name, value)| row(kind, name, value)))
        .collect();
    if !rows.is_empty() {
        page += &format!("| name | is | unit | value | meaning |\n|---|---|---|---|---|\n{rows}\n");
    }
    page
}

#[test]
fn fragments_page_is_that_of_the_files() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/fragments.md");
    let text = std::fs::read_to_string(&path).expect("docs/fragments.md");
    let (head, _) = text.split_once(START).expect("the page's marker");
    let all: String = EMBEDDED.iter().map(|(name, _)| of(name)).collect();
    let wanted = format!("{head}{START}\n{}\n", all.trim_end());
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, &wanted).expect("written");
    } else {
        assert!(
            text == wanted,
            "docs/fragments.md is behind: UPDATE_DOCS=1 cargo test --release fragments_page"
        );
    }
}
