//! Energy check: a frame that gains energy is repeated with more substeps, the more the larger its gain.
//!
//! Too long a substep adds energy. This happens at a light link that whips, a point that parts, a hard impact at a
//! limit, or a drag that has not converged. K is the kinetic energy of links and rotors. S is the energy in springs of
//! contacts, self-collision, limits and joints. V is the links' energy in gravity. W is the work of torques and drives,
//! W+ the sum of the works' absolute values. A frame of T seconds passes if
//!
//! ```text
//! gain = (K + S)_1 - E <= GAIN_TOLERANCE max((K + S)_0, E) + WORK_TOLERANCE W+ + FALL_TOLERANCE m (g T)^2 / 2,    E = (K + S)_0 + W - (V_1 - V_0)
//! ```
//!
//! In a repeated frame contacts and limits have theta 1/2, and their springs 1/4. Where the thetas differ, a force
//! computed at `v + theta (v' - v)` does work on another velocity, `f . (v + v') / 2`. A light link between stiff
//! touches then gains energy, in proportion to the substep. With equal thetas each touch alone dissipates.
//!
//! A gain that remains at the most substeps, above all at an edge of terrain, is removed from K_1: one factor scales
//! all velocities. Where K_1 is too small, or the excess is above both (K + S)_0 and E, the frame ends at rest in its
//! first pose.
//!
//! All other forces dissipate, so a gain is an error of the step. The gain falls with the square of the substep, or the
//! first power where a point meets or leaves its surface. At edges and between cells of terrain the distance jumps, and
//! no substep is short enough to avoid a gain. Every frame is checked in scenes with more than planes. Elsewhere a
//! frame is checked only after an event that may gain energy. Examples are a joint that moves fast
//! (`fast.rs`), a point or limit that comes or leaves, and solves without convergence. All other frames, and explicit
//! presets, stay unchanged.

use nerd_core::dynamics::{to_local, velocities};

use super::{config::Asked, fold::folded, workspace::Workspace};
use crate::prelude::*;
use crate::{scene::place, solver::gone};

/// Tolerated gain as a fraction of the larger of (K + S)_0 and E; and the same for frames without contact and
/// self-collision.
pub(super) const GAIN_TOLERANCE: f64 = 1e-5;
pub(super) const GAIN_TOLERANCE_FREE: f64 = 5e-7;
/// Tolerated gain as a fraction of W+, the absolute work of torques and drives.
pub(super) const WORK_TOLERANCE: f64 = 1e-3;
/// Tolerated gain as a fraction of the kinetic energy that the robot gains by a frame of free fall from rest.
pub(super) const FALL_TOLERANCE: f64 = 1e-3;
/// A frame is not refined at or above this number of substeps.
pub(super) const MAX_REFINED: usize = 1024;
/// A frame in contact with terrain is not refined at or above this number of substeps. Between cells a ball's distance
/// jumps, and no substep is short enough for the energy that its spring gains.
pub(super) const MAX_REFINED_TERRAIN: usize = 8;
/// Turn (rad) or travel (m) of a joint in a Runge-Kutta substep above which the frame's energy is checked.
pub(super) const FAST_TURN_RK4: f64 = 0.1;

/// Energies (J) of a state.
#[derive(Default)]
pub(super) struct Energy {
    /// Kinetic energy, K.
    kinetic: f64,
    /// Kinetic energy and energy in springs, K + S.
    kinetic_and_springs: f64,
    /// Energy in gravity, V.
    potential: f64,
}

impl Workspace {
    /// Factors on the substeps and on the velocities of a frame from `start` to `state`. The first, a power of two,
    /// multiplies `substeps` so that the frame gains no energy; 1 if it passes. This factor is a lower bound, since the
    /// gain falls with the square of the substep at most. The second would remove the gain from the velocities at the
    /// frame's end; 0 if none can.
    pub(super) fn refine(
        &mut self,
        asked: &Asked,
        state: &[f64],
        substeps: usize,
        finest: usize,
    ) -> Result<(usize, f64), String> {
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
        // E: K + S at the frame's end without a gain.
        let expected = before.kinetic_and_springs + work - (after.potential - before.potential);
        let gain = after.kinetic_and_springs - expected;
        let scale = before.kinetic_and_springs.max(expected);
        let fallen = 0.5 * system.robot.mass() * (scene.gravity.norm() * system.frame_time).powi(2);
        let free = !asked.contact && system.folds.is_empty();
        let share = if free { GAIN_TOLERANCE_FREE } else { GAIN_TOLERANCE };
        let mut most = share * scale + WORK_TOLERANCE * effort + FALL_TOLERANCE * fallen;
        let mut times = 1;
        let over = if gain <= most { 0.0 } else { gain - most };
        let left =
            if over < after.kinetic.min(scale) { (1.0 - over / after.kinetic).sqrt() } else { f64::from(over == 0.0) };
        // A gain that is not a number fails.
        let within = |most: f64| gain <= most && gain.is_finite();
        while !within(most) && times * substeps < finest {
            (most, times) = (4.0 * most, 2 * times);
        }
        Ok((times, left))
    }

    fn energy(&mut self, system: &System, scene: &Scene, state: &[f64]) -> Result<Energy, String> {
        self.trial.copy_from_slice(state);
        let mut trial = std::mem::take(&mut self.trial);
        let energy = self.energy_of(system, scene, &mut trial);
        // Restores the memory before an error returns, since the next environment needs it.
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
        let mut energy = Energy::default();
        let data = &self.data;
        for (i, link) in robot.links.iter().enumerate() {
            let body = &link.inertia;
            let r = &data.rotation[i];
            let com = data.position[i] + r * body.com;
            let (w, v) = (r.tr_mul(&data.velocity[i].ang), data.velocity[i].at(&com));
            let rotor = link.joint.as_ref().map_or(0.0, |j| j.armature * (j.ratio() * qd[data.dof[i]]).powi(2));
            energy.kinetic += 0.5 * (body.mass * v.norm_squared() + w.dot(&(body.inertia * w)) + rotor);
            let lifted = (data.origin + data.position[i] + r * link.lifted.at) * link.lifted.mass;
            energy.potential -= scene.gravity.dot(&((com + data.origin) * body.mass - lifted));
        }
        energy.kinetic_and_springs = energy.kinetic;
        if !self.materials.is_empty() {
            for (owner, event) in self.owners.iter().zip(&self.events) {
                let point = &robot.contact_points[*owner];
                // A plane's event has the normal, but not the place of a point with a moving locus.
                let roams = || event.normal.dot(&(place(point, data, &event.normal) - event.p1));
                let Some(material) = self.materials.of(system, point, &scene.colliders[event.collider], event.collider)
                else {
                    continue;
                };
                let gap =
                    (if point.locus.is_fixed() { event.distance } else { roams() } - point.radius - material.margin)
                        .min(0.0);
                energy.kinetic_and_springs += 0.5 * material.stiffness * gap * gap;
            }
        }
        if !system.folds.is_empty() {
            energy.kinetic_and_springs += folded(system, &self.stiff.bounds.folds, self.first_h, data);
        }
        for (x, joint) in q[robot.root_coords()..].iter().zip(robot.joints()) {
            let beyond = joint.limit.map_or(0.0, |l| l.stiffness * (x - x.clamp(l.lower, l.upper)).powi(2));
            energy.kinetic_and_springs += 0.5 * (beyond + joint.stiffness * (x - joint.rest).powi(2));
        }
        Ok(energy)
    }
}
