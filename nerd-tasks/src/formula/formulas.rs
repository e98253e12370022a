//! The trait of a task that is written in formulas.

use nerd_sim::{prelude::*, system::SystemError};

use super::{Number, Sight};
use crate::About;

/// A task in formulas. Its episodes begin by the robot's own `reset` ranges.
pub trait Formulas: Send + Sync {
    /// Its names and sizes.
    fn about(&self) -> About;

    /// Its robot.
    fn system(&self) -> Result<Arc<System>, SystemError> {
        System::named(self.about().robot)
    }

    /// As [`crate::Task::fit`].
    fn fit(&self, robot: Arc<System>) -> Result<Arc<System>, SystemError> {
        Ok(robot)
    }

    /// As [`crate::Task::text`].
    fn text(&self) -> Option<&str> {
        None
    }

    /// As [`crate::Task::place`].
    fn place(&self) -> bool {
        self.goal().len() >= 3
    }

    /// Ranges of the numbers of an episode's goal, `[low, high)`, drawn in this order before the start.
    fn goal(&self) -> &[[f64; 2]] {
        &[]
    }

    /// As [`crate::Task::commands`].
    fn commands(&self) -> Vec<(String, [f64; 2])> {
        Vec::new()
    }

    /// As [`crate::Task::memory`], after the drawn numbers of the goal.
    fn memory(&self) -> usize {
        0
    }

    /// As [`crate::Task::levels`].
    fn levels(&self) -> Option<(usize, usize)> {
        None
    }

    /// Writes the observation.
    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]);

    /// Writes the joint torques (N m or N) of an action, which is in [-1, 1].
    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]);

    /// As [`crate::Task::controlled`].
    fn controlled(&self) -> bool {
        false
    }

    /// Reward for arriving here; `torques` acted in the last frame.
    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, torques: &[N]) -> N;

    /// As [`crate::Task::terms`].
    fn terms(&self) -> &[String] {
        &[]
    }

    /// The reward, followed by its terms.
    fn rewards<N: Number>(&self, sight: &mut impl Sight<N>, torques: &[N]) -> Vec<N> {
        vec![self.reward(sight, torques)]
    }

    /// Error relative to the tolerance, as [`crate::Task::miss`].
    fn miss<N: Number>(&self, _sight: &mut impl Sight<N>) -> Option<N> {
        None
    }

    /// As [`crate::Task::allowed`].
    fn allowed(&self) -> (f64, &str) {
        (1.0, "")
    }

    /// Whether this state ends the episode: 1 or 0.
    fn over<N: Number>(&self, _sight: &mut impl Sight<N>) -> N {
        N::from(0.0)
    }
}

/// Torques of a frame for the reward, clamped: with a controller that acts inside the frame they are its commands without bounds.
pub(super) fn bounded<N: Number>(task: &impl Formulas, system: &System, torques: impl Iterator<Item = N>) -> Vec<N> {
    let bounds = (0..).map(|joint| if task.controlled() { system.most(joint) } else { f64::INFINITY });
    let bound = |(tau, most): (N, f64)| if most.is_finite() { tau.max(N::from(-most)).min(N::from(most)) } else { tau };
    torques.zip(bounds).map(bound).collect()
}
