//! Quantities of one environment that formulas can read.

use nerd_sim::prelude::*;

use super::tape::{Leaf, Tape, Traced};
use crate::{View, Work};

/// One environment, in numbers of one kind.
pub trait Sight<N> {
    /// The robot.
    fn system(&self) -> &System;
    /// Number k of the state's `q` (m, rad; a free root's quaternion is x y z w).
    fn q(&self, k: usize) -> N;
    /// Number k of the state's `qd` (m/s, rad/s); a free root's first six are its twist about the world's origin.
    fn qd(&self, k: usize) -> N;
    /// Number k of the episode's goal, see [`super::Formulas::goal`].
    fn goal(&self, k: usize) -> N;
    /// World position of a point of a link (m); `local` in the link's own axes (m).
    fn place(&mut self, link: usize, local: [f64; 3]) -> [N; 3];
    /// Distance of a contact point from the scene (m), radius not subtracted; points in the order of the robot's `contact_points`.
    fn distance(&mut self, point: usize) -> N;
    /// Height (m) of uneven ground ([`Scene::ground`]) at a distance (m) ahead of a free root and to its left; 0 for other ground.
    fn ground(&mut self, at: [f64; 2]) -> N;
    /// The robot's own controller ([`nerd_sim::control::Controller`]): one action a joint in, one torque a joint out (N m or N).
    fn controlled(&mut self, action: &[N], torques: &mut [N]);
}

/// On the CPU: poses of links and distances are computed at their first use.
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
            contacts(system, self.view.scene, self.view.state, data, events);
            self.placed = false;
        }
        events[point].distance
    }

    fn ground(&mut self, at: [f64; 2]) -> f64 {
        self.view.scene.ground(self.view.state, at).unwrap_or(0.0)
    }

    fn controlled(&mut self, action: &[f64], torques: &mut [f64]) {
        self.work.controller.torques(self.view.state, action, torques);
    }
}

/// Records every access; values exist on the CPU alone.
pub(super) struct Recorded<'a, 'b> {
    pub tape: &'a Tape,
    system: &'b System,
    goals: usize,
    direct: Option<Direct<'b>>,
}

impl<'a, 'b> Recorded<'a, 'b> {
    /// Without a state.
    pub fn unknown(tape: &'a Tape, system: &'b System, goals: usize) -> Self {
        Self { tape, system, goals, direct: None }
    }

    /// With the values of a view.
    pub fn of(tape: &'a Tape, system: &'b System, view: View<'b>, work: &'b mut Work) -> Self {
        Self { tape, system, goals: view.goal.len(), direct: Some(Direct::new(view, work)) }
    }

    fn leaf(&self, leaf: Leaf, value: impl FnOnce(&Direct) -> f64) -> Traced<'a> {
        self.tape.leaf(leaf, self.direct.as_ref().map_or(f64::NAN, value))
    }
}

impl<'a> Sight<Traced<'a>> for Recorded<'a, '_> {
    fn system(&self) -> &System {
        self.system
    }

    fn q(&self, k: usize) -> Traced<'a> {
        self.tape.among("coordinates", k, self.system.robot.nq());
        self.leaf(Leaf::State(k), |direct| direct.q(k))
    }

    fn qd(&self, k: usize) -> Traced<'a> {
        self.tape.among("velocities", k, self.system.robot.nv());
        self.leaf(Leaf::State(self.system.robot.nq() + k), |direct| direct.qd(k))
    }

    fn goal(&self, k: usize) -> Traced<'a> {
        self.tape.among("numbers of the goal", k, self.goals);
        self.leaf(Leaf::Goal(k), |direct| direct.goal(k))
    }

    fn place(&mut self, link: usize, local: [f64; 3]) -> [Traced<'a>; 3] {
        self.tape.among("links", link, self.system.robot.links.len());
        let at = self.direct.as_mut().map_or([f64::NAN; 3], |direct| direct.place(link, local));
        [0, 1, 2].map(|axis| self.tape.leaf(Leaf::Place { link, local, axis }, at[axis]))
    }

    fn distance(&mut self, point: usize) -> Traced<'a> {
        self.tape.among("contact points", point, self.system.robot.contact_points.len());
        let gap = self.direct.as_mut().map_or(f64::NAN, |direct| direct.distance(point));
        self.tape.leaf(Leaf::Distance(point), gap)
    }

    fn ground(&mut self, at: [f64; 2]) -> Traced<'a> {
        let height = self.direct.as_mut().map_or(f64::NAN, |direct| direct.ground(at));
        self.tape.leaf(Leaf::Ground(at), height)
    }

    fn controlled(&mut self, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        let joints = self.system.robot.joint_count();
        if action.len() != joints || torques.len() != joints {
            let text = format!("{} actions and {} torques for a controller of {joints} joints", action.len(), torques.len());
            self.tape.wrong.borrow_mut().get_or_insert(text);
        }
        let (call, mut values) = (self.tape.list(action), vec![f64::NAN; torques.len()]);
        if let Some(direct) = &mut self.direct {
            direct.controlled(&action.iter().map(|a| a.value()).collect::<Vec<_>>(), &mut values);
        }
        let all = torques.iter_mut().zip(values).enumerate();
        all.for_each(|(i, (tau, value))| *tau = self.tape.leaf(Leaf::Controlled { call, i }, value));
    }
}
