//! A `ros2idl` definition (IDL as ROS 2 makes it: modules, structures, annotations) in; the types it
//! declares out.

use super::types::{Declared, Number, Written, WrittenMember};
use std::collections::BTreeMap;

/// The types of a definition, by `package::msg::Type`.
///
/// # Errors
/// In words: what is no IDL, and where.
pub(super) fn parse(text: &str) -> Result<BTreeMap<String, Declared>, String> {
    let words = words(text)?;
    let mut parser = Parser { words: &words, at: 0, scope: Vec::new(), declared: BTreeMap::new() };
    while parser.at < parser.words.len() {
        parser.definition()?;
    }
    Ok(parser.declared)
}

/// Names (with their `::`), numbers, texts (with their quotation mark in front) and single signs.
fn words(text: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let separator = |line: &str| {
        let line = line.trim();
        line.starts_with('#') || line.starts_with("==") || line.starts_with("IDL:")
    };
    // Lines of the preprocessor and those between two files say nothing about types.
    let kept: Vec<&str> = text.lines().map(|l| if separator(l) { "" } else { l }).collect();
    let kept = kept.join("\n");
    let mut rest = kept.trim_start();
    while let Some(first) = rest.chars().next() {
        let end = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").ok_or("a comment of the schema does not end")? + 2
        } else if first == '"' {
            text_end(rest).ok_or("a text of the schema does not end")?
        } else if in_word(first) {
            word_end(rest)
        } else {
            first.len_utf8()
        };
        let (word, tail) = rest.split_at(end);
        if !word.starts_with("//") && !word.starts_with("/*") {
            words.push(if first == '"' { unquoted(word) } else { word.to_string() });
        }
        rest = tail.trim_start();
    }
    Ok(words)
}

fn in_word(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '_' | '.')
}

fn word_end(text: &str) -> usize {
    let mut end = 0;
    while let Some(c) = text.get(end..).and_then(|t| t.chars().next()) {
        if in_word(c) {
            end += c.len_utf8();
        } else if text[end..].starts_with("::") {
            end += 2;
        } else {
            break;
        }
    }
    end
}

/// Where the text that begins with the first quotation mark ends.
fn text_end(text: &str) -> Option<usize> {
    let mut escaped = false;
    for (i, c) in text.char_indices().skip(1) {
        if c == '"' && !escaped {
            return Some(i + 1);
        }
        escaped = c == '\\' && !escaped;
    }
    None
}

fn unquoted(word: &str) -> String {
    let inner = word.strip_prefix('"').and_then(|w| w.strip_suffix('"')).unwrap_or(word);
    let inner = inner.replace("\\n", " ").replace("\\\"", "\"");
    format!("\"{inner}")
}

#[derive(Default)]
struct Notes {
    unit: String,
    doc: String,
}

struct Parser<'a> {
    words: &'a [String],
    at: usize,
    scope: Vec<String>,
    declared: BTreeMap<String, Declared>,
}

impl Parser<'_> {
    fn peek(&self) -> &str {
        self.words.get(self.at).map_or("", String::as_str)
    }

    fn next(&mut self) -> String {
        let word = self.peek().to_string();
        self.at += 1;
        word
    }

    fn takes(&mut self, word: &str) -> bool {
        let there = self.peek() == word;
        self.at += usize::from(there);
        there
    }

    fn expect(&mut self, word: &str) -> Result<(), String> {
        if self.takes(word) {
            return Ok(());
        }
        let there = if self.peek().is_empty() { "its end" } else { self.peek() };
        Err(format!("\"{word}\" is wanted in the schema, there is {there:.80?}"))
    }

    fn full(&self, name: &str) -> String {
        self.scope.iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join("::")
    }

    fn definition(&mut self) -> Result<(), String> {
        self.annotations();
        match self.next().as_str() {
            "module" => {
                let name = self.next();
                self.scope.push(name);
                if self.scope.len() > 16 {
                    return Err("the modules of the schema are nested too deep".into());
                }
                self.expect("{")?;
                while !self.takes("}") {
                    if self.at >= self.words.len() {
                        return Err("a module of the schema does not end".into());
                    }
                    self.definition()?;
                }
                self.scope.pop();
                self.takes(";");
                Ok(())
            }
            "struct" => self.structure(),
            "typedef" => {
                let kind = self.kind(0)?;
                self.declarators(&kind, |parser, name, kind| {
                    parser.declared.insert(parser.full(&name), Declared::Alias(kind));
                })
            }
            "enum" => {
                let name = self.full(self.peek());
                self.declared.insert(name, Declared::Alias(Written::Number(Number::U32)));
                self.skip_statement();
                Ok(())
            }
            "union" | "bitmask" | "bitset" => {
                let name = self.full(self.peek());
                self.declared.insert(name, Declared::Alias(Written::Opaque));
                self.skip_statement();
                Ok(())
            }
            "const" => {
                self.skip_statement();
                Ok(())
            }
            ";" => Ok(()),
            other => Err(format!("{other:.80?} in the schema is no definition")),
        }
    }

    fn structure(&mut self) -> Result<(), String> {
        let name = self.next();
        let name = self.full(&name);
        if self.takes(";") {
            return Ok(());
        }
        let mut members = Vec::new();
        self.expect("{")?;
        while !self.takes("}") {
            let notes = self.annotations();
            if self.takes("}") {
                break;
            }
            let kind = self.kind(0)?;
            self.declarators(&kind, |_, name, kind| {
                let (unit, doc) = (notes.unit.clone(), notes.doc.clone());
                members.push(WrittenMember { name, kind, unit, doc });
            })?;
        }
        self.takes(";");
        // How ROS 2 spells a message without fields.
        members.retain(|m| m.name != "structure_needs_at_least_one_member");
        self.declared.insert(name, Declared::Struct(members));
        Ok(())
    }

    /// Names, each perhaps with lengths, up to the semicolon.
    fn declarators(
        &mut self,
        kind: &Written,
        mut each: impl FnMut(&mut Self, String, Written),
    ) -> Result<(), String> {
        loop {
            let name = self.next();
            if !name.starts_with(in_word) {
                return Err(format!("a name is wanted in the schema, there is {name:.80?}"));
            }
            let mut lengths = Vec::new();
            while self.takes("[") {
                let length = self.next();
                let n = length.parse::<u64>();
                lengths.push(n.map_err(|_| format!("{length:.80?} in the schema is no length"))?);
                self.expect("]")?;
            }
            let wrap = |kind: Written, n: u64| Written::Array(Box::new(kind), n);
            let kind = lengths.into_iter().rev().fold(kind.clone(), wrap);
            each(self, name, kind);
            if !self.takes(",") {
                return self.expect(";");
            }
        }
    }

    /// `@unit(value="m")` and `@verbatim(language="comment", text="...")`; others say nothing here.
    fn annotations(&mut self) -> Notes {
        let mut notes = Notes::default();
        while self.takes("@") {
            let name = self.next();
            let mut depth = 0;
            while self.peek() == "(" || depth > 0 {
                let before = self.at.checked_sub(2).map_or("", |i| self.words[i].as_str());
                let word = self.next();
                match (word.as_str(), word.strip_prefix('"')) {
                    ("(", _) => depth += 1,
                    (")", _) => depth -= 1,
                    ("", _) => break,
                    (_, Some(text)) if name == "unit" => notes.unit = text.into(),
                    (_, Some(text)) if name == "verbatim" && before != "language" => {
                        notes.doc.push_str(text);
                    }
                    _ => {}
                }
                if depth == 0 {
                    break;
                }
            }
        }
        notes.doc = notes.doc.trim().to_string();
        notes
    }

    /// To the semicolon behind what is open.
    fn skip_statement(&mut self) {
        let mut depth = 0;
        loop {
            match self.next().as_str() {
                "{" => depth += 1,
                "}" => depth -= 1,
                ";" if depth <= 0 => return,
                "" => return,
                _ => {}
            }
        }
    }

    fn kind(&mut self, depth: usize) -> Result<Written, String> {
        if depth > 16 {
            return Err("the types of the schema are nested too deep".into());
        }
        let word = self.next();
        let number = match word.as_str() {
            "boolean" => Number::Bool,
            "octet" | "uint8" | "char" => Number::U8,
            "int8" => Number::I8,
            "int16" | "short" => Number::I16,
            "uint16" => Number::U16,
            "int32" => Number::I32,
            "uint32" => Number::U32,
            "int64" => Number::I64,
            "uint64" => Number::U64,
            "float" => Number::F32,
            "double" => Number::F64,
            "long" if self.takes("long") => Number::I64,
            "long" if self.takes("double") => return Ok(Written::Opaque),
            "long" => Number::I32,
            "unsigned" if self.takes("short") => Number::U16,
            "unsigned" => {
                self.expect("long")?;
                if self.takes("long") { Number::U64 } else { Number::U32 }
            }
            "string" => {
                self.bound()?;
                return Ok(Written::Text);
            }
            "wstring" | "wchar" | "map" | "any" | "fixed" => {
                self.bound()?;
                return Ok(Written::Opaque);
            }
            "sequence" => {
                self.expect("<")?;
                let item = self.kind(depth + 1)?;
                if self.takes(",") {
                    self.at += 1;
                }
                self.expect(">")?;
                return Ok(Written::Sequence(Box::new(item)));
            }
            name if name.starts_with(in_word) || name.starts_with(':') => {
                return Ok(Written::Named(self.candidates(name)));
            }
            other => return Err(format!("a type is wanted in the schema, there is {other:.80?}")),
        };
        Ok(Written::Number(number))
    }

    /// What may stand between `<` and `>` behind a type.
    fn bound(&mut self) -> Result<(), String> {
        if self.takes("<") {
            while !self.takes(">") {
                if self.next().is_empty() {
                    return Err("a type of the schema does not end".into());
                }
            }
        }
        Ok(())
    }

    /// The full names that a name may stand for, from the innermost module outwards.
    fn candidates(&self, name: &str) -> Vec<String> {
        if let Some(full) = name.strip_prefix("::") {
            return vec![full.to_string()];
        }
        let within = |n: usize| {
            self.scope[..n].iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join("::")
        };
        (0..=self.scope.len()).rev().map(within).collect()
    }
}
