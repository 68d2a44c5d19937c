//! A message in; its layout, with which messages like it are read, and its scalars out.

use super::super::encoding::{UNREADABLE, finite};
use super::super::paths;
use std::collections::BTreeMap;

/// Messages nested deeper than this are not read.
pub const DEEPEST: usize = 64;

/// The text of a message with its scalars taken out.
pub struct Layout {
    /// Text before each scalar, and which path (if any) the scalar belongs to.
    slots: Vec<(Vec<u8>, Option<Slot>)>,
    tail: Vec<u8>,
}

/// Where a number goes, and what a whole one is above it.
struct Slot {
    number: usize,
    rest: Option<usize>,
}

impl Layout {
    pub fn learn(message: &[u8], paths: &[String]) -> Option<Layout> {
        let mut slots = Vec::new();
        let mut at = 0;
        // looked up, not searched: a message may have as many scalars as paths are wanted of it
        let places: BTreeMap<&str, usize> =
            paths.iter().enumerate().rev().map(|(place, path)| (path.as_str(), place)).collect();
        let of = |path: &str| {
            let number = *places.get(path)?;
            let rest = places.get(paths::rest_of(path).as_str()).copied();
            Some(Slot { number, rest })
        };
        scan(message, usize::MAX, &mut |path, start, end| {
            slots.push((message[at..start].to_vec(), of(path)));
            at = end;
        })?;
        Some(Layout { slots, tail: message[at..].to_vec() })
    }

    /// False where the message is laid out differently; `out` is then undefined.
    pub fn read(&self, message: &[u8], out: &mut [f64]) -> bool {
        out.fill(UNREADABLE);
        let mut rest = message;
        for (text, wanted) in &self.slots {
            let Some(after) = rest.strip_prefix(text.as_slice()) else { return false };
            rest = match wanted.as_ref().filter(|slot| slot.number < out.len()) {
                Some(slot) => match number(after) {
                    Some((x, tail)) => {
                        out[slot.number] = x;
                        if let Some(above) = slot.rest.and_then(|rest| out.get_mut(rest)) {
                            *above = whole(after).map_or(UNREADABLE, paths::rest);
                        }
                        tail
                    }
                    None => match skip_scalar(after) {
                        Some(tail) => tail,
                        None => return false,
                    },
                },
                None => match skip_scalar(after) {
                    Some(tail) => tail,
                    None => return false,
                },
            };
        }
        rest == self.tail.as_slice()
    }
}

/// The number at the start of `text` and what follows it. Numbers in quotes, booleans (0, 1), null
/// and NaN count as numbers.
pub fn number(text: &[u8]) -> Option<(f64, &[u8])> {
    match text.first()? {
        b'"' => {
            let end = 1 + text.get(1..)?.iter().position(|&b| b == b'"')?;
            let inner = text[1..end].trim_ascii();
            Some((quoted(inner)?, &text[end + 1..]))
        }
        b'n' if text.starts_with(b"null") => Some((f64::NAN, &text[4..])),
        b't' if text.starts_with(b"true") => Some((1.0, &text[4..])),
        b'f' if text.starts_with(b"false") => Some((0.0, &text[5..])),
        _ => {
            let (x, n) = fast_float2::parse_partial::<f64, _>(text).ok()?;
            Some((finite(x), text.get(n..)?))
        }
    }
}

/// The whole number at the start of `text`, in quotes or not; none where it has a point or an exponent.
fn whole(text: &[u8]) -> Option<i128> {
    let text = text.strip_prefix(b"\"").map_or(text, <[u8]>::trim_ascii_start);
    let sign = usize::from(text.first() == Some(&b'-'));
    let digits = text.iter().skip(sign).take_while(|b| b.is_ascii_digit()).count();
    let ends = !matches!(text.get(sign + digits), Some(b'.' | b'e' | b'E'));
    // Of what has more digits than 64 bits nothing is exact.
    let number = text.get(..sign + digits).filter(|_| ends && (1..=19).contains(&digits))?;
    std::str::from_utf8(number).ok()?.parse().ok()
}

fn quoted(inner: &[u8]) -> Option<f64> {
    if inner.is_empty() || inner.eq_ignore_ascii_case(b"null") || inner.eq_ignore_ascii_case(b"n/a")
    {
        return Some(f64::NAN);
    }
    fast_float2::parse::<f64, _>(inner).ok().map(finite)
}

/// What follows the scalar at the start of `text`; `None` where there is none (a list, an object,
/// the end).
fn skip_scalar(text: &[u8]) -> Option<&[u8]> {
    match text.first()? {
        b'"' => {
            let mut i = 1;
            while *text.get(i)? != b'"' {
                i += if text[i] == b'\\' { 2 } else { 1 };
            }
            Some(&text[i + 1..])
        }
        _ => {
            let end = text.iter().position(|&b| !IN_TOKEN[usize::from(b)]).unwrap_or(text.len());
            if end == 0 { None } else { text.get(end..) }
        }
    }
}

/// The bytes that numbers and words (`null`, `-1.5e+3`) are made of.
const IN_TOKEN: [bool; 256] = {
    let mut table = [false; 256];
    let mut b = 0;
    while b < 256 {
        table[b] = (b as u8).is_ascii_alphanumeric() || matches!(b as u8, b'+' | b'-' | b'.');
        b += 1;
    }
    table
};

/// Calls `visit(path, start, end)` for every scalar of a message; `None` where it is no JSON (NaN
/// and Infinity are let through). Items of a list behind the first `named` have `*` for their place.
pub fn scan(message: &[u8], named: usize, visit: &mut dyn FnMut(&str, usize, usize)) -> Option<()> {
    let mut scanner = Scanner { text: message, at: 0, path: String::new(), named, visit };
    scanner.blank();
    scanner.value(0)?;
    scanner.blank();
    (scanner.at == message.len()).then_some(())
}

struct Scanner<'a, 'v> {
    text: &'a [u8],
    at: usize,
    path: String,
    named: usize,
    visit: &'v mut dyn FnMut(&str, usize, usize),
}

impl Scanner<'_, '_> {
    fn peek(&self) -> Option<u8> {
        self.text.get(self.at).copied()
    }

    fn blank(&mut self) {
        while self.peek().is_some_and(|b| b.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    fn expect(&mut self, byte: u8) -> Option<()> {
        self.blank();
        (self.peek()? == byte).then(|| self.at += 1)
    }

    fn value(&mut self, depth: usize) -> Option<()> {
        if depth > DEEPEST {
            return None;
        }
        match self.peek()? {
            b'{' => self.items(b'}', depth, true),
            b'[' => self.items(b']', depth, false),
            _ => {
                let start = self.at;
                self.at = self.text.len() - skip_scalar(&self.text[start..])?.len();
                if !sound_scalar(&self.text[start..self.at]) {
                    return None;
                }
                (self.visit)(&self.path, start, self.at);
                Some(())
            }
        }
    }

    /// The items of an object or a list.
    fn items(&mut self, close: u8, depth: usize, object: bool) -> Option<()> {
        self.at += 1;
        self.blank();
        if self.peek()? == close {
            self.at += 1;
            return Some(());
        }
        let outer = self.path.len();
        for index in 0.. {
            self.blank();
            let name = match object {
                true => self.key()?,
                false if index < self.named => index.to_string(),
                false => "*".to_string(),
            };
            if outer > 0 {
                self.path.push('.');
            }
            self.path.push_str(&name);
            self.blank();
            self.value(depth + 1)?;
            self.path.truncate(outer);
            self.blank();
            match self.peek()? {
                b',' => self.at += 1,
                b if b == close => {
                    self.at += 1;
                    return Some(());
                }
                _ => return None,
            }
        }
        None
    }

    fn key(&mut self) -> Option<String> {
        let start = self.at;
        if self.peek()? != b'"' {
            return None;
        }
        self.at = self.text.len() - skip_scalar(&self.text[start..])?.len();
        let name = serde_json::from_slice::<String>(&self.text[start..self.at]).ok()?;
        self.expect(b':')?;
        Some(name)
    }
}

/// Whether a token is a string, number or word that a message may hold.
fn sound_scalar(token: &[u8]) -> bool {
    match token.first() {
        Some(b'"') => std::str::from_utf8(token).is_ok(),
        _ => {
            matches!(token, b"null" | b"true" | b"false")
                || fast_float2::parse::<f64, _>(token).is_ok()
        }
    }
}
