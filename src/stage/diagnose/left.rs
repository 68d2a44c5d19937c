//! A diagnosis in; what the model leaves of each output, and what turbulence makes of it, in tables
//! and in words, out.

use super::Outcome;
use crate::diagnose::{Accounted, Diagnosis, Left, Turbulence, strongest};
use crate::error::Result;
use crate::math::digits;
use crate::math::distribution::INTERVAL_95;
use crate::signal::adequacy::Adequacy;
use crate::table::Table;

/// One row for each output, at the end.
pub fn unexplained(outcome: &Outcome) -> Result<Table> {
    let d = &outcome.diagnosis;
    let finite = |v: f64| if v.is_finite() { v } else { f64::NAN };
    let number =
        |of: &dyn Fn(&Left) -> f64| d.left.iter().map(|l| finite(of(l))).collect::<Vec<f64>>();
    let of = |of: fn(&Adequacy) -> f64| number(&|l| of(&l.adequacy));
    let filter = |of: fn(&Accounted) -> f64| {
        let found = |l: &Left| {
            let all = d.turbulence.iter().flat_map(|t| &t.outputs);
            all.into_iter().find(|o| o.output == l.output).map_or(f64::NAN, of)
        };
        number(&found)
    };
    Table::build("unexplained")
        .repeat("diagnosis", &outcome.config.name())
        .strings("output", d.left.iter().map(|l| &l.output))
        .strings("unit", d.left.iter().map(|l| &l.unit))
        .i64("n", d.left.iter().map(|l| l.adequacy.samples() as i64).collect::<Vec<_>>())
        .f64("noise", of(Adequacy::noise))
        .f64("left", of(Adequacy::left))
        .f64("variation", of(Adequacy::variation))
        .f64("share", of(Adequacy::share))
        .f64("bias", of(|a| a.parts()[0]))
        .f64("size", of(|a| a.parts()[1]))
        .f64("shape", of(|a| a.parts()[2]))
        .strings("leaves", d.left.iter().map(|l| l.adequacy.leaves().as_str()))
        .f64("foretold", number(&|l| l.foretold))
        .f64("turbulence", filter(|o| o.explained))
        .f64("innovations_foretold", filter(|o| o.foretold))
        .f64("filter_noise", filter(|o| o.noise))
        .finish()
}

/// One row for each density of the noise that was let drive the model.
pub fn turbulence(outcome: &Outcome) -> Result<Table> {
    let found = outcome.diagnosis.turbulence.as_ref();
    let all: Vec<_> = found.iter().flat_map(|t| &t.densities).collect();
    let lasts = |of: &dyn Fn((f64, Option<f64>)) -> f64| -> Vec<f64> {
        all.iter().map(|d| d.lasts.map_or(f64::NAN, of)).collect()
    };
    Table::build("turbulence")
        .repeat("diagnosis", &outcome.config.name())
        .strings("state", all.iter().map(|d| &d.state))
        .strings("unit", all.iter().map(|d| &d.unit))
        .f64("density", all.iter().map(|d| d.value).collect::<Vec<_>>())
        .f64("sd", all.iter().map(|d| d.sd.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .f64("lasts", lasts(&|(time, _)| time))
        .f64("lasts_sd", lasts(&|(_, sd)| sd.unwrap_or(f64::NAN)))
        .repeat("accounts", found.is_some_and(|t| t.objection.is_none()).to_string().as_str())
        .finish()
}

fn percent(share: f64) -> String {
    format!("{:.0}%", 100.0 * share)
}

/// The densities with 95% intervals: `0.237 +- 0.033 rad/s^1.5 in p`.
fn densities(found: &Turbulence) -> String {
    let all = found.densities.iter().filter(|d| d.value > 0.0);
    let one = |d: &crate::diagnose::Density| {
        let sd = d.sd.map(|sd| format!(" +- {}", digits(INTERVAL_95 * sd))).unwrap_or_default();
        let lasts = d.lasts.map(|(time, sd)| {
            let sd = sd.map(|sd| format!(" +- {}", digits(INTERVAL_95 * sd))).unwrap_or_default();
            format!(", which lasts {}{sd} s", digits(time))
        });
        let lasts = lasts.unwrap_or_default();
        format!("{}{sd} {} in the rate of {}{lasts}", digits(d.value), d.unit, d.state)
    };
    all.map(one).collect::<Vec<_>>().join(", ")
}

/// What turbulence accounts for, where it does.
pub fn but_turbulence(d: &Diagnosis) -> String {
    let found = d.turbulence.as_ref().map(densities).unwrap_or_default();
    format!(
        "Nothing is missing but turbulence that these flights could show. Noise that drives the rates accounts for what is left beyond the sensors' \
         noise, estimated by filter error (root of its spectral density, +- is 95%): {found}. The standard deviations of output error do not \
         hold here, and its estimates may be biased: give the states `noise` and estimate by filter error."
    )
}

/// What turbulence accounts for beside what is named; none where it does not.
pub fn accounted(d: &Diagnosis) -> Option<String> {
    let found = d.turbulence.as_ref().filter(|t| t.objection.is_none() && d.is_named())?;
    Some(format!(
        " What the model leaves beyond that and the sensors' noise goes with no input, and noise that drives the rates, as turbulence would, accounts \
         for it (root of its spectral density, +- is 95%): {}.",
        densities(found)
    ))
}

/// The strongest evidence that something is missing, in two sentences: the equation that lacks most
/// with what that goes with, and the outputs of which more than noise is left. Empty where there is
/// neither.
pub fn evidence(d: &Diagnosis) -> String {
    let begun = |text: String| {
        let mut letters = text.chars();
        let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
        first + letters.as_str()
    };
    let outputs = begun(outputs(d));
    [lacks(d), outputs].into_iter().filter(|text| !text.is_empty()).map(|t| t + ". ").collect()
}

/// An equation lacks something where what is left of it is this many times what noise makes of it.
const LACKS: f64 = 1.2;

fn lacks(d: &Diagnosis) -> String {
    let lacking = d.comparison.lacking_at_last();
    let Some(found) = strongest(&lacking.equations, &lacking.relations) else {
        return String::new();
    };
    let e = &found.equation;
    if e.rms < LACKS * e.noise {
        return String::new();
    }
    let name = if e.is_rate { format!("The rate of {}", e.name) } else { e.name.clone() };
    let with = match d.comparison.still_lacking {
        Some(_) => ", with what was found,",
        None => "",
    };
    let times = format!(
        "{name}{with} lacks most, {} times what noise makes of it",
        digits(e.rms / e.noise)
    );
    match &found.relation {
        Some(r) => {
            let source = r.source.strip_prefix("modelled ").unwrap_or(&r.source);
            let (is, limit) = (r.correlation, r.limit);
            format!(
                "{times}, and goes with {source}: correlation {is:.2}, by chance {limit:.2} (lag {} s)",
                digits(r.lag)
            )
        }
        None => format!("{times}, and that goes with no input or motion beyond chance"),
    }
}

/// The outputs of which more than noise is left, most first, and why turbulence does not account for what is
/// left where it was asked.
pub fn outputs(d: &Diagnosis) -> String {
    let mut poor: Vec<&Left> = d.left.iter().filter(|l| l.adequacy.is_poor()).collect();
    poor.sort_by(|a, b| b.adequacy.share().total_cmp(&a.adequacy.share()));
    let one = |l: &&Left| format!("{} of {}", percent(l.adequacy.share()), l.output);
    let all: Vec<String> = poor.iter().map(one).collect();
    let refused = d.turbulence.as_ref().and_then(|t| t.objection.as_ref());
    let refused =
        refused.map(|why| format!("turbulence in the model does not account for it: {why}"));
    if all.is_empty() {
        return refused.unwrap_or_default();
    }
    let refused = refused.map(|why| format!("; {why}")).unwrap_or_default();
    let foretold = poor.iter().map(|l| l.foretold).fold(0.0, f64::max);
    format!(
        "beyond its sensor's noise the model leaves, of the measured variation, {} (its own past foretells up to {} of that: it is no white noise){refused}",
        all.join(", "),
        percent(foretold)
    )
}
