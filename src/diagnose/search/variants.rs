//! Maneuvers that a model can use in; other choices of which train and which are held out, out.
//!
//! Every third maneuver of each input is held out in turn. Then, often enough to count votes, a
//! quarter of the maneuvers of each input is left out and a third of the rest held out, drawn by
//! named random numbers (Meinshausen and Buehlmann, J. R. Stat. Soc. B 72, 2010: what is chosen in
//! nearly all subsamples is no accident of one).

use crate::diagnose::settings::Settings;
use crate::diagnose::subject::Places;
use crate::estimate::Prepared;
use crate::simulate::Stream;

/// One choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    pub name: String,
    pub places: Places,
}

/// All choices in which there is something to train on and something held out.
pub fn variants(prepared: &Prepared, settings: &Settings) -> Vec<Variant> {
    let strata = strata(prepared);
    let every = settings.hold_every.max(2);
    let turns = (0..every).map(|turn| {
        let held = |k: usize| (k + turn) % every == every - 1;
        (
            format!("turn {}", turn + 1),
            chosen(&strata, &mut |of| {
                let (held, training): (Vec<_>, Vec<_>) =
                    of.iter().enumerate().partition(|(k, _)| held(*k));
                (
                    training.into_iter().map(|(_, s)| *s).collect(),
                    held.into_iter().map(|(_, s)| *s).collect(),
                )
            }),
        )
    });
    let drawn = (0..settings.thresholds.subsamples).map(|i| {
        let mut stream = Stream::new(settings.seed, &["diagnose", "variant", &i.to_string()]);
        (format!("subsample {}", i + 1), chosen(&strata, &mut |of| drawn(of, every, &mut stream)))
    });
    turns
        .chain(drawn)
        .filter(|(_, places)| !places.training.is_empty() && !places.held_out.is_empty())
        .map(|(name, places)| Variant { name, places })
        .collect()
}

/// Places of the maneuvers of each input.
fn strata(prepared: &Prepared) -> Vec<Vec<usize>> {
    let mut all: Vec<(String, Vec<usize>)> = Vec::new();
    for (place, &s) in prepared.used.iter().enumerate() {
        let input = prepared.segments[s].labels.get("input").cloned().unwrap_or_default();
        match all.iter_mut().find(|(name, _)| *name == input) {
            Some((_, of)) => of.push(place),
            None => all.push((input, vec![place])),
        }
    }
    all.into_iter().map(|(_, of)| of).collect()
}

/// How the maneuvers of one input are divided: training, held out.
type Divide<'a> = dyn FnMut(&[usize]) -> (Vec<usize>, Vec<usize>) + 'a;

fn chosen(strata: &[Vec<usize>], divide: &mut Divide) -> Places {
    let mut places = Places { training: Vec::new(), held_out: Vec::new() };
    for of in strata {
        let (training, held_out) = divide(of);
        places.training.extend(training);
        places.held_out.extend(held_out);
    }
    places.training.sort_unstable();
    places.held_out.sort_unstable();
    places
}

/// A quarter is left out, every so-many-th of the rest held out; where that is no whole number, one
/// more as often as it takes.
fn drawn(of: &[usize], every: usize, stream: &mut Stream) -> (Vec<usize>, Vec<usize>) {
    let mut order = of.to_vec();
    for k in (1..order.len()).rev() {
        order.swap(k, (stream.uniform() * (k + 1) as f64) as usize);
    }
    let mut share = |n: usize, parts: usize| {
        let more = stream.uniform() * (parts as f64) < (n % parts) as f64;
        n / parts + usize::from(more)
    };
    let left = order.len() - share(order.len(), 4);
    order.truncate(left);
    let held = share(left, every);
    let training = order.split_off(held);
    (training, order)
}
