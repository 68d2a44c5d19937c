//! Progress of a run: events come in, bars on the terminal and the time of each stage go out; where
//! standard error is no terminal, lines of what a unit tells, and now and then one of how far a long
//! run is.

use super::left;
use super::summary::count;
use super::words::{Volume, aside, detail, plain};
use crate::pipeline::{Ended, Event};
use crate::stage::Stage;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Bars for the stages of a run.
pub struct Bars {
    visible: bool,
    state: Arc<Mutex<State>>,
    /// Where lines stand in for bars: they end with it.
    _lines: Option<Sender<()>>,
}

#[derive(Default)]
struct State {
    bar: Option<ProgressBar>,
    /// The stage that runs, and since when.
    running: Option<(&'static str, Instant)>,
    /// By stage: time that passed, s.
    seconds: BTreeMap<&'static str, f64>,
    /// The flights whose stage it is, in words.
    of: String,
    /// Steps done and wanted, by unit, of the stage that runs.
    steps: BTreeMap<String, (usize, usize)>,
    units: usize,
    /// When the next line about how far a run is may come.
    next: Option<Instant>,
}

/// Every unit counts as so many steps of the bar.
const GRAIN: u64 = 1000;
/// A run that is over by then needs no line about how far it is.
const FIRST_LINE: Duration = Duration::from_secs(5);
/// From one such line to the next.
const EVERY: Duration = Duration::from_secs(10);

impl Bars {
    pub fn new() -> Bars {
        let heard = Volume::Document.is_heard();
        let visible = heard && std::io::stderr().is_terminal();
        let state = Arc::new(Mutex::new(State::default()));
        let _lines = (heard && !visible).then(|| lines(state.clone())).flatten();
        Bars { visible, state, _lines }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.state)
    }

    /// The time that passed in each stage, s.
    pub fn seconds(&self) -> BTreeMap<&'static str, f64> {
        self.state().seconds.clone()
    }

    /// Shows an event.
    pub fn hear(&self, event: Event) {
        let mut state = self.state();
        state.detail(&event);
        state.clock(&event);
        match event {
            Event::Stage { stage, to_run, flights } => {
                state.steps.clear();
                state.units = to_run;
                state.of = of(flights);
                let shown = self.visible && to_run > 0;
                state.bar = shown.then(|| bar(stage, &state.of, to_run));
            }
            Event::Step { unit, done, of } => {
                // Work inside a unit runs in parallel: the count may arrive out of order.
                let entry = state.steps.entry(unit.name.clone()).or_insert((0, of));
                *entry = (entry.0.max(done), of);
                state.show();
            }
            Event::Told { unit, text } => {
                let line = format!("{}: {text}", unit.name);
                match &state.bar {
                    // Above the bar, which goes on.
                    Some(bar) => bar.println(plain(&line)),
                    None if Volume::Document.is_heard() => aside(&line),
                    None => {}
                }
            }
            Event::Unit { ended: Ended::Kept(_) | Ended::Blocked(_), .. } => {}
            Event::Unit { unit, .. } => {
                state.steps.insert(unit.name.clone(), (1, 1));
                state.show();
            }
            Event::End => {
                if let Some(bar) = state.bar.take() {
                    bar.finish_and_clear();
                }
            }
        }
    }
}

impl State {
    /// Says each unit of work, where that is asked for.
    fn detail(&self, event: &Event) {
        let running = self.running.map_or("", |(stage, _)| stage);
        let line = match event {
            Event::Stage { stage, to_run, .. } if *to_run > 0 => {
                format!("{}: {}", stage.name, count(*to_run, "unit"))
            }
            Event::Unit { ended: Ended::Kept(_) | Ended::Blocked(_), .. } => return,
            Event::Unit { unit, .. } => format!("{running} of {}: done", unit.name),
            _ => return,
        };
        match &self.bar {
            Some(bar) => bar.suspend(|| detail(&line)),
            None => detail(&line),
        }
    }

    fn clock(&mut self, event: &Event) {
        match event {
            Event::Stage { stage, .. } => self.running = Some((stage.name, Instant::now())),
            Event::End => {
                if let Some((stage, since)) = self.running.take() {
                    *self.seconds.entry(stage).or_default() += since.elapsed().as_secs_f64();
                }
            }
            _ => {}
        }
    }

    /// How much is done: in grains, and in whole units.
    fn done(&self) -> (u64, usize) {
        let parts = self.steps.values().filter(|(_, of)| *of > 0);
        let grains = parts.map(|(done, of)| GRAIN * *done as u64 / *of as u64).sum();
        (grains, self.steps.values().filter(|(done, of)| done == of).count())
    }

    fn show(&self) {
        if let Some(bar) = &self.bar {
            let (grains, done) = self.done();
            bar.set_position(grains);
            bar.set_message(format!("{done}/{}", self.units));
        }
    }

    /// How far the stage is that runs, where a line about it is due by now.
    fn line(&mut self, now: Instant) -> Option<String> {
        let next = *self.next.get_or_insert(now + FIRST_LINE);
        let (stage, since) = self.running.filter(|_| self.units > 0 && now >= next)?;
        let ((grains, done), passed) = (self.done(), now.saturating_duration_since(since));
        if passed < left::SOON {
            return None;
        }
        self.next = Some(now + EVERY);
        let share = grains as f64 / (GRAIN * self.units as u64) as f64;
        Some(format!(
            "{stage}{}: {done} of {}, {}{}",
            self.of,
            count(self.units, "unit"),
            left::spoken(passed),
            left::words(share, passed)
        ))
    }
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(|p| p.into_inner())
}

/// Says from time to time how far a run is, until what is returned is dropped; none where there is no thread
/// for it, which is no reason to do without the run.
fn lines(state: Arc<Mutex<State>>) -> Option<Sender<()>> {
    let (end, ended) = channel();
    let say = move || say_until(&ended, &state);
    std::thread::Builder::new().name("progress".into()).spawn(say).ok().map(|_| end)
}

fn say_until(ended: &Receiver<()>, state: &Mutex<State>) {
    while ended.recv_timeout(Duration::from_secs(1)) == Err(RecvTimeoutError::Timeout) {
        if let Some(line) = locked(state).line(Instant::now()) {
            aside(&line);
        }
    }
}

/// Which flights these are, in words behind a stage.
fn of(flights: Option<&[String]>) -> String {
    match flights {
        Some([first, .., last]) => format!(", {first} to {last}"),
        Some([only]) => format!(", {only}"),
        _ => String::new(),
    }
}

fn bar(stage: &Stage, of: &str, units: usize) -> ProgressBar {
    let bar =
        ProgressBar::with_draw_target(Some(GRAIN * units as u64), ProgressDrawTarget::stderr());
    let template = "{prefix:<12} {bar:30} {msg:>7} {elapsed:>4}{left}";
    if let Ok(style) = ProgressStyle::with_template(template) {
        let left = |state: &ProgressState, to: &mut dyn std::fmt::Write| {
            // A terminal's line that cannot be made is drawn without it.
            let _ = to.write_str(&left::words(state.fraction().into(), state.elapsed()));
        };
        bar.set_style(style.with_key("left", left));
    }
    bar.set_prefix(format!("{} ({}{of})", stage.name, stage.about));
    bar.set_message(format!("0/{units}"));
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_run_says_now_and_then_how_far_it_is_and_a_short_one_nothing() {
        let begin = Instant::now();
        let at = |seconds| begin + Duration::from_secs(seconds);
        let steps = BTreeMap::from([("a".to_string(), (1, 1)), ("b".to_string(), (5, 10))]);
        let running = Some(("estimate", begin));
        let mut state = State { running, steps, units: 6, ..State::default() };
        assert_eq!((state.line(begin), state.line(at(4))), (None, None));
        let first = "estimate: 1 of 6 units, 5 s, about 15 s left";
        assert_eq!(state.line(at(5)).as_deref(), Some(first));
        assert_eq!(state.line(at(14)), None);
        let second = "estimate: 1 of 6 units, 1 min 20 s, about 4 min left";
        assert_eq!(state.line(at(80)).as_deref(), Some(second));
        state.running = None;
        assert_eq!(state.line(at(200)), None);
    }
}
