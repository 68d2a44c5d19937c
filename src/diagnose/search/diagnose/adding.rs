//! A round that is judged, and what is in the model already, in; what of it is added, and what would only
//! stand for something that is there, out.

use crate::diagnose::base::stand::Known;
use crate::diagnose::search::judged::{Judged, Round, Standing};
use crate::diagnose::settings::Settings;
use crate::diagnose::thresholds::Thresholds;

/// An effect in the model as it stands.
#[derive(Debug, Clone)]
pub struct Link {
    pub name: String,
    pub values: Vec<f64>,
    pub evidence: f64,
    /// What chance gives among all candidates of the round in which it was found.
    pub limit: f64,
    /// Candidates that came near it in its round.
    pub rivals: Vec<String>,
    /// Those of its round that explain the same, and are not told from it.
    pub alike: Vec<String>,
    /// Why it is not believed although nothing explains more.
    pub doubt: Option<String>,
    /// It takes noise out of a record, or is nothing but that.
    pub noise: bool,
    /// Everything that the fit found in which it was added.
    pub known: Known,
}

impl Link {
    /// What becomes of a candidate that is added; so many `rivals` are kept.
    pub fn of(round: &Round, judged: &Judged, rivals: usize) -> Option<Link> {
        let refit = judged.refit.as_ref()?;
        let mut near: Vec<&Judged> = round
            .judged
            .iter()
            .filter(|j| j.score > round.limit && j.name != judged.name)
            .collect();
        near.sort_by(|a, b| b.score.total_cmp(&a.score));
        let class = round.class.iter().filter_map(|&c| round.judged.get(c));
        let alike = class.filter(|j| j.name != judged.name);
        Some(Link {
            name: judged.name.clone(),
            values: refit.values.iter().map(|v| v.value).collect(),
            evidence: judged.evidence,
            limit: round.limit,
            rivals: near.iter().take(rivals).map(|j| j.name.clone()).collect(),
            alike: alike.map(|j| j.name.clone()).collect(),
            doubt: None,
            noise: judged.is_of_record(),
            known: refit.known.clone(),
        })
    }
}

/// The link that a candidate is an alternative to, where beside it it adds little: the two explain the same, each
/// in its own way, and what the chosen one leaves is no second effect.
fn instead_of<'l>(links: &'l [Link], judged: &Judged, thresholds: &Thresholds) -> Option<&'l Link> {
    let is_little = |l: &&Link| judged.evidence < thresholds.between * l.evidence;
    links.iter().filter(|l| l.alike.contains(&judged.name)).find(is_little)
}

/// What such candidates of a round add, in words.
pub fn beside(links: &[Link], round: &Round, thresholds: &Thresholds) -> Vec<String> {
    let words = |j: &Judged| {
        let link = instead_of(links, j, thresholds).filter(|_| j.evidence > round.limit)?;
        Some(format!(
            "beside {}, {}, which explains the same, gains {:.1} more, where chance gives {:.1}",
            link.name, j.name, j.evidence, round.limit
        ))
    };
    round.class.iter().filter_map(|&c| words(round.judged.get(c)?)).collect()
}

/// The candidate to add: the first of the class, unless another one has more evidence by far that
/// held-out maneuvers hardly take away. Beside a name that one may be one that the flights do not
/// determine: the name would be wrong where something else explains far more. What noise of the inputs makes is
/// not added, nor is an alternative to what is there and what explains the same as that one.
pub fn to_add(links: &[Link], round: &Round, settings: &Settings) -> Option<usize> {
    let is_instead = |j: &Judged| instead_of(links, j, &settings.thresholds).is_some();
    let gain = |j: &Judged| j.refit.as_ref().map_or(f64::NAN, |r| r.gain);
    let held = |j: &Judged| {
        j.standing.is_doubt()
            && j.standing != Standing::ByNoise
            && !(j.standing == Standing::Unidentifiable && round.class.is_empty())
            && j.evidence > round.limit
            && j.evidence > (1.0 - settings.thresholds.held_out_taken) * gain(j)
    };
    let passing =
        |j: &Judged| matches!(j.standing, Standing::Chosen | Standing::Alike | Standing::Beaten);
    let best = round.class.iter().any(|&c| is_instead(&round.judged[c]));
    let is_out = |j: &Judged| is_instead(j) || best && j.replaces;
    let able = (0..round.judged.len())
        .filter(|&i| passing(&round.judged[i]) || held(&round.judged[i]))
        .filter(|&i| !is_out(&round.judged[i]));
    let top =
        able.max_by(|&a, &b| round.judged[a].evidence.total_cmp(&round.judged[b].evidence))?;
    match round.class.iter().find(|&&c| !is_out(&round.judged[c])) {
        Some(&first)
            if round.class.iter().any(|&c| {
                round.judged[c].evidence > round.judged[top].evidence - settings.apart
            }) =>
        {
            Some(first)
        }
        _ => Some(top),
    }
}
