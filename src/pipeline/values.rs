//! Two values of a setting come in; where they differ, and what each says there, goes out.

use serde_json::Value;

/// Characters of a value that changed which are shown.
const SHOWN: usize = 400;

/// A place inside a setting at which two of its values differ.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// `.text`, `[2].unit`; empty for the whole value.
    pub at: String,
    /// None where there was nothing.
    pub old: Option<Value>,
    /// None where there is nothing now.
    pub new: Option<Value>,
}

/// Where two values differ, as deep inside as both have the same parts.
pub fn changes(old: Option<&Value>, new: Option<&Value>) -> Vec<Change> {
    let mut all = Vec::new();
    compare("", old, new, &mut all);
    all
}

fn compare(at: &str, old: Option<&Value>, new: Option<&Value>, all: &mut Vec<Change>) {
    match (old, new) {
        (old, new) if old == new => {}
        (Some(Value::Object(a)), Some(Value::Object(b))) => {
            let more = b.keys().filter(|key| !a.contains_key(*key));
            for key in a.keys().chain(more) {
                compare(&format!("{at}.{key}"), a.get(key), b.get(key), all);
            }
        }
        (Some(Value::Array(a)), Some(Value::Array(b))) if a.len() == b.len() => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{at}[{i}]"), Some(a), Some(b), all);
            }
        }
        (Some(Value::Array(a)), Some(Value::Array(b))) => unlike(at, a, b, all),
        (Some(Value::String(a)), Some(Value::String(b))) if a.contains('\n') => {
            let lines = |text: &String| text.lines().map(Value::from).collect::<Vec<_>>();
            let before = all.len();
            unlike(at, &lines(a), &lines(b), all);
            pair(all, before);
        }
        (old, new) => {
            all.push(Change { at: at.to_string(), old: old.cloned(), new: new.cloned() });
        }
    }
}

/// The items (of a list) or lines (of a text) that are in one alone; all of both where only their
/// order differs.
fn unlike(at: &str, a: &[Value], b: &[Value], all: &mut Vec<Change>) {
    let change = |old: Option<&Value>, new: Option<&Value>| Change {
        at: at.to_string(),
        old: old.cloned(),
        new: new.cloned(),
    };
    let only = |of: &[Value], other: &[Value]| -> Vec<Value> {
        let mut left = other.to_vec();
        let is_new = |item: &&Value| match left.iter().position(|known| known == *item) {
            Some(i) => {
                left.swap_remove(i);
                false
            }
            None => true,
        };
        of.iter().filter(is_new).cloned().collect()
    };
    let before = all.len();
    all.extend(only(a, b).iter().map(|item| change(Some(item), None)));
    all.extend(only(b, a).iter().map(|item| change(None, Some(item))));
    if all.len() == before {
        all.push(change(Some(&a.into()), Some(&b.into())));
    }
}

/// Makes one change of a line that is gone and one that is new where both say what the same name is.
fn pair(all: &mut Vec<Change>, from: usize) {
    let name = |line: &Option<Value>| {
        let (name, _) = line.as_ref()?.as_str()?.split_once('=')?;
        Some(name.trim().to_string())
    };
    let mut rest = all.split_off(from);
    while !rest.is_empty() {
        let mut change = rest.remove(0);
        let same = |other: &Change| other.old.is_none() && name(&other.new) == name(&change.old);
        if change.new.is_none()
            && name(&change.old).is_some()
            && let Some(i) = rest.iter().position(same)
        {
            change.new = rest.remove(i).new;
        }
        all.push(change);
    }
}

impl std::fmt::Display for Change {
    /// `.start: 0.3 -> 0.31`
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}: ", self.at)?;
        match (&self.old, &self.new) {
            (Some(old), Some(new)) => {
                let [old, new] = apart(&old.to_string(), &new.to_string());
                write!(f, "{old} -> {new}")
            }
            (Some(old), None) => write!(f, "was there and is not now: {}", shown(old, SHOWN)),
            (None, Some(new)) => write!(f, "is new: {}", shown(new, SHOWN)),
            (None, None) => Ok(()),
        }
    }
}

/// Characters that two long values have in common which are shown before they differ.
const COMMON: usize = 80;

/// Two values that differ, on one line each: where they are long, from a little before the place at which they
/// differ.
fn apart(old: &str, new: &str) -> [String; 2] {
    let common = old.chars().zip(new.chars()).take_while(|(a, b)| a == b).count();
    let long = [old, new].iter().any(|text| text.chars().count() > SHOWN);
    let from = if long { common.saturating_sub(COMMON) } else { 0 };
    [old, new].map(|text| {
        let before = if from > 0 { "... " } else { "" };
        let behind = if text.chars().count() > from + SHOWN { " ..." } else { "" };
        let shown: String = text.chars().skip(from).take(SHOWN).collect();
        format!("{before}{shown}{behind}")
    })
}

/// A value on one line of at most so many characters.
pub fn shown(value: &Value, most: usize) -> String {
    let text = value.to_string();
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{} ...", text.get(..end).unwrap_or_default()),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn words(old: Value, new: Value) -> Vec<String> {
        changes(Some(&old), Some(&new)).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn only_what_differs_is_told_with_both_values() {
        assert!(words(json!({ "a": [1, 2] }), json!({ "a": [1, 2] })).is_empty());
        assert_eq!(
            words(json!({ "a": [1, 2], "b": 1 }), json!({ "a": [1, 3], "c": "x" })),
            [".a[1]: 2 -> 3", ".b: was there and is not now: 1", ".c: is new: \"x\"",]
        );
        assert_eq!(words(json!([1, 2]), json!([2])), [": was there and is not now: 1"]);
        assert_eq!(words(json!(0.3), json!(0.31)), [": 0.3 -> 0.31"]);
    }

    #[test]
    fn long_values_are_told_from_where_they_differ() {
        let of = |end: &str| json!(format!("{}{end}", "x".repeat(1000)));
        let [line] = &words(of("share: 0.1"), of("share: 0.02"))[..] else { panic!("one line") };
        assert!(line.contains("xshare: 0.1\" -> ... xx"), "{line}");
        assert!(line.ends_with("xshare: 0.02\"") && line.len() < 250, "{line}");
    }

    #[test]
    fn of_a_text_the_lines_are_told() {
        assert_eq!(
            words(json!({ "text": "a\nb\nc" }), json!({ "text": "a\nB\nc\nb2" })),
            [
                ".text: was there and is not now: \"b\"",
                ".text: is new: \"B\"",
                ".text: is new: \"b2\"",
            ]
        );
        assert_eq!(words(json!("T = 1\nb"), json!("b\nT = 2")), [": \"T = 1\" -> \"T = 2\""]);
        assert_eq!(words(json!("a\nb"), json!("b\na")), [": [\"a\",\"b\"] -> [\"b\",\"a\"]"]);
    }
}
