//! Durations of alternating steps in, the name of their pattern, its unit time and how regular they
//! are out.

/// The pattern of a multistep input, or a sweep.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Deserialize,
    serde::Serialize,
    schemars::JsonSchema,
)]
pub enum Kind {
    #[serde(rename = "3211")]
    K3211,
    #[serde(rename = "2211")]
    K2211,
    #[serde(rename = "211")]
    K211,
    #[serde(rename = "doublet")]
    Doublet,
    #[serde(rename = "step")]
    Step,
    /// Alternating steps of no listed pattern.
    #[serde(rename = "multistep")]
    Multistep,
    /// A slow triangle: from trim to one side, to the other, and back, once or more.
    #[serde(rename = "sweep")]
    Sweep,
}

impl Kind {
    pub const ALL: [Kind; 7] = [
        Kind::K3211,
        Kind::K2211,
        Kind::K211,
        Kind::Doublet,
        Kind::Step,
        Kind::Multistep,
        Kind::Sweep,
    ];

    /// The word for tables and configuration files.
    pub fn name(self) -> &'static str {
        match self {
            Kind::K3211 => "3211",
            Kind::K2211 => "2211",
            Kind::K211 => "211",
            Kind::Doublet => "doublet",
            Kind::Step => "step",
            Kind::Multistep => "multistep",
            Kind::Sweep => "sweep",
        }
    }

    /// Durations of the steps in unit times; empty for a multistep of no pattern and for a sweep.
    pub fn pattern(self) -> &'static [f64] {
        match self {
            Kind::K3211 => &[3.0, 2.0, 1.0, 1.0],
            Kind::K2211 => &[2.0, 2.0, 1.0, 1.0],
            Kind::K211 => &[2.0, 1.0, 1.0],
            Kind::Doublet => &[1.0, 1.0],
            Kind::Step => &[1.0],
            Kind::Multistep | Kind::Sweep => &[],
        }
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}", self.name())
    }
}

/// Durations seen as a pattern.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    pub kind: Kind,
    /// s
    pub unit_time: f64,
    /// Rms deviation of the durations from the pattern, in unit times; `None` where the pattern
    /// leaves none.
    pub deviation: Option<f64>,
}

/// The pattern nearest to step `durations` (s), if their rms deviation is within `tolerance` unit
/// times; a multistep otherwise.
pub(super) fn classify(durations: &[f64], tolerance: f64) -> Match {
    let of_length = Kind::ALL
        .into_iter()
        .filter(|k| !k.pattern().is_empty() && k.pattern().len() == durations.len());
    let best = of_length
        .map(|k| compare(durations, k))
        .min_by(|a, b| a.deviation.unwrap_or(0.0).total_cmp(&b.deviation.unwrap_or(0.0)));
    match best {
        Some(m) if m.deviation.unwrap_or(0.0) <= tolerance => m,
        _ => Match {
            kind: Kind::Multistep,
            unit_time: durations.iter().copied().fold(f64::INFINITY, f64::min),
            deviation: None,
        },
    }
}

/// Least-squares unit time of `durations` taken as `kind`, which has as many steps.
fn compare(durations: &[f64], kind: Kind) -> Match {
    let pattern = kind.pattern();
    let sum = |f: &dyn Fn(f64, f64) -> f64| {
        durations.iter().zip(pattern).map(|(d, k)| f(*d, *k)).sum::<f64>()
    };
    let unit_time = sum(&|d, k| d * k) / sum(&|_, k| k * k);
    let rms =
        (sum(&|d, k| (d / unit_time - k) * (d / unit_time - k)) / pattern.len() as f64).sqrt();
    Match { kind, unit_time, deviation: (pattern.len() > 1).then_some(rms) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_patterns_are_named_at_any_unit_time() {
        for kind in Kind::ALL.into_iter().filter(|k| !k.pattern().is_empty()) {
            for unit in [0.25, 1.0, 3.0] {
                let durations: Vec<f64> = kind.pattern().iter().map(|k| k * unit).collect();
                let m = classify(&durations, 0.3);
                assert_eq!(m.kind, kind);
                assert!((m.unit_time - unit).abs() < 1e-12 && m.deviation.unwrap_or(0.0) < 1e-12);
            }
        }
    }

    #[test]
    fn other_patterns_are_multisteps() {
        for durations in
            [&[1.4, 2.4, 1.1][..], &[1.0, 1.0, 1.0, 1.0, 1.0], &[1.0, 3.0], &[1.0, 1.0, 2.0, 3.0]]
        {
            assert_eq!(classify(durations, 0.3).kind, Kind::Multistep);
        }
    }

    #[test]
    fn names_are_those_of_the_files() {
        for kind in Kind::ALL {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.name());
        }
    }
}
