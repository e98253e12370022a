//! No frame gives energy: one that does is stepped anew with twice the substeps, or as many as its error asks for at least.
//!
//! What a substep is too long for shows in the energy: a light link that whirls, a point that parts, a limit hit hard, a drag that has not
//! settled. With the kinetic energy K of links and rotors, the energy S in the springs of contacts, links on each other, limits and joints,
//! the energy V of the links in gravity, and the work W of torques and drives, W+ its size either way, a frame of T is sound where
//!
//! ```text
//! (K + S + V)_1 - (K + S + V)_0 - W <= SHARE max((K + S)_0, (K + S)_1) + LABOUR W+ + FALL m (g T)^2 / 2
//! ```
//!
//! In the finer steps contacts and limits look ahead by the means over a substep alone: shares of a half, of a quarter for springs. Where the
//! shares differ a force works on another velocity than it was found at, `f . (v + v') / 2` at `v + a (v' - v)`, and what a light link between
//! stiff touches gains by that falls with the substep alone. With the means each touch by itself takes energy, whatever else acts.
//!
//! All else that acts takes energy, so what is gained is the step's error: it falls with the square of the substep, and with the substep
//! where a point meets or leaves its surface. At edges and from cell to cell of terrain the distance jumps, and no substep is short
//! enough. The gain is worked out only for a frame in which something happened that may give any: a joint that
//! turned by [`WHIRL`] in a substep, a point or a limit that came or left, repetition without an end. All other frames, and explicit presets,
//! are as they were.

use nerd_core::dynamics::{to_local, velocities};

use super::{config::Asked, fold::folded, workspace::Workspace};
use crate::prelude::*;
use crate::{scene::place, solver::gone};

/// Share of a frame's energy that it may gain.
pub(super) const SHARE: f64 = 1e-5;
/// Share of what torques and drives do in a frame, either way, that it may gain.
pub(super) const LABOUR: f64 = 1e-3;
/// Share of what gravity gives a robot at rest in a frame that it may gain.
pub(super) const FALL: f64 = 1e-3;
/// Substeps from which on a frame is not refined.
pub(super) const FINEST: usize = 1024;
/// The same on terrain: from cell to cell a ball's distance jumps, and what its spring gains by that no substep is short enough for.
pub(super) const ROUGHEST: usize = 8;
/// Turn (rad, or way in m) of a joint in a substep from which on the energy is looked at.
pub(super) const WHIRL: f64 = 0.015;
/// The same of Runge-Kutta's.
pub(super) const WHIRL_RK4: f64 = 0.1;

/// Energies (J) of a state.
pub(super) struct Energy {
    /// Of motion and in springs, K + S.
    lively: f64,
    /// In gravity, V.
    high: f64,
}

impl Workspace {
    /// Times as many substeps that a frame from `start` to `state` in so many of them needs to give no energy: 1, or the power of 2 that is
    /// needed at least, since the step's error falls with their square at most.
    pub(super) fn refine(&mut self, asked: &Asked, state: &[f64], substeps: usize, finest: usize) -> Result<usize, String> {
        let Asked { system, scene, tau, .. } = *asked;
        let start = std::mem::take(&mut self.start);
        let before = self.energy(system, scene, &start);
        let after = self.energy(system, scene, state);
        let joints = system.robot.root_coords()..system.robot.nq();
        let ways = state[joints.clone()].iter().zip(&start[joints]).map(|(to, from)| to - from);
        let (mut work, mut effort) = self.touches.work;
        for (tau, way) in tau.iter().zip(ways) {
            (work, effort) = (work + tau * way, effort + (tau * way).abs());
        }
        self.start = start;
        let (before, after) = (before?, after?);
        let gain = after.lively - before.lively + (after.high - before.high) - work;
        let fallen = 0.5 * system.robot.mass() * (scene.gravity.norm() * system.frame_time).powi(2);
        let (mut most, mut times) = (SHARE * before.lively.max(after.lively) + LABOUR * effort + FALL * fallen, 1);
        // What is no number is too much.
        let within = |most: f64| gain <= most;
        while !within(most) && times * substeps < finest {
            (most, times) = (4.0 * most, 2 * times);
        }
        Ok(times)
    }

    fn energy(&mut self, system: &System, scene: &Scene, state: &[f64]) -> Result<Energy, String> {
        self.trial.copy_from_slice(state);
        let mut trial = std::mem::take(&mut self.trial);
        let energy = self.energy_of(system, scene, &mut trial);
        // Of a state that has none, too: the next environment needs the memory.
        self.trial = trial;
        energy
    }

    fn energy_of(&mut self, system: &System, scene: &Scene, trial: &mut [f64]) -> Result<Energy, String> {
        let robot = &system.robot;
        let (q, qd) = trial.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        kinematics(robot, q, &mut self.data);
        velocities(robot, qd, &mut self.data);
        let queried = if self.materials.is_empty() { Ok(()) } else { self.query(system, scene, qd, 0.0, 0.0) };
        queried.map_err(|lost| gone(system, q).unwrap_or(lost))?;
        let (mut energy, data) = (Energy { lively: 0.0, high: 0.0 }, &self.data);
        for (i, link) in robot.links.iter().enumerate() {
            let (body, r) = (&link.inertia, &data.rotation[i]);
            let com = data.position[i] + r * body.com;
            let (w, v) = (r.tr_mul(&data.velocity[i].ang), data.velocity[i].at(&com));
            let rotor = link.joint.as_ref().map_or(0.0, |j| j.armature * (j.ratio() * qd[data.dof[i]]).powi(2));
            energy.lively += 0.5 * (body.mass * v.norm_squared() + w.dot(&(body.inertia * w)) + rotor);
            let lifted = (data.origin + data.position[i] + r * link.lifted.at) * link.lifted.mass;
            energy.high -= scene.gravity.dot(&((com + data.origin) * body.mass - lifted));
        }
        if !self.materials.is_empty() {
            for (owner, event) in self.owners.iter().zip(&self.events) {
                let point = &robot.contact_points[*owner];
                // Of a plane the event tells the normal alone, not where on its link the point lies.
                let roams = || event.normal.dot(&(place(point, data, &event.normal) - event.p1));
                let Some(material) = self.materials.of(system, point, &scene.colliders[event.collider], event.collider) else { continue };
                let gap = (if point.locus.is_fixed() { event.distance } else { roams() } - point.radius - material.margin).min(0.0);
                energy.lively += 0.5 * material.stiffness * gap * gap;
            }
        }
        if !system.folds.is_empty() {
            energy.lively += folded(system, &self.stiff.bounds.folds, self.whole, data);
        }
        for (x, joint) in q[robot.root_coords()..].iter().zip(robot.joints()) {
            let beyond = joint.limit.map_or(0.0, |l| l.stiffness * (x - x.clamp(l.lower, l.upper)).powi(2));
            energy.lively += 0.5 * (beyond + joint.stiffness * (x - joint.rest).powi(2));
        }
        Ok(energy)
    }
}
