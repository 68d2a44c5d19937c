//! An entry of the study file's list of designs in; the designs that it stands for out.

use super::settings::{Each, Row};
use crate::simulate::Maneuver;

/// Name of the design that a search found.
pub const SEARCHED: &str = "searched";

/// One input design.
#[derive(Debug, Clone)]
pub struct Design {
    /// Its name in the tables: also that of its flight, which names its random numbers.
    pub name: String,
    /// Key of the entry that it comes from.
    pub key: String,
    /// The signal.
    pub maneuver: Maneuver,
    /// How many times it is flown.
    pub repeats: u32,
}

impl Design {
    /// What it is, in words: `3211, 1 s, amplitude 2.5`.
    pub fn words(&self) -> String {
        let m = &self.maneuver;
        let mut words = vec![m.kind.clone()];
        words.extend(m.unit_time_s.map(|t| format!("{} s", short(t))));
        words.extend(m.duration_s.map(|t| format!("{} s", short(t))));
        let sign = f64::from(m.polarity);
        words.extend(m.amplitude.map(|a| format!("amplitude {}", short(sign * a))));
        words.extend(m.amplitudes.as_ref().map(|all| {
            let all: Vec<String> = all.iter().map(|a| short(sign * a)).collect();
            format!("amplitudes {}", all.join(" "))
        }));
        words.extend((self.repeats > 1).then(|| format!("{} times", self.repeats)));
        words.join(", ")
    }
}

/// At most four digits.
fn short(x: f64) -> String {
    let scale = 10f64.powi(3 - x.abs().max(1e-300).log10().floor() as i32);
    format!("{}", (x * scale).round() / scale)
}

/// The designs of all entries, in order: unit times vary slowest, then durations, amplitudes,
/// polarities and repeats. Numbers count through all of them.
pub fn expand(rows: &[Row], input: &str) -> Vec<Design> {
    let mut designs = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        let mut of_row = combinations(row, input, &format!("row.{i}"));
        let several = of_row.len() > 1;
        for (k, design) in of_row.iter_mut().enumerate() {
            let number = format!("d{:02}", designs.len() + k + 1);
            design.name = match &row.name {
                Some(name) if several => format!("{name}-{}", k + 1),
                Some(name) => name.clone(),
                None => number,
            };
        }
        designs.append(&mut of_row);
    }
    designs
}

fn combinations(row: &Row, input: &str, key: &str) -> Vec<Design> {
    let mut all = vec![Design {
        name: String::new(),
        key: key.to_string(),
        maneuver: plain(row, input),
        repeats: 1,
    }];
    vary(&mut all, Each::all(row.unit_time_s.as_ref()), |d, v| d.maneuver.unit_time_s = v);
    vary(&mut all, Each::all(row.duration_s.as_ref()), |d, v| d.maneuver.duration_s = v);
    vary(&mut all, Each::all(row.amplitude.as_ref()), |d, v| d.maneuver.amplitude = v);
    vary(&mut all, Each::all(row.polarity.as_ref()), |d, v| d.maneuver.polarity = v.unwrap_or(1));
    vary(&mut all, Each::all(row.repeats.as_ref()), |d, v| d.repeats = v.unwrap_or(1));
    all
}

/// Each design once for every value.
fn vary<T: Copy>(all: &mut Vec<Design>, values: Vec<Option<T>>, set: fn(&mut Design, Option<T>)) {
    let with = |design: &Design, value: Option<T>| {
        let mut design = design.clone();
        set(&mut design, value);
        design
    };
    *all = all.iter().flat_map(|d| values.iter().map(move |v| with(d, *v))).collect();
}

fn plain(row: &Row, input: &str) -> Maneuver {
    Maneuver {
        input: input.to_string(),
        kind: row.kind.clone(),
        unit_time_s: None,
        amplitude: None,
        amplitudes: row.amplitudes.clone(),
        polarity: 1,
        edge_s: row.edge_s,
        duration_s: None,
        band_hz: row.band_hz,
        period_s: row.period_s,
        cycles: None,
        times_s: row.times_s.clone(),
        values: row.values.clone(),
        with: Vec::new(),
    }
}
