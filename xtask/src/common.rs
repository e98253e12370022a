//! Options and small things every verb shares.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Where networks are computed.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The CPU, through burn.
    Flex,
    /// An NVIDIA GPU, through the fused engine (build with `--features cuda`).
    Cuda,
}

/// A progress bar with throughput and time left; a line every twenty seconds where there is no terminal.
pub struct Bar {
    bar: Option<ProgressBar>,
    what: String,
    total: u64,
    started: Instant,
    printed: Mutex<Instant>,
    said: Mutex<String>,
}

/// Starts a bar over `total` units of `what`.
pub fn bar(what: &str, total: u64) -> Bar {
    let bar = std::io::stderr().is_terminal().then(|| {
        let bar = ProgressBar::new(total);
        if let Ok(style) = ProgressStyle::with_template("{msg} {bar:30} {human_pos}/{human_len}, {per_sec}, {eta} left") {
            bar.set_style(style);
        }
        bar.with_message(what.to_string())
    });
    Bar { bar, what: what.into(), total, started: Instant::now(), printed: Mutex::new(Instant::now()), said: Mutex::default() }
}

impl Bar {
    /// `done` units are done.
    pub fn set(&self, done: u64) {
        if let Some(bar) = &self.bar {
            return bar.set_position(done);
        }
        let Ok(mut printed) = self.printed.lock() else { return };
        if printed.elapsed() > Duration::from_secs(20) {
            let rate = done as f64 / self.started.elapsed().as_secs_f64();
            let left = self.total.saturating_sub(done) as f64 / rate.max(1e-9);
            let said = self.said.lock().map(|said| said.clone()).unwrap_or_default();
            eprintln!("{} {done}/{}, {rate:.0}/s, {left:.0} s left{said}", self.what, self.total);
            *printed = Instant::now();
        }
    }

    /// What else is to be known now, for example how well it goes.
    pub fn say(&self, text: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(format!("{}: {text}", self.what));
        }
        if let Ok(mut said) = self.said.lock() {
            *said = format!("; {text}");
        }
    }

    /// Takes the bar away.
    pub fn finish(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Folders in one, by their names' beginning, in order; none if it is not there.
pub fn folders(of: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    if !of.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(of).with_context(|| format!("cannot read {}", of.display()))?;
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| p.join("config.json").exists()).collect();
    found.retain(|p| p.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix)));
    found.sort();
    Ok(found)
}
