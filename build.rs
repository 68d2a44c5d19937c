//! Hashes what each stage is made from, for its cache key, and lists the candidate effects of
//! `pipelines/effects/` and the tables of `schemas/tables/`, so that adding one is adding a file.

#[path = "build/closure.rs"]
mod closure;

use std::path::{Path, PathBuf};

fn files(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { files(&path, out) } else { out.push(path) }
    }
}

/// A list of names and texts of the files of a folder that end in `ending`, in alphabetical order.
fn embedded(doc: &str, folder: &str, ending: &str) -> String {
    let mut paths = Vec::new();
    files(Path::new(folder), &mut paths);
    paths.retain(|p| p.extension().is_some_and(|e| e == ending));
    paths.sort();
    let root = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let entry = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        format!(
            "    ({name:?}, include_str!({:?})),\n",
            Path::new(&root).join(path).to_string_lossy()
        )
    };
    let entries: String = paths.iter().map(entry).collect();
    format!("/// {doc}\npub const EMBEDDED: &[(&str, &str)] = &[\n{entries}];\n")
}

/// Everything that goes into a hash.
fn sources() -> closure::Files {
    let mut paths = vec![PathBuf::from("Cargo.lock"), PathBuf::from("Cargo.toml")];
    closure::FOLDERS.iter().for_each(|folder| files(Path::new(folder), &mut paths));
    let read = |path: PathBuf| {
        (path.to_string_lossy().replace('\\', "/"), std::fs::read(&path).unwrap_or_default())
    };
    paths.into_iter().map(read).collect()
}

/// The compiler and the target.
fn compiler() -> String {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let version =
        std::process::Command::new(rustc).arg("-V").output().map(|o| o.stdout).unwrap_or_default();
    format!(
        "{}\n{}",
        String::from_utf8_lossy(&version),
        std::env::var("TARGET").unwrap_or_default()
    )
}

/// The hashes of the stages, and one of everything for a stage that is in no list.
fn codes() -> String {
    let (files, compiler) = (sources(), compiler());
    let mut all = blake3::Hasher::new();
    for (path, bytes) in &files {
        all.update(path.as_bytes()).update(bytes);
    }
    let entry = |(stage, hash): (String, String)| format!("    ({stage:?}, {hash:?}),\n");
    let entries: String = closure::hashes(&files, &compiler).into_iter().map(entry).collect();
    format!(
        "/// Hash of what each stage is made from, by its name.\nconst CODES: &[(&str, &str)] = &[\n{entries}];\n\n\
         /// Hash of all sources.\nconst ALL: &str = {:?};\n",
        &all.update(compiler.as_bytes()).finalize().to_hex()[..16]
    )
}

fn main() {
    let out = PathBuf::from(std::env::var("OUT_DIR").unwrap_or_default());
    for (name, text) in [
        (
            "effects.rs",
            embedded("The library: name and text of every effect.", "pipelines/effects", "toml"),
        ),
        ("tables.rs", embedded("Name and text of every table's schema.", "schemas/tables", "json")),
        ("codes.rs", codes()),
    ] {
        let path = out.join(name);
        // What did not change is not written: the crate is not compiled for it.
        if std::fs::read_to_string(&path).is_ok_and(|before| before == text) {
            continue;
        }
        if let Err(e) = std::fs::write(&path, text) {
            println!("cargo:warning={}: {e}", path.display());
        }
    }
    for path in closure::FOLDERS.iter().chain(&["build", "build.rs", "Cargo.lock", "Cargo.toml"]) {
        println!("cargo:rerun-if-changed={path}");
    }
}
