//! `aircraft` of the pipeline file comes in; the constants, those among them that other pipelines
//! have estimated, or the mistakes, go out.
//!
//! A value is taken with its total standard deviation and with its covariance with the others that
//! are taken from the same estimate. Both hold the noise of that estimate and the constants that it
//! assumed itself (its `budget`): `cov_ij = r_ij sd_i sd_j + sum_c s_ic s_jc sd_c^2`.

use crate::config;
use crate::error::{Error, Errors};
use crate::model::{Constants, Given as Constant, Origin};
use crate::pipeline::out_folder;
use crate::pipeline::settings::{Aircraft, Entry, Taken};
use crate::stage::check::Given;
use crate::stage::estimate;
use crate::table::{Table, read_dataset};
use crate::units::Unit;
use indexmap::IndexMap;
use std::path::{Path, PathBuf};

/// Another pipeline whose results this one takes: a run makes it first.
#[derive(Debug)]
pub struct Source {
    pub pipeline: PathBuf,
    /// The values that it does not have, and why: it was never run, or an estimate failed.
    pub lacking: Errors,
}

/// The estimates of another pipeline file, checked.
pub type Estimates<'a> = &'a dyn Fn(&Path) -> std::result::Result<Vec<estimate::Config>, Errors>;

/// The constants of all entries; none where one has mistakes. `chain` are the pipeline files that
/// want them, this one last.
pub fn read(
    given: &mut Given,
    said: &Aircraft,
    chain: &[PathBuf],
    estimates: Estimates,
) -> (Option<Constants>, Vec<Source>) {
    let (mut all, mut sources, mut sound) = (Constants::default(), Vec::new(), true);
    let one = matches!(said, Aircraft::One(_));
    for (i, entry) in said.entries().into_iter().enumerate() {
        let key = if one { "aircraft".to_string() } else { format!("aircraft.{i}") };
        let found = match &entry {
            Entry::File(name) => file(given, &key, name),
            Entry::Taken(taken) => {
                values(given, &key, taken, (chain, estimates)).map(|(found, source)| {
                    sources.push(source);
                    found
                })
            }
        };
        sound &= found.is_some();
        for (name, constant) in found.into_iter().flat_map(|found| found.0) {
            if let Some(earlier) = all.0.get(&name) {
                let what = format!("\"{name}\" is there already: {}", earlier.source);
                given.push(&key, what, "a constant has one value: take it away in one of them");
                sound = false;
            }
            all.0.insert(name, constant);
        }
    }
    (sound.then_some(all), sources)
}

fn file(given: &mut Given, key: &str, name: &str) -> Option<Constants> {
    if !given.names_a_file(key, name) {
        return None;
    }
    let path = given.path(name);
    let (constants, doc) = given.errors.take(config::load::<Constants>(&path))?;
    let before = given.errors.0.len();
    for (name, constant) in &constants.0 {
        if POSITIVE.contains(&(name.as_str(), constant.unit.as_str())) && !(constant.value > 0.0) {
            let text = format!("{name} is {} {}", constant.value, constant.unit);
            let error = doc.error(&format!("{name}.value"), text);
            given
                .errors
                .push(error.help("a mass, an inertia, an area or a length is larger than zero"));
        }
    }
    (given.errors.0.len() == before).then_some(constants)
}

/// Constants that cannot be zero or less, with their units. Others in these units can: what is added to a mass.
const POSITIVE: [(&str, &str); 8] = [
    ("m", "kg"),
    ("mass", "kg"),
    ("S", "m^2"),
    ("b", "m"),
    ("c", "m"),
    ("I_x", "kg m^2"),
    ("I_y", "kg m^2"),
    ("I_z", "kg m^2"),
];

/// What one entry takes; none where it asks for what the other pipeline does not estimate.
fn values(
    given: &mut Given,
    key: &str,
    taken: &Taken,
    (chain, estimates): (&[PathBuf], Estimates),
) -> Option<(Constants, Source)> {
    if !given.names_a_file(&format!("{key}.from"), &taken.from) {
        return None;
    }
    let path = given.path(&taken.from);
    if chain.contains(&canonical(&path)) {
        let what = format!("{} takes values from here, itself or by others", path.display());
        given.push(&format!("{key}.from"), what, "results cannot depend on themselves");
        return None;
    }
    let estimates = &given.errors.take(estimates(&path))?[..];
    if let Some(wanted) = &taken.estimate
        && estimates.iter().all(|e| e.name() != *wanted)
    {
        let names: Vec<String> = estimates.iter().map(estimate::Config::name).collect();
        given.unknown(&format!("{key}.estimate"), "[[estimate]]", wanted, &names);
        return None;
    }
    let tables = Tables::read(&out_folder(&path));
    let (mut found, mut lacking, mut rows) = (Constants::default(), Errors::default(), Vec::new());
    let mut sound = true;
    for (j, name) in taken.take.iter().enumerate() {
        let key = format!("{key}.take.{j}");
        let Some(place) = estimated(given, &key, taken, name, estimates) else {
            sound = false;
            continue;
        };
        let base = &estimates[place];
        let row = tables.row(&base.name(), name);
        let row = match row {
            Ok(row) => row,
            Err(what) => {
                let what = format!("{}: \"{name}\" of {} {what}", taken.from, base.name());
                lacking.push(given.doc.error(&key, what));
                Row::default()
            }
        };
        found.0.insert(name.clone(), constant(base, name, &row, &taken.from)?);
        rows.push((base.name(), name.clone(), row));
    }
    for (estimate, name, row) in &rows {
        let of = |(_, other, r): &(String, String, Row)| {
            Some((other.clone(), tables.covariance(estimate, (name, row), (other, r))?))
        };
        let with: IndexMap<String, f64> = rows
            .iter()
            .filter(|(e, other, _)| e == estimate && other != name)
            .filter_map(of)
            .collect();
        if let Some(Constant { origin: Some(origin), .. }) = found.0.get_mut(name) {
            origin.with = with;
        }
    }
    sound.then_some((found, Source { pipeline: path, lacking }))
}

/// Place of the one estimate that has a parameter of this name free.
fn estimated(
    given: &mut Given,
    key: &str,
    taken: &Taken,
    name: &str,
    estimates: &[estimate::Config],
) -> Option<usize> {
    let asked = |e: &estimate::Config| taken.estimate.as_ref().is_none_or(|n| *n == e.name());
    let of = |e: &estimate::Config| -> Vec<String> {
        let free = e.settings.method.free.as_ref();
        let names = e.model.parameters.iter().filter(|p| match free {
            Some(free) => free.contains(&p.quantity.name),
            None => !p.fixed,
        });
        names.map(|p| p.quantity.name.clone()).collect()
    };
    let places: Vec<usize> = (0..estimates.len())
        .filter(|&i| asked(&estimates[i]) && of(&estimates[i]).iter().any(|n| n == name))
        .collect();
    match places[..] {
        [place] => Some(place),
        [] => {
            let mut known: Vec<String> =
                estimates.iter().filter(|e| asked(e)).flat_map(of).collect();
            known.sort();
            known.dedup();
            given.unknown(key, &format!("estimated parameter in {}", taken.from), name, &known);
            None
        }
        _ => {
            let names: Vec<String> = places.iter().map(|&i| estimates[i].name()).collect();
            let what = format!(
                "\"{name}\" is estimated {} times in {}: by {}",
                names.len(),
                taken.from,
                config::list(&names)
            );
            given.push(key, what, "say which one beside `take`: estimate = \"...\"");
            None
        }
    }
}

/// The constant that an estimate's value makes. Where there is no value yet, that of the model's
/// file stands in, so that everything else can be checked.
fn constant(base: &estimate::Config, name: &str, row: &Row, from: &str) -> Option<Constant> {
    let parameter = &base.model.parameters[base.model.parameter(name)?];
    let unit = Unit::parse(&parameter.quantity.unit).ok()?;
    let (value, sd) = if row.there { (row.value, row.sd_total) } else { (parameter.start, 0.0) };
    Some(Constant {
        value: unit.to_si(value),
        sd: sd * unit.scale,
        unit: if unit.is_si() { parameter.quantity.unit.clone() } else { unit.dim.to_string() },
        source: format!("{from}: estimate {}", base.name()),
        origin: Some(Origin { from: from.to_string(), with: IndexMap::new() }),
    })
}

/// A parameter's row of the table `estimates`, in the unit of the parameter.
#[derive(Debug, Clone, Default)]
struct Row {
    there: bool,
    group: String,
    value: f64,
    sd: f64,
    sd_total: f64,
}

/// The other pipeline's tables, as far as they are there.
struct Tables {
    estimates: Option<Table>,
    correlations: Option<Table>,
    budget: Option<Table>,
}

impl Tables {
    fn read(folder: &Path) -> Tables {
        let table = |name| read_dataset(folder, name).ok();
        Tables {
            estimates: table("estimates"),
            correlations: table("correlations"),
            budget: table("budget"),
        }
    }

    /// The one value of a parameter, or why there is none.
    fn row(&self, estimate: &str, name: &str) -> Result<Row, String> {
        let never = || "has no value yet: it has not been estimated there".to_string();
        let table = self.estimates.as_ref().ok_or_else(never)?;
        let read = || -> crate::error::Result<Vec<(Row, String, bool)>> {
            let (models, names) = (table.strings("model")?, table.strings("parameter")?);
            let (groups, stops) = (table.strings("group")?, table.strings("stop")?);
            let (value, sd) = (table.f64("value")?, table.f64("sd")?);
            let (total, bound) = (table.f64("sd_total")?, table.bools("at_bound")?);
            let here = (0..table.rows()).filter(|&i| models[i] == estimate && names[i] == name);
            let row = |i: usize| {
                let there = value[i].is_finite() && sd[i].is_finite();
                let total = if total[i].is_finite() { total[i] } else { sd[i] };
                let group = groups[i].to_string();
                let row = Row { there, group, value: value[i], sd: sd[i], sd_total: total };
                (row, stops[i].to_string(), bound[i])
            };
            Ok(here.map(row).collect())
        };
        let rows = read().map_err(|e| format!("cannot be read: {e}"))?;
        match &rows[..] {
            [] => Err(never()),
            [(_, stop, _)] if stop != "converged" => {
                Err(format!("has not converged there: its estimate ended as \"{stop}\""))
            }
            [(_, _, true)] => Err("sits on a bound there and has no standard deviation".into()),
            [(row, ..)] if !row.there => Err("has no standard deviation there".into()),
            [(row, ..)] => Ok(row.clone()),
            _ => Err(format!(
                "has {} values there, one per maneuver or flight: take one of an estimate of all (`group = \"all\"`)",
                rows.len()
            )),
        }
    }

    /// The correlation of the total errors of two values of one estimate; none where it is not known
    /// or they are of different groups.
    fn covariance(
        &self,
        estimate: &str,
        (a, one): (&str, &Row),
        (b, other): (&str, &Row),
    ) -> Option<f64> {
        if !(one.there && other.there) || one.group != other.group {
            return None;
        }
        let noise = self.correlation(estimate, &one.group, [a, b]).unwrap_or(0.0);
        let (first, second) = (self.shares(estimate, one, a), self.shares(estimate, other, b));
        let assumed: f64 =
            first.iter().filter_map(|(c, s)| Some(s * second.get(c).copied()?)).sum();
        let r = (noise * one.sd * other.sd + assumed) / (one.sd_total * other.sd_total);
        r.is_finite().then_some(r.clamp(-1.0, 1.0))
    }

    /// Correlation of the noise of two parameters.
    fn correlation(&self, estimate: &str, group: &str, pair: [&str; 2]) -> Option<f64> {
        let table = self.correlations.as_ref()?;
        let column = |name| table.strings(name).ok();
        let (models, groups) = (column("model")?, column("group")?);
        let (a, b, value) = (column("parameter")?, column("other")?, table.f64("value").ok()?);
        let here = |i: &usize| {
            let both = [a[*i], b[*i]];
            models[*i] == estimate
                && groups[*i] == group
                && (both == pair || both == [pair[1], pair[0]])
        };
        (0..table.rows()).find(here).map(|i| value[i])
    }

    /// What each assumed constant adds to a parameter, with its sign.
    fn shares(&self, estimate: &str, row: &Row, name: &str) -> IndexMap<String, f64> {
        let of = || -> Option<IndexMap<String, f64>> {
            let table = self.budget.as_ref()?;
            let column = |name| table.strings(name).ok();
            let (models, groups) = (column("model")?, column("group")?);
            let (names, constants) = (column("parameter")?, table.opt_strings("constant").ok()?);
            let slope = table.f64("sensitivity").ok()?;
            let sd = table.f64("constant_sd").ok()?;
            let here = (0..table.rows())
                .filter(|&i| models[i] == estimate && groups[i] == row.group && names[i] == name);
            let share = |i: usize| Some((constants[i]?.to_string(), slope[i] * sd[i]));
            Some(here.filter_map(share).filter(|(_, s)| s.is_finite()).collect())
        };
        of().unwrap_or_default()
    }
}

/// A path as it is compared with others.
pub fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_path_buf())
}

/// What a run says where values are missing although the other pipelines have been run.
pub fn lacking(sources: &[Source]) -> Errors {
    let all = sources.iter().flat_map(|s| {
        s.lacking.0.iter().cloned().map(|e: Error| {
            e.help(format!("see what `koehler run {}` says of it", s.pipeline.display()))
        })
    });
    Errors(all.collect())
}
