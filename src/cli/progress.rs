//! Progress of a run: events come in, bars on the terminal and the time of each stage go out; where
//! standard error is no terminal, only lines of what a unit tells.

use super::summary::count;
use super::words::{Volume, aside, detail, plain};
use crate::pipeline::{Ended, Event};
use crate::stage::Stage;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

/// Bars for the stages of a run.
pub struct Bars {
    visible: bool,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    bar: Option<ProgressBar>,
    /// The stage that runs, and since when.
    running: Option<(&'static str, Instant)>,
    /// By stage: time that passed, s.
    seconds: BTreeMap<&'static str, f64>,
    /// Steps done and wanted, by unit, of the stage that runs.
    steps: BTreeMap<String, (usize, usize)>,
    units: usize,
}

/// Every unit counts as so many steps of the bar.
const GRAIN: u64 = 1000;

impl Bars {
    pub fn new() -> Bars {
        let visible = std::io::stderr().is_terminal() && Volume::Document.is_heard();
        Bars { visible, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|p| p.into_inner())
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
        if !self.visible {
            if let Event::Told { unit, text } = event
                && Volume::Document.is_heard()
            {
                aside(&format!("{}: {text}", unit.name));
            }
            return;
        }
        match event {
            Event::Stage { stage, to_run, flights } => {
                state.steps.clear();
                state.units = to_run;
                state.bar = (to_run > 0).then(|| bar(stage, flights, to_run));
            }
            Event::Step { unit, done, of } => {
                // Work inside a unit runs in parallel: the count may arrive out of order.
                let entry = state.steps.entry(unit.name.clone()).or_insert((0, of));
                *entry = (entry.0.max(done), of);
                state.show();
            }
            // Above the bar, which goes on.
            Event::Told { unit, text } => {
                if let Some(bar) = &state.bar {
                    bar.println(plain(&format!("{}: {text}", unit.name)));
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

    fn show(&self) {
        if let Some(bar) = &self.bar {
            let parts = self
                .steps
                .values()
                .filter(|(_, of)| *of > 0)
                .map(|(done, of)| GRAIN * *done as u64 / *of as u64);
            bar.set_position(parts.sum());
            let done = self.steps.values().filter(|(done, of)| done == of).count();
            bar.set_message(format!("{done}/{}", self.units));
        }
    }
}

fn bar(stage: &Stage, flights: Option<&[String]>, units: usize) -> ProgressBar {
    let bar =
        ProgressBar::with_draw_target(Some(GRAIN * units as u64), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{prefix:<12} {bar:30} {msg:>7} {elapsed:>4}") {
        bar.set_style(style);
    }
    let of = match flights {
        Some([first, .., last]) => format!(", {first} to {last}"),
        Some([only]) => format!(", {only}"),
        _ => String::new(),
    };
    bar.set_prefix(format!("{} ({}{of})", stage.name, stage.about));
    bar.set_message(format!("0/{units}"));
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}
