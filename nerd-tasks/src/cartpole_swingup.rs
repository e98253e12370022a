//! Cartpole swing-up (paper A.3.1.1). World up is +y, the rail runs along +x; theta = 0 is upright.
//!
//! Observation `(x, theta, x_dot, theta_dot)`; action: force on the slider, 1 is 1500 N; reward
//! `5 - theta^2 - 0.05 x^2 - 0.1 theta_dot^2 - 0.1 x_dot^2`; over when `|x| > 4` m or a velocity passes 10 m/s or
//! 10 rad/s; truncated after 300 frames.

use nerd_core::state::wrap;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::Task;

/// The task; it has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct CartpoleSwingup;

/// Force of an action of 1 (N).
const FORCE: f64 = 1500.0;

impl Task for CartpoleSwingup {
    fn robot(&self) -> &'static str {
        "cartpole"
    }

    fn observation_dim(&self) -> usize {
        4
    }

    fn action_dim(&self) -> usize {
        1
    }

    fn episode_length(&self) -> u64 {
        300
    }

    fn observe(&self, state: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[state[0], wrap(state[1]), state[2], state[3]]);
    }

    fn act(&self, _state: &[f64], action: &[f64], torques: &mut [f64]) {
        torques.copy_from_slice(&[FORCE * action[0].clamp(-1.0, 1.0), 0.0]);
    }

    fn reward(&self, state: &[f64], _torques: &[f64]) -> f64 {
        let (x, theta, xd, thetad) = (state[0], wrap(state[1]), state[2], state[3]);
        5.0 - theta * theta - 0.05 * x * x - 0.1 * thetad * thetad - 0.1 * xd * xd
    }

    fn terminated(&self, state: &[f64]) -> bool {
        state[0].abs() > 4.0 || state[2].abs() > 10.0 || state[3].abs() > 10.0
    }

    /// `x, x_dot, theta_dot ~ U(-1, 1)`, `theta ~ U(-pi, pi)`.
    fn reset(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut side = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
        vec![side(1.0), side(std::f64::consts::PI), side(1.0), side(1.0)]
    }
}
