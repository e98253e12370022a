//! Where the time of a policy's training goes.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use nerd_model::transformer::{ForwardError, Stream};
use nerd_sim::prelude::*;

use super::Iteration;

/// Nanoseconds in a solver, and of these in its network.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    /// In a solver, its network included.
    pub solver: Arc<AtomicU64>,
    /// In its network.
    pub network: Arc<AtomicU64>,
}

/// Something whose time is added to a clock.
pub(super) struct Timed<T>(pub(super) T, pub(super) Arc<AtomicU64>);

impl<T> Timed<T> {
    fn time<R>(&mut self, work: impl FnOnce(&mut T) -> R) -> R {
        let started = Instant::now();
        let done = work(&mut self.0);
        self.1.fetch_add(started.elapsed().as_nanos() as u64, Ordering::Relaxed);
        done
    }
}

impl Solver for Timed<Box<dyn Solver>> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.time(|solver| solver.step(batch, torques))
    }

    fn reset(&mut self, env: usize) {
        self.0.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.0.capabilities()
    }

    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn nerd_sim::articulated::device::Resident> {
        self.0.resident()
    }
}

impl Stream for Timed<Box<dyn Stream>> {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        self.time(|network| network.push(tokens, asked, out))
    }

    fn clear(&mut self, env: usize) {
        self.0.clear(env);
    }
}

/// Seconds of some iterations by what they were spent on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Split {
    rollout: f64,
    policy: f64,
    update: f64,
    steps: f64,
    /// Where no clock counts it.
    solver: f64,
}

impl Split {
    /// One more iteration of `steps` steps.
    pub fn add(&mut self, line: &Iteration, steps: usize) {
        self.rollout += line.rollout_seconds;
        self.policy += line.policy_seconds;
        self.update += line.update_seconds;
        self.steps += steps as f64;
        self.solver += line.solver_seconds.unwrap_or(0.0);
    }

    /// In words: steps a second, and shares.
    pub fn words(&self, clock: &Clock) -> String {
        let [solver, network] = [&clock.solver, &clock.network].map(|c| c.load(Ordering::Relaxed) as f64 * 1e-9);
        let solver = solver + self.solver;
        let all = (self.rollout + self.update).max(1e-9);
        let share = |seconds: f64| format!("{:.0} %", 100.0 * seconds.max(0.0) / all);
        let dynamics = match network {
            0.0 => format!("solver {}", share(solver)),
            _ => format!("network {}, contact queries, flight and tokens {}", share(network), share(solver - network)),
        };
        let task = share(self.rollout - solver - self.policy);
        let (policy, update) = (share(self.policy), share(self.update));
        format!("{:.0} steps/s: {dynamics}, task {task}, policy {policy}, update {update}", self.steps / all)
    }
}
