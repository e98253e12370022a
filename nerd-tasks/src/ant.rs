//! What the tasks of the Ant share (paper A.3.1.2; `Point` is our own). World up is +y, forward is +x; m, rad, s.
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
    /// To a point drawn from a square of 6 m, and stay there: `R = 5 - d + 0.1 p_up`, d the torso's horizontal distance from it (m). The
    /// way there, along world x and z (m), is observed, too.
    Point,
}

/// Height (m) below which it is over.
const LOWEST: f64 = 0.3;
/// Box of points (m), low and high.
const POINTS: [[f64; 2]; 3] = [[-3.0, 3.0], [0.5, 0.5], [-3.0, 3.0]];
/// Distance within which it is there (m).
const NEAR: f64 = 0.5;

impl Formulas for Ant {
    fn about(&self) -> About {
        let name = match self {
            Self::Run => "ant-run",
            Self::Spin => "ant-spin",
            Self::SpinTrack => "ant-spin-track",
            Self::Point => "ant-point",
        };
        let observation = if *self == Self::Point { 31 } else { 29 };
        About { name, robot: "ant", scene: "ground", observation, action: 8, steps: 500, frames: 1 }
    }

    fn goal(&self) -> &[[f64; 2]] {
        if *self == Self::Point { &POINTS } else { &[] }
    }

    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        observe(sight, &mut out[..29]);
        if *self == Self::Point {
            out[29..].copy_from_slice(&way(sight));
        }
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
            Self::Point => N::from(5.0) - distance(sight) + tenth * up,
        }
    }

    /// Of [`Self::Point`] alone: the way to it (m), and an upright torso at the height of its start that does not spin.
    fn residuals<N: Number>(&self, sight: &mut impl Sight<N>) -> Vec<N> {
        if *self != Self::Point {
            return Vec::new();
        }
        let Body { height, up, angular, .. } = Body::of(sight);
        let upright = [N::from(3.0) * (N::from(1.0) - up), N::from(2.0) * (height - N::from(0.7))];
        way(sight).into_iter().chain(upright).chain(angular.map(|w| N::from(0.1) * w)).collect()
    }

    fn miss<N: Number>(&self, sight: &mut impl Sight<N>) -> Option<N> {
        (*self == Self::Point).then(|| distance(sight) / N::from(NEAR))
    }

    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        sight.q(1).below(N::from(LOWEST))
    }
}

/// From the torso to the point, along world x and z (m).
fn way<N: Number>(sight: &impl Sight<N>) -> [N; 2] {
    [0, 2].map(|k| sight.goal(k) - sight.q(k))
}

/// Of the torso from the point, along the ground (m).
fn distance<N: Number>(sight: &impl Sight<N>) -> N {
    let [x, z] = way(sight);
    (x.squared() + z.squared()).sqrt()
}
