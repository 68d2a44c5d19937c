//! Calibrated airspeed and pressure altitude in, true airspeed out: the standard atmosphere.

/// Sea-level temperature, K (ISO 2533:1975, table 1).
const T0: f64 = 288.15;
/// Sea-level pressure, Pa (ISO 2533:1975, table 1).
const P0: f64 = 101_325.0;
/// Temperature gradient of the troposphere, K/m (ISO 2533:1975, table 4).
const LAPSE: f64 = 0.0065;
/// Height of the tropopause, m.
const TROPOPAUSE: f64 = 11_000.0;
/// Standard acceleration of free fall, m/s^2.
const G0: f64 = 9.80665;
/// Specific gas constant of air, J/(kg K) (ISO 2533:1975, table 1).
const R: f64 = 287.05287;
/// Ratio of specific heats.
const GAMMA: f64 = 1.4;

/// Metres per foot.
pub const FOOT: f64 = 0.3048;
/// Metres per second in a knot.
pub const KNOT: f64 = 1852.0 / 3600.0;

/// Static temperature, K, at pressure altitude `h`, m (ISO 2533:1975, Eq. 8; up to 20 km).
pub fn temperature(h: f64) -> f64 {
    T0 - LAPSE * h.min(TROPOPAUSE)
}

/// Static pressure, Pa, at pressure altitude `h`, m (ISO 2533:1975, Eq. 12; up to 20 km).
pub fn pressure(h: f64) -> f64 {
    let troposphere = P0 * libm::pow(temperature(h) / T0, G0 / (R * LAPSE));
    if h <= TROPOPAUSE {
        troposphere
    } else {
        troposphere * libm::exp(-G0 * (h - TROPOPAUSE) / (R * temperature(h)))
    }
}

/// True airspeed, m/s, from calibrated airspeed `cas`, m/s, at pressure altitude `h`, m.
///
/// The impact pressure of the calibrated airspeed at sea level,
/// `qc = p0 ((1 + (g-1)/2 (cas/a0)^2)^(g/(g-1)) - 1)`, is the one of the Mach number at `h`
/// (isentropic flow, Anderson, Introduction to Flight, Eqs. 4.77, 4.78).
pub fn true_airspeed(cas: f64, h: f64) -> f64 {
    let k = (GAMMA - 1.0) / 2.0;
    let e = GAMMA / (GAMMA - 1.0);
    let a0_squared = GAMMA * R * T0;
    let impact = P0 * (libm::pow(1.0 + k * cas * cas / a0_squared, e) - 1.0);
    let mach_squared = (libm::pow(impact / pressure(h) + 1.0, 1.0 / e) - 1.0) / k;
    (mach_squared * GAMMA * R * temperature(h)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_tables_of_the_standard_atmosphere() {
        // ISO 2533 tables: 5000 m 255.650 K, 54019.9 Pa (pressure heights); 11000 m 216.650 K,
        // 22632.0 Pa; 15000 m 12044.6 Pa.
        assert!((temperature(5000.0) - 255.65).abs() < 1e-9);
        assert!((pressure(5000.0) - 54_019.9).abs() < 0.5);
        assert!((pressure(11_000.0) - 22_632.0).abs() < 0.5);
        assert!((pressure(15_000.0) - 12_044.6).abs() < 0.5);
    }

    #[test]
    fn calibrated_is_true_at_sea_level_and_less_above() {
        for cas in [50.0, 100.0, 150.0] {
            assert!((true_airspeed(cas, 0.0) - cas).abs() < 1e-9);
        }
        // 200 kt at 17000 ft: with the incompressible formula 200/sqrt(sigma) = 260.5 kt;
        // compressibility takes off about 2 kt.
        let sigma = pressure(17_000.0 * FOOT) / P0 * T0 / temperature(17_000.0 * FOOT);
        let tas = true_airspeed(200.0 * KNOT, 17_000.0 * FOOT) / KNOT;
        let incompressible = 200.0 / sigma.sqrt();
        assert!(tas < incompressible && tas > incompressible - 4.0, "{tas} {incompressible}");
    }
}
