//! A base model and effects in; every combination of what fills the roles of an effect, compiled,
//! out.

use std::collections::{BTreeMap, BTreeSet};

use indexmap::IndexMap;
use rayon::prelude::*;

use super::added::{Added, Check};
use super::block::{Block, quoted};
use super::candidate::{Candidate, OF, Offer, Skipped};
use super::context::Context;
use super::file::{Bind, Effect, Size};
use super::fill::{fill, placeholders, unit_factor};
use super::roles::{self, Bound};
use crate::diagnose::thresholds::SIZES;
use crate::model::file::Value;
use crate::model::{Model, Scope};
use crate::units::simplified;

/// Which effects are wanted, by name.
pub type Wanted<'a> = dyn Fn(&str) -> bool + Sync + 'a;

/// All candidates for a base model, in the order of the effects and of the model.
pub fn candidates(base: &Model, context: &Context, effects: &[Effect]) -> Offer {
    candidates_of(base, context, effects, &|_| true)
}

/// Those of the effects wanted.
pub fn candidates_of(
    base: &Model,
    context: &Context,
    effects: &[Effect],
    wanted: &Wanted,
) -> Offer {
    let of = |effect: &Effect| match options(base, context, effect) {
        Ok(options) => {
            let bound = |chosen| candidate(base, context, effect, &options, chosen);
            combinations(effect, &options).into_iter().map(bound).collect()
        }
        Err(why) => vec![Err(Skipped { effect: effect.name.clone(), why, wrong: false })],
    };
    // Every model is compiled, which takes longer than what is done with most of them.
    let effects = effects.par_iter().filter(|effect| wanted(&effect.name));
    let all: Vec<Vec<Result<Candidate, Skipped>>> = effects.map(of).collect();
    let mut offer = Offer::default();
    for one in all.into_iter().flatten() {
        match one {
            Ok(candidate) => offer.candidates.push(candidate),
            Err(skipped) => offer.skipped.push(skipped),
        }
    }
    offer
}

/// What keeps an effect from being tried with a model whatever is bound: what is wrong with its file, or what
/// the model has nothing of.
pub fn useless(base: &Model, context: &Context, effect: &Effect) -> Option<Skipped> {
    let offer = candidates(base, context, std::slice::from_ref(effect));
    offer.candidates.is_empty().then(|| offer.skipped.into_iter().next()).flatten()
}

/// What may be bound to each name of the effect.
fn options(
    base: &Model,
    context: &Context,
    effect: &Effect,
) -> Result<IndexMap<String, Vec<Bound>>, String> {
    let has = |role: &&String| !roles::find(role, base, context).is_empty();
    if let Some(role) = effect.file.unless.as_ref().filter(has) {
        return Err(format!("the model has a {role} ({})", roles::meaning(role)));
    }
    let mut options = IndexMap::new();
    for (key, bind) in &effect.file.bind {
        let mut found = roles::find(bind.role(), base, context);
        if let (true, Bind::Or(full)) = (found.is_empty(), bind) {
            let name =
                free_name(&format!("{}_reference", full.role.replace('-', "_")), &taken(base));
            found.push(Bound {
                text: name.clone(),
                ident: name,
                unit: full.unit.clone(),
                fields: BTreeMap::new(),
            });
        }
        if found.is_empty() {
            return Err(format!(
                "the model has no {} ({})",
                bind.role(),
                roles::meaning(bind.role())
            ));
        }
        options.insert(key.clone(), found);
    }
    Ok(options)
}

/// Numbers of options, one per name; names of the same role take different ones, in one order only. What an
/// effect changes with may be what it is made dimensionless with (the airspeed).
fn combinations(effect: &Effect, options: &IndexMap<String, Vec<Bound>>) -> Vec<Vec<usize>> {
    let roles: Vec<&str> = effect.file.bind.values().map(Bind::role).collect();
    let mut all: Vec<Vec<usize>> = vec![Vec::new()];
    for (k, found) in options.values().enumerate() {
        let before = (0..k).rev().find(|&j| roles[j] == roles[k]);
        let at_once = matches!(effect.file.bind.values().nth(k), Some(Bind::All(_)));
        let extend = |chosen: Vec<usize>| {
            if at_once {
                return vec![[&chosen[..], &[0]].concat()];
            }
            let from = before.map_or(0, |j| chosen[j] + 1);
            (from..found.len()).map(move |i| [&chosen[..], &[i]].concat()).collect::<Vec<_>>()
        };
        all = all.into_iter().flat_map(extend).collect();
    }
    let same = |chosen: &Vec<usize>| {
        let texts = chosen.iter().zip(options.values()).map(|(&i, found)| found[i].text.as_str());
        let distinct = texts.zip(&roles).filter(|(_, role)| **role != "condition");
        let texts: Vec<&str> = distinct.map(|(text, _)| text).collect();
        (1..texts.len()).any(|k| texts[..k].contains(&texts[k]))
    };
    all.into_iter().filter(|chosen| !same(chosen)).collect()
}

/// Names that are in use.
fn taken(base: &Model) -> BTreeSet<String> {
    base.dims.keys().cloned().collect()
}

/// The name, with a number behind it where it is taken.
fn free_name(name: &str, taken: &BTreeSet<String>) -> String {
    let numbered = (2..).map(|i| format!("{name}_{i}"));
    std::iter::once(name.to_string())
        .chain(numbered)
        .find(|n| !taken.contains(n))
        .unwrap_or_default()
}

/// One binding with the names it uses.
struct Binding<'a> {
    base: &'a Model,
    context: &'a Context,
    effect: &'a Effect,
    bound: IndexMap<&'a str, &'a Bound>,
    /// What is bound at once, if anything.
    all: Option<(&'a str, &'a [Bound])>,
    /// Local names of the effect to names in the model.
    names: BTreeMap<&'a str, String>,
}

fn candidate<'a>(
    base: &'a Model,
    context: &'a Context,
    effect: &'a Effect,
    options: &'a IndexMap<String, Vec<Bound>>,
    chosen: Vec<usize>,
) -> Result<Candidate, Skipped> {
    let bound: IndexMap<&str, &Bound> =
        options.iter().zip(&chosen).map(|((key, found), &i)| (key.as_str(), &found[i])).collect();
    let many = bound.iter().filter(
        |(key, _)| matches!(&effect.file.bind[**key], Bind::Role(role) if roles::is_list(role)),
    );
    let idents: Vec<&str> = many.map(|(_, b)| b.ident.as_str()).collect();
    let name = if idents.is_empty() {
        effect.name.clone()
    } else {
        format!("{}{OF}{}", effect.name, idents.join(","))
    };
    let suffix = if idents.is_empty() { effect.name.replace('-', "_") } else { idents.join("_") };
    let all = effect.file.bind.iter().find(|(_, bind)| matches!(bind, Bind::All(_)));
    let all = all.map(|(key, _)| (key.as_str(), options[key].as_slice()));
    let mut binding = Binding { base, context, effect, bound, all, names: BTreeMap::new() };
    binding.choose_names(&suffix);
    let file = &effect.file;
    let added: Vec<Added> =
        file.parameters.iter().map(|(key, size)| binding.added(key, size)).collect();
    let block = binding.block();
    let skipped = |why: String| Skipped { effect: name.clone(), why, wrong: true };
    let nulls = block.text(&added, &BTreeMap::new(), false, &[], "");
    let model = base.amended(&format!("\n{nulls}")).map_err(|e| skipped(e.to_string()))?;
    if model.inputs != base.inputs || model.outputs != base.outputs {
        return Err(skipped("it would change the inputs or outputs".into()));
    }
    Ok(Candidate {
        effect: effect.name.clone(),
        sentence: binding.prose(&file.title),
        signature: binding.prose(&file.signature),
        separate: binding.prose(&file.separate),
        family: file.family,
        series: file.series,
        form: file.form.clone(),
        noise: file.noise,
        model,
        added,
        block,
        name,
    })
}

impl<'a> Binding<'a> {
    /// Names of the effect's parameters, equations and states that are free in the base.
    fn choose_names(&mut self, suffix: &str) {
        let mut taken = taken(self.base);
        let file = &self.effect.file;
        let wanted = file.parameters.iter().map(|(key, size)| (key, size.name.as_deref()));
        let own = file
            .equations
            .keys()
            .chain(file.states.keys())
            .chain(file.constants.keys())
            .map(|key| (key, None));
        for (key, name) in wanted.chain(own).collect::<Vec<_>>() {
            let name = match name {
                Some(name) => fill(name, |k| self.field(k, |b| b.ident.clone())),
                None => format!("{key}_{suffix}"),
            };
            let name = free_name(&name, &taken);
            taken.insert(name.clone());
            self.names.insert(key, name);
        }
    }

    /// What `key` or `key.field` is bound to.
    fn field(&self, key: &str, own: impl Fn(&Bound) -> String) -> Option<String> {
        match key.split_once('.') {
            None => self.bound.get(key).map(|b| own(b)),
            Some((key, field)) => self.bound.get(key)?.fields.get(field).cloned(),
        }
    }

    fn expression(&self, text: &str) -> String {
        fill(text, |k| self.names.get(k).cloned().or_else(|| self.field(k, |b| b.text.clone())))
    }

    /// A line of `add` or `replace`, for each of what is bound at once where it names that.
    fn lines(&self, target: &str, text: &str) -> Vec<(String, String)> {
        let each = self.all.filter(|(key, _)| placeholders(target).iter().any(|p| p == key));
        let Some((key, bounds)) = each else {
            return vec![(self.expression(target), self.expression(text))];
        };
        let with = |b: &Bound| {
            let first = |text: &str| fill(text, |k| (k == key).then(|| b.text.clone()));
            (self.expression(&first(target)), self.expression(&first(text)))
        };
        bounds.iter().map(with).collect()
    }

    fn prose(&self, text: &str) -> String {
        fill(text, |k| self.field(k, |b| b.ident.clone()))
    }

    fn unit(&self, text: &str) -> String {
        simplified(&fill(text, |k| self.field(k, |b| unit_factor(&b.unit))))
    }

    /// Half the range of what is bound to `key`, or something plausible for its unit.
    fn size(&self, key: &str) -> f64 {
        let Some(b) = self.bound.get(key) else { return 1.0 };
        let of = |name: &str| self.context.sizes.get(name).copied();
        let parts = [b.text.as_str(), b.ident.as_str()]
            .into_iter()
            .chain(b.fields.values().map(String::as_str));
        let known = parts.filter_map(of).filter(|s| *s > 0.0).fold(0.0, f64::max);
        let plausible =
            || SIZES.iter().find(|(unit, _)| *unit == b.unit).map_or(1.0, |(_, size)| *size);
        if known > 0.0 { known } else { plausible() }
    }

    /// The middle of the range of what is bound to `key`.
    fn middle(&self, key: &str) -> f64 {
        let Some(b) = self.bound.get(key) else { return 0.0 };
        // of a hinge it is that of its position
        let position = b.fields.get("position");
        let known = |name: &String| self.context.middles.get(name).copied();
        let parts = [Some(&b.text), Some(&b.ident), position];
        parts.into_iter().flatten().find_map(known).unwrap_or(0.0)
    }

    /// The middle of the range of what is bound to `key`, or the number that stands in for it.
    fn usual(&self, key: &str) -> f64 {
        let stand_in = match self.effect.file.bind.get(key) {
            Some(Bind::Or(with)) => with.or,
            _ => 1.0,
        };
        Some(self.middle(key)).filter(|v| *v > 0.0).unwrap_or(stand_in)
    }

    fn added(&self, key: &str, size: &Size) -> Added {
        let over = size.over.as_ref().map_or(1.0, |over| self.usual(over));
        let scale = size.of.as_ref().map_or(1.0, |of| self.size(of)) / over;
        let middle = size.about.as_ref().map_or(0.0, |of| self.middle(of));
        let check = size.near.as_ref().and_then(|near| {
            let constant = roles::find(&near.role, self.base, self.context).into_iter().next()?;
            let value = self.constant(&constant.text)?;
            // A distance, or the time that it takes at the airspeed flown, where that is known.
            let Some(over) = &size.over else {
                return Some(Check { value, text: constant.text, within: near.within });
            };
            let middle = Some(self.middle(over)).filter(|v| *v > 0.0)?;
            let text = format!("{}/{}", constant.text, self.bound.get(over.as_str())?.ident);
            Some(Check { value: value / middle, text, within: near.within })
        });
        let mut starts: Vec<f64> = size.starts.iter().map(|s| middle + s * scale).collect();
        if let Some(check) = &check
            && size.null.is_none()
        {
            starts.insert(0, check.value);
        }
        let (min, max) = (
            size.min.map_or(f64::NEG_INFINITY, |v| v * scale),
            size.max.map_or(f64::INFINITY, |v| v * scale),
        );
        let steps = size.steps.iter().map(|s| s * scale).collect();
        let range = size.about.as_ref().map_or(f64::INFINITY, |about| 2.0 * self.size(about));
        let step = size.typical.or(size.starts.first().copied()).unwrap_or(1.0);
        Added {
            name: self.names[key].clone(),
            unit: self.unit(&size.unit),
            null: size.null,
            hold: size.hold,
            steps,
            chosen: size.chosen,
            starts,
            min,
            max,
            span: range.min(max - min),
            typical: step.abs() * scale,
            scope: Scope::parse(&size.per),
            held_in: None,
            check,
        }
    }

    /// The value of a constant of the model or of the aircraft.
    fn constant(&self, name: &str) -> Option<f64> {
        let own = self.base.constants.iter().find(|c| c.quantity.name == name).map(|c| c.value);
        own.filter(|v| v.is_finite()).or_else(|| self.base.given()?.0.get(name).map(|g| g.value))
    }

    fn block(&self) -> Block {
        let file = &self.effect.file;
        let lines =
            |of: &IndexMap<String, String>| of.iter().flat_map(|(t, x)| self.lines(t, x)).collect();
        let state = |(key, s): (&String, &crate::model::file::State)| {
            let value = |value: &Value| match value {
                Value::Number(x) => format!("{x:?}"),
                Value::Text(text) => quoted(&self.expression(text)),
            };
            let more = [
                ("min", &s.min),
                ("max", &s.max),
                ("rate_max", &s.rate_max),
                ("friction", &s.friction),
            ];
            let mut keys = vec![
                ("unit", quoted(&self.unit(&s.unit))),
                ("rate", quoted(&self.expression(&s.rate))),
                ("start", value(&s.start)),
            ];
            keys.extend(more.into_iter().filter_map(|(key, x)| Some((key, value(x.as_ref()?)))));
            (self.names[key.as_str()].clone(), keys)
        };
        Block {
            title: self.prose(&file.title),
            constants: self.constants(),
            docs: file.parameters.values().map(|p| p.doc.clone()).collect(),
            equations: file
                .equations
                .iter()
                .map(|(k, x)| (self.names[k.as_str()].clone(), self.expression(x)))
                .collect(),
            states: file.states.iter().map(state).collect(),
            add: lines(&file.add),
            replace: lines(&file.replace),
        }
    }

    /// Constants that the effect needs and the model does not declare.
    fn constants(&self) -> Vec<(String, String, Option<f64>)> {
        let own = self.effect.file.constants.iter();
        let mut out: Vec<_> = own
            .map(|(k, c)| (self.names[k.as_str()].clone(), self.unit(&c.unit), c.value))
            .collect();
        for (key, bind) in &self.effect.file.bind {
            let b = self.bound[key.as_str()];
            let of_aircraft = self.base.given().is_some_and(|g| g.0.contains_key(&b.text));
            match bind {
                Bind::Or(full)
                    if b.text.contains("_reference") && !self.base.dims.contains_key(&b.text) =>
                {
                    out.push((b.text.clone(), full.unit.clone(), Some(full.or)));
                }
                _ if of_aircraft && !self.base.dims.contains_key(&b.text) => {
                    out.push((b.text.clone(), b.unit.clone(), None))
                }
                _ => {}
            }
        }
        out
    }
}
