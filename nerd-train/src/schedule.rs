//! Learning rate over a run of N updates.
//!
//! `lr(s) = start + (end - start) s / N`; during the w updates of the warm-up it is multiplied by `(s + 1) / w`. The
//! paper's rate is `1e-3 (1 - e/1000) + 1e-4 e/1000` in epoch e of 5000 updates. Here the rate changes at every update.

use crate::prelude::*;

/// Linear decay with optional warm-up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Learning rate of the first update (paper: 1e-3).
    pub start: f64,
    /// Learning rate at the end of the decay (paper: 1e-4).
    pub end: f64,
    /// Updates over which the rate rises from zero (paper: 0).
    pub warmup: u64,
}

impl Schedule {
    /// Refuses rates outside their ranges.
    pub fn check(&self) -> Result<(), String> {
        within("rate", self.start, 1e-12..=10.0, "")?;
        within("last_rate", self.end, 0.0..=10.0, "")
    }

    /// Learning rate of update `step`, counted from 0, in a run of `updates`.
    pub fn rate(&self, step: u64, updates: u64) -> f64 {
        let rate = self.start + (self.end - self.start) * step.min(updates) as f64 / updates.max(1) as f64;
        if step < self.warmup { rate * (step + 1) as f64 / self.warmup as f64 } else { rate }
    }
}
