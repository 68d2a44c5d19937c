//! Words in; the nearest known word and readable lists of words out.

/// The known word that `word` is most likely a misspelling of, if any is near enough.
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = word.to_lowercase();
    let limit = 1 + word.chars().count() / 4;
    known
        .into_iter()
        .map(|k| (strsim::damerau_levenshtein(&lower, &k.to_lowercase()), k))
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, k)| k)
}

/// `a, b, c`, cut off after 20 with the number of the rest.
pub fn list<S: AsRef<str>>(words: &[S]) -> String {
    const SHOWN: usize = 20;
    let mut text = words.iter().take(SHOWN).map(|w| w.as_ref()).collect::<Vec<_>>().join(", ");
    if words.len() > SHOWN {
        text += &format!(" and {} more", words.len() - SHOWN);
    }
    text
}

/// `"a", "b"`: [`list`] with every word in quotes.
pub fn quoted<S: AsRef<str>>(words: &[S]) -> String {
    list(&words.iter().map(|w| format!("\"{}\"", w.as_ref())).collect::<Vec<_>>())
}

/// What to do about an unknown `word` where `known` ones are allowed:
/// `did you mean "level"? The keys here are: ...`.
pub(super) fn suggestion(word: &str, known: &[&str], all: &str) -> String {
    let listed =
        if known.is_empty() { format!("{all}: none") } else { format!("{all}: {}", list(known)) };
    match nearest(word, known.iter().copied()) {
        Some(k) => format!("did you mean \"{k}\"? {listed}"),
        None => listed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_word_is_found_only_when_near() {
        assert_eq!(nearest("chanel", ["level", "channel"]), Some("channel"));
        assert_eq!(nearest("Channel", ["level", "channel"]), Some("channel"));
        assert_eq!(nearest("rho", ["level", "channel"]), None);
    }

    #[test]
    fn long_lists_are_cut_with_a_count() {
        let words: Vec<String> = (0..23).map(|i| i.to_string()).collect();
        assert!(list(&words).ends_with("18, 19 and 3 more"));
        assert_eq!(quoted(&["a", "b"]), "\"a\", \"b\"");
    }
}
