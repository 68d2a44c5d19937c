//! Records in turbulence: is a model that leaves more than noise never called adequate, and is
//! turbulence told from what is missing?

use crate::flightdata::{copy, data, koehler};
use crate::real::{diagnose, findings};
use koehler::table::read_dataset;

/// A published record in turbulence, which output error takes for noise of the sensors.
#[test]
fn recovery_turbulence_of_a_published_record_at_any_length_of_blocks() {
    let Some(data) = data("records/y13aus_da1.asc") else { return };
    for block_s in [2.0, 2.5, 4.0, 5.0] {
        let folder = copy("y13aus");
        koehler(folder.path(), &data, &["import", "import.toml"]);
        let path = folder.path().join("pipeline.toml");
        let text = std::fs::read_to_string(&path).expect("the pipeline");
        let diagnosis = format!(
            "\n[[diagnose]]\nestimate = \"output-error\"\n[diagnose.method]\nblock_s = {block_s:?}\n"
        );
        std::fs::write(&path, text + &diagnosis).expect("written");
        let code = diagnose(folder.path(), &data, &["pipeline.toml"]);
        let out = folder.path().join("out");
        let (verdict, named) = findings(&out);
        println!("{block_s} s: {verdict}, {named:?}, {code:?}");
        // A short block may stand out among the others, which is more than turbulence.
        assert_ne!(verdict, "nothing missing", "{block_s} s");
        if block_s < 2.5 {
            continue;
        }
        assert_eq!((code, &*verdict), (Some(0), "nothing missing but turbulence"), "{block_s} s");

        // The densities are those that the record was made with (docs/filter-error.md).
        let table = read_dataset(&out, "turbulence").expect("turbulence");
        let (states, values) =
            (table.strings("state").expect("states"), table.f64("density").expect("values"));
        for (state, truth) in [("p", 0.2373), ("r", 0.1964)] {
            let row = states.iter().position(|s| *s == state).expect("a density");
            assert!((values[row] / truth - 1.0).abs() < 0.01, "{state}: {}", values[row]);
        }

        // The same rule on the page: what output error leaves is more than noise, what the filter
        // leaves is not.
        let left = read_dataset(&out, "adequacy").expect("adequacy");
        let (models, leaves) =
            (left.strings("model").expect("models"), left.strings("leaves").expect("answers"));
        let poor = |model: &str| {
            (0..left.rows())
                .filter(|&i| models[i] == model && leaves[i] == "more than noise")
                .count()
        };
        assert!(poor("output-error") >= 3 && poor("filter-error") == 0, "{models:?} {leaves:?}");
    }
}

/// The same record and a model that knows no ailerons: noise on its rates does not make up for them.
#[test]
fn recovery_an_input_that_is_missing_is_not_taken_for_turbulence() {
    let Some(data) = data("records/y13aus_da1.asc") else { return };
    let folder = copy("y13aus");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    let path = folder.path().join("lateral.model.toml");
    let text = std::fs::read_to_string(&path).expect("the model");
    assert!(text.contains("Lda*da"));
    std::fs::write(&path, text.replace("Lda*da", "0.0*Lda*da")).expect("written");
    let code = diagnose(folder.path(), &data, &["pipeline.toml", "--estimate", "output-error"]);
    let (verdict, named) = findings(&folder.path().join("out"));
    println!("{verdict}, {named:?}, {code:?}");
    assert_eq!((code, &*verdict), (Some(3), "located but unexplained"));
    let text = read_dataset(&folder.path().join("out"), "findings").expect("findings");
    let text = text.strings("text").expect("texts")[0].to_string();
    // The equation that lacks it comes first, and the objection against turbulence is the input.
    assert!(text.starts_with("L lacks most") && text.contains("goes with da"), "{text}");
}
