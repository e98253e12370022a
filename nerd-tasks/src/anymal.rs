//! What both tasks of ANYmal share (paper A.3.1.4). World up is +y, forward is +x, sideways is +z; m, rad, s.
//!
//! Observation: 37 numbers ([`crate::body::observe`]). Action: twelve joint positions, 1 is 0.5 rad from the default pose,
//! through the position law of `anymal.toml`. Truncated after 1000 steps of 1/60 s; over when the base is below 0.4 m, or
//! base or knees are within 1 cm of touching the ground, the reference system's margin, without which a touch between two
//! frames would be missed. With (a, b) the velocity (v_x, v_z) that is asked for,
//!
//! ```text
//! R = max(0, exp(-((v_x - a)^2 + (v_z - b)^2)) + 0.5 exp(-w_y^2) - 2.5e-5 sum tau^2)
//! ```
//!
//! The appendix prints the last term as `(0.002 sum tau)^2`, under which opposed torques would cost nothing; this is the law
//! of the reference system's code, whose rewards are the ones that were published. Starts: the `reset` ranges of
//! `anymal.toml`.

use crate::About;
use crate::body::{Body, observe};
use crate::formula::{Formulas, Number, Sight};

/// A task of ANYmal, which is the velocity it asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anymal {
    /// 1 m/s along world +x.
    Forward,
    /// 1 m/s along world +z.
    Side,
}

/// Height of the base (m) below which it is over.
const LOWEST: f64 = 0.4;
/// Gap between surfaces (m) that counts as a touch.
const MARGIN: f64 = 0.01;
/// Radius (m) of the feet, the only contact points that may touch: all others are larger.
const FOOT: f64 = 0.03;

impl Formulas for Anymal {
    fn about(&self) -> About {
        let name = if *self == Self::Forward { "anymal-forward" } else { "anymal-side" };
        About { name, robot: "anymal", scene: "ground", observation: 37, action: 12, steps: 1000, frames: 1 }
    }

    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        observe(sight, out);
    }

    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        sight.controlled(action, torques);
    }

    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, torques: &[N]) -> N {
        let (body, one) = (Body::of(sight), N::from(1.0));
        let none = N::from(0.0);
        let [forward, sideways] = if *self == Self::Forward { [one, none] } else { [none, one] };
        let gap = (body.linear[0] - forward).squared() + (body.linear[2] - sideways).squared();
        let effort = torques.iter().fold(none, |sum, tau| sum + tau.squared());
        ((-gap).exp() + N::from(0.5) * (-body.angular[1].squared()).exp() - N::from(2.5e-5) * effort).max(none)
    }

    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        let mut over = sight.q(1).below(N::from(LOWEST));
        for point in 0..sight.system().robot.contact_points.len() {
            let radius = sight.system().robot.contact_points[point].radius;
            if radius > FOOT + 1e-3 {
                over = over.or(sight.distance(point).below(N::from(radius + MARGIN)));
            }
        }
        over
    }
}
