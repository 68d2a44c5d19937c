//! The sources as texts by path in; what each stage is made from, and one hash of that per stage,
//! out.
//!
//! Shared by `build.rs` and the tests. A module of `src/` counts as a whole, with every file in its
//! folder that is not a test. Inside `src/stage/` each stage counts on its own. Where an edge is in
//! doubt it is there: one too many costs a rerun, one too few a wrong table.

use std::collections::{BTreeMap, BTreeSet};

/// Contents by path relative to the root of the project, with `/`.
pub type Files = BTreeMap<String, Vec<u8>>;

/// What `build.rs` writes for `include!`, and the folder that it is made from.
pub const GENERATED: &[(&str, &str)] =
    &[("effects.rs", "pipelines/effects/"), ("tables.rs", "schemas/tables/"), ("codes.rs", "")];

/// Folders of the project with what goes into a hash.
pub const FOLDERS: [&str; 3] = ["src", "schemas/tables", "pipelines/effects"];

/// The code of a file: without comments, and without items that only tests have.
pub fn code(text: &str) -> String {
    let mut lines = text.lines();
    let mut kept = Vec::new();
    while let Some(line) = lines.next() {
        if line.trim() == "#[cfg(test)]" {
            let indent = &line[..line.len() - line.trim_start().len()];
            skip_item(&mut lines, indent);
        } else {
            kept.push(without_comment(line));
        }
    }
    kept.join("\n")
}

/// Goes behind the item that begins on the next line: to the line that ends it, which formatted
/// code indents as its first.
fn skip_item<'a>(lines: &mut impl Iterator<Item = &'a str>, indent: &str) {
    for line in lines {
        let own =
            line.strip_prefix(indent).is_some_and(|rest| !rest.starts_with(char::is_whitespace));
        if own && !line.trim_start().starts_with("#[") && line.ends_with([';', '}']) {
            return;
        }
    }
}

/// The line up to a comment; `//` inside a string is none.
fn without_comment(line: &str) -> &str {
    let begins = |(at, _): &(usize, &str)| line[..*at].matches('"').count().is_multiple_of(2);
    line.match_indices("//").find(begins).map_or(line, |(at, _)| &line[..at])
}

/// First names of the paths that follow `prefix` in `code`: of `crate::a::b` and `crate::{a::b, c}`
/// they are `a` and `a`, `c`.
pub fn named(code: &str, prefix: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices(prefix) {
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        found.extend(firsts(&code[at + prefix.len()..]));
    }
    found
}

/// Modules of this crate that `code` names.
pub fn imports(code: &str) -> Vec<String> {
    named(code, "crate::")
}

fn firsts(rest: &str) -> Vec<String> {
    if !rest.starts_with('{') {
        return Some(word(rest)).filter(|name| !name.is_empty()).into_iter().collect();
    }
    let (mut found, mut depth, mut start) = (Vec::new(), 0, 1);
    for (i, c) in rest.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 || (depth == 1 && c == ',') {
            found.push(word(rest[start..i].trim()));
            start = i + 1;
        }
        if depth == 0 {
            break;
        }
    }
    found.retain(|name| !name.is_empty());
    found
}

fn word(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

/// The modules of the stages, as `STAGES` in `src/stage/mod.rs` lists them; each is named as its
/// stage.
pub fn stages(files: &Files) -> Vec<String> {
    let text = text(files, "src/stage/mod.rs");
    let list = text
        .split("const STAGES: &[Stage] = &[")
        .nth(1)
        .and_then(|rest| rest.split("];").next())
        .unwrap_or_default();
    code(list)
        .split(',')
        .filter_map(|entry| entry.trim().strip_suffix("::STAGE").map(str::to_string))
        .collect()
}

fn text(files: &Files, path: &str) -> String {
    files.get(path).map(|bytes| String::from_utf8_lossy(bytes).into_owned()).unwrap_or_default()
}

fn is_test(path: &str) -> bool {
    path.ends_with("tests.rs") || path.contains("/tests/")
}

/// What an edge leads to: a module of `src/`, or a module of `src/stage/`.
pub type Module = String;

/// `src/math/simd.rs` is of `math`; `src/stage/diagnose/words.rs` of `stage/diagnose`;
/// `src/stage/mod.rs` of `stage`.
fn module(path: &str) -> Option<Module> {
    let inner = path.strip_prefix("src/")?;
    let own = |part: &str| part.trim_end_matches(".rs").to_string();
    let mut parts = inner.split('/');
    let first = own(parts.next()?);
    Some(match (first.as_str(), parts.next().map(own)) {
        ("lib" | "main", _) => return None,
        ("stage", Some(second)) if second != "mod" => format!("stage/{second}"),
        _ => first,
    })
}

/// Edges of one file to modules; to files outside of `src/`.
fn edges(
    path: &str,
    code: &str,
    known: &BTreeSet<Module>,
    fields: &BTreeMap<String, Module>,
) -> BTreeSet<Module> {
    let mut found: BTreeSet<Module> = imports(code).into_iter().collect();
    // `super::` as often as the file is deep leads to the root of the crate.
    let depth = path.matches('/').count() - usize::from(path.ends_with("/mod.rs"));
    found.extend((depth..=depth + 2).flat_map(|n| named(code, &"super::".repeat(n.max(1)))));
    // The list of stages and the campaign name all stages; who uses one of them says so himself, or
    // takes the campaign's field.
    let hub = ["src/stage/mod.rs", "src/stage/kind.rs"].contains(&path);
    if hub {
        // It names the type of a section; a stage that has one names it in its own file.
        found.remove("report");
    }
    if path.starts_with("src/stage/") && !hub {
        let mut names = named(code, "crate::stage::");
        names.extend((1..4).flat_map(|n| named(code, &"super::".repeat(n))));
        // `crate::fit::` is a module of the crate, no stage.
        let relative = |name: &String, at: usize| !code[..at - name.len()].ends_with("crate::");
        names.extend(
            code.match_indices("::")
                .filter_map(|(at, _)| Some(before(&code[..at])).filter(|name| relative(name, at))),
        );
        found.extend(names.into_iter().map(|name| format!("stage/{name}")));
        found.extend(
            fields
                .iter()
                .filter(|(field, _)| reads_field(code, field))
                .map(|(_, module)| module.clone()),
        );
        let common = ["kind", "inputs", "told", "notes", "slice", "channels"];
        found.extend(common.map(|name| format!("stage/{name}")));
        found.insert("stage".to_string());
    }
    found.retain(|module| known.contains(module) && Some(module) != self::module(path).as_ref());
    found
}

/// The identifier at the end of `code`.
fn before(code: &str) -> String {
    let word: Vec<char> =
        code.chars().rev().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    word.into_iter().rev().collect()
}

/// Whether the code takes this field of anything.
fn reads_field(code: &str, field: &str) -> bool {
    code.match_indices(&format!(".{field}")).any(|(at, found)| {
        let next = code[at + found.len()..].chars().next();
        next.is_none_or(|c| !(c.is_alphanumeric() || c == '_' || c == '('))
    })
}

/// The fields of the campaign that belong to a stage: `estimates: Vec<estimate::Config>` is of
/// `stage/estimate`.
fn fields(files: &Files) -> BTreeMap<String, Module> {
    let text = code(&text(files, "src/stage/kind.rs"));
    let field = |line: &str| {
        let (name, kind) = line.trim().strip_prefix("pub ")?.split_once(": ")?;
        let (owner, _) = kind.split_once("::")?;
        Some((name.to_string(), format!("stage/{}", before(owner))))
    };
    text.lines().filter_map(field).collect()
}

/// Files outside of the module that a file includes: by a written path, or made by `build.rs` from
/// a folder.
fn included(path: &str, code: &str, files: &Files) -> Vec<String> {
    let mut found = Vec::new();
    for (name, folder) in GENERATED
        .iter()
        .filter(|(name, folder)| !folder.is_empty() && code.contains(&format!("\"/{name}\"")))
    {
        debug_assert!(!name.is_empty());
        found.extend(files.keys().filter(|p| p.starts_with(folder)).cloned());
    }
    for start in ["include_str!(\"", "include_bytes!(\"", "include!(\""] {
        for rest in code.split(start).skip(1) {
            let mut at: Vec<&str> = path.split('/').collect();
            at.pop();
            for part in rest.split('"').next().unwrap_or_default().split('/') {
                if part == ".." { at.pop().map_or((), |_| ()) } else { at.push(part) }
            }
            found.push(at.join("/"));
        }
    }
    found
}

/// Modules by the names of their macros that the whole crate sees: no path leads to them.
fn macros(modules: &BTreeMap<Module, Vec<&String>>, files: &Files) -> BTreeMap<String, Module> {
    let mut found = BTreeMap::new();
    for (module, path) in
        modules.iter().flat_map(|(module, paths)| paths.iter().map(move |path| (module, path)))
    {
        let code = code(&text(files, path));
        for rest in code
            .split("#[macro_export]")
            .skip(1)
            .filter_map(|rest| rest.split("macro_rules! ").nth(1))
        {
            found.insert(word(rest), module.clone());
        }
    }
    found
}

/// The files of every module; those of tests alone are of none.
pub fn modules(files: &Files) -> BTreeMap<Module, Vec<&String>> {
    let mut modules: BTreeMap<Module, Vec<&String>> = BTreeMap::new();
    for path in files.keys().filter(|path| !is_test(path)) {
        if let Some(module) = module(path) {
            modules.entry(module).or_default().push(path);
        }
    }
    modules
}

/// Every file that a stage is made from, by path.
pub fn closure(files: &Files, stage: &str) -> BTreeSet<String> {
    reached(files, &format!("stage/{stage}"))
}

/// Every file that a module is made from, by path.
pub fn reached(files: &Files, module: &str) -> BTreeSet<String> {
    let modules = modules(files);
    let known: BTreeSet<Module> = modules.keys().cloned().collect();
    let (fields, macros) = (fields(files), macros(&modules, files));
    let mut seen: BTreeSet<Module> = BTreeSet::new();
    let mut todo = vec![module.to_string()];
    let mut all = BTreeSet::new();
    while let Some(module) = todo.pop() {
        if !seen.insert(module.clone()) {
            continue;
        }
        for path in modules.get(&module).into_iter().flatten() {
            all.insert(path.to_string());
            if path.ends_with(".rs") {
                let code = code(&text(files, path));
                todo.extend(edges(path, &code, &known, &fields));
                todo.extend(
                    macros
                        .iter()
                        .filter(|(name, _)| code.contains(&format!("{name}!")))
                        .map(|(_, module)| module.clone()),
                );
                all.extend(included(path, &code, files));
            }
        }
    }
    all
}

/// The entries of `Cargo.lock` that the program's normal dependencies reach: tools of tests and of
/// the build are left out.
pub fn locked(files: &Files) -> String {
    let (lock, manifest) = (text(files, "Cargo.lock"), text(files, "Cargo.toml"));
    let entries: Vec<&str> = lock.split("[[package]]").skip(1).map(str::trim).collect();
    let value = |entry: &str, key: &str| {
        let line = entry.lines().find_map(|line| line.strip_prefix(&format!("{key} = ")));
        line.map(|line| line.trim_matches('"').to_string()).unwrap_or_default()
    };
    let direct = manifest.split("\n[dependencies]\n").nth(1).unwrap_or_default();
    let direct = direct.lines().take_while(|line| !line.starts_with('['));
    let mut todo: Vec<String> = direct
        .filter_map(|line| line.split_once(" = "))
        .map(|(name, _)| name.to_string())
        .collect();
    let mut reached = BTreeSet::new();
    while let Some(wanted) = todo.pop() {
        // `name`, or `name version` where there are several of one name.
        let mut words = wanted.split(' ');
        let (name, version) = (words.next().unwrap_or_default(), words.next());
        for entry in entries.iter().filter(|e| {
            value(e, "name") == name && version.is_none_or(|v| value(e, "version") == v)
        }) {
            if reached.insert(*entry) {
                let list = entry.split("dependencies = [").nth(1).unwrap_or_default();
                todo.extend(list.split('"').skip(1).step_by(2).map(str::to_string));
            }
        }
    }
    reached.into_iter().collect::<Vec<_>>().join("\n")
}

/// One hash per stage, by name: of the files it is made from, of the locked dependencies, and of
/// `rest` (the compiler, the target).
pub fn hashes(files: &Files, rest: &str) -> Vec<(String, String)> {
    let locked = locked(files);
    let hash = |paths: &BTreeSet<String>| {
        let mut hasher = blake3::Hasher::new();
        for path in paths {
            let bytes = files.get(path).map(Vec::as_slice).unwrap_or_default();
            hasher
                .update(path.as_bytes())
                .update(&[0])
                .update(&(bytes.len() as u64).to_le_bytes())
                .update(bytes);
        }
        hasher.update(locked.as_bytes()).update(&[0]).update(rest.as_bytes());
        hasher.finalize().to_hex()[..16].to_string()
    };
    stages(files).into_iter().map(|stage| (stage.clone(), hash(&closure(files, &stage)))).collect()
}
