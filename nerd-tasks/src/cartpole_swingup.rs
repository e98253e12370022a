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

use crate::About;
use crate::formula::{Formulas, Number, Sight};

/// The task; it has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct CartpoleSwingup;

/// Angle from upright within which it is up (rad).
const NEAR: f64 = 0.2;

/// Force of an action of 1 (N).
const FORCE: f64 = 1500.0;

impl Formulas for CartpoleSwingup {
    fn about(&self) -> About {
        About { name: "cartpole-swingup", robot: "cartpole", scene: "free", observation: 4, action: 1, steps: 300, frames: 1 }
    }

    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        out.copy_from_slice(&[sight.q(0), sight.q(1).wrap(), sight.qd(0), sight.qd(1)]);
    }

    fn act<N: Number>(&self, _sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        torques.copy_from_slice(&[N::from(FORCE) * action[0], N::from(0.0)]);
    }

    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _torques: &[N]) -> N {
        let (x, theta, tenth) = (sight.q(0), sight.q(1).wrap(), N::from(0.1));
        let moved = tenth * sight.qd(1).squared() + tenth * sight.qd(0).squared();
        N::from(5.0) - theta.squared() - N::from(0.05) * x.squared() - moved
    }

    /// The reward is 5 less their squares.
    fn residuals<N: Number>(&self, sight: &mut impl Sight<N>) -> Vec<N> {
        let (tenth, twentieth) = (N::from(0.1_f64.sqrt()), N::from(0.05_f64.sqrt()));
        vec![sight.q(1).wrap(), twentieth * sight.q(0), tenth * sight.qd(1), tenth * sight.qd(0)]
    }

    fn miss<N: Number>(&self, sight: &mut impl Sight<N>) -> Option<N> {
        Some(sight.q(1).wrap().abs() / N::from(NEAR))
    }

    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        let beyond = |most: f64, x: N| N::from(most).below(x.abs());
        beyond(4.0, sight.q(0)).or(beyond(10.0, sight.qd(0))).or(beyond(10.0, sight.qd(1)))
    }
}
