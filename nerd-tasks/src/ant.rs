//! What the three tasks of the Ant share (paper A.3.1.2). World up is +y, forward is +x; m, rad, s.
//!
//! Observation: 29 numbers ([`crate::body::observe`]). Action: torque of eight joints, 1 is 400 N m. Over when the torso's
//! origin is below 0.3 m; truncated after 500 steps of 1/60 s. Starts: the reset law of `ant.toml`.

use crate::body::{Body, observe};
use crate::{Task, View, Work};

/// A task of the Ant, which is its reward.
#[derive(Clone, Copy)]
pub struct Ant {
    /// Name on the command line.
    pub name: &'static str,
    /// Reward of a state of the torso.
    pub reward: fn(&Body) -> f64,
}

/// Coordinates of the Ant, and height below which it is over (m).
const NQ: usize = 15;
const LOWEST: f64 = 0.3;

impl Task for Ant {
    fn name(&self) -> &'static str {
        self.name
    }

    fn robot(&self) -> &'static str {
        "ant"
    }

    fn scene(&self) -> &'static str {
        "ground"
    }

    fn observation_dim(&self) -> usize {
        29
    }

    fn action_dim(&self) -> usize {
        8
    }

    fn episode_length(&self) -> u64 {
        500
    }

    fn observe(&self, view: View, _work: &mut Work, out: &mut [f64]) {
        observe(view.state, NQ, out);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        work.controller.torques(view.state, action, torques);
    }

    fn reward(&self, view: View, _torques: &[f64], _work: &mut Work) -> f64 {
        (self.reward)(&Body::of(view.state, NQ))
    }

    fn terminated(&self, view: View, _work: &mut Work) -> bool {
        view.state[1] < LOWEST
    }
}
