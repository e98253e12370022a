//! What formulas can read of one environment.

use nerd_core::dynamics::{kinematics, point_position};
use nerd_sim::scene::contacts;
use nerd_sim::system::System;

use crate::{View, Work};

/// One environment, in numbers of a kind.
pub trait Sight<N> {
    /// The robot.
    fn system(&self) -> &System;
    /// Number k of the state's `q` (m, rad; a free root's quaternion is x y z w).
    fn q(&self, k: usize) -> N;
    /// Number k of the state's `qd` (m/s, rad/s); a free root's first six are its twist about the world's origin.
    fn qd(&self, k: usize) -> N;
    /// Number k of what the episode asks for, of [`super::Formulas::goal`].
    fn goal(&self, k: usize) -> N;
    /// Where in the world a point of a link is (m); `local` in the link's own axes (m).
    fn place(&mut self, link: usize, local: [f64; 3]) -> [N; 3];
    /// How far a contact point is from the scene (m), its radius not taken off; points in the order of the robot's `contact_points`.
    fn distance(&mut self, point: usize) -> N;
    /// The robot's own controller ([`nerd_sim::control::Controller`]): one action a joint in, one torque a joint out (N m or N).
    fn controlled(&mut self, action: &[N], torques: &mut [N]);
}

/// On the CPU: links and distances are found when they are first asked for.
pub(super) struct Direct<'a> {
    view: View<'a>,
    work: &'a mut Work,
    placed: bool,
    near: bool,
}

impl<'a> Direct<'a> {
    pub(super) fn new(view: View<'a>, work: &'a mut Work) -> Self {
        Self { view, work, placed: false, near: false }
    }
}

impl Sight<f64> for Direct<'_> {
    fn system(&self) -> &System {
        &self.work.system
    }

    fn q(&self, k: usize) -> f64 {
        self.view.state[k]
    }

    fn qd(&self, k: usize) -> f64 {
        self.view.state[self.work.system.robot.nq() + k]
    }

    fn goal(&self, k: usize) -> f64 {
        self.view.goal[k]
    }

    fn place(&mut self, link: usize, local: [f64; 3]) -> [f64; 3] {
        let Work { system, data, .. } = &mut *self.work;
        if !std::mem::replace(&mut self.placed, true) {
            kinematics(&system.robot, self.view.state, data);
        }
        point_position(data, link, &local.into()).into()
    }

    fn distance(&mut self, point: usize) -> f64 {
        let Work { system, data, events, .. } = &mut *self.work;
        if !std::mem::replace(&mut self.near, true) {
            contacts(&system.robot, self.view.scene, self.view.state, data, events);
            self.placed = false;
        }
        events[point].distance
    }

    fn controlled(&mut self, action: &[f64], torques: &mut [f64]) {
        self.work.controller.torques(self.view.state, action, torques);
    }
}
