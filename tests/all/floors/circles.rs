//! Sources as text in; which file imports from which, and the circles among them, out.
//!
//! A path counts for the file that *defines* what it names: `super::{Name}` and
//! `crate::module::Name` are followed through child modules and re-exports. A `mod.rs` that only
//! re-exports its children therefore takes part in no circle; one whose own items its children
//! import, and that calls them, does.

use std::collections::{BTreeMap, BTreeSet};

/// One file as a module.
#[derive(Default)]
struct File {
    /// Path of the module, the crate root being empty.
    module: Vec<String>,
    path: String,
    /// What `use` brings in: the name here and the path it stands for.
    imports: Vec<Import>,
    /// Paths written in the code itself: `gaps::noise(...)`.
    inline: Vec<Vec<String>>,
    /// Items it defines, and all words outside `use`.
    defined: BTreeSet<String>,
    words: BTreeSet<String>,
}

struct Import {
    name: String,
    path: Vec<String>,
    is_public: bool,
}

/// Where a path leads: into a module, or to an item of that file.
enum Landing {
    Module(usize),
    Item(usize),
}

pub struct Imports {
    files: Vec<File>,
    modules: BTreeMap<Vec<String>, usize>,
    edges: Edges,
}

/// Which file imports from which, and what.
type Edges = BTreeMap<(usize, usize), BTreeSet<String>>;

impl Imports {
    /// Of sources (path in `src`, text). Tests may look at anything: their files are left out.
    pub fn read<'a>(sources: impl IntoIterator<Item = (&'a str, &'a str)>) -> Imports {
        let is_test =
            |path: &str| path.ends_with("tests.rs") || path.split('/').any(|part| part == "tests");
        let files: Vec<File> = sources
            .into_iter()
            .filter(|(path, _)| !is_test(path))
            .map(|(path, text)| file(path, text))
            .collect();
        let modules = files.iter().enumerate().map(|(i, file)| (file.module.clone(), i)).collect();
        let imports = Imports { files, modules, edges: Edges::new() };
        Imports { edges: imports.edges(), ..imports }
    }

    /// Groups of files that all reach each other, largest first.
    pub fn circles(&self) -> Vec<Vec<String>> {
        let reached: Vec<BTreeSet<usize>> =
            (0..self.files.len()).map(|from| reach(&self.edges, from)).collect();
        let mut seen = BTreeSet::new();
        let mut circles = Vec::new();
        for from in 0..self.files.len() {
            let circle: Vec<usize> =
                reached[from].iter().copied().filter(|&to| reached[to].contains(&from)).collect();
            if !circle.is_empty() && seen.insert(circle.clone()) {
                let mut paths: Vec<String> =
                    circle.iter().map(|&i| self.files[i].path.clone()).collect();
                paths.sort();
                circles.push(paths);
            }
        }
        circles.sort_by_key(|circle| (usize::MAX - circle.len(), circle.clone()));
        circles
    }

    /// The files that those for which `start` holds lead to, file by file; what `ends` imports is
    /// not followed.
    pub fn reached_from(&self, start: impl Fn(&str) -> bool, ends: &[&str]) -> BTreeSet<String> {
        let path = |i: usize| self.files[i].path.as_str();
        let mut todo: Vec<usize> = (0..self.files.len()).filter(|&i| start(path(i))).collect();
        let mut seen: BTreeSet<usize> = todo.iter().copied().collect();
        while let Some(from) = todo.pop() {
            if ends.contains(&path(from)) {
                continue;
            }
            let next = self.edges.range((from, 0)..(from + 1, 0)).map(|((_, to), _)| *to);
            todo.extend(next.filter(|to| seen.insert(*to)));
        }
        seen.into_iter().map(|i| path(i).to_string()).collect()
    }

    /// The imports inside a circle, one a line: who takes what from whom.
    pub fn inside(&self, circle: &[String]) -> Vec<String> {
        let of = |i: usize| &self.files[i].path;
        let mut lines = Vec::new();
        for ((from, to), names) in &self.edges {
            if circle.contains(of(*from)) && circle.contains(of(*to)) {
                lines.push(format!(
                    "    {} <- {}: {}",
                    of(*from),
                    of(*to),
                    names.iter().cloned().collect::<Vec<_>>().join(", ")
                ));
            }
        }
        lines
    }

    fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        for (at, file) in self.files.iter().enumerate() {
            // A name that is only passed on is no use of it.
            let used = |import: &&Import| !import.is_public || file.words.contains(&import.name);
            for path in
                file.imports.iter().filter(used).map(|import| &import.path).chain(&file.inline)
            {
                for landing in self.landings(at, path, 0) {
                    // An imported module counts by what is taken from it.
                    if let Landing::Item(to) = landing
                        && to != at
                    {
                        edges.entry((at, to)).or_default().insert(path.join("::"));
                    }
                }
            }
        }
        edges
    }

    /// Where a path written in a file leads. More than one place: a module and a function may share
    /// a name.
    fn landings(&self, at: usize, path: &[String], depth: usize) -> Vec<Landing> {
        let mut module = self.files[at].module.clone();
        let mut rest = path;
        while let Some((first, after)) = rest.split_first() {
            match first.as_str() {
                "crate" => module.clear(),
                "self" => {}
                "super" => drop(module.pop()),
                _ => break,
            }
            rest = after;
        }
        let is_bare = rest.len() == path.len();
        match self.modules.get(&module) {
            Some(&start) => self.descend(start, rest, is_bare, depth),
            None => Vec::new(),
        }
    }

    fn descend(&self, at: usize, path: &[String], is_bare: bool, depth: usize) -> Vec<Landing> {
        let Some((first, rest)) = path.split_first() else { return vec![Landing::Module(at)] };
        if first == "*" {
            return vec![Landing::Item(at)];
        }
        let mut found = Vec::new();
        let mut child = self.files[at].module.clone();
        child.push(first.clone());
        if let Some(&child) = self.modules.get(&child) {
            found.extend(self.descend(child, rest, false, depth));
        }
        if self.files[at].defined.contains(first) && (rest.is_empty() || found.is_empty()) {
            found.push(Landing::Item(at));
        }
        // Re-exports of re-exports are short chains; the bound ends what names itself.
        let passed_on = self.files[at].imports.iter().filter(|_| depth < 8);
        for import in passed_on.filter(|import| import.name == *first || import.name == "*") {
            if import.name == "*" {
                let source = import.path.split_last().map_or(&[][..], |(_, source)| source);
                for landing in self.landings(at, source, depth + 1) {
                    let Landing::Module(source) = landing else { continue };
                    if source != at && self.files[source].defined.contains(first) {
                        found.push(Landing::Item(source));
                    }
                }
                continue;
            }
            if is_bare && import.path == path {
                continue;
            }
            for landing in self.landings(at, &import.path, depth + 1) {
                match landing {
                    Landing::Module(module) => {
                        found.extend(self.descend(module, rest, false, depth + 1))
                    }
                    item => found.push(item),
                }
            }
        }
        // A bare name that is neither here nor imported belongs to another crate; else it is an
        // item that the text does not show (a macro's).
        if found.is_empty() && !is_bare {
            found.push(Landing::Item(at));
        }
        found
    }
}

fn reach(edges: &Edges, from: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(at) = open.pop() {
        open.extend(
            edges
                .range((at, 0)..=(at, usize::MAX))
                .map(|((_, to), _)| *to)
                .filter(|to| reached.insert(*to)),
        );
    }
    reached
}

fn file(path: &str, text: &str) -> File {
    let stem = path.trim_end_matches(".rs").trim_end_matches("/mod");
    let module =
        if stem == "lib" { Vec::new() } else { stem.split('/').map(String::from).collect() };
    let mut file = File { module, path: path.to_string(), ..File::default() };
    let tokens = without_tests(tokens(text));
    let mut i = 0;
    while i < tokens.len() {
        let before = i.checked_sub(1).map_or("", |i| tokens[i].as_str());
        let is_path =
            tokens.get(i + 1).is_some_and(|t| t == "::") && !["::", "."].contains(&before);
        if tokens[i] == "use" {
            let mut leaves = Vec::new();
            let is_public = before == "pub" || before == ")";
            i = tree(&tokens, i + 1, &[], &mut leaves);
            file.imports.extend(leaves.into_iter().map(|(name, path)| Import {
                name,
                path,
                is_public,
            }));
        } else if is_word(&tokens[i]) && is_path {
            let mut leaves = Vec::new();
            let end = tree(&tokens, i, &[], &mut leaves);
            file.words.extend(tokens[i..end].iter().cloned());
            file.inline.extend(leaves.into_iter().map(|(_, path)| path));
            i = end.max(i + 1);
        } else {
            if ["fn", "struct", "enum", "trait", "type", "const", "static", "union", "mod"]
                .contains(&before)
                && is_word(&tokens[i])
            {
                // `mod name;` is a file of its own.
                if before != "mod" || tokens.get(i + 1).is_some_and(|t| t == "{") {
                    file.defined.insert(tokens[i].clone());
                }
            }
            if before != "mod" {
                file.words.insert(tokens[i].clone());
            }
            i += 1;
        }
    }
    file
}

/// The paths of a tree `a::{b, c::d as e, *}` with the names they get; returns where it ends.
fn tree(
    tokens: &[String],
    mut i: usize,
    prefix: &[String],
    leaves: &mut Vec<(String, Vec<String>)>,
) -> usize {
    let mut path = prefix.to_vec();
    loop {
        match tokens.get(i).map(String::as_str) {
            Some("{") => {
                i += 1;
                while tokens.get(i).is_some_and(|t| t != "}") {
                    let next = tree(tokens, i, &path, leaves);
                    // What is no path (a block) is stepped over.
                    i = if tokens.get(next).is_some_and(|t| t == ",") || next == i {
                        next + 1
                    } else {
                        next
                    };
                }
                return i + 1;
            }
            Some("*") => {
                path.push("*".into());
                leaves.push(("*".into(), path));
                return i + 1;
            }
            Some(word) if is_word(word) => {
                if word != "self" || path.is_empty() {
                    path.push(word.to_string());
                }
                i += 1;
            }
            _ => return i,
        }
        if tokens.get(i).is_some_and(|t| t == "::")
            && tokens.get(i + 1).is_some_and(|t| is_word(t) || t == "{" || t == "*")
        {
            i += 1;
            continue;
        }
        let mut name = path.last().cloned().unwrap_or_default();
        if tokens.get(i).is_some_and(|t| t == "as")
            && tokens.get(i + 2).is_some_and(|t| t == "," || t == ";" || t == "}")
        {
            name = tokens[i + 1].clone();
            i += 2;
        }
        leaves.push((name, path));
        return i;
    }
}

fn is_word(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Words, `::` and single signs; no comments, no text.
fn tokens(text: &str) -> Vec<String> {
    let chars: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let mut i = 0;
    while i < chars.len() {
        let rest = &chars[i..];
        i += match rest {
            ['/', '/', ..] => rest.iter().position(|c| *c == '\n').unwrap_or(rest.len()),
            ['r', '#', '"', ..] => {
                3 + rest[3..].windows(2).position(|w| w == ['"', '#']).map_or(rest.len(), |n| n + 2)
            }
            ['r', '"', ..] => {
                2 + rest[2..].iter().position(|c| *c == '"').map_or(rest.len(), |n| n + 1)
            }
            ['"', ..] => text_length(rest),
            ['\'', '\\', _, ..] => {
                3 + rest[3..].iter().position(|c| *c == '\'').map_or(rest.len(), |n| n + 1)
            }
            ['\'', _, '\'', ..] => 3,
            [':', ':', ..] => {
                tokens.push("::".into());
                2
            }
            [c, ..] if c.is_alphanumeric() || *c == '_' => {
                let length = rest
                    .iter()
                    .position(|c| !c.is_alphanumeric() && *c != '_')
                    .unwrap_or(rest.len());
                tokens.push(rest[..length].iter().collect());
                length
            }
            [c, ..] => {
                if !c.is_whitespace() {
                    tokens.push(c.to_string());
                }
                1
            }
            [] => 1,
        };
    }
    tokens
}

/// Of a string that starts here, its quotes and escapes counted.
fn text_length(chars: &[char]) -> usize {
    let mut i = 1;
    while i < chars.len() && chars[i] != '"' {
        i += if chars[i] == '\\' { 2 } else { 1 };
    }
    i + 1
}

/// Without the items behind `#[cfg(test)]`: each ends with its `;` or with the brace it opens.
fn without_tests(tokens: Vec<String>) -> Vec<String> {
    let mark = ["#", "[", "cfg", "(", "test", ")", "]"];
    let mut kept = Vec::new();
    let mut i = 0;
    while i < tokens.len() {
        if !tokens[i..].iter().map(String::as_str).take(mark.len()).eq(mark) {
            kept.push(tokens[i].clone());
            i += 1;
            continue;
        }
        let mut depth = 0usize;
        i += mark.len();
        while i < tokens.len() {
            match tokens[i].as_str() {
                "{" => depth += 1,
                "}" => depth = depth.saturating_sub(1),
                _ => {}
            }
            i += 1;
            if depth == 0 && (tokens[i - 1] == ";" || tokens[i - 1] == "}") {
                break;
            }
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circles(sources: &[(&str, &str)]) -> Vec<Vec<String>> {
        Imports::read(sources.iter().copied()).circles()
    }

    const LIB: (&str, &str) = ("lib.rs", "pub mod a;");

    #[test]
    fn files_that_import_each_other_are_a_circle_in_every_spelling() {
        for spelling in [
            "use super::b::B;",
            "use super::{c::C, b::{self, B}};",
            "use crate::a::b::B as Other;",
            "use crate::{a::b::B};",
            "fn f() { super::b::b() }",
            "use super::b; fn f() -> b::B {}",
            "use super::B;",
            "fn f<'a>(x: &'a str) -> char { let _ = (\"\\\"\", '\"', '{'); crate::a::B::new(x) }",
        ] {
            let found = circles(&[
                LIB,
                ("a/mod.rs", "mod b; mod c; mod d; pub use b::B;"),
                ("a/b.rs", "use super::d::D; pub struct B;"),
                ("a/c.rs", "pub struct C;"),
                ("a/d.rs", &format!("pub struct D; {spelling}")),
            ]);
            assert_eq!(found, [["a/b.rs", "a/d.rs"]], "{spelling}");
        }
    }

    #[test]
    fn a_parent_takes_part_by_its_own_items_only() {
        let child = ("a/b.rs", "use super::A; pub fn b(a: A) {}");
        assert!(
            circles(&[LIB, ("a/mod.rs", "mod b; pub use b::b; pub struct A;"), child]).is_empty(),
            "passed on, not used"
        );
        let used = ("a/mod.rs", "mod b; pub use b::b; pub struct A; fn f() { b(A) }");
        assert_eq!(circles(&[LIB, used, child]), [["a/b.rs", "a/mod.rs"]]);
        let of_its_own = [
            LIB,
            ("a/mod.rs", "mod b; mod c; pub use c::A; fn f() { b::b(A) }"),
            child,
            ("a/c.rs", "pub struct A;"),
        ];
        assert!(circles(&of_its_own).is_empty(), "the shared type in a file of its own");
    }

    #[test]
    fn tests_comments_and_text_are_no_imports() {
        let text = "pub struct B; // super::d::D\nconst T: &str = \"super::d::D\";\n#[cfg(test)]\nmod tests { use super::super::d::D; }\n";
        let sources = [
            LIB,
            ("a/mod.rs", "#[cfg(test)]\nmod tests; mod b; mod d;"),
            ("a/b.rs", text),
            ("a/d.rs", "use super::b::B; pub struct D;"),
        ];
        assert!(circles(&sources).is_empty());
        let after = format!("{text} use super::d::D;");
        assert_eq!(
            circles(&[LIB, ("a/mod.rs", "mod b; mod d;"), ("a/b.rs", &after), sources[3]]).len(),
            1,
            "what follows the tests counts"
        );
    }
}
