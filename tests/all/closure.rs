//! What each stage is made from: a changed byte changes the hash of the stages that use it, and of
//! no other.

#[path = "../../build/closure.rs"]
pub mod shared;

use crate::floors::circles::Imports;
use shared::{FOLDERS, Files, GENERATED, closure, code, hashes, locked, modules, reached, stages};
use std::collections::BTreeSet;
use std::path::Path;

fn read(folder: &Path, root: &Path, files: &mut Files) {
    for entry in std::fs::read_dir(folder).expect("readable folder") {
        let path = entry.expect("readable entry").path();
        if path.is_dir() {
            read(&path, root, files);
        } else {
            let name =
                path.strip_prefix(root).expect("inside").to_string_lossy().replace('\\', "/");
            files.insert(name, std::fs::read(&path).expect("readable file"));
        }
    }
}

fn sources() -> Files {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Files::new();
    FOLDERS.iter().for_each(|folder| read(&root.join(folder), root, &mut files));
    for name in ["Cargo.lock", "Cargo.toml"] {
        files.insert(name.to_string(), std::fs::read(root.join(name)).expect("readable file"));
    }
    files
}

/// Stages whose hash a byte more at the end of a file changes.
fn changed(files: &Files, path: &str) -> Vec<String> {
    let before = hashes(files, "");
    let mut after = files.clone();
    after.get_mut(path).unwrap_or_else(|| panic!("there is no {path}")).push(b'\n');
    before.into_iter().zip(hashes(&after, "")).filter(|(a, b)| a != b).map(|(a, _)| a.0).collect()
}

#[test]
fn a_byte_in_the_report_changes_the_pages_alone() {
    let files = sources();
    for path in ["src/report/checks.rs", "src/report/html/page.css", "src/stage/report.rs"] {
        assert_eq!(changed(&files, path), ["page", "report"], "{path}");
    }
}

#[test]
fn an_effect_changes_the_diagnosis_and_the_estimate_behind_it_alone() {
    let files = sources();
    let effects: Vec<&String> =
        files.keys().filter(|p| p.starts_with("pipelines/effects/")).collect();
    assert!(effects.len() > 10);
    assert_eq!(changed(&files, effects[0]), ["diagnose", "rerun"]);
    assert_eq!(changed(&files, "src/diagnose/mod.rs"), ["diagnose", "rerun"]);
}

#[test]
fn a_byte_changes_all_that_use_it() {
    let files = sources();
    let math = changed(&files, "src/math/dense.rs");
    for stage in ["reconstruct", "estimate", "fit", "diagnose", "rerun"] {
        assert!(math.iter().any(|s| s == stage), "{stage} uses math: {math:?}");
    }
    let all = stages(&files);
    assert_eq!(all, koehler::stage::STAGES.iter().map(|s| s.name).collect::<Vec<_>>());
    for path in [
        "src/table/build.rs",
        "schemas/tables/samples.json",
        "src/stage/mod.rs",
        "src/stage/inputs.rs",
        "src/stage/kind.rs",
        "src/stage/notes.rs",
        "src/stage/slice.rs",
        "src/stage/told.rs",
        "src/stage/channels.rs",
        "src/error.rs",
    ] {
        assert_eq!(changed(&files, path), all, "{path}");
    }
    // What lines go along tells conditions of repeats.
    let fit = changed(&files, "src/stage/fit/mod.rs");
    assert_eq!(fit[..2], ["repeats", "fit"].map(String::from));
    // What only commands and tests are made from is in no stage.
    for path in ["src/cli/mod.rs", "src/main.rs", "src/report/tests.rs", "src/pipeline/run.rs"] {
        assert_eq!(changed(&files, path), Vec::<String>::new(), "{path}");
    }
}

#[test]
fn the_program_has_the_hashes_of_its_sources() {
    let files = sources();
    let codes: BTreeSet<&str> = koehler::stage::STAGES.iter().map(|s| s.code()).collect();
    assert_eq!(
        codes.len(),
        hashes(&files, "").into_iter().map(|(_, hash)| hash).collect::<BTreeSet<_>>().len()
    );
    assert_eq!(koehler::stage::code("no stage").len(), 16);
    assert!(!codes.contains(koehler::stage::code("no stage")));
    assert_ne!(hashes(&files, "rustc 1"), hashes(&files, "rustc 2"));
}

#[test]
fn the_lock_counts_as_far_as_the_program_reaches() {
    let mut files = sources();
    let text = locked(&files);
    let has = |name: &str| text.contains(&format!("name = \"{name}\"\n"));
    // Of dependencies, of their dependencies; not of tests.
    assert!(has("parquet") && has("libm") && has("arrow-buffer"));
    assert!(!has("divan") && !has("proptest") && !has("koehler"));
    let before = hashes(&files, "");
    let lock = String::from_utf8(files["Cargo.lock"].clone()).expect("text");
    let at = lock.find("name = \"arrow-buffer\"\nversion = \"").expect("an entry")
        + "name = \"arrow-buffer\"\nversion = \"".len();
    files.insert("Cargo.lock".into(), format!("{}9{}", &lock[..at], &lock[at..]).into_bytes());
    assert!(before.iter().zip(hashes(&files, "")).all(|(a, b)| *a != b));
}

#[test]
fn an_edge_is_seen_however_it_is_written() {
    let stage = |text: &str| {
        let list = "pub const STAGES: &[Stage] = &[\n    toy::STAGE,\n    other::STAGE,\n];\n";
        let campaign = "pub struct Campaign {\n    pub others: Vec<other::Config>,\n}\n";
        let all = [
            ("src/stage/mod.rs", list),
            ("src/stage/kind.rs", campaign),
            ("src/stage/inputs.rs", ""),
            ("src/stage/toy.rs", text),
            ("src/stage/other.rs", "use crate::far::X;\n"),
            ("src/far/mod.rs", "mod deep;\n\n#[macro_export]\nmacro_rules! made {\n}\n"),
            ("src/far/deep.rs", "const TEXT: &str = include_str!(\"../../docs/x.txt\");\n"),
            ("docs/x.txt", ""),
        ];
        let files: Files = all
            .into_iter()
            .map(|(path, text)| (path.to_string(), text.as_bytes().to_vec()))
            .collect();
        assert_eq!(stages(&files), ["toy", "other"]);
        closure(&files, "toy")
    };
    for text in [
        "use crate::far;\n",
        "use crate::{\n    units,\n    far::{X, Y},\n};\n",
        "fn f() { let url = \"http://x\"; crate::far::x() }\n",
        "use super::super::far;\n",
        "use super::{Stage, other};\n",
        "#[cfg(test)]\nmod tests;\n\nuse crate::far;\n",
        "#[cfg(test)]\nmod tests {\n    use crate::units;\n}\n\nuse crate::far;\n",
        "fn f(campaign: &Campaign) -> usize { campaign.others.len() }\n",
        "fn f() { crate::made!(1) }\n",
    ] {
        let all = stage(text);
        assert!(all.contains("src/far/deep.rs") && all.contains("docs/x.txt"), "{text}: {all:?}");
    }
    for text in [
        "// crate::far\n",
        "#[cfg(test)]\nmod tests {\n    use crate::far;\n}\n",
        "fn f(x: X) { x.others() }\n",
    ] {
        assert!(!stage(text).contains("src/far/deep.rs"), "{text}");
    }
}

/// Files of the project that the compiler read for the library, as it wrote them down beside the
/// library.
fn compiled() -> BTreeSet<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let test = std::env::current_exe().expect("a program");
    let folder = test.parent().expect("a folder");
    // of several builds (other features, other flags) the last one is that of these sources
    let mut found = Vec::new();
    for path in
        std::fs::read_dir(folder).expect("readable").map(|entry| entry.expect("readable").path())
    {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with("koehler-") && name.ends_with(".d") {
            let text = std::fs::read_to_string(&path).expect("readable");
            let library = folder.join(format!("lib{}", name.replace(".d", ".rlib")));
            if text.contains(&format!("{}: ", library.display())) {
                found.push((
                    std::fs::metadata(&path).and_then(|m| m.modified()).expect("a time"),
                    text,
                ));
            }
        }
    }
    let (_, text) = found.into_iter().max().unwrap_or_else(|| {
        panic!("{} has no koehler-*.d about libkoehler-*.rlib: rustc writes it where cargo builds the library", folder.display())
    });
    // every file has a line of its own, `path:`, relative to the root of the project or absolute
    let file = |line: &str| {
        let path = root.join(line.strip_suffix(':')?.replace("\\ ", " ")).canonicalize().ok()?;
        // what build.rs made is made from files that are in the list themselves
        let made = folder.parent().is_some_and(|built| path.starts_with(built));
        let inside = path.strip_prefix(root.canonicalize().ok()?).ok()?;
        (!made).then(|| inside.to_string_lossy().replace('\\', "/"))
    };
    text.lines().filter_map(file).collect()
}

#[test]
fn every_file_that_the_compiler_reads_is_reached() {
    let (files, compiled) = (sources(), compiled());
    assert!(compiled.contains("src/lib.rs") && compiled.len() > 300, "{compiled:?}");
    // The root of the crate declares the modules and is of none.
    let missed = |files: &Files| -> Vec<&String> {
        let seen: BTreeSet<String> =
            modules(files).keys().flat_map(|module| reached(files, module)).collect();
        compiled.iter().filter(|path| !seen.contains(*path) && *path != "src/lib.rs").collect()
    };
    assert!(missed(&files).is_empty(), "no module is made from {:?}", missed(&files));
    // A walk that sees no include is found out.
    let unseen = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes).replace("include", "exclude");
        GENERATED.iter().fold(text, |text, (name, _)| text.replace(name, "")).into_bytes()
    };
    let blind: Files = files.iter().map(|(path, bytes)| (path.clone(), unseen(bytes))).collect();
    for folder in ["pipelines/effects/", "schemas/tables/"] {
        assert!(missed(&blind).iter().any(|path| path.starts_with(folder)), "{folder}");
    }
    let unread: Vec<&String> = compiled.iter().filter(|path| !files.contains_key(*path)).collect();
    assert!(unread.is_empty(), "the hashes leave out {unread:?}: name their folder in FOLDERS");
}

/// Two readers of the same sources: the hashes go by module and by text, and take too much rather
/// than too little; the test of circles goes from file to file by resolved paths. What the second
/// finds, the first has to have.
#[test]
fn whatever_a_stage_imports_is_in_its_hash() {
    let files = sources();
    let texts: Vec<(&str, String)> = files
        .iter()
        .filter_map(|(path, bytes)| {
            let inner = path.strip_prefix("src/").filter(|p| p.ends_with(".rs"))?;
            Some((inner, String::from_utf8_lossy(bytes).into_owned()))
        })
        .collect();
    let imports = Imports::read(texts.iter().map(|(path, text)| (*path, text.as_str())));
    // The list of stages and the campaign name all stages (see `build/closure.rs`).
    let hubs = ["stage/mod.rs", "stage/kind.rs", "lib.rs"];
    let missed = |files: &Files, stage: &str| -> Vec<String> {
        let (file, folder) = (format!("stage/{stage}.rs"), format!("stage/{stage}/"));
        let own = |path: &str| path == file || path.starts_with(&folder);
        let hashed = closure(files, stage);
        let reached =
            imports.reached_from(own, &hubs).into_iter().map(|path| format!("src/{path}"));
        reached.filter(|path| path != "src/lib.rs" && !hashed.contains(path)).collect()
    };
    for stage in stages(&files) {
        let missed = missed(&files, &stage);
        assert!(missed.is_empty(), "{stage} imports what its hash leaves out: {missed:?}");
    }
    // A walk that does not see one way of writing an edge is found out.
    let without =
        |bytes: &[u8]| String::from_utf8_lossy(bytes).replace("crate::", "lost::").into_bytes();
    let blind: Files = files.iter().map(|(path, bytes)| (path.clone(), without(bytes))).collect();
    assert!(!missed(&blind, "fit").is_empty() && !missed(&blind, "report").is_empty());
}

#[test]
fn nothing_is_included_that_the_walk_does_not_see() {
    let files = sources();
    for (path, bytes) in files.iter().filter(|(path, _)| path.ends_with(".rs")) {
        let code = code(&String::from_utf8_lossy(bytes));
        for (at, _) in code.match_indices("include").filter(|(at, _)| {
            code[*at..].starts_with("include_") || code[*at..].starts_with("include!")
        }) {
            let call = code[at..].lines().next().unwrap_or_default();
            let written = call.split_once("!(").is_some_and(|(_, rest)| rest.starts_with('"'));
            let made = GENERATED.iter().any(|(name, _)| {
                call.contains(&format!("concat!(env!(\"OUT_DIR\"), \"/{name}\")"))
            });
            // A folder inside the module counts as a whole.
            let inside = call.contains("concat!(\"fragments/\"");
            assert!(!call.contains("!(") || written || made || inside, "{path}: {call}");
        }
    }
}
