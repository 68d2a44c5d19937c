//! Text with `{placeholders}` in; the names in it, or the text with what they stand for, out.

/// The names between braces, in order.
pub fn placeholders(text: &str) -> Vec<String> {
    pieces(text).filter_map(|p| p.1).map(str::to_string).collect()
}

/// The text with every placeholder replaced; one that `of` does not know stays as it is.
pub fn fill(text: &str, of: impl Fn(&str) -> Option<String>) -> String {
    let mut out = String::new();
    for (plain, name) in pieces(text) {
        out += plain;
        if let Some(name) = name {
            out += &of(name).unwrap_or_else(|| format!("{{{name}}}"));
        }
    }
    out
}

/// Plain text and the placeholder behind it, if any.
fn pieces(text: &str) -> impl Iterator<Item = (&str, Option<&str>)> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let now = rest.take()?;
        let found = now.find('{').and_then(|open| Some((open, open + now[open..].find('}')?)));
        let Some((open, close)) = found else { return Some((now, None)) };
        rest = Some(&now[close + 1..]);
        Some((&now[..open], Some(&now[open + 1..close])))
    })
}

/// A unit as a factor of another: `-` is 1, sums of factors are put in parentheses.
pub fn unit_factor(unit: &str) -> String {
    match unit {
        "-" => "1".to_string(),
        unit if unit.contains([' ', '/', '^']) => format!("({unit})"),
        unit => unit.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_filled() {
        assert_eq!(placeholders("{a}*x + {b.left}"), ["a", "b.left"]);
        assert_eq!(fill("{a}*x + {b}", |k| (k == "a").then(|| "C".into())), "C*x + {b}");
        assert_eq!(fill("open { brace", |_| None), "open { brace");
        assert_eq!(
            [unit_factor("-"), unit_factor("rad"), unit_factor("m/s")],
            ["1", "rad", "(m/s)"]
        );
    }
}
