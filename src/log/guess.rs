//! A field's name and unit in; the well-known signal it may be, and the unit its numbers may have,
//! out.

use super::decode::FieldInfo;
use crate::units::Unit;

/// A quantity that flight logs hold: signal name, SI unit, what it is, and the names that fields
/// have for it.
pub(super) struct Known {
    pub signal: &'static str,
    si: &'static str,
    pub doc: &'static str,
    names: &'static [&'static str],
}

const fn known(
    signal: &'static str,
    si: &'static str,
    doc: &'static str,
    names: &'static [&'static str],
) -> Known {
    Known { signal, si, doc, names }
}

/// Everything that is recognised by name, in the order of the starter file. Names are compared
/// without case, underscores, units. Signals that the flight-path reconstruction asks for have the
/// names it asks for.
#[rustfmt::skip]
pub(super) const KNOWN: &[Known] = &[
    known("V", "m/s", "True airspeed", &["v", "tas", "vtas", "trueairspeed", "airspeed", "truespeed"]),
    known("alpha_vane", "rad", "Angle of attack", &["alpha", "alphavane", "aoa", "angleofattack", "vaneaoa"]),
    known("beta_vane", "rad", "Angle of sideslip, wind from the right positive", &["beta", "betavane", "aos", "sideslip", "sideslipangle", "angleofsideslip"]),
    known("phi", "rad", "Bank angle, right wing down positive", &["phi", "roll", "rollangle", "rollattitude", "bank", "bankangle"]),
    known("theta", "rad", "Pitch angle, nose up positive", &["theta", "pitch", "pitchangle", "pitchattitude"]),
    known("psi", "rad", "Heading, clockwise positive", &["psi", "yaw", "yawangle", "heading", "trueheading"]),
    known("p_imu", "rad/s", "Roll rate, right wing down positive", &["p", "pimu", "rollrate", "gyrox", "angularvelocityx", "bodyrollrate"]),
    known("q_imu", "rad/s", "Pitch rate, nose up positive", &["q", "qimu", "pitchrate", "gyroy", "angularvelocityy", "bodypitchrate"]),
    known("r_imu", "rad/s", "Yaw rate, nose right positive", &["r", "rimu", "yawrate", "gyroz", "angularvelocityz", "bodyyawrate"]),
    known("ax_imu", "m/s^2", "Longitudinal specific force, forward positive", &["ax", "aximu", "accelx", "accx", "accelerationx", "linearaccelerationx", "longitudinalacceleration"]),
    known("ay_imu", "m/s^2", "Lateral specific force, right positive", &["ay", "ayimu", "accely", "accy", "accelerationy", "linearaccelerationy", "lateralacceleration"]),
    known("az_imu", "m/s^2", "Normal specific force, down positive (about -9.8 in level flight)", &["az", "azimu", "accelz", "accz", "accelerationz", "linearaccelerationz", "normalacceleration"]),
    known("h", "m", "Altitude", &["h", "alt", "altitude", "height", "pressurealtitude", "baroaltitude"]),
    known("delta_e", "rad", "Elevator deflection, trailing edge down positive", &["de", "deltae", "elevator", "elev", "elevatordeflection", "elevatorposition"]),
    known("delta_a", "rad", "Aileron deflection", &["da", "deltaa", "aileron", "ail", "xi", "ailerondeflection", "aileronposition"]),
    known("delta_r", "rad", "Rudder deflection", &["dr", "deltar", "rudder", "rud", "zeta", "rudderdeflection", "rudderposition"]),
    known("thrust", "N", "Thrust", &["thrust", "totalthrust", "netthrust"]),
    known("mass", "kg", "Mass of the aircraft", &["mass", "aircraftmass", "grossmass"]),
    known("static_pressure", "Pa", "Static pressure", &["staticpressure", "pstatic", "pressurestatic"]),
    known("q_dyn", "Pa", "Dynamic pressure", &["dynamicpressure", "qbar", "qdyn", "impactpressure"]),
    known("temperature", "K", "Static air temperature", &["statictemperature", "sat", "oat", "airtemperature", "outsideairtemperature", "temperature"]),
];

/// What drives the flight-path reconstruction, and what its path is compared with
/// (`tests/all/starter.rs` holds them against its model).
pub const INPUTS: [&str; 7] =
    ["ax_imu", "ay_imu", "az_imu", "p_imu", "q_imu", "r_imu", "temperature"];
pub const OUTPUTS: [&str; 8] =
    ["V", "alpha_vane", "beta_vane", "phi", "theta", "psi", "h", "static_pressure"];

/// Endings of field names that say the unit, longest first.
const ENDINGS: &[(&str, &str)] = &[
    ("_rad_s2", "rad/s^2"),
    ("_radps2", "rad/s^2"),
    ("_deg_s2", "deg/s^2"),
    ("_rad_s", "rad/s"),
    ("_radps", "rad/s"),
    ("_rps", "rad/s"),
    ("_deg_s", "deg/s"),
    ("_degps", "deg/s"),
    ("_dps", "deg/s"),
    ("_m_s2", "m/s^2"),
    ("_mps2", "m/s^2"),
    ("_ms2", "m/s^2"),
    ("_m_s", "m/s"),
    ("_mps", "m/s"),
    ("_ft_min", "ft/min"),
    ("_fpm", "ft/min"),
    ("_rad", "rad"),
    ("_deg", "deg"),
    ("_degc", "degC"),
    ("_hpa", "hPa"),
    ("_pa", "Pa"),
    ("_kg", "kg"),
    ("_kts", "kt"),
    ("_kt", "kt"),
    ("_knots", "kt"),
    ("_ft", "ft"),
    ("_nm", "N m"),
    ("_n", "N"),
    ("_k", "K"),
    ("_g", "g"),
    ("_m", "m"),
    ("_s", "s"),
    ("_pct", "%"),
    ("_percent", "%"),
];

/// The unit of a field: what the schema says, or what the end of its name says; `None` where
/// neither says a known unit.
pub(super) fn unit_of(field: &FieldInfo) -> Option<(String, &'static str)> {
    if !field.unit.is_empty() && Unit::parse(&field.unit).is_ok() {
        return Some((field.unit.clone(), "from the schema"));
    }
    let (_, unit) = ending(&field.path)?;
    Unit::parse(unit).is_ok().then(|| (unit.to_string(), "guessed from the name"))
}

fn ending(path: &str) -> Option<(&'static str, &'static str)> {
    let lower = path.to_lowercase();
    ENDINGS.iter().find(|(end, _)| lower.ends_with(end) && lower.len() > end.len()).copied()
}

/// The well-known signal that a field may be: its name fits, and its unit (if known) does not
/// contradict.
pub(super) fn signal_of(field: &FieldInfo) -> Option<&'static Known> {
    let lower = field.path.to_lowercase();
    let stem = ending(&field.path).and_then(|(end, _)| lower.strip_suffix(end)).unwrap_or(&lower);
    let plain = |s: &str| s.chars().filter(|c| c.is_alphanumeric()).collect::<String>();
    let last = stem.rsplit('.').next().unwrap_or(stem);
    let (whole, last) = (plain(stem), plain(last));
    let unit = unit_of(field).and_then(|(unit, _)| Unit::parse(&unit).ok());
    let fits = |k: &&Known| {
        let named = k.names.contains(&last.as_str())
            || k.names.iter().any(|n| n.len() > 4 && whole.ends_with(n));
        let dim = Unit::parse(k.si).ok().map(|u| u.dim);
        named && unit.is_none_or(|u| Some(u.dim) == dim)
    };
    KNOWN.iter().find(fits)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guess(path: &str, unit: &str) -> (Option<&'static str>, Option<String>) {
        let field = FieldInfo { path: path.into(), unit: unit.into(), doc: String::new() };
        (signal_of(&field).map(|k| k.signal), unit_of(&field).map(|u| u.0))
    }

    #[test]
    fn well_known_fields_are_recognised_and_units_must_not_contradict() {
        let text = |s: &str| Some(s.to_string());
        assert_eq!(guess("alpha_deg", ""), (Some("alpha_vane"), text("deg")));
        assert_eq!(guess("imu.angular_velocity.x", "rad/s"), (Some("p_imu"), text("rad/s")));
        assert_eq!(guess("TrueAirspeed", "kt"), (Some("V"), text("kt")));
        assert_eq!(guess("q", "Pa"), (None, text("Pa")));
        assert_eq!(guess("label", "furlong"), (None, None));
    }

    #[test]
    fn signals_have_the_names_that_the_reconstruction_asks_for() {
        use crate::model::{Constants, Given, Model};
        let place = |name: &str, unit: &str| {
            (
                name.to_string(),
                Given {
                    value: 0.0,
                    unit: unit.into(),
                    sd: 0.0,
                    source: "nowhere".into(),
                    origin: None,
                },
            )
        };
        let places = ["x_imu", "y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"]
            .map(|name| place(name, "m"));
        let model = Model::embedded(
            "kinematics",
            &Constants(places.into_iter().chain([place("upwash", "-")]).collect()),
        )
        .unwrap();
        let asked: Vec<&str> = model.inputs.iter().map(|q| q.name.as_str()).collect();
        assert!(
            asked.len() == INPUTS.len() && INPUTS.iter().all(|name| asked.contains(name)),
            "{asked:?}"
        );
        assert!(OUTPUTS.iter().all(|name| model.output(name).is_some()));
        assert!(INPUTS.iter().chain(&OUTPUTS).all(|name| KNOWN.iter().any(|k| k.signal == *name)));
    }

    #[test]
    fn every_listed_unit_exists() {
        for k in KNOWN {
            assert!(Unit::parse(k.si).is_ok(), "{}", k.si);
        }
        for (end, unit) in ENDINGS {
            assert!(Unit::parse(unit).is_ok(), "{end} {unit}");
        }
    }
}
