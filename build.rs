//! Hashes the program's sources into `KOEHLER_CODE`, the code version that is part of every cache key, and lists the candidate effects of
//! `pipelines/effects/`, so that adding one is adding a file.

use std::path::{Path, PathBuf};

fn files(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { files(&path, out) } else { out.push(path) }
    }
}

/// A list of names and texts of the effect files, for `src/diagnose/effect/file.rs`.
fn effects() -> String {
    let mut paths = Vec::new();
    files(Path::new("pipelines/effects"), &mut paths);
    paths.retain(|p| p.extension().is_some_and(|e| e == "toml"));
    paths.sort();
    let root = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let entry = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        format!("    ({name:?}, include_str!({:?})),\n", Path::new(&root).join(path).to_string_lossy())
    };
    let entries: String = paths.iter().map(entry).collect();
    format!("/// The library: name and text of every effect.\npub const EMBEDDED: &[(&str, &str)] = &[\n{entries}];\n")
}

fn main() {
    println!("cargo:rerun-if-changed=pipelines/effects");
    let out = PathBuf::from(std::env::var("OUT_DIR").unwrap_or_default()).join("effects.rs");
    if let Err(e) = std::fs::write(&out, effects()) {
        println!("cargo:warning={}: {e}", out.display());
    }
    println!("cargo:rerun-if-changed=src");
    println!("cargo:rerun-if-changed=schemas");
    println!("cargo:rerun-if-changed=Cargo.lock");
    let mut paths = vec![PathBuf::from("Cargo.lock")];
    files(Path::new("src"), &mut paths);
    files(Path::new("schemas"), &mut paths);
    files(Path::new("pipelines/effects"), &mut paths);
    paths.sort();
    let mut hasher = blake3::Hasher::new();
    for path in paths {
        hasher.update(path.to_string_lossy().replace('\\', "/").as_bytes());
        hasher.update(&std::fs::read(&path).unwrap_or_default());
    }
    println!("cargo:rustc-env=KOEHLER_CODE={}", &hasher.finalize().to_hex()[..16]);
}
