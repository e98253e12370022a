//! What a running training shows on standard error: a bar on a terminal, a line every twenty seconds elsewhere.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between lines where there is no terminal.
const EVERY: Duration = Duration::from_secs(20);

/// Shows the progress of one run.
#[derive(Debug)]
pub struct Report {
    bar: Option<ProgressBar>,
    updates: u64,
    /// Step and time the estimate of the time left starts from.
    origin: (u64, Instant),
    printed: Option<Instant>,
}

impl Report {
    /// A run of `updates` that has done `step`.
    pub fn new(step: u64, updates: u64) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(updates);
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} updates, {msg}, {eta} left") {
                bar.set_style(style);
            }
            bar.set_position(step);
            bar.reset_eta();
            bar
        });
        Self { bar, updates, origin: (step, Instant::now()), printed: None }
    }

    /// `step` updates are done, the last ones with this mean loss and speed.
    pub fn progress(&mut self, step: u64, loss: f32, windows_per_second: f64) {
        let message = format!("loss {loss:.3e}, {windows_per_second:.0} windows/s");
        if let Some(bar) = &self.bar {
            bar.set_message(message);
            bar.set_position(step);
        } else if step == self.updates || self.printed.is_none_or(|t| t.elapsed() >= EVERY) {
            let done = step.saturating_sub(self.origin.0).max(1) as f64;
            let left = self.origin.1.elapsed().as_secs_f64() / done * self.updates.saturating_sub(step) as f64;
            eprintln!("{step}/{} updates, {message}, {left:.0} s left", self.updates);
            self.printed = Some(Instant::now());
        }
    }

    /// A validation was made.
    pub fn validation(&mut self, step: u64, loss: f32, criterion: f64, best: bool) {
        let star = if best { ", best so far" } else { "" };
        let line = format!("step {step}: validation loss {loss:.4e}, criterion {criterion:.4e}{star}");
        match &self.bar {
            Some(bar) => bar.println(line),
            None => eprintln!("{line}"),
        }
    }
}
