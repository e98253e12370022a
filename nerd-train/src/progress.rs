//! Progress on standard error: a bar on a terminal, elsewhere a line every twenty seconds.

use std::io::{IsTerminal, Write};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::prelude::*;

/// Prints a line on standard error. A closed pipe (`2>&1 | head`) is ignored.
pub fn tell(text: std::fmt::Arguments) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Prints the assumptions made about a robot, a line each. For a built-in robot it prints nothing, since the robot's
/// files state them.
pub fn notes(system: &System) {
    if System::texts(&system.name).is_none() {
        system.notes.iter().for_each(|note| tell(format_args!("{}: {note}", system.name)));
    }
}

/// Time between lines where standard error is not a terminal.
const EVERY: Duration = Duration::from_secs(20);

/// Progress of one task, with throughput and remaining time.
#[derive(Debug)]
pub struct Bar {
    /// The drawn bar, hidden where standard error is not a terminal.
    bar: ProgressBar,
    what: String,
    /// Units done at the start, and time of the start, for the throughput.
    origin: (u64, Instant),
    /// Time of the last line; none on a terminal, or inside parallel work, where only the outer bar shows.
    printed: Option<Mutex<Instant>>,
}

/// Starts a bar over `total` units of `what`.
pub fn bar(what: &str, total: u64) -> Bar {
    bar_from(what, 0, total)
}

/// Starts a bar over `total` units of `what`, with `done` units finished before.
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
    /// Sets the number of finished units, earlier runs included.
    pub fn set(&self, done: u64) {
        self.bar.set_position(done);
        self.print();
    }

    /// Adds `more` finished units.
    pub fn add(&self, more: u64) {
        self.bar.inc(more);
        self.print();
    }

    fn print(&self) {
        let Some(Ok(mut printed)) = self.printed.as_ref().map(Mutex::lock) else { return };
        if printed.elapsed() > EVERY {
            let done = self.bar.position();
            let total = self.bar.length().unwrap_or_default();
            let rate = done.saturating_sub(self.origin.0) as f64 / self.origin.1.elapsed().as_secs_f64();
            let left = total.saturating_sub(done) as f64 / rate.max(1e-9);
            tell!("{} {done}/{total}, {rate:.0}/s, {left:.0} s left", self.bar.message());
            *printed = Instant::now();
        }
    }

    /// Sets the text after the bar's name, for example the loss.
    pub fn say(&self, text: &str) {
        self.bar.set_message(format!("{}: {text}", self.what));
    }

    /// Prints a line that stays above the bar.
    pub fn line(&self, text: &str) {
        if self.bar.is_hidden() { tell!("{text}") } else { self.bar.println(text) }
    }

    /// Removes the bar.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
