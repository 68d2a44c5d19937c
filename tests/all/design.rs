//! Studies of input designs through the program: a small one of the Citation, one with a design that
//! cannot be flown, and (slowly) the paper's 18 with its findings.

use crate::flightdata::copy;
use koehler::table::{Table, read_dataset};
use std::path::Path;
use std::process::Output;

/// The shipped study with other designs, as a file of its own beside it.
fn study(folder: &Path, rows: &str) {
    let text = std::fs::read_to_string(folder.join("design.toml")).expect("the shipped study");
    let head = text.split("[[row]]").next().expect("its beginning");
    let head = head.replace("optimise    = true", "").replace("= 20\n", "= 2\n");
    std::fs::write(folder.join("small.toml"), format!("{head}{rows}")).expect("written");
}

fn koehler(folder: &Path, args: &[&str]) -> Output {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    command.current_dir(folder).args(args).output().expect("started")
}

/// The study of the documentation.
fn of_the_page() -> &'static str {
    let page = include_str!("../../docs/design.md");
    let block = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next());
    block.expect("a study on the page")
}

#[test]
fn a_small_study_is_ranked_and_the_same_with_any_number_of_threads() {
    let folder = copy("citation");
    std::fs::write(folder.path().join("mine.toml"), of_the_page()).expect("written");
    for jobs in ["1", "2"] {
        let output =
            koehler(folder.path(), &["design", "mine.toml", "--out", jobs, "--jobs", jobs]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(said.contains("linear: 3 designs, 4 recordings each"), "{said}");
    }
    let part = |jobs: &str| {
        std::fs::read(folder.path().join(jobs).join("designs/part-0.parquet")).expect("the table")
    };
    assert!(part("1") == part("2"));
    let table = read_dataset(&folder.path().join("1"), "designs").expect("designs");
    let trace = table.f64("trace").expect("column");
    assert_eq!(table.strings("design").expect("column"), ["d01", "d02", "sines"]);
    assert!(trace[0] < trace[1], "2.5 V tells more than 1 V: {trace:?}");
    assert!((0..3).all(|i| table.f64("C_h_delta_error").expect("column")[i].abs() < 0.05));
}

#[test]
fn fault_a_design_that_cannot_be_flown_leaves_the_others_and_shows_in_the_exit_code() {
    let folder = copy("citation");
    study(folder.path(), "[[row]]\nkind = \"3211\"\nunit_time_s = 1.0\namplitude = [2.5, 1e5]\n");
    let file = folder.path().join("small.toml");
    let text = std::fs::read_to_string(&file).expect("the study");
    // a servo without limits, a surface without stops
    let none = |name: &str, unit: &str| {
        format!("{name} = {{ value = 1e9, unit = \"{unit}\", sd = 0.0, source = \"none\" }}\n")
    };
    let free = [("I_max_e", "A"), ("stop_up", "rad"), ("stop_down", "rad")];
    let free: String = free.iter().map(|(name, unit)| none(name, unit)).collect();
    std::fs::write(&file, text.replace("[truth]\n", &format!("[truth]\n{free}"))).expect("written");
    let output = koehler(folder.path(), &["design", "small.toml"]);
    let (said, wrong) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(1), "{said}{wrong}");
    assert!(
        wrong.contains("small.toml:")
            && wrong.contains("design d02 (3211, 1 s, amplitude 100000): the ")
            && wrong.contains("look at the truth model's stability"),
        "{wrong}"
    );
    assert!(said.contains("1 design could not be flown"), "{said}");
    let table = read_dataset(&folder.path().join("out/small"), "designs").expect("designs");
    assert_eq!(table.strings("outcome").expect("column")[1], "not flown");
    assert!(table.f64("trace").expect("column")[0] > 0.0);
}

/// Files end at 4 kB, as on a disk that is full there.
#[cfg(unix)]
#[test]
fn fault_a_table_that_cannot_be_written_is_named_and_nothing_is_left_of_it() {
    let folder = copy("citation");
    std::fs::write(folder.path().join("mine.toml"), of_the_page()).expect("written");
    let limited = "trap '' XFSZ; ulimit -f 8; exec \"$0\" design mine.toml --out full";
    let mut command = std::process::Command::new("sh");
    command.args(["-c", limited, env!("CARGO_BIN_EXE_koehler")]);
    let output = command.current_dir(folder.path()).output().expect("started");
    let wrong = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{wrong}");
    let file = "full/designs/part-0.parquet: cannot write the file: ";
    assert!(wrong.contains(file), "{wrong}");
    let left = std::fs::read_dir(folder.path().join("full/designs")).expect("its folder");
    assert_eq!(left.count(), 0);
}

/// Trace, airspeed and rank of the 18 designs under one estimate.
fn of(table: &Table, estimate: &str) -> Vec<(f64, f64, i64)> {
    let column = |name: &str| table.f64(name).expect("column").to_vec();
    let (trace, airspeed) = (column("trace"), column("airspeed"));
    let rank = table.opt_i64("rank").expect("column");
    let (names, designs) =
        (table.strings("estimate").expect("column"), table.strings("design").expect("column"));
    (0..table.rows())
        .filter(|&i| names[i] == estimate && designs[i] != "searched")
        .map(|i| (trace[i], airspeed[i], rank[i].expect("flown")))
        .collect()
}

/// AIAA 2009-5692, section IV.C, Table 3 and Fig. 9.
#[test]
fn truth_the_findings_of_the_papers_input_design() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (a minute)");
        return;
    }
    let folder = copy("citation");
    let output = koehler(folder.path(), &["design", "design.toml"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", String::from_utf8_lossy(&output.stdout));
    let table = read_dataset(&folder.path().join("out/design"), "designs").expect("designs");
    let constant = of(&table, "constant_airspeed");
    assert_eq!(constant.len(), 18);
    let trace = |number: usize| constant[number - 1].0;
    // "The optimal 3211 input is located somewhere between a dt of 1 and 2 seconds and a maximum
    // available amplitude": rows 2 to 7.
    let best = (1..=18).min_by(|a, b| trace(*a).total_cmp(&trace(*b))).expect("18");
    assert!((2..=7).contains(&best), "the best is {best}");
    // 3 s is worse, and so are 1/3 s and less
    for worse in [1, 13, 14, 15, 16, 17, 18] {
        assert!(trace(worse) > 1.5 * trace(best), "{worse}");
    }
    // 2.5 V is better than 1 V at each unit time
    for (full, small) in [(6, 8), (7, 8), (10, 11), (13, 14), (16, 17)] {
        assert!(trace(full) < trace(small), "{full} {small}");
    }
    // the airspeed changes more with longer steps
    let full = [16, 13, 10, 6, 4, 2, 1];
    assert!(full.windows(2).all(|w| constant[w[0] - 1].1 < constant[w[1] - 1].1));
    // and that is what keeps long steps back: with the air data of the moment they gain places
    let measured = of(&table, "measured_airspeed");
    for long in [1, 2, 3] {
        assert!(measured[long - 1].2 < constant[long - 1].2, "{long}");
        assert!(measured[long - 1].0 < 0.5 * trace(long), "{long}");
    }
    // where nothing is held, the recordings scatter as the estimator says, and about the truth
    for name in ["C_h_delta", "C_h_alpha", "C_h_deltadot", "C_h_0"] {
        let column = |ending: &str| table.f64(&format!("{name}{ending}")).expect("column").to_vec();
        let (error, scatter, sd) = (column("_error"), column("_scatter"), column("_sd"));
        let names = table.strings("estimate").expect("column");
        for i in (0..table.rows()).filter(|&i| names[i] == "measured_airspeed") {
            assert!((0.5..1.7).contains(&(scatter[i] / sd[i])), "{name} {i}");
            assert!(error[i].abs() < 1.5 * sd[i], "{name} {i}: {} {}", error[i], sd[i]);
        }
    }
}
