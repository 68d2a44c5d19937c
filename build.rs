//! Hashes the program's sources into `KOEHLER_CODE`, the code version that is part of every cache key.

use std::path::{Path, PathBuf};

fn files(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { files(&path, out) } else { out.push(path) }
    }
}

fn main() {
    println!("cargo:rerun-if-changed=src");
    println!("cargo:rerun-if-changed=schemas");
    println!("cargo:rerun-if-changed=Cargo.lock");
    let mut paths = vec![PathBuf::from("Cargo.lock")];
    files(Path::new("src"), &mut paths);
    files(Path::new("schemas"), &mut paths);
    paths.sort();
    let mut hasher = blake3::Hasher::new();
    for path in paths {
        hasher.update(path.to_string_lossy().replace('\\', "/").as_bytes());
        hasher.update(&std::fs::read(&path).unwrap_or_default());
    }
    println!("cargo:rustc-env=KOEHLER_CODE={}", &hasher.finalize().to_hex()[..16]);
}
