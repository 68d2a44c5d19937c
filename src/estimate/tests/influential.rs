//! The sample on which an estimate hangs: what is foretold is what happens without it.

use super::hazards::{DELAYED, empty, flown, model};
use crate::dynamics::Record;
use crate::estimate::{Estimation, Settings, Stop, estimate};

#[test]
fn a_sample_on_which_an_estimate_hangs_is_named_and_its_effect_foretold() {
    let model = model(&DELAYED.replace("OF", "u").replace("tau = {", "# tau = {"));
    let mut record = flown(&model, &[1.2, 0.6], empty(200, 20, 1), 7, 0.01);
    let estimated = |record: &Record| -> Estimation {
        let e = estimate(&model, std::slice::from_ref(record), &Settings::default()).unwrap();
        assert_eq!(e.stop, Stop::Converged);
        e
    };
    assert_eq!(estimated(&record).influential, None);

    let at = 60;
    record.channels[0].z[at] += 1.5;
    let with = estimated(&record);
    let found = with.influential.clone().unwrap();
    assert_eq!((found.segment, &*found.output, found.t), (0, "x", record.channels[0].t[at]));
    assert!(found.residual > 10.0, "{found:?}");

    record.channels[0].z[at] = f64::NAN;
    let without = estimated(&record);
    let row = &with.rows[found.row];
    let shift = (without.rows[found.row].value - row.value) / row.sd.unwrap();
    assert!((shift - found.shift).abs() < 0.1 * shift.abs(), "{shift}, {found:?}");
    assert_eq!(without.influential, None);
}
