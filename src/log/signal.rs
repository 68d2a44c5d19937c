//! The decoded columns of a flight and one entry of the channel map in; that signal in SI with its
//! account and notes out.

use super::around::{around, turn};
use super::channel_map::{ChannelMap, SignalMap, TimeSource, TimeZero, Wrong};
use super::clocks;
use super::decode::{is_damaged, is_unreadable};
use super::file::LogFile;
use super::flight::{SignalLog, rest_path, stamp_paths};
use super::left_out::{self, Fate, Seen};
use super::parts::{Columns, PartData, TopicPlan};
use super::series::{
    Account, Series, clock_jumps, describe, drop_stray_times, drop_twice, order, seconds,
};
use super::{Note, agree, said, words};
use crate::config::Doc;
use crate::error::{Error, Errors};
use crate::signal::{spikes, still};
use crate::units::Unit;

/// Time stamps, ns since the flight's zero; `None` where a message has none.
type Stamps = Vec<Option<i64>>;

/// Everything that the signals of one flight share.
pub(super) struct Context<'a> {
    pub log: &'a LogFile,
    pub map: &'a ChannelMap,
    pub doc: &'a Doc,
    pub plans: &'a [TopicPlan],
    pub parts: &'a [PartData],
    pub start_ns: u64,
}

impl Context<'_> {
    /// Reads one signal.
    pub fn signal(&self, name: &str, signal: &SignalMap) -> Result<(SignalLog, Vec<Note>), Errors> {
        let error = |key: &str, what: String| {
            Error::at(self.doc.place(&format!("signal.{name}.{key}")), what)
        };
        let unit = Unit::parse(&signal.unit).map_err(|e| error("unit", e))?;
        let Some((index, plan)) =
            self.plans.iter().enumerate().find(|(_, p)| p.topic == signal.topic)
        else {
            return Err(error("topic", format!("topic \"{}\" was not read", signal.topic)).into());
        };
        let data: Vec<&Columns> = self.parts.iter().map(|p| &p.topics[index]).collect();
        let messages: usize = data.iter().map(|c| c.log.len()).sum();
        if messages == 0 {
            let what =
                format!("topic \"{}\" of {} has no intact message", signal.topic, self.log.name());
            return Err(error("topic", what).into());
        }
        let mut account = Account {
            topic: signal.topic.clone(),
            field: signal.field.clone(),
            unit: signal.unit.clone(),
            messages: messages as u64,
            ..Account::default()
        };
        let (log_ns, stamps) =
            self.stamps(plan, &data, signal).map_err(|what| error(self.time_key(signal), what))?;
        account.clock_jumps = clock_jumps(
            &log_ns,
            &stamps.iter().zip(&log_ns).map(|(s, l)| s.unwrap_or(*l)).collect::<Vec<_>>(),
        );

        let raw = column(plan, &data, &signal.field);
        if raw.clone().all(is_unreadable) {
            return Err(error("field", self.no_such_field(plan, signal)).into());
        }
        let clocks = clocks::left_out(&stamps).map_err(|why| {
            let what = format!("topic \"{}\" of {}: {why}", signal.topic, self.log.name());
            error(self.time_key(signal), what).help(clocks::HELP)
        })?;
        let mut of_another = vec![false; if clocks.is_empty() { 0 } else { messages }];
        clocks.iter().flat_map(|two| &two.fewer).for_each(|&k| of_another[k] = true);
        let mut samples: Vec<(i64, f64)> = Vec::with_capacity(messages);
        for (k, (stamp, value)) in stamps.iter().zip(raw).enumerate() {
            match stamp {
                Some(_) if value.is_finite() && of_another.get(k) == Some(&true) => {
                    account.dropped_clock += 1;
                }
                Some(stamp) if value.is_finite() => samples.push((*stamp, value)),
                Some(_) if !is_unreadable(value) => account.dropped_nan += 1,
                _ => {
                    account.dropped_unreadable += 1;
                    account.lacking += u64::from(is_unreadable(value) && !is_damaged(value));
                }
            }
        }
        account.dropped_times += account.dropped_clock;
        let twice = drop_twice(&mut samples, &mut account);
        order(&mut samples, &mut account);
        drop_stray_times(&mut samples, &mut account);
        let factor = f64::from(signal.sign) * signal.scale;
        samples.iter_mut().for_each(|s| s.1 = factor * unit.to_si(s.1) + signal.offset);
        let left_out = drop_bad(signal, &mut samples, &mut account);
        let turns = around(name, signal, &mut samples);
        let still = drop_still(signal, &mut samples, &mut account);
        let series = Series {
            t_s: samples.iter().map(|s| seconds(s.0) - signal.delay).collect(),
            value: samples.iter().map(|s| s.1).collect(),
        };
        describe(&series, &samples, &mut account);
        let mut notes = self.notes(name, &account, &log_ns, &stamps);
        notes.extend(said::nothing_left(name, &account, signal.optional));
        notes.extend(said::another_clock(name, &account, &clocks));
        notes.extend(said::set_back(name, &account, &twice));
        notes.extend(said::told(name, signal, &unit, &left_out));
        notes.extend(still.then(|| said::stood_still(name, &account)));
        notes.extend(turns);
        notes.extend(signal.trend.and_then(|trend| said::against(name, signal, trend, &series)));
        Ok((SignalLog { series, account, left_out }, notes))
    }

    fn no_such_field(&self, plan: &TopicPlan, signal: &SignalMap) -> String {
        let known = names(plan);
        let (field, topic, file) = (&signal.field, &signal.topic, self.log.name());
        if known.contains(&field.as_str()) {
            return format!("field \"{field}\" of topic \"{topic}\" in {file} holds no number");
        }
        agree::no_field(topic, field, &plan.fields, Default::default()).of(&file).what
    }

    fn time_key(&self, signal: &SignalMap) -> &'static str {
        if signal.time.is_some() { "time" } else { "topic" }
    }

    /// Log times and the stamps that count, ns since the flight's zero, in file order.
    fn stamps(
        &self,
        plan: &TopicPlan,
        data: &[&Columns],
        signal: &SignalMap,
    ) -> Result<(Vec<i64>, Stamps), String> {
        let since =
            |ns: u64| i64::try_from(i128::from(ns) - i128::from(self.start_ns)).unwrap_or(i64::MAX);
        let log_ns: Vec<i64> = data.iter().flat_map(|c| c.log.iter().map(|&t| since(t))).collect();
        let stamps = match self.map.time_source(signal) {
            TimeSource::Log => log_ns.iter().copied().map(Some).collect(),
            TimeSource::Publish => {
                if data.iter().all(|c| c.publish.iter().all(|&t| t == 0)) {
                    let (topic, file) = (&signal.topic, self.log.name());
                    return Err(format!(
                        "topic \"{topic}\" of {file} has no publish times (all are 0); use time = \"log\""
                    ));
                }
                data.iter().flat_map(|c| c.publish.iter().map(|&t| Some(since(t)))).collect()
            }
            TimeSource::Field(path, unit, zero) => {
                let zero_ns = match zero {
                    TimeZero::Epoch => self.start_ns,
                    TimeZero::Start => 0,
                };
                self.field_stamps(plan, data, &path, unit, zero_ns)?
            }
        };
        Ok((log_ns, stamps))
    }

    /// Stamps from a field of the message (or a pair of fields), ns since `zero_ns`.
    fn field_stamps(
        &self,
        plan: &TopicPlan,
        data: &[&Columns],
        path: &str,
        unit: Option<f64>,
        zero_ns: u64,
    ) -> Result<Stamps, String> {
        let stamp = |ns: i128| i64::try_from(ns - i128::from(zero_ns)).ok();
        // Larger numbers are no time; the limit keeps the sums below in range.
        let whole = |x: f64, unit: f64| {
            (libm::fabs(x * unit) < 1e20).then(|| libm::round(x * unit) as i128)
        };
        let stamps: Stamps = match (stamp_paths(path, unit, &plan.fields).as_slice(), unit) {
            ([sec, nanosec], _) => column(plan, data, sec)
                .zip(column(plan, data, nanosec))
                .map(|(s, ns)| stamp(whole(s, 1.0)? * 1_000_000_000 + whole(ns, 1.0)?))
                .collect(),
            (_, Some(unit)) => {
                let rest = rest_path(path, Some(unit));
                let rest = rest.filter(|rest| plan.paths.contains(rest));
                let rests = rest.iter().flat_map(|rest| column(plan, data, rest));
                // Only what is there counts: a number with a point has nothing but itself.
                let rests = rests.map(|x| if x.is_finite() { x as i128 } else { 0 });
                column(plan, data, path)
                    .zip(rests.chain(std::iter::repeat(0)))
                    .map(|(x, rest)| stamp(whole(x, unit)? + rest))
                    .collect()
            }
            _ => {
                let what = format!(
                    "the time stamp \"{path}\" of topic \"{}\" needs a time_unit",
                    plan.topic
                );
                return Err(format!("{what}: \"s\", \"ms\", \"us\" or \"ns\""));
            }
        };
        if stamps.iter().all(Option::is_none) {
            let has = words::nearest_first(path, &names(plan));
            let (topic, file) = (&plan.topic, self.log.name());
            return Err(format!(
                "no message of topic \"{topic}\" in {file} has a time stamp \"{path}\"; it has {has}"
            ));
        }
        Ok(stamps)
    }

    fn notes(&self, name: &str, a: &Account, log_ns: &[i64], stamps: &[Option<i64>]) -> Vec<Note> {
        let from = format!("{} {}", a.topic, a.field);
        let of = format!("of {} messages", a.messages);
        let (mut notes, mut few) = (Vec::new(), Vec::new());
        let mut say = |count: u64, text: String| {
            if count > 0 {
                notes.push(Note::warning(name, count, format!("{from}: {text}")));
            }
        };
        let damaged = a.dropped_unreadable - a.lacking;
        say(damaged, format!("{damaged} {of} unreadable"));
        let (field, lacking) = (&a.field, a.lacking);
        say(lacking, format!("{lacking} {of} have no field {field}, or no number in it"));
        say(a.dropped_nan, format!("{} {of} hold NaN, dropped", a.dropped_nan));
        let repeated = format!("{} {of} repeat a time stamp, dropped", a.dropped_duplicate);
        if a.dropped_duplicate.saturating_mul(1000) >= a.messages {
            say(a.dropped_duplicate, repeated);
        } else if a.dropped_duplicate > 0 {
            // a recorder that now and then writes a message twice loses nothing
            few.push(Note::info(name, a.dropped_duplicate, format!("{from}: {repeated}")));
        }
        let range = format!("{} {of} outside its range, dropped", a.dropped_out_of_range);
        say(a.dropped_out_of_range, range);
        let strays = a.dropped_times - a.dropped_twice - a.dropped_clock;
        say(strays, format!("{strays} {of} with times more than a day from the others, dropped"));
        say(a.clock_jumps, format!("the clock jumps by more than 1 s at {} places", a.clock_jumps));
        notes.append(&mut few);
        notes.extend(said::out_of_order(name, a));
        // Stamps of a clock of their own (since boot, say) would silently shift the signal against
        // all others.
        let mut apart: Vec<i64> = stamps
            .iter()
            .zip(log_ns)
            .filter_map(|(s, l)| Some(s.as_ref()?.saturating_sub(*l)))
            .collect();
        let middle = apart.len() / 2;
        if !apart.is_empty() && apart.select_nth_unstable(middle).1.saturating_abs() > 1_000_000_000
        {
            let text = format!(
                "{from}: its time stamps are {:.3} s off the log time; signals of other clocks are not aligned with it (time_zero = \"start\" for stamps that count from the start of the recording)",
                seconds(apart[middle])
            );
            notes.push(Note::warning(name, a.messages, text));
        }
        notes
    }
}

/// Drops samples outside the range and spikes; they are returned with their neighbours.
fn drop_bad(signal: &SignalMap, samples: &mut Vec<(i64, f64)>, account: &mut Account) -> Vec<Seen> {
    let outside = |y: f64| signal.range.is_some_and(|[low, high]| !(y >= low && y <= high));
    let fate = |s: &(i64, f64)| if outside(s.1) { Fate::OutOfRange } else { Fate::Kept };
    let mut fates: Vec<Fate> = samples.iter().map(fate).collect();
    let inside: Vec<usize> = (0..samples.len()).filter(|&k| fates[k] == Fate::Kept).collect();
    account.dropped_out_of_range = (samples.len() - inside.len()) as u64;
    if signal.spikes != Wrong::Keep {
        let (t, y): (Vec<i64>, Vec<f64>) = inside.iter().map(|&k| samples[k]).unzip();
        let found = spikes::found(&t, &y, turn(signal));
        account.dropped_spikes = found.len() as u64;
        found.into_iter().for_each(|k| fates[inside[k]] = Fate::Spike);
    }
    let seen = left_out::seen(samples, &fates, signal.delay);
    if !seen.is_empty() {
        let mut fates = fates.iter();
        samples.retain(|_| fates.next() == Some(&Fate::Kept));
    }
    seen
}

/// Finds where a sensor stands still, and drops what it repeats there; whether it did. The first sample of
/// that time is one like those before.
fn drop_still(signal: &SignalMap, samples: &mut Vec<(i64, f64)>, account: &mut Account) -> bool {
    let (t, y): (Vec<f64>, Vec<f64>) =
        samples.iter().map(|s| (seconds(s.0) - signal.delay, s.1)).unzip();
    let Some(run) = still::longest(&t, &y) else { return false };
    account.still = Some([t[run.start], t[run.end - 1]]);
    if signal.still == Wrong::Keep {
        return false;
    }
    account.dropped_still = (run.len() - 1) as u64;
    samples.drain(run.start + 1..run.end);
    true
}

/// The fields of a topic that a map can name.
fn names(plan: &TopicPlan) -> Vec<&str> {
    plan.fields.iter().map(|f| f.path.as_str()).filter(|p| !p.contains('*')).collect()
}

/// One field of a topic over all parts.
fn column<'a>(
    plan: &TopicPlan,
    data: &'a [&'a Columns],
    path: &str,
) -> impl Iterator<Item = f64> + Clone + 'a {
    let (at, width) =
        (plan.paths.iter().position(|p| p == path).unwrap_or(0), plan.paths.len().max(1));
    data.iter().flat_map(move |c| c.values.iter().skip(at).step_by(width).copied())
}
