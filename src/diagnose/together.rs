//! How a pipeline estimates its maneuvers (together, flight by flight, one by one; lines fitted
//! through the estimates) in; one estimation over all of them that claims the same of every
//! parameter, out.
//!
//! A model is judged as it is used. Effects are looked for over all maneuvers at once, because one
//! that is missing is missing in all of them. But what a pipeline estimates anew in every maneuver
//! is not one number: taken as one, it would be wrong in nearly all of them, and whatever varies as
//! it does would pass for an effect.
//!
//! - *A line is fitted through the estimates* (`[[fit]]`): that line is what the user says of the
//!   parameter. It is `value + slope (x - centre)` in every maneuver, `x` its condition (the mean
//!   of a signal before the maneuver), value and slope common to all. What held-out maneuvers are
//!   predicted with follows from the training's line. Where there are several fits of one parameter
//!   the first one counts.
//! - *No line*: one value per maneuver, or per flight. Those of a held-out maneuver are found
//!   there, with the effect and without it, as its initial states and zero shifts are: what such a
//!   parameter can follow is no gain of either, and nothing of the effect itself is ever fitted to
//!   a maneuver that is held out. So the difference of the two predictions still is what the effect
//!   predicts to gain, and no derivative has to be carried to where the pipeline carries none. (Of
//!   a flight that has maneuvers in the training the training's values are taken.)
//! - *All together*: as it is.
//!
//! What an effect adds is one number for all maneuvers in every case; the amended model is the
//! user's own with that effect, and is estimated as the pipeline does. Parameters that are held at
//! predictions are held: nothing of this concerns them.

use crate::error::Errors;
use crate::estimate::{Grouping, InitialFrom, Line, SEGMENT, Segment, Settings, extended};
use crate::model::{Model, Scope};
use indexmap::IndexMap;

/// How the estimates of a pipeline come about.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Claim {
    /// What is estimated apart: "segment", or the column by which maneuvers are kept apart; none
    /// where all are estimated together.
    pub apart: Option<String>,
    pub lines: Vec<Fitted>,
}

/// A parameter that a line is fitted through.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    pub parameter: String,
    /// The condition, and its SI unit.
    pub against: String,
    pub unit: String,
}

/// The method for all segments together, and in words what is not one number in it (nothing where
/// all of them are estimated together, or there is one only); labels by which a parameter comes to
/// differ are put on the segments.
///
/// # Errors
/// Shifts that the method asks for and the model cannot have.
pub fn together(
    model: &Model,
    method: &Settings,
    segments: &mut [Segment],
    claim: &Claim,
) -> Result<(Settings, String), Errors> {
    let mut method = method.clone();
    let all: Vec<&Segment> = segments.iter().collect();
    let Some(apart) =
        claim.apart.as_ref().filter(|apart| Grouping::by(apart, &all).values.len() > 1)
    else {
        return Ok((method, String::new()));
    };
    if apart == SEGMENT {
        method.initial_from = InitialFrom::Own;
    }
    let model = extended(model, &method)?;
    let mut columns: Vec<String> = Vec::new();
    for parameter in &model.parameters {
        let name = &parameter.quantity.name;
        let scope = method.per.get(name).map_or(parameter.scope.clone(), |per| Scope::parse(per));
        let line =
            claim.lines.iter().find(|line| line.parameter == *name).filter(|_| apart == SEGMENT);
        let per = match (line, scope) {
            (Some(fitted), _) => {
                method.lines.extend(line_of(fitted, segments).map(|line| (name.clone(), line)));
                Scope::Campaign.name().to_string()
            }
            (None, Scope::Campaign) => apart.clone(),
            (None, Scope::Column(column)) if apart != SEGMENT && column != *apart => {
                let both = both(apart, &column);
                columns.push(column);
                both
            }
            (None, Scope::Column(_) | Scope::Segment) if apart == SEGMENT => SEGMENT.to_string(),
            (None, scope) => scope.name().to_string(),
        };
        method.per.insert(name.clone(), per);
    }
    for segment in segments {
        for column in &columns {
            if let (Some(a), Some(b)) =
                (segment.labels.get(apart).cloned(), segment.labels.get(column).cloned())
            {
                segment.labels.insert(both(apart, column), both(&a, &b));
            }
        }
    }
    let words = words(&method, apart);
    Ok((method, words))
}

/// Name of two columns together, or of their values.
fn both(one: &str, other: &str) -> String {
    format!("{one}, {other}")
}

/// The line, its centre in the middle of the maneuvers; none where all of them were flown at one
/// condition.
fn line_of(fitted: &Fitted, segments: &[Segment]) -> Option<Line> {
    let known = || {
        segments.iter().filter_map(|s| s.conditions.get(&fitted.against)).filter(|x| x.is_finite())
    };
    let centre = known().sum::<f64>() / known().count() as f64;
    let varies = known().any(|x| (x - centre).abs() > 1e-9 * centre.abs());
    varies.then(|| Line { against: fitted.against.clone(), unit: fitted.unit.clone(), centre })
}

/// The lines and what differs, in words.
fn words(method: &Settings, apart: &str) -> String {
    let mut groups: IndexMap<&str, Vec<&str>> = IndexMap::new();
    method
        .lines
        .iter()
        .for_each(|(name, line)| groups.entry(&line.against).or_default().push(name));
    let group = |(against, names): (&str, Vec<&str>)| match &names[..] {
        [one] => format!("{one} is a line in {against}"),
        several => format!("{} are lines in {against}", several.join(", ")),
    };
    let lines: Vec<String> = groups.into_iter().map(group).collect();
    let others = if apart == SEGMENT { "maneuver" } else { apart };
    match &lines[..] {
        [] => format!("parameters have one value per {others}"),
        lines => format!("{}; what has no line has one value per {others}", lines.join("; ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Constants;

    const TEXT: &str = "[inputs]\nu = \"rad\"\n[parameters]\nK = { unit = \"-\", start = 1.0 }\nL = { unit = \"-\", start = 1.0, per = \"flap\" }\n\
        M = { unit = \"-\", start = 1.0 }\n[outputs]\ny = { unit = \"rad\", value = \"(K + L + M)*u\" }\n";

    fn segments() -> Vec<Segment> {
        let one = |i: usize| {
            let labels = [("flight", ["f1", "f2"][i / 2]), ("flap", ["0", "15"][i % 2])];
            let labels = labels.map(|(name, value)| (name.to_string(), value.to_string())).into();
            let conditions = [("alpha".to_string(), 0.02 * i as f64)].into();
            Segment { labels, conditions, ..Segment::default() }
        };
        (0..4).map(one).collect()
    }

    fn told(apart: Option<&str>, segments: &mut [Segment]) -> (Settings, String) {
        let model = Model::parse("m", &format!("title = \"m\"\n{TEXT}"), &Constants::default())
            .unwrap_or_else(|e| panic!("{e}"));
        let fitted = Fitted { parameter: "K".into(), against: "alpha".into(), unit: "rad".into() };
        let method = Settings {
            per: [("M".to_string(), "campaign".to_string())].into(),
            ..Settings::default()
        };
        let claim = Claim { apart: apart.map(str::to_string), lines: vec![fitted] };
        together(&model, &method, segments, &claim).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn parameters_are_one_number_where_the_pipeline_has_one() {
        let mut all = segments();
        let (method, words) = told(None, &mut all);
        assert!(
            method.lines.is_empty()
                && method.per.len() == 1
                && words.is_empty()
                && all == segments()
        );
        let (method, words) = told(Some(SEGMENT), &mut all);
        let per = |method: &Settings, name: &str| method.per.get(name).cloned().unwrap_or_default();
        assert_eq!(
            [per(&method, "K"), per(&method, "L"), per(&method, "M")],
            ["campaign", "segment", "segment"]
        );
        let line = &method.lines["K"];
        assert!(line.against == "alpha" && (line.centre - 0.03).abs() < 1e-12, "{line:?}");
        assert_eq!(words, "K is a line in alpha; what has no line has one value per maneuver");
        // Lines are fitted through estimates per maneuver.
        let (method, words) = told(Some("flight"), &mut all);
        assert_eq!(
            [per(&method, "K"), per(&method, "L"), per(&method, "M")],
            ["flight", "flight, flap", "flight"]
        );
        assert!(
            method.lines.is_empty() && words == "parameters have one value per flight",
            "{words}"
        );
        assert_eq!(all[3].labels["flight, flap"], "f2, 15");
        // A single one is what it is.
        let (method, words) = told(Some(SEGMENT), &mut segments()[..1]);
        assert!(method.per.len() == 1 && words.is_empty());
        // At one condition a line is a number.
        let mut still = segments();
        still.iter_mut().for_each(|s| s.conditions[0] = 0.05);
        let (method, _) = told(Some(SEGMENT), &mut still);
        assert!(method.lines.is_empty() && per(&method, "K") == "campaign");
    }
}
