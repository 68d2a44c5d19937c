//! The name of a unit that is not known in; what may be meant by it, in words, out.

/// Names that say more than a unit, or less, and what to write.
const MEANT: &[(&[&str], &str)] = &[
    (&["g0", "G", "gee", "gees", "gn"], "\"g\" is the standard acceleration of gravity"),
    (
        &["kias", "kcas", "keas", "ktas"],
        "knots are \"kt\"; which speed it is (indicated, calibrated, true) belongs into `doc`",
    ),
    (
        &["mach", "bool", "counts", "count", "enum", "none", "n/a"],
        "\"1\" stands for a number without a unit",
    ),
    (&["c", "degc", "deg c", "deg_c"], "\"degC\" is the degree Celsius"),
    (&["f", "degf", "deg f", "deg_f"], "\"degF\" is the degree Fahrenheit"),
    (
        &["gal", "gals", "gallon", "gallons"],
        "gallons are of several sizes: write \"l\", and the factor as `scale`",
    ),
    (
        &["psig", "barg"],
        "a pressure above that of the air: \"psi\" or \"bar\", and the rest as `offset`",
    ),
    (&["in_hg", "in hg", "inches hg", "in.hg"], "\"inHg\" is the inch of mercury"),
    (&["ft_lb", "ft.lb", "lb_ft", "ft lb", "lb ft"], "a torque is in \"ft lbf\""),
];

/// What may be meant by a name: one that is spelt otherwise only, or says what `MEANT` knows.
pub fn hint(name: &str, known: &[&str]) -> Option<String> {
    let name = name.trim();
    let lower = name.to_lowercase();
    let said =
        MEANT.iter().find(|(names, _)| names.contains(&name) || names.contains(&lower.as_str()));
    // A letter in the other case is mostly something else: S is no second.
    let spelt = |unit: &&&str| name.len() > 1 && unit.to_lowercase() == lower;
    let mut near = known.iter().filter(spelt);
    match (said, near.next(), near.next()) {
        (Some((_, text)), _, _) => Some((*text).to_string()),
        (None, Some(one), None) => Some(format!("did you mean \"{one}\"?")),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use crate::units::Unit;

    #[test]
    fn fault_a_unit_that_is_not_known_comes_with_what_may_be_meant() {
        for (unit, wanted) in [
            ("g0", "\"g\" is the standard acceleration"),
            ("G", "\"g\" is the standard acceleration"),
            ("KIAS", "knots are \"kt\""),
            ("KIAS/s", "knots are \"kt\""),
            ("Mach", "\"1\" stands for a number"),
            ("deg C", "\"degC\" is"),
            ("in_Hg", "\"inHg\" is"),
            ("hpa", "did you mean \"hPa\"?"),
            ("MM/s", "did you mean \"mm\"?"),
            ("Deg", "did you mean \"deg\"?"),
            ("gal", "several sizes"),
        ] {
            let e = Unit::parse(unit).expect_err(unit);
            assert!(e.contains(wanted) && e.contains(unit), "{unit}: {e}");
        }
        // nothing is made up: M may be mega, S siemens
        for unit in ["furlong", "M", "S"] {
            let e = Unit::parse(unit).expect_err(unit);
            assert!(e.ends_with("is not a known unit"), "{unit}: {e}");
        }
    }
}
