//! The Citation's campaign recorded anew, with friction that the model of its elevator does not have: is it named?
//!
//! Slow: needs `KOEHLER_SLOW=1`, in release mode, some two minutes a recording; `KOEHLER_SEEDS=20` says how many recordings,
//! `3-5` which.

use crate::flightdata::{copy, koehler, seeds, slow};
use crate::real::{classes, diagnose, findings};

#[test]
fn recovery_of_friction_hidden_in_recordings_of_the_citation() {
    if !slow() {
        return;
    }
    let (mut right, mut all) = (0, 0);
    for seed in seeds() {
        let folder = copy("citation");
        let campaign = folder.path().join("campaign.toml");
        let text = std::fs::read_to_string(&campaign).expect("the campaign");
        let shipped = "seed         = 20090810";
        assert!(text.contains(shipped), "its seed");
        let anew = text.replace(shipped, &format!("seed = {}", 7000 + seed));
        std::fs::write(&campaign, anew).expect("written");
        koehler(folder.path(), folder.path(), &["simulate", "campaign.toml"]);
        let code = diagnose(folder.path(), folder.path(), &["no-friction.toml"]);
        let out = folder.path().join("out/no-friction");
        let (verdict, classes) = (findings(&out).0, classes(&out));
        println!("{seed}: {code:?} {verdict}, {classes:?}");
        let is_friction = |class: &Vec<String>| class.iter().any(|n| n == "hinge-friction:delta_e");
        // Named, or one of two.
        let found = ["named", "one of these"].contains(&&*verdict)
            && classes.iter().any(|class| class.len() <= 2 && is_friction(class));
        all += 1;
        right += u32::from(found && code == Some(3));
    }
    println!("friction is named in {right} of {all} recordings");
    assert!(f64::from(right) >= 0.9 * f64::from(all), "{right} of {all}");
}
