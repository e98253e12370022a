//! Progress on standard error: a bar on a terminal, a line every twenty seconds elsewhere.

use std::io::{IsTerminal, Write};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::prelude::*;

/// A line on standard error. Nobody may read there (`2>&1 | head`), which ends no work.
pub fn tell(text: std::fmt::Arguments) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// What was taken for granted of a robot, a line each; built-in ones say it in their files.
pub fn notes(system: &System) {
    if System::texts(&system.name).is_none() {
        system.notes.iter().for_each(|note| tell(format_args!("{}: {note}", system.name)));
    }
}

/// Time between lines where there is no terminal.
const EVERY: Duration = Duration::from_secs(20);

/// Progress of one piece of work, with throughput and time left.
#[derive(Debug)]
pub struct Bar {
    /// Hidden where there is no terminal.
    bar: ProgressBar,
    what: String,
    /// Units and time the estimate of the time left starts from.
    origin: (u64, Instant),
    /// When a line was last printed; of a part of parallel work none is, since only the bar around it is shown.
    printed: Option<Mutex<Instant>>,
}

/// Starts a bar over `total` units of `what`.
pub fn bar(what: &str, total: u64) -> Bar {
    bar_from(what, 0, total)
}

/// Starts a bar over `total` units of `what`, of which `done` were done before.
pub fn bar_from(what: &str, done: u64, total: u64) -> Bar {
    let inner = rayon::current_thread_index().is_some();
    let shown = std::io::stderr().is_terminal() && !inner;
    let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(total), target).with_message(what.to_string());
    if let Ok(style) = ProgressStyle::with_template("{msg} {bar:30} {human_pos}/{human_len}, {per_sec}, {eta} left") {
        bar.set_style(style);
    }
    bar.set_position(done);
    bar.reset_eta();
    let now = Instant::now();
    Bar { bar, what: what.into(), origin: (done, now), printed: (!shown && !inner).then(|| Mutex::new(now)) }
}

impl Bar {
    /// Sets the count of finished units to `done`, including units of earlier runs.
    pub fn set(&self, done: u64) {
        self.bar.set_position(done);
        self.print();
    }

    /// So many more are done.
    pub fn add(&self, more: u64) {
        self.bar.inc(more);
        self.print();
    }

    fn print(&self) {
        let Some(Ok(mut printed)) = self.printed.as_ref().map(Mutex::lock) else { return };
        if printed.elapsed() > EVERY {
            let (done, total) = (self.bar.position(), self.bar.length().unwrap_or_default());
            let rate = done.saturating_sub(self.origin.0) as f64 / self.origin.1.elapsed().as_secs_f64();
            let left = total.saturating_sub(done) as f64 / rate.max(1e-9);
            tell!("{} {done}/{total}, {rate:.0}/s, {left:.0} s left", self.bar.message());
            *printed = Instant::now();
        }
    }

    /// What else is to be known now, for example how well it goes.
    pub fn say(&self, text: &str) {
        self.bar.set_message(format!("{}: {text}", self.what));
    }

    /// A line of its own, which stays.
    pub fn line(&self, text: &str) {
        if self.bar.is_hidden() { tell!("{text}") } else { self.bar.println(text) }
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
