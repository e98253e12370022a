//! What the three tasks of the Ant share (paper A.3.1.2). World up is +y, forward is +x; m, rad, s.
//!
//! Observation: 29 numbers ([`crate::body::observe`]). Action: torque of eight joints, 1 is 400 N m. Over when the torso's
//! origin is below 0.3 m; truncated after 500 steps of 1/60 s. Starts: the `reset` ranges of `ant.toml`.

use crate::About;
use crate::body::{Body, observe};
use crate::formula::{Formulas, Number, Sight};

/// A task of the Ant, which is its reward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ant {
    /// Forward, along world +x, as fast as it can: `R = v_x + 0.1 p_up + p_heading`, v in m/s.
    Run,
    /// About world +y as fast as it can: `R = w_y + p_up`, w in rad/s.
    Spin,
    /// About world +y at 5 rad/s: `R = 5 exp(-(w_y - 5)^2 - 0.1 w_x^2 - 0.1 w_z^2) + 0.1 p_up`, w in rad/s.
    SpinTrack,
}

/// Height (m) below which it is over.
const LOWEST: f64 = 0.3;

impl Formulas for Ant {
    fn about(&self) -> About {
        let name = match self {
            Self::Run => "ant-run",
            Self::Spin => "ant-spin",
            Self::SpinTrack => "ant-spin-track",
        };
        About { name, robot: "ant", scene: "ground", observation: 29, action: 8, steps: 500, frames: 1 }
    }

    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        observe(sight, out);
    }

    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        sight.controlled(action, torques);
    }

    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _torques: &[N]) -> N {
        let (Body { linear, angular: [x, y, z], up, heading, .. }, tenth) = (Body::of(sight), N::from(0.1));
        match self {
            Self::Run => linear[0] + tenth * up + heading,
            Self::Spin => y + up,
            Self::SpinTrack => {
                let away = (y - N::from(5.0)).squared() + tenth * x.squared() + tenth * z.squared();
                N::from(5.0) * (-away).exp() + tenth * up
            }
        }
    }

    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        sight.q(1).below(N::from(LOWEST))
    }
}
