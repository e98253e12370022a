//! Model predictive path integral control (Williams et al. 2017, "Information theoretic MPC for model-based reinforcement learning"): plans
//! are drawn about the present one, rolled out, and averaged with weights `exp(R / temperature)` of their rewards R. It needs no slopes.
//! Its cost of control is left out (gamma = 0), the plan itself is one of the samples, and actions are limited by clamping those drawn.

use nerd_sim::sampling::{normal, stream};
use nerd_sim::solver::StepError;

use super::Planner;
use super::ahead::Ahead;
use crate::Episodes;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MppiConfig {
    /// Plans that are compared for an environment.
    pub samples: usize,
    /// Steps of a plan.
    pub steps: usize,
    /// Standard deviation of what is added to an action.
    pub noise: f64,
    /// Steps for which that is held.
    pub hold: usize,
    /// By so much (sum of rewards) may a plan be worse than the best, and count 1/e.
    pub temperature: f64,
    /// Rounds of drawing and averaging for each action.
    pub rounds: usize,
    /// Seed of what is drawn.
    pub seed: u64,
}

impl Default for MppiConfig {
    fn default() -> Self {
        Self { samples: 32, steps: 24, noise: 0.4, hold: 1, temperature: 1.0, rounds: 1, seed: 0 }
    }
}

/// The planner.
pub struct Mppi {
    ahead: Ahead,
    config: MppiConfig,
}

impl Mppi {
    /// Looks ahead in `episodes`, of which there are [`MppiConfig::samples`] for each environment that is planned for.
    pub fn new(episodes: Episodes, config: MppiConfig) -> Self {
        Self { ahead: Ahead::new(episodes, config.samples, config.steps), config }
    }

    /// Plans of all copies, `[step][copy][action]`; the first copy of an environment has its plan as it is.
    fn draw(&self, present: &Episodes, round: usize) -> Vec<f64> {
        let (Ahead { plans, steps, copies, .. }, MppiConfig { noise, hold, seed, .. }) = (&self.ahead, self.config);
        let (n, width) = (self.ahead.episodes.len(), self.ahead.episodes.task.action_dim());
        let mut drawn = vec![0.0; steps * n * width];
        for (env, plan) in plans.chunks_exact(self.ahead.size()).enumerate() {
            let (first, frame) = (present.draws().1 + env, present.simulation.batch.frames[env]);
            let mut rng = stream(seed.wrapping_add(round as u64), (first as u64) << 32 | frame);
            for copy in 0..*copies {
                let mut change = vec![0.0; width];
                for (step, planned) in plan.chunks_exact(width).enumerate() {
                    if copy > 0 && step % hold.max(1) == 0 {
                        change.iter_mut().for_each(|x| *x = noise * normal(&mut rng));
                    }
                    let at = (step * n + env * copies + copy) * width;
                    (0..width).for_each(|k| drawn[at + k] = (planned[k] + change[k]).clamp(-1.0, 1.0));
                }
            }
        }
        drawn
    }
}

impl Planner for Mppi {
    fn act(&mut self, present: &Episodes) -> Result<Vec<f64>, StepError> {
        self.ahead.begin(present)?;
        for round in 0..self.config.rounds {
            self.ahead.place(present)?;
            let drawn = self.draw(present, round);
            let totals = self.ahead.rewards(&drawn)?;
            let (n, copies, size) = (totals.len(), self.config.samples, self.ahead.size());
            let width = size / self.ahead.steps;
            for (env, (plan, totals)) in self.ahead.plans.chunks_exact_mut(size).zip(totals.chunks_exact(copies)).enumerate() {
                let best = totals.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let weights: Vec<f64> = totals.iter().map(|total| ((total - best) / self.config.temperature).exp()).collect();
                let sum: f64 = weights.iter().sum();
                plan.fill(0.0);
                for (copy, weight) in weights.iter().enumerate() {
                    for (step, plan) in plan.chunks_exact_mut(width).enumerate() {
                        let drawn = &drawn[(step * n + env * copies + copy) * width..];
                        plan.iter_mut().zip(drawn).for_each(|(x, drawn)| *x += weight / sum * drawn);
                    }
                }
            }
        }
        self.ahead.take(present)
    }
}
