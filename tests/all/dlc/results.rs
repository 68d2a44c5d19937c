//! The folder of a run of the ATTAS campaign in; what tests and tables ask of it out.

use koehler::table::{Table, read_dataset};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Landing flap from which on a value counts as that of 14 deg, rad.
const BETWEEN: f64 = 0.13;
/// A change of level moves the pitch rate for this long, s; this long after the last one it is
/// steady again.
const CHANGING_S: f64 = 1.0;
const SETTLED_S: f64 = 3.0;

pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/attas")
}

/// One estimate of a parameter common to all maneuvers, to a setting of the landing flap, or to a
/// flight.
#[derive(Debug, Clone)]
pub struct Row {
    pub parameter: String,
    pub unit: String,
    pub per: String,
    pub of: Option<String>,
    pub value: f64,
    pub sd: f64,
    /// By the Cramer-Rao bound for white residuals.
    pub crlb: f64,
}

impl Row {
    /// Whether it is one of the landing flap at 14 deg.
    pub fn out(&self) -> bool {
        self.per == "eta_k"
            && self.of.as_ref().is_some_and(|of| of.parse::<f64>().is_ok_and(|k| k > BETWEEN))
    }

    /// The parameter, with the landing flap where there is a value for each setting.
    pub fn name(&self) -> String {
        match self.per.as_str() {
            "eta_k" => format!("{}, {} deg", self.parameter, if self.out() { 14 } else { 1 }),
            _ => self.parameter.clone(),
        }
    }

    /// The constant of the truth that this is an estimate of.
    pub fn truth(&self) -> f64 {
        let name =
            if self.out() { format!("{}_14", self.parameter) } else { self.parameter.clone() };
        true_value(&name)
    }

    /// (estimate - truth)/sd.
    pub fn off(&self) -> f64 {
        (self.value - self.truth()) / self.sd
    }
}

/// A constant of the truth's aerodynamics, or of the aircraft.
pub fn true_value(name: &str) -> f64 {
    static TRUTH: OnceLock<[toml::Table; 2]> = OnceLock::new();
    let [truth, aircraft] = TRUTH.get_or_init(|| {
        ["truth_aerodynamics.model.toml", "aircraft.toml"].map(|file| {
            let text = std::fs::read_to_string(folder().join(file)).expect("the truth");
            toml::from_str(&text).expect("a table")
        })
    });
    let value = |table: &toml::Value| table.get("value").and_then(toml::Value::as_float);
    // an estimated constant has a name of its own
    let name = name.trim_end_matches("_free");
    let constants = truth["constants"].as_table().expect("constants");
    constants
        .get(name)
        .and_then(value)
        .or_else(|| aircraft.get(name).and_then(value))
        .unwrap_or_else(|| panic!("the truth has no {name}"))
}

/// A run's tables.
pub struct Results {
    out: PathBuf,
    estimates: Table,
}

impl Results {
    pub fn of(out: &Path) -> Results {
        let estimates = read_dataset(out, "estimates").unwrap_or_else(|e| panic!("{e}"));
        Results { out: out.to_path_buf(), estimates }
    }

    pub fn table(&self, name: &str) -> Table {
        read_dataset(&self.out, name).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The estimates of `model` that hold for more than one maneuver.
    pub fn rows(&self, model: &str) -> Vec<Row> {
        let table = &self.estimates;
        let text = |name: &str| table.strings(name).expect("a column");
        let (models, names, units, per, stops) =
            (text("model"), text("parameter"), text("unit"), text("per"), text("stop"));
        let of = table.opt_strings("of").expect("a column");
        let number = |name: &str| table.f64(name).expect("a column");
        let (values, sds, crlbs) = (number("value"), number("sd"), number("sd_crlb"));
        let of_model = (0..table.rows()).filter(|i| models[*i] == model && per[*i] != "segment");
        let row = |i: usize| {
            assert_eq!(stops[i], "converged", "{model}");
            Row {
                parameter: names[i].to_string(),
                unit: units[i].to_string(),
                per: per[i].to_string(),
                of: of[i].map(str::to_string),
                value: values[i],
                sd: sds[i],
                crlb: crlbs[i],
            }
        };
        of_model.filter(|i| sds[*i].is_finite()).map(row).collect()
    }

    /// The derivatives: estimates for all flights, or for a setting of the landing flap.
    pub fn derivatives(&self, model: &str) -> Vec<Row> {
        self.rows(model).into_iter().filter(|row| row.per != "flight").collect()
    }

    /// One of them, by `Row::name`.
    pub fn find(&self, model: &str, name: &str) -> Option<Row> {
        self.derivatives(model).into_iter().find(|row| row.name() == name)
    }

    pub fn one(&self, model: &str, name: &str) -> Row {
        self.find(model, name).unwrap_or_else(|| panic!("{model}: {name}"))
    }

    /// Last determinant of R.
    pub fn det_r(&self, model: &str) -> f64 {
        let table = self.table("iterations");
        let (models, det) = (table.strings("model").unwrap(), table.f64("det_r").unwrap());
        (0..table.rows()).rfind(|i| models[*i] == model).map(|i| det[i]).expect("iterations")
    }

    /// Root mean square of the residuals of an output over all maneuvers.
    pub fn rms(&self, model: &str, output: &str) -> f64 {
        let table = self.table("residuals");
        let (models, outputs) = (table.strings("model").unwrap(), table.strings("output").unwrap());
        let segments = table.opt_strings("segment").unwrap();
        let (rms, n) = (table.f64("rms").unwrap(), table.i64("n").unwrap());
        let rows = (0..table.rows())
            .filter(|i| models[*i] == model && outputs[*i] == output && segments[*i].is_some());
        let (square, count) =
            rows.fold((0.0, 0.0), |s, i| (s.0 + rms[i] * rms[i] * n[i] as f64, s.1 + n[i] as f64));
        (square / count).sqrt()
    }

    /// Steps of the 3211s of the flaps alone, by segment: times on the flight's clock.
    fn changes(&self) -> BTreeMap<String, Vec<f64>> {
        let table = self.table("segments");
        let text = |name: &str| table.strings(name).unwrap();
        let (names, inputs, kinds) = (text("segment"), text("input"), text("kind"));
        let (starts, units) = (table.f64("t_start_s").unwrap(), table.f64("unit_time_s").unwrap());
        let rows = (0..table.rows()).filter(|i| inputs[*i] == "dlc" && kinds[*i] == "3211");
        let steps = |i: usize| [0.0, 3.0, 5.0, 6.0, 7.0].map(|k| starts[i] + k * units[i]).to_vec();
        rows.map(|i| (names[i].to_string(), steps(i))).collect()
    }

    /// R.m.s. residual of the pitch rate in the flaps' maneuvers: within a second of a change of
    /// level, and from three seconds after the last change on.
    pub fn pitch_rate(&self, model: &str) -> [f64; 2] {
        let (table, changes) = (self.table("responses"), self.changes());
        let text = |name: &str| table.strings(name).unwrap();
        let (models, segments, outputs) = (text("model"), text("segment"), text("output"));
        let (t, residual) = (table.f64("t_s").unwrap(), table.f64("residual").unwrap());
        let mut sums = [(0.0, 0.0); 2];
        for i in (0..table.rows()).filter(|i| models[*i] == model && outputs[*i] == "q") {
            let Some(steps) = changes.get(segments[i]) else { continue };
            let changing = steps.iter().any(|step| t[i] >= *step && t[i] < step + CHANGING_S);
            let settled = t[i] > steps[4] + SETTLED_S;
            if residual[i].is_finite() && (changing || settled) {
                let sum = &mut sums[usize::from(!changing)];
                *sum = (sum.0 + residual[i] * residual[i], sum.1 + 1.0);
            }
        }
        sums.map(|(square, n)| (square / n).sqrt())
    }
}
