//! Paths of fields (`pose.position.x`, `states.0.value`) in; what of them lies below a field or an
//! item of a list out.

/// Below a field that is a number: what a whole number is above the nearest `f64`, which is the field's own
/// value. Whole ns since 1970 are rounded to 256 by themselves. Nothing is there where the number is none that
/// is rounded.
const REST: &str = "\u{1}rest";

/// The path of what the number at `path` is above its nearest `f64`.
pub fn rest_of(path: &str) -> String {
    joined(path, REST)
}

/// What a whole number is above its nearest `f64`: not above 512 where it has 64 bits, and so exact.
pub(super) fn rest(whole: i128) -> f64 {
    (whole - whole as f64 as i128) as f64
}

/// A path that is wanted (what is left of it) and the slot that its number goes to.
pub(super) type Wanted<'a> = (&'a [&'a str], usize);

/// The names on each path.
pub(super) fn split(paths: &[String]) -> Vec<Vec<&str>> {
    paths.iter().map(|path| path.split('.').collect()).collect()
}

/// The paths with the slots that they have from the start: their own places.
pub(super) fn all<'a>(split: &'a [Vec<&'a str>]) -> Vec<Wanted<'a>> {
    split.iter().enumerate().map(|(slot, names)| (&names[..], slot)).collect()
}

/// The wanted paths that begin with a name, without it.
pub(super) fn below<'a>(wanted: &[Wanted<'a>], name: &str) -> Vec<Wanted<'a>> {
    let under = |w: &Wanted<'a>| {
        let (head, tail) = w.0.split_first()?;
        (*head == name).then_some((tail, w.1))
    };
    wanted.iter().filter_map(under).collect()
}

/// The slot of the number that a path ends at.
pub(super) fn here(wanted: &[Wanted]) -> Option<usize> {
    wanted.iter().find(|w| w.0.is_empty()).map(|w| w.1)
}

/// The slot of what the number that a path ends at is above its nearest `f64`.
pub(super) fn rest_here(wanted: &[Wanted]) -> Option<usize> {
    wanted.iter().find(|w| *w.0 == [REST]).map(|w| w.1)
}

/// What is wanted of a list of numbers: slots by place in the list, ascending.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    pub at: Vec<(usize, usize)>,
    /// Of what a number is above its nearest `f64`.
    pub above: Vec<(usize, usize)>,
}

/// The wanted numbers of a list.
pub(super) fn numbers(wanted: &[Wanted]) -> Numbers {
    let mut numbers = Numbers::default();
    for (place, below) in items(wanted) {
        numbers.at.extend(here(&below).map(|slot| (place, slot)));
        numbers.above.extend(rest_here(&below).map(|slot| (place, slot)));
    }
    numbers
}

/// What is wanted of the items of a list, by place in the list, ascending.
pub(super) fn items<'a>(wanted: &[Wanted<'a>]) -> Vec<(usize, Vec<Wanted<'a>>)> {
    let head = |w: &Wanted<'a>| w.0.first().and_then(|h| Some((place(h)?, *h)));
    let mut heads: Vec<_> = wanted.iter().filter_map(head).collect();
    heads.sort_unstable();
    heads.dedup();
    heads.into_iter().map(|(place, head)| (place, below(wanted, head))).collect()
}

/// A place in a list, written as it is written everywhere: `03` is none.
fn place(text: &str) -> Option<usize> {
    text.parse::<usize>().ok().filter(|n| n.to_string() == text)
}

/// The path of a field, or of an item of a list.
pub(super) fn joined(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_string() } else { format!("{path}.{name}") }
}
