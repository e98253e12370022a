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
//! of the reference system's code, whose rewards are the ones that were published. Starts: the reset law of
//! `anymal.toml`.

use nerd_sim::batch::contacts;

use crate::body::{Body, observe};
use crate::{Task, View, Work};

/// A task of ANYmal, which is the velocity it asks for.
#[derive(Clone, Copy)]
pub struct Anymal {
    /// Name on the command line.
    pub name: &'static str,
    /// Velocity forward and sideways (m/s).
    pub velocity: [f64; 2],
}

/// Coordinates of ANYmal, and height of the base below which it is over (m).
const NQ: usize = 19;
const LOWEST: f64 = 0.4;
/// Gap between surfaces (m) that counts as a touch.
const MARGIN: f64 = 0.01;
/// Radius (m) of the feet, the only contact points that may touch: all others are larger.
const FOOT: f64 = 0.03;

impl Task for Anymal {
    fn name(&self) -> &'static str {
        self.name
    }

    fn robot(&self) -> &'static str {
        "anymal"
    }

    fn scene(&self) -> &'static str {
        "ground"
    }

    fn observation_dim(&self) -> usize {
        37
    }

    fn action_dim(&self) -> usize {
        12
    }

    fn episode_length(&self) -> u64 {
        1000
    }

    fn observe(&self, view: View, _work: &mut Work, out: &mut [f64]) {
        observe(view.state, NQ, out);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        let Work { controller, numbers, .. } = work;
        numbers.clear();
        numbers.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        controller.torques(view.state, numbers, torques);
    }

    fn reward(&self, view: View, torques: &[f64], _work: &mut Work) -> f64 {
        let (body, [forward, sideways]) = (Body::of(view.state, NQ), self.velocity);
        let gap = (body.linear.x - forward).powi(2) + (body.linear.z - sideways).powi(2);
        let effort: f64 = torques.iter().map(|tau| tau * tau).sum();
        ((-gap).exp() + 0.5 * (-body.angular.y.powi(2)).exp() - 2.5e-5 * effort).max(0.0)
    }

    fn terminated(&self, view: View, work: &mut Work) -> bool {
        if view.state[1] < LOWEST {
            return true;
        }
        let Work { system, data, events, .. } = work;
        contacts(system, view.scene, view.state, data, events);
        let points = system.robot.contact_points.iter().zip(&*events);
        points.filter(|(point, _)| point.radius > FOOT + 1e-3).any(|(point, event)| event.distance < point.radius + MARGIN)
    }
}
