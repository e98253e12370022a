//! The trait of a task that is written in formulas, and such a task as a [`Task`].

use nerd_sim::system::System;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::program::program;
use super::sight::Direct;
use super::{Number, Sight};
use crate::{About, Task, View, Work};

/// A task in formulas. Its episodes begin by the robot's own `reset` ranges.
pub trait Formulas: Send + Sync {
    /// Its names and sizes.
    fn about(&self) -> About;

    /// Ranges of the numbers of an episode's goal, `[low, high)`, drawn in this order before the start.
    fn goal(&self) -> &'static [[f64; 2]] {
        &[]
    }

    /// Writes the observation.
    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]);

    /// Writes the joint torques (N m or N) of an action, which is in [-1, 1].
    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]);

    /// Reward for arriving here; `torques` acted in the last frame.
    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, torques: &[N]) -> N;

    /// Whether being here ends the episode: 1 or 0.
    fn over<N: Number>(&self, _sight: &mut impl Sight<N>) -> N {
        N::from(0.0)
    }
}

impl<F: Formulas> Task for F {
    fn about(&self) -> About {
        Formulas::about(self)
    }

    fn goal_dim(&self) -> usize {
        self.goal().len()
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        out.iter_mut().zip(self.goal()).for_each(|(x, [low, high])| *x = low + (high - low) * rng.random::<f64>());
    }

    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        Formulas::observe(self, &mut Direct::new(view, work), out);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        let mut within = std::mem::take(&mut work.numbers);
        within.clear();
        within.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        Formulas::act(self, &mut Direct::new(view, work), &within, torques);
        work.numbers = within;
    }

    fn reward(&self, view: View, torques: &[f64], work: &mut Work) -> f64 {
        Formulas::reward(self, &mut Direct::new(view, work), torques)
    }

    fn terminated(&self, view: View, work: &mut Work) -> bool {
        self.over(&mut Direct::new(view, work)) != 0.0
    }

    fn kernels(&self, system: &System, colliders: usize) -> Result<String, String> {
        program(self, system, colliders)
    }
}
