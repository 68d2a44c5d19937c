//! A `ros2msg` definition (a `.msg` file, and behind lines of `=` those it names) in; the types it
//! declares out.

use super::types::{Declared, Number, Written, WrittenMember};
use std::collections::BTreeMap;

/// The types of a definition, by `package/Type`. `name` is that of the first one.
///
/// # Errors
/// In words: a line that is no field.
pub(super) fn parse(text: &str, name: &str) -> Result<BTreeMap<String, Declared>, String> {
    let mut declared = standard();
    let mut name = short(name);
    let mut lines: Vec<&str> = Vec::new();
    let mut behind_separator = false;
    for line in text.lines() {
        let bare = line.trim();
        if bare.len() >= 3 && bare.bytes().all(|b| b == b'=') {
            close(&mut declared, &name, &mut lines)?;
            behind_separator = true;
        } else if let (true, Some(next)) = (behind_separator, bare.strip_prefix("MSG:")) {
            name = short(next.trim());
            behind_separator = false;
        } else {
            lines.push(bare);
        }
    }
    close(&mut declared, &name, &mut lines)?;
    Ok(declared)
}

/// `package/msg/Type` and `package/Type` are the same.
pub(super) fn short(name: &str) -> String {
    match (name.split('/').next(), name.rsplit('/').next()) {
        (Some(package), Some(last)) if package != last => format!("{package}/{last}"),
        _ => name.to_string(),
    }
}

/// Types that a definition need not repeat.
fn standard() -> BTreeMap<String, Declared> {
    let field = |name: &str, number: Number| WrittenMember {
        name: name.into(),
        kind: Written::Number(number),
        unit: String::new(),
        doc: String::new(),
    };
    let stamp = Declared::Struct(vec![field("sec", Number::I32), field("nanosec", Number::U32)]);
    let names = ["builtin_interfaces/Time", "builtin_interfaces/Duration"];
    names.into_iter().map(|name| (name.to_string(), stamp.clone())).collect()
}

fn close(
    declared: &mut BTreeMap<String, Declared>,
    name: &str,
    lines: &mut Vec<&str>,
) -> Result<(), String> {
    let package = name.split('/').next().unwrap_or_default();
    let mut members = Vec::new();
    let mut above: Vec<&str> = Vec::new();
    for line in std::mem::take(lines) {
        if let Some(comment) = line.strip_prefix('#') {
            above.push(comment.trim());
            continue;
        }
        if let Some(mut member) = field(line, package).map_err(|e| format!("{name}: {e}"))? {
            if member.doc.is_empty() {
                member.doc = above.join(" ").trim().to_string();
            }
            members.push(member);
        }
        above.clear();
    }
    declared.insert(name.to_string(), Declared::Struct(members));
    Ok(())
}

/// The field of a line: `type name`, perhaps with a default; none on an empty line and on that of a
/// constant (`type NAME=value`).
fn field(line: &str, package: &str) -> Result<Option<WrittenMember>, String> {
    let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
        return if line.is_empty() { Ok(None) } else { Err(no_field(line)) };
    };
    let rest = rest.trim_start();
    let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
    let (name, rest) = rest.split_at(end);
    if name.is_empty() {
        return Err(no_field(line));
    }
    if rest.trim_start().starts_with('=') {
        return Ok(None);
    }
    let doc = rest.split_once('#').map_or("", |(_, comment)| comment.trim());
    let kind = written(kind, package).ok_or_else(|| no_field(line))?;
    Ok(Some(WrittenMember { name: name.into(), kind, unit: String::new(), doc: doc.into() }))
}

fn no_field(line: &str) -> String {
    format!("the line {line:.80?} of the schema is no field")
}

/// A type: `float64`, `string<=10`, `geometry_msgs/Point`, each perhaps with `[]`, `[9]`, `[<=9]`.
fn written(kind: &str, package: &str) -> Option<Written> {
    let Some((item, length)) = kind.strip_suffix(']').and_then(|k| k.rsplit_once('[')) else {
        return Some(single(kind, package));
    };
    let item = Box::new(single(item, package));
    let bound = |digits: &str| digits.parse::<u64>().ok();
    match length.strip_prefix("<=") {
        _ if length.is_empty() => Some(Written::Sequence(item)),
        Some(most) => bound(most).map(|_| Written::Sequence(item)),
        None => bound(length).map(|n| Written::Array(item, n)),
    }
}

fn single(name: &str, package: &str) -> Written {
    let number = match name.split_once("<=").map_or(name, |(bare, _)| bare) {
        "bool" => Number::Bool,
        "byte" | "char" | "uint8" => Number::U8,
        "int8" => Number::I8,
        "uint16" => Number::U16,
        "int16" => Number::I16,
        "uint32" => Number::U32,
        "int32" => Number::I32,
        "uint64" => Number::U64,
        "int64" => Number::I64,
        "float32" => Number::F32,
        "float64" => Number::F64,
        "string" => return Written::Text,
        // Writers do not agree on how wide its letters are.
        "wstring" => return Written::Opaque,
        "time" => return Written::Named(vec!["builtin_interfaces/Time".into()]),
        "duration" => return Written::Named(vec!["builtin_interfaces/Duration".into()]),
        "Header" => {
            return Written::Named(vec![format!("{package}/Header"), "std_msgs/Header".into()]);
        }
        other if other.contains('/') => return Written::Named(vec![short(other)]),
        other => return Written::Named(vec![format!("{package}/{other}")]),
    };
    Written::Number(number)
}
