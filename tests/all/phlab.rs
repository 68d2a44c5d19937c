//! A real flight at 10 Hz without a sideslip vane and without heading: is the path plausible, and
//! is it said what could not be checked?

use crate::flightdata::{copy, data, koehler};
use koehler::table::read_dataset;

#[test]
fn fault_a_real_flight_without_sideslip_vane_and_heading_says_what_it_could_not_check() {
    let Some(data) = data("citation-phlab/flight20190312_maneuvers.csv") else { return };
    let folder = copy("citation-phlab");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    koehler(folder.path(), &data, &["run", "pipeline.toml"]);
    let out = folder.path().join("out");

    // the path stays near the sensors it was made from, as far as a light aircraft in light
    // turbulence lets it
    let matched = read_dataset(&out, "pathmatch").expect("pathmatch");
    let (names, z, y) = (
        matched.strings("channel").unwrap(),
        matched.f64("measured").unwrap(),
        matched.f64("reconstructed").unwrap(),
    );
    for (channel, limit) in
        [("V", 1.0), ("alpha_vane", 0.005), ("theta", 0.005), ("phi", 0.01), ("h", 5.0)]
    {
        let e: Vec<f64> =
            (0..matched.rows()).filter(|&k| names[k] == channel).map(|k| z[k] - y[k]).collect();
        assert!(
            e.len() > 3000 && e.iter().all(|e| e.is_finite()),
            "{channel}: {} samples",
            e.len()
        );
        let rms = (e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64).sqrt();
        println!("{channel}: r.m.s. of measured less reconstructed {rms:.4}");
        assert!(rms < limit, "{channel}: {rms}");
    }

    // with level wings the angle of attack is the pitch angle less that of the climb, by an
    // altitude rate that the path has not seen
    let samples = read_dataset(&out, "samples").expect("samples");
    let column = |name: &str| samples.f64(name).expect("a column");
    let level = (0..samples.rows()).filter(|&k| column("phi")[k].abs() < 0.1);
    let flow = |k: usize| {
        column("theta")[k] - (column("climb")[k] / column("V")[k]).asin() - column("alpha")[k]
    };
    let e: Vec<f64> = level.map(flow).filter(|e| e.is_finite()).collect();
    let (mean, square) = (
        e.iter().sum::<f64>() / e.len() as f64,
        e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64,
    );
    println!(
        "angle of attack against pitch less climb: mean {mean:.5} rad, r.m.s. {:.5} rad of {} samples",
        square.sqrt(),
        e.len()
    );
    assert!(
        e.len() > 4000 && mean.abs() < 0.003 && square.sqrt() < 0.02,
        "{mean} {}",
        square.sqrt()
    );

    // nothing measures heading: no number is made up for it
    let path = read_dataset(&out, "flightpath").expect("flightpath");
    assert!(path.f64("psi").unwrap().iter().all(|v| v.is_nan()), "a heading out of nothing");
    let sd = path.f64("beta_sd").unwrap();
    assert!(
        sd.iter().all(|sd| sd.is_nan() || *sd > 1e-3),
        "a sideslip as sharp as if it were measured"
    );
    let notes = read_dataset(&out, "notes").expect("notes");
    let texts = notes.strings("text").unwrap();
    let said = |what: &str| texts.iter().any(|t| t.contains(what));
    assert!(said("no sensor determines psi: there is no path of psi"), "{texts:?}");
    assert!(said("not measured, so not checked: beta_vane, psi"), "{texts:?}");
    // noise that was given is not called too small to be told
    assert!(!said("filtered before they were logged"), "{texts:?}");
}
