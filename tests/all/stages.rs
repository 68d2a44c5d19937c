//! A stage is one value: handed to the machinery, or written into a copy of the sources as one file
//! and its name in the list.

use crate::campaign::Campaign;
use koehler::pipeline::{self, Plan, State, Store};
use koehler::report::{Body, Grid, On, Section};
use koehler::stage::{
    Output, Read, STAGES, Stage, Unit, derive, estimate, fit, ingest, report, segment,
};
use koehler::table::{Table, read_dataset};
use serde_json::json;
use std::path::Path;
use std::process::Command;

const SECTION: Section = Section {
    id: "toy",
    heading: "Lengths of the flights",
    on: On::Both,
    tables: &["biases"],
    build: |given| {
        let Some(table) = given.get("biases") else { return Ok(None) };
        let mut grid = Grid::new(["flight", "#length|s"]);
        (0..table.rows()).for_each(|r| {
            grid.push(vec![table.text("flight", r).into(), table.text("value", r).into()])
        });
        Ok(Some(Body::grid(grid)))
    },
};

/// The length of every flight, in a table that no other stage of the small campaign writes.
const TOY: Stage = Stage {
    name: "toy",
    about: "measure the flights",
    units: Unit::flights,
    writes: &["biases"],
    sections: &[SECTION],
    reads: |_, unit| Read::flight(&["samples"], &unit.name),
    slice: |_, _| json!({ "what": "length" }),
    run: |_, unit, inputs| {
        let samples = inputs.of("samples", &unit.name)?;
        let t = samples.f64("t_s")?;
        let (begin, end) = (t[0], t[t.len() - 1]);
        let table = Table::build("biases")
            .strings("flight", [&unit.name])
            .i64("window", vec![0])
            .f64("t_start_s", vec![begin])
            .f64("t_end_s", vec![end])
            .strings("parameter", ["length"])
            .strings("unit", ["s"])
            .f64("value", vec![end - begin])
            .f64("sd", vec![f64::NAN])
            .finish()?;
        Ok(Output { tables: vec![("biases", table)], ..Output::default() })
    },
    ..Stage::PLAIN
};

static WITH_TOY: [Stage; 7] =
    [ingest::STAGE, derive::STAGE, segment::STAGE, estimate::STAGE, fit::STAGE, TOY, report::STAGE];

#[test]
fn a_new_stage_is_one_value() {
    let c = Campaign::new();
    let mut plan = Plan::read(&c.path("pipeline.toml")).expect("a plan");
    plan.campaign.stages = &WITH_TOY;
    let store = Store::open(&c.path("out"));
    let run = |plan: &Plan| {
        pipeline::run(
            plan,
            &store,
            &koehler::engine::Threads,
            &|_| {},
            &pipeline::Limits::default(),
        )
        .expect("a run")
    };
    let first = run(&plan);
    assert!(first.errors.is_empty(), "{}", first.errors);
    let toy = first.stages.iter().find(|s| s.name == "toy").expect("the stage ran");
    assert_eq!((toy.ran, toy.failed), (3, 0));
    let table = read_dataset(&c.path("out"), "biases").expect("its table");
    assert_eq!(table.rows(), 3);
    assert!(table.f64("value").expect("column").iter().all(|length| *length > 10.0));
    // Its section, its place in the provenance, its units in `status`; all without a line anywhere
    // else.
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a page");
    assert!(page.contains("<section id=\"toy\"") && page.contains("Lengths of the flights"));
    let stages = read_dataset(&c.path("out"), "stages").expect("provenance");
    assert!(stages.strings("stage").expect("column").contains(&"toy"));
    let status = pipeline::status(&plan, &store).expect("status");
    let (_, units) = status.iter().find(|(stage, _)| stage.name == "toy").expect("the stage");
    assert!(units.len() == 3 && units.iter().all(|a| a.state == State::Fresh), "{units:?}");
    assert!(run(&plan).nothing_done());
    // Taken away, its table and its section go.
    plan.campaign.stages = STAGES;
    assert_eq!(run(&plan).removed.len(), 3);
    assert!(!c.path("out/biases").exists());
    assert!(
        !std::fs::read_to_string(c.path("out/report/index.html"))
            .expect("a page")
            .contains("id=\"toy\"")
    );
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("readable folder") {
        let path = entry.expect("readable entry").path();
        let to = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy(&path, &to)
        } else {
            std::fs::copy(&path, &to).map(|_| ()).expect("copied")
        }
    }
}

/// The stage of CONTRIBUTING.md, with settings, a table and a section, in a copy of the sources.
#[test]
fn a_new_stage_is_one_file_and_its_name_in_the_list() {
    if std::env::var_os("KOEHLER_SLOW").is_none() {
        eprintln!("skipped: builds a copy of the program, minutes; KOEHLER_SLOW=1 runs it");
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let c = Campaign::new();
    let tree = c.path("tree");
    for folder in ["src", "build", "schemas", "pipelines/effects"] {
        copy(&root.join(folder), &tree.join(folder));
    }
    std::fs::copy(root.join("build.rs"), tree.join("build.rs")).expect("copied");
    std::fs::copy(root.join("Cargo.lock"), tree.join("Cargo.lock")).expect("copied");
    std::fs::copy(root.join("README.md"), tree.join("README.md")).expect("copied");
    // A program of another name: the one that the other tests run stays where it is.
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).expect("readable");
    let (before, after) = manifest.split_once("[[bench]]").expect("benches");
    let after = &after[after.find("[dependencies]").expect("dependencies")..];
    let renamed = before
        .replace("default-run = \"koehler\"", "")
        .replace("[[bin]]\nname = \"koehler\"", "[[bin]]\nname = \"koehler-toy\"");
    std::fs::write(tree.join("Cargo.toml"), format!("{renamed}{after}")).expect("written");
    // The stage: a file, its table's schema, and its name in the list.
    std::fs::write(tree.join("src/stage/lengths.rs"), include_str!("toy/lengths.rs"))
        .expect("written");
    std::fs::write(tree.join("schemas/tables/lengths.json"), include_str!("toy/lengths.json"))
        .expect("written");
    c.edit("tree/src/stage/mod.rs", "pub mod ingest;\n", "pub mod ingest;\npub mod lengths;\n");
    c.edit(
        "tree/src/stage/mod.rs",
        "    report::STAGE,\n",
        "    lengths::STAGE,\n    report::STAGE,\n",
    );
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), Into::into);
    let built = Command::new(env!("CARGO"))
        .args(["build", "--offline", "--bin", "koehler-toy"])
        .current_dir(&tree)
        .env("CARGO_TARGET_DIR", &target)
        .output()
        .expect("started");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let koehler = |args: &[&str]| {
        let output = Command::new(target.join("debug/koehler-toy"))
            .args(args)
            .current_dir(c.folder.path())
            .output()
            .expect("started");
        (
            output.status.success(),
            String::from_utf8_lossy(&output.stdout).into_owned()
                + &String::from_utf8_lossy(&output.stderr),
        )
    };
    // Its settings are checked: their type by the schema, their sense by the stage.
    c.edit("pipeline.toml", "[report]", "[lengths]\nlonger_than_s = \"long\"\n\n[report]");
    let (ok, text) = koehler(&["check", "pipeline.toml"]);
    assert!(!ok && text.contains("pipeline.toml:2") && text.contains("longer_than_s"), "{text}");
    c.edit("pipeline.toml", "\"long\"", "-1.0");
    let (ok, text) = koehler(&["check", "pipeline.toml"]);
    assert!(!ok && text.contains("zero or more seconds, not -1"), "{text}");
    c.edit("pipeline.toml", "-1.0", "5.0");
    let (ok, text) = koehler(&["run", "pipeline.toml"]);
    assert!(ok, "{text}");
    assert_eq!(std::fs::read_dir(c.path("out/lengths")).expect("its table").count(), 3);
    assert!(
        std::fs::read_to_string(c.path("out/report/index.html"))
            .expect("a page")
            .contains("<section id=\"lengths\"")
    );
    let (_, text) = koehler(&["run", "pipeline.toml"]);
    assert!(text.contains("nothing to do"), "{text}");
    c.edit("pipeline.toml", "longer_than_s = 5.0", "longer_than_s = 6.0");
    let (_, text) = koehler(&["status", "pipeline.toml"]);
    assert!(text.contains("setting `longer_than_s` changed"), "{text}");
}
