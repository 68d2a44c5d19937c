//! What belongs to the cluster is built by those alone who want it: the packages of the default build
//! come in, and none of them is of the engine of many machines.

use std::process::Command;

fn tree(package: &str) -> String {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--locked", "--offline", "--edges", "normal,build", "--prefix", "none"])
        .args(["--package", package])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo is there");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Packages that nothing but the cluster may bring.
fn of_the_cluster(line: &str) -> bool {
    ["ballista", "datafusion", "tonic", "arrow-flight", "koehler-cluster"]
        .iter()
        .any(|name| line.starts_with(name))
}

#[test]
fn the_default_build_has_nothing_of_the_cluster() {
    let tree = tree("koehler");
    assert!(tree.lines().any(|line| line.starts_with("arrow-array v59.")));
    let found: Vec<&str> = tree.lines().filter(|line| of_the_cluster(line)).collect();
    assert!(found.is_empty(), "{found:?}");
    let root = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"));
    assert!(root.expect("readable").contains("default-members = [\".\"]"));
}

/// What the cluster sends as a table is what the program writes as one: the workspace has one version.
#[test]
fn the_cluster_has_the_arrow_of_the_program() {
    let lock = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.lock"));
    let lock = lock.expect("readable");
    let found = lock.lines().filter(|line| *line == "name = \"arrow-array\"");
    assert_eq!(found.count(), 1);
}
