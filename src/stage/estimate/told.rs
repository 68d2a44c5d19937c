//! An estimation comes in; what there is to say of it, as notes, goes out.

use super::batch::{Batch, segment};
use super::config::Config;
use super::doubts;
use super::limits;
use crate::estimate::{self, Estimation, Row, Trace};
use crate::math::digits;
use crate::noise::Modelled;
use crate::stage::{Note, Severity};

/// What to say about one estimation that did not end well, or whose parameters the data hardly
/// separate.
pub fn notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let mut notes = Vec::new();
    if estimation.stop != estimate::Stop::Converged {
        let why = estimation.why.as_ref().map_or(String::new(), |why| format!(": {why}"));
        let text = format!(
            "{}: the estimate of {} ended with \"{}\"{why}",
            batch.group,
            config.name(),
            estimation.stop
        );
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    for left in &estimation.left_out {
        let segment = batch.segments.get(left.segment).cloned().unwrap_or_default();
        let text =
            format!("{segment} is left out of the estimate of {}: {}", config.name(), left.why);
        notes.push(config.note("", Severity::Missing, segment, 1, text));
    }
    for doubtful in &estimation.doubtful {
        let segment = batch.segments.get(doubtful.segment).cloned().unwrap_or_default();
        let text = format!("output {} of {segment}: {}", doubtful.output, doubtful.why);
        notes.push(config.note("", Severity::Warning, segment, 1, text));
    }
    for (segment, state) in &estimation.stuck {
        let segment = batch.segments.get(*segment).cloned().unwrap_or_default();
        let text = format!("{state} is stuck throughout {segment}: friction holds it all along");
        notes.push(config.note("", Severity::Warning, segment, 1, text));
    }
    for short in &estimation.too_short {
        let segment = batch.segments.get(short.segment).cloned().unwrap_or_default();
        let text = format!(
            "{segment}: a delay of {} is {:.3} s, and the record has {:.3} s before its start: what came before is taken for its first value \
             (`preroll_s` gives more)",
            short.input, short.delay, short.preroll
        );
        notes.push(config.note("", Severity::Warning, segment, 1, text));
    }
    for text in &estimation.crossed {
        let text = format!("{}: {text}", batch.group);
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    let doubts = doubts::of(config, batch, estimation);
    notes.extend(doubts.into_iter().map(|doubt| doubt.note(config, batch)));
    notes.extend(noise_alone_note(config, batch, estimation));
    notes.extend(starts_note(config, batch, estimation));
    notes.extend(together_note(config, batch, estimation));
    notes.extend(unknown_shift_note(config, batch, estimation));
    notes.extend(tried_notes(config, batch, estimation));
    notes.extend(elsewhere_note(config, batch, estimation));
    if config.settings.method.stabilise.values().any(|gain| *gain != 0.0) {
        let text = format!(
            "{}: states are led back to what was measured of them, whose noise drives the model: no standard deviations",
            batch.group
        );
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    notes.extend(colour_notes(config, batch, estimation));
    notes.extend(not_white_note(config, batch, estimation));
    for row in estimation.rows.iter().filter(|row| row.idle) {
        let text = format!("{}: {}", batch.group, limits::idle(estimation, row).1);
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    for row in estimation.rows.iter().filter(|row| row.at_bound) {
        notes.push(bound_note(config, batch, row));
    }
    notes.extend(still_notes(config, batch, estimation));
    let name = |s: usize| segment(batch, Some(s)).unwrap_or_default().to_string();
    for combination in &estimation.verdict.combinations {
        notes.push(config.note(
            "",
            Severity::Warning,
            batch.group.clone(),
            1,
            format!("{}: {}", batch.group, combination.words(&name)),
        ));
    }
    notes
}

/// A parameter on its bound. None of something that cannot be negative is an ordinary result.
fn bound_note(config: &Config, batch: &Batch, row: &Row) -> Note {
    let severity = if row.value == 0.0 { Severity::Info } else { Severity::Warning };
    let unit = if row.unit == "-" { String::new() } else { format!(" {}", row.unit) };
    let text = format!(
        "{}: {} is on its bound, {}{unit}: it has no sd, and the other estimates hold for it fixed there",
        batch.group,
        row.name,
        digits(row.value)
    );
    config.note("", severity, batch.group.clone(), 1, text)
}

/// Outputs of which one value was measured throughout a maneuver in which the model moves them.
fn still_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let mut notes = Vec::new();
    for (segment, traces) in batch.segments.iter().zip(&estimation.responses) {
        for trace in traces.iter().filter(|trace| is_still(trace)) {
            let text = format!(
                "{segment}: {} has one value throughout, and the model moves it: is its sensor dead?",
                trace.name
            );
            notes.push(config.note("", Severity::Problem, segment.clone(), 1, text));
        }
    }
    notes
}

/// Fewest samples of one value that tell something.
const STILL: usize = 20;

fn is_still(trace: &Trace) -> bool {
    let both = trace.measured.iter().zip(trace.modelled.iter());
    let scored: Vec<(f64, f64)> =
        both.map(|(z, y)| (*z, *y)).filter(|(z, _)| z.is_finite()).collect();
    let Some(&(first, start)) = scored.first() else { return false };
    let scale = scored.iter().fold(0.0f64, |most, (z, y)| most.max(z.abs()).max(y.abs()));
    let moves = scored.iter().any(|(_, y)| (y - start).abs() > MOVES * scale);
    scored.len() >= STILL && moves && scored.iter().all(|(z, _)| *z == first)
}

/// A modelled output that changes by less than this share of its size is at rest.
const MOVES: f64 = 1e-3;

/// Parameters that are named in a note at most.
const NAMED: usize = 4;

/// Parameters of which noise of the inputs alone tells.
fn noise_alone_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let noisy = estimation.noisy_inputs.as_ref().filter(|noisy| !noisy.alone.is_empty())?;
    let text = format!(
        "{}: nothing but noise of the inputs (SI: {}) determines {}: value and sd mean nothing; hold it (`fixed`), or fly what moves its input",
        batch.group,
        noisy.words(),
        noisy.alone.join(", ")
    );
    Some(config.note("", Severity::Warning, batch.group.clone(), noisy.alone.len(), text))
}

/// Parameters with the factor of each, the first ones by name.
fn factors(all: &[(String, f64)]) -> String {
    let each = |(name, by): &(String, f64)| format!("{name} {by:.1}");
    let named: Vec<String> = all.iter().take(NAMED).map(each).collect();
    match all.len().saturating_sub(NAMED) {
        0 => named.join(", "),
        more => format!("{} and {more} others", named.join(", ")),
    }
}

/// Standard deviations that noise of the samples which states start at makes larger.
fn starts_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let noisy = estimation.noisy_starts.as_ref()?;
    let quoted = |name: &String| format!("\"{name}\"");
    let states: Vec<String> = noisy.states.iter().map(quoted).collect();
    let text = format!(
        "{}: {} start at one measured sample, whose noise makes sd so many times larger: {} (it is in `sd`, not in `sd_crlb`): `initial = [{}]` under [estimate.method] estimates the starts",
        batch.group,
        noisy.states.join(", "),
        factors(&noisy.larger),
        states.join(", ")
    );
    Some(config.note("", Severity::Warning, batch.group.clone(), noisy.larger.len(), text))
}

/// Standard deviations that are too small because what is left of several outputs goes together.
fn together_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let all = &estimation.together;
    let text = format!(
        "{}: what is left of several outputs goes together, as where gusts move all of them, and sd take each output for itself: they are so many times too small: {}. Turbulence in the model (gusts are fragments, noise that drives states: filter error) accounts for it",
        batch.group,
        factors(all)
    );
    let note = config.note("", Severity::Warning, batch.group.clone(), all.len(), text);
    (!all.is_empty()).then_some(note)
}

/// Estimates by equation error of which nobody can tell how far noise of the regressors has moved them.
fn unknown_shift_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let regression = estimation.regression.as_ref().filter(|r| r.is_estimate)?;
    let is_unknown = regression.rows.iter().all(|r| r.shift.is_none())
        && regression.rows.iter().any(|r| r.sd.is_some());
    let text = format!(
        "{}: how far noise in the regressors has moved the estimates cannot be told: signals are slower than the grid, and of a derived column nobody knows which ones it has its noise from",
        batch.group
    );
    is_unknown.then(|| config.note("", Severity::Info, batch.group.clone(), 1, text))
}

/// What became of several starts.
fn tried_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let tried = &estimation.tried;
    let Some(best) = tried.iter().filter(|t| t.there).map(|t| t.cost).reduce(f64::min) else {
        return Vec::new();
    };
    let of = |severity, text: String| {
        config.note("", severity, batch.group.clone(), 1, format!("{}: {text}", batch.group))
    };
    let there = tried.iter().filter(|t| t.there).count();
    let text = format!("the best of {} starts, and {there} of them end there", tried.len());
    let mut notes = vec![of(Severity::Info, text)];
    let names: Vec<&String> = config.settings.method.tries.keys().collect();
    let mut said: Vec<String> = Vec::new();
    for rival in tried.iter().filter(|t| t.rivals(best)) {
        let ends = names.iter().zip(&rival.ends);
        let at: Vec<String> =
            ends.map(|(name, end)| format!("{name} = {}", digits(*end))).collect();
        let at = at.join(", ");
        if !said.contains(&at) {
            let more = rival.cost - best;
            notes.push(of(
                Severity::Warning,
                format!("another minimum, at {at}, is hardly worse (cost + {more:.2}): these data do not tell which"),
            ));
            said.push(at);
        }
    }
    notes
}

/// What is said of another start that ended in another minimum.
fn elsewhere_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let other = estimation.elsewhere.as_ref()?;
    let ends = other.ends.iter().map(|(name, value)| format!("{name} = {}", digits(*value)));
    let at = ends.collect::<Vec<_>>().join(", ");
    let (from, worse) = (other.from, other.worse);
    let text = match other.taken {
        true => format!(
            "from {from} the iteration ends in a worse minimum (cost + {worse:.1}), at {at}: the estimate is where another start leads to"
        ),
        false => format!(
            "from {from} the iteration ends in another minimum, at {at}, which is worse (cost + {worse:.1})"
        ),
    };
    let text = format!("{}: {text}", batch.group);
    Some(config.note("", Severity::Warning, batch.group.clone(), 1, text))
}

/// Innovations are white if the noise that drives the model is what drove the aircraft: their past foretells
/// no more of them than this. *Convention* (a tenth), as for the turbulence of a diagnosis.
const FORETOLD: f64 = 0.1;
/// Innovations below this share of what was measured are rounding, of which nothing is told.
const ROUNDING: f64 = 1e-4;
/// And they are so, or not, beyond chance.
const DEMONSTRATED: f64 = 0.999;

/// Outputs of a filter whose innovations are not white.
fn not_white_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let mut traces = estimation.responses.iter().flatten();
    if !traces.any(|trace| trace.filtered.is_some()) {
        return None;
    }
    let of = |output: &estimate::OutputScatter| {
        let colour = output.colour.as_ref()?;
        let share = colour.model.foretold();
        let traces = estimation.responses.iter().flatten().filter(|t| t.name == output.name);
        let is_poor =
            share > FORETOLD && colour.coloured > DEMONSTRATED && traces.into_iter().any(tells);
        is_poor.then(|| format!("{} ({:.0}%)", output.name, 100.0 * share))
    };
    let outputs: Vec<String> = estimation.outputs.iter().filter_map(of).collect();
    let text = format!(
        "{}: what is new at each sample is not white: its past foretells a part of {}. Noise of another kind drives the aircraft (gusts that last, say), or a sensor: estimates may be off by more than their sd. Give the model that noise (gusts are fragments), or compare with output error",
        batch.group,
        outputs.join(", ")
    );
    let note = config.note("", Severity::Warning, batch.group.clone(), outputs.len(), text);
    (!outputs.is_empty()).then_some(note)
}

/// Whether what is new in an output is more than rounding of it.
fn tells(trace: &Trace) -> bool {
    let largest = |of: &dyn Fn((&f64, &f64)) -> f64| {
        let both = trace.measured.iter().zip(trace.modelled.iter());
        both.map(of).filter(|x| x.is_finite()).fold(0.0, f64::max)
    };
    largest(&|(z, y)| (z - y).abs()) > ROUNDING * largest(&|(z, _)| z.abs())
}

/// What was cut off where the colour of the residuals was found.
fn colour_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let of = |text: String| config.note("", Severity::Info, batch.group.clone(), 1, text);
    let cut = |output: &estimate::OutputScatter| {
        let order = output.colour.as_ref()?.cut?;
        let words = Modelled::cut_words(order);
        Some(of(format!("{}: {}: {words}", batch.group, output.name)))
    };
    let unsettled = (!estimation.settled).then(|| {
        of(format!("{}: the colour of the residuals still changed in the last round: sd may be off by some percent", batch.group))
    });
    estimation.outputs.iter().filter_map(cut).chain(unsettled).collect()
}
