//! A value as it stands in the text, and the JSON types that were wanted, come in; the same value in
//! a form that is wanted, out.

/// The value `raw` (`"50"`, `50`, `true`) as one of the JSON types `wanted` where that is what a
/// person may have meant: a number in quotes, one item of a list.
pub fn as_wanted(raw: &str, wanted: &[&str]) -> Option<String> {
    let bare = raw.trim_matches(['"', '\'']);
    let quoted = bare.len() < raw.len();
    let plain = !raw.starts_with(['[', '{']);
    let is_number = bare.parse::<f64>().is_ok_and(f64::is_finite);
    wanted.iter().find_map(|kind| match *kind {
        "number" if quoted && is_number => Some(bare.to_string()),
        "integer" if quoted && bare.parse::<i64>().is_ok() => Some(bare.to_string()),
        "boolean" if quoted && ["true", "false"].contains(&bare) => Some(bare.to_string()),
        "array" if plain => Some(format!("[{raw}]")),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_in_another_form_is_read_as_it_was_meant() {
        for (raw, wanted, meant) in [
            ("\"50\"", "number", Some("50")),
            ("'0.5'", "number", Some("0.5")),
            ("\"fast\"", "number", None),
            ("\"1.5\"", "integer", None),
            ("\"3\"", "integer", Some("3")),
            ("\"true\"", "boolean", Some("true")),
            // No name is a number.
            ("1", "string", None),
            ("\"a\"", "array", Some("[\"a\"]")),
            ("{ a = 1 }", "array", None),
        ] {
            assert_eq!(as_wanted(raw, &[wanted]).as_deref(), meant, "{raw} as {wanted}");
        }
    }
}
