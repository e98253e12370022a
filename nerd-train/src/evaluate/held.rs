//! Drives with random targets around the default pose, a new one every 20 ms, like a policy's commands.

use nerd_sim::drive::{Drive, holding, specified};

use crate::prelude::*;

/// Time between new targets (s).
const PERIOD: f64 = 0.02;

/// Random targets of the joints' drives, which change every [`Held::every`] frames.
pub struct Held {
    /// Drives of one environment, at the default pose.
    pub rest: Vec<Drive>,
    /// Number of frames between new targets.
    pub every: usize,
    /// Offsets of the targets from the default pose (rad or m), `[target][env][joint]`.
    pub targets: Vec<Vec<Vec<f64>>>,
}

impl Held {
    /// Draws targets within `size` (rad or m) of the default pose, for `starts` starts of `frames` frames each.
    pub(super) fn new(system: &System, size: f64, [starts, frames]: [usize; 2], seed: u64) -> Self {
        let mut rest = specified(system);
        if rest.is_empty() {
            rest = holding(system, &system.default_state());
        }
        let every = ((PERIOD / system.frame_time).round() as usize).max(1);
        let mut streams = (0..starts as u64).map(|env| stream(seed.wrapping_add(1), env)).collect_vec();
        let draw = |rng: &mut ChaCha8Rng| rest.iter().map(|_| rng.random_range(-1.0..=1.0) * size).collect();
        let targets = (0..frames.div_ceil(every)).map(|_| streams.iter_mut().map(draw).collect()).collect();
        Self { rest, every, targets }
    }

    /// Drives `[env][joint]` with target number `target`. Environments beyond the number of starts repeat the starts'
    /// targets cyclically.
    pub fn drives(&self, target: usize, environments: usize) -> Vec<Drive> {
        let of = |own: &Vec<f64>| {
            self.rest.iter().zip(own).map(|(drive, x)| Drive { target: drive.target + x, ..*drive }).collect_vec()
        };
        self.targets[target].iter().cycle().take(environments).flat_map(of).collect()
    }
}
