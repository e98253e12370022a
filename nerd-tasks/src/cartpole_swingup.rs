//! Cartpole swing-up (paper A.3.1.1). World up is +y, the rail runs along +x; theta = 0 is upright; m, rad, s.
//!
//! Observation `(x, theta, x_dot, theta_dot)`, theta in [-pi, pi); action: force on the slider, 1 is 1500 N; reward
//!
//! ```text
//! R = 5 - theta^2 - 0.05 x^2 - 0.1 theta_dot^2 - 0.1 x_dot^2
//! ```
//!
//! Over when `|x| > 4` m or a velocity passes 10 m/s or 10 rad/s; truncated after 300 steps of 1/60 s. Starts:
//! `x, x_dot, theta_dot ~ U(-1, 1)`, `theta ~ U(-pi, pi)` (`cartpole.toml`).

use nerd_core::state::wrap;

use crate::{Task, View, Work};

/// The task; it has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct CartpoleSwingup;

/// Force of an action of 1 (N).
const FORCE: f64 = 1500.0;

impl Task for CartpoleSwingup {
    fn name(&self) -> &'static str {
        "cartpole-swingup"
    }

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

    fn observe(&self, view: View, _work: &mut Work, out: &mut [f64]) {
        out.copy_from_slice(view.state);
        out[1] = wrap(out[1]);
    }

    fn act(&self, _view: View, action: &[f64], _work: &mut Work, torques: &mut [f64]) {
        torques.copy_from_slice(&[FORCE * action[0].clamp(-1.0, 1.0), 0.0]);
    }

    fn reward(&self, view: View, _torques: &[f64], _work: &mut Work) -> f64 {
        let (x, theta, xd, thetad) = (view.state[0], wrap(view.state[1]), view.state[2], view.state[3]);
        5.0 - theta * theta - 0.05 * x * x - 0.1 * thetad * thetad - 0.1 * xd * xd
    }

    fn terminated(&self, view: View, _work: &mut Work) -> bool {
        view.state[0].abs() > 4.0 || view.state[2].abs() > 10.0 || view.state[3].abs() > 10.0
    }
}
