//! Learning rate over a run of N updates.
//!
//! With k the updates of the tail, `lr(s) = start + (end - start) s / (N - k)` for s < N - k and
//! `lr(s) = end (N - s) / k` after it; during the w updates of the warm-up it is multiplied by `(s + 1) / w`.
//! The paper steps `1e-3 (1 - e/1000) + 1e-4 e/1000` once per epoch of 5000 updates; here every update steps.

use crate::prelude::*;

/// Linear decay with optional warm-up and tail.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Rate of the first update (paper: 1e-3).
    pub start: f64,
    /// Rate the decay ends at (paper: 1e-4).
    pub end: f64,
    /// Updates over which the rate rises from zero (paper: 0).
    pub warmup: u64,
    /// Last updates, over which the rate falls from `end` to zero (paper: 0). With a high `end` this is the
    /// "constant, then cool down" schedule.
    pub tail: u64,
}

impl Schedule {
    /// Refuses rates that teach nothing or blow up.
    pub fn check(&self) -> Result<(), String> {
        within("rate", self.start, 1e-12..=10.0, "")?;
        within("last_rate", self.end, 0.0..=10.0, "")
    }

    /// Learning rate of update `step`, counted from 0, in a run of `updates`.
    pub fn rate(&self, step: u64, updates: u64) -> f64 {
        let decay = updates.saturating_sub(self.tail);
        let rate = if step < decay {
            self.start + (self.end - self.start) * step as f64 / decay as f64
        } else {
            self.end * updates.saturating_sub(step) as f64 / self.tail.max(1) as f64
        };
        if step < self.warmup { rate * (step + 1) as f64 / self.warmup as f64 } else { rate }
    }
}
