//! Change of velocity over an implicit substep, by repeated solves.

use nalgebra::DVector;
use nerd_core::dynamics::bias;

use super::spin::{SPIN_PASSES, Spin};
use super::stick::{BREAKAWAY_SOLVES, HELD_FACTOR};
use super::touch::{Contact, Touch};
use super::{along::Tree, config::Asked, touches::Touches, workspace::Workspace};
use crate::prelude::*;

/// Most solves of a substep.
pub(super) const PASSES: usize = 6;
/// Tolerance on the relative change of a drag between two solves, in a frame of one substep. A frame of n substeps
/// takes 1 / n of this tolerance.
pub(super) const SETTLED: f64 = 0.02;

/// Tolerated error of a joint's predicted middle velocity, times h (rad or m); above it the substep is solved again.
/// Used only where steps are solved along the tree.
pub(super) const OFF: f64 = 1e-3;
/// Tolerated error (rad or m) of that prediction after the second solve; above it the substep is halved.
pub(super) const LOST: f64 = 1e-2;

/// Settings of the solves of a substep.
#[derive(Clone, Copy)]
pub(super) struct Substep<'a> {
    pub(super) asked: &'a Asked<'a>,
    /// See [`SETTLED`] and [`PASSES`].
    pub(super) settled: f64,
    pub(super) passes: usize,
    /// Length (s) of the substep: the frame's substep, or a fraction if halved.
    pub(super) h: f64,
}

impl Workspace {
    /// Computes `rate`, the rate of change of local velocities over h, from the forces at the substep's middle. `false`
    /// if the substep is too long to find its middle velocity.
    pub(super) fn accelerate_ahead(&mut self, own: &Substep, qd: &[f64], first: bool) -> Result<bool, String> {
        let Substep { h, settled, .. } = *own;
        let Asked { system, scene, config, tau, .. } = *own.asked;
        let robot = &system.robot;
        let dofs = robot.root_dofs();
        let Touches { touches, shares, mass, tree, .. } = &mut self.touches;
        if tree.is_none() {
            shares.iter().enumerate().for_each(|(i, share)| self.data.mass[(dofs + i, dofs + i)] += share);
            if !touches.is_empty() {
                mass.as_mut_slice().copy_from_slice(self.data.mass.as_slice());
            }
        }
        let spins = Spin::of(robot, &self.data, (h, settled), qd);
        let mut turn = Vector3::zeros();
        let mut spin = None;
        // A root that turns fast may gain energy, as a joint may.
        self.touches.may_gain_energy |= spins.is_some();
        let passes = own.passes + if spins.is_some() { SPIN_PASSES } else { 0 };
        let mut all = true;
        let mut stale = true;
        let mut correct = first;
        let mut corrected = false;
        let mut quiet = false;
        let mut found = true;
        if let Some(kept) = &mut self.kept {
            kept.stages.clear();
        }
        for pass in 0..passes {
            let Touches { touches, middle, rate, right, pull, damping_used, .. } = &mut self.touches;
            if stale {
                if all {
                    middle.iter_mut().zip(qd.iter().zip(rate.iter())).for_each(|(m, (v, a))| *m = v + 0.5 * h * a);
                }
                if let Some(w) = spin {
                    middle[..3].copy_from_slice(Vector3::as_slice(&w));
                }
                bias(robot, middle, &scene.gravity, &mut self.data);
                if robot.floating() {
                    // The derivative of the root's velocity is its spatial acceleration plus w x v.
                    turn = vector(&middle[..3]).cross(&vector(&middle[3..6]));
                }
                let free = scene.gravity - turn;
                for touch in touches.iter_mut() {
                    if let Touch::Contact(contact) = touch {
                        if all && pass > 0 && config.friction == Friction::Coulomb {
                            contact.hold(&(contact.wrench() * HELD_FACTOR));
                        }
                        contact.bend(&robot.contact_points[contact.point], &self.data, &free, &turn, h);
                    }
                }
                right.iter_mut().zip(self.data.tau.as_slice()).for_each(|(r, t)| *r = -t);
                for (i, right) in right[dofs..].iter_mut().enumerate() {
                    *right += tau[i] + pull[i] - damping_used[i] * qd[dofs + i];
                }
            }
            self.solve(robot, h, pass > 0)?;
            let changed = self.settle(robot, h, settled, config.friction, pass);
            // A rate found before all drives are within their bounds does not correct the middle velocity.
            let wait = changed && !self.drives.is_empty();
            let Touches { middle, rate, tree, .. } = &mut self.touches;
            if tree.is_some() {
                // In a chain that whips, the last substep's rate predicts this substep's middle velocity badly.
                let joints = middle.iter().zip(qd.iter().zip(self.data.qdd.iter())).skip(dofs);
                let jump = joints.fold(0.0f64, |most, (m, (v, a))| most.max((v + 0.5 * h * a - m).abs())) * h;
                found = jump <= LOST;
                // A jump of the velocity because a point has parted is no whip.
                if !jump.is_finite() || corrected && quiet && !found {
                    return Ok(false);
                }
                correct |= jump > if corrected { LOST } else { OFF };
                quiet = !changed;
            }
            rate.copy_from_slice(self.data.qdd.as_slice());
            if robot.floating() {
                (0..3).for_each(|k| rate[3 + k] += turn[k]);
            }
            let turned = spin.is_some();
            spin = spins.as_ref().filter(|_| !(correct && wait)).and_then(|spins| spins.next(qd, middle, rate));
            let done = !changed && !correct && spin.is_none();
            all = correct && !wait;
            if let Some(kept) = self.kept.as_mut().filter(|_| done || all || pass + 1 == passes) {
                kept.stage(&self.touches, all && pass == 0, spins.is_some() && (turned || !all));
                if spins.is_some() && !all {
                    // For the gradient the recorded middle is the mean of both ends to rounding, not to the tolerance.
                    let mean = |k: usize| qd[k] + 0.5 * h * self.touches.rate[k];
                    kept.stages
                        .iter_mut()
                        .last()
                        .into_iter()
                        .for_each(|stage| (0..3).for_each(|k| stage.middle[k] = mean(k)));
                }
            }
            stale = all || spin.is_some();
            if done {
                return Ok(true);
            }
            correct &= wait;
            corrected |= all;
        }
        self.touches.may_gain_energy = true;
        Ok(found)
    }

    /// Solves for accelerations with the touches that have not parted. The first solve expects the matrix without
    /// touches in `data.mass`. With `again` that matrix is restored, or its factor reused.
    fn solve(&mut self, robot: &Robot, h: f64, again: bool) -> Result<(), String> {
        let Touches { touches, columns, shares, mass, right, tree, .. } = &mut self.touches;
        match tree {
            Some(tree) => tree.clear(shares),
            None if again && !touches.is_empty() => self.data.mass.as_mut_slice().copy_from_slice(mass.as_slice()),
            None => {}
        }
        self.data.qdd.as_mut_slice().copy_from_slice(right);
        let dofs = robot.root_dofs();
        for touch in touches.iter() {
            let (joint, (force, resists)) = match touch {
                Touch::Contact(contact) if contact.parted => continue,
                Touch::Contact(contact) => {
                    match tree {
                        Some(tree) => tree.point(contact, h),
                        None => press(&mut self.data, contact, &columns[contact.columns.clone()], h),
                    }
                    if tree.is_none() && contact.turns() {
                        press_turns(robot, &mut self.data, contact, h);
                    }
                    continue;
                }
                Touch::Drive { spring, held: Some(force), .. } => {
                    self.data.qdd[dofs + spring.joint] += force;
                    continue;
                }
                Touch::Drive { spring, .. } | Touch::Limit(spring) => (spring.joint, spring.push(h)),
                Touch::Friction(dry) => (dry.joint, (-(dry.rate * dry.drag), dry.drag)),
            };
            let k = dofs + joint;
            self.data.qdd[k] += force;
            match tree {
                Some(tree) => tree.joint(joint, resists * h),
                None => self.data.mass[(k, k)] += resists * h,
            }
        }
        if let Some(tree) = tree {
            let mut qdd = std::mem::replace(&mut self.data.qdd, DVector::zeros(0));
            let sound = tree.solve(robot, &self.data, qdd.as_mut_slice());
            self.data.qdd = qdd;
            if !sound {
                return Err(self.factor.fault_at(robot, Some(tree.lost())));
            }
        } else {
            if !(again && touches.is_empty() || self.factor.refill(&self.data.mass)) {
                return Err(self.factor.fault(robot));
            }
            self.factor.solve(self.data.qdd.as_mut_slice());
        }
        Ok(())
    }

    /// Updates each touch: drags follow from force and slip at the solution, and a point that would pull has parted.
    /// Returns whether anything changed.
    fn settle(&mut self, robot: &Robot, h: f64, settled: f64, friction: Friction, pass: usize) -> bool {
        let mut changed = false;
        let dofs = robot.root_dofs();
        let Touches { touches, columns, tree, may_gain_energy, .. } = &mut self.touches;
        for touch in touches.iter_mut() {
            changed |= match touch {
                Touch::Contact(contact) if contact.parted => false,
                Touch::Contact(contact) => {
                    let change = moved(contact, columns, tree.as_ref(), &self.data.qdd, h);
                    let mut changed = contact.settle(&change, h, friction, (settled, pass));
                    if contact.turns() {
                        let spin = match tree {
                            Some(tree) => tree.spin(contact.link) * h,
                            None => turns(robot, (&self.data.dof, &self.data.axis), contact.link)
                                .map(|(k, axis)| axis * (h * self.data.qdd[k]))
                                .sum(),
                        };
                        let force = (!contact.parted).then_some(&contact.force);
                        changed |= contact.turning.settle(
                            (&contact.normal, &contact.material),
                            force,
                            &spin,
                            (settled, pass < BREAKAWAY_SOLVES),
                        );
                    }
                    *may_gain_energy |= contact.parted;
                    changed
                }
                Touch::Friction(dry) => {
                    let change = h * self.data.qdd[dofs + dry.joint];
                    // Dry friction has theta 1, so it may add energy where its joint reverses.
                    *may_gain_energy |= dry.rate * (dry.rate + change) < 0.0;
                    dry.settle(change, friction, settled)
                }
                Touch::Drive { spring, bounds: [least, most], held: held @ None } => {
                    let force = spring.force(h * self.data.qdd[dofs + spring.joint], h);
                    *held = (!(*least..=*most).contains(&force)).then(|| force.clamp(*least, *most));
                    held.is_some()
                }
                Touch::Drive { .. } | Touch::Limit(_) => false,
            };
        }
        changed
    }
}

/// Change (m/s) `h J qdd` of a contact's velocity in the last solution.
#[inline]
fn moved(
    contact: &Contact,
    columns: &[(usize, Vector3<f64>)],
    tree: Option<&Tree>,
    qdd: &DVector<f64>,
    h: f64,
) -> Vector3<f64> {
    match tree {
        Some(tree) => tree.at(contact.link, &contact.x) * h,
        None => columns[contact.columns.clone()].iter().map(|(k, a)| a * (h * qdd[*k])).sum(),
    }
}

/// Adds a contact's force to `data.qdd`, and its resistance `h D` to the lower triangle of `data.mass`.
#[inline]
fn press(data: &mut Data, contact: &Contact, columns: &[(usize, Vector3<f64>)], h: f64) {
    let n = &contact.normal;
    let (force, along, across) = contact.push(h);
    for (i, a) in columns {
        data.qdd[*i] += a.dot(&force);
        // h D a
        let d = (n * ((along - across) * n.dot(a)) + a * across) * h;
        for (j, b) in columns.iter().filter(|(j, _)| j <= i) {
            data.mass[(*i, *j)] += b.dot(&d);
        }
    }
}

/// Adds torques of torsional and rolling friction to `data.qdd`, and their resistance to the lower triangle of
/// `data.mass`.
fn press_turns(robot: &Robot, data: &mut Data, contact: &Contact, h: f64) {
    let turning = &contact.turning;
    let n = &contact.normal;
    let torque = turning.resists(n, &(turning.spin - turning.turn_offset));
    let Data { dof, axis, qdd, mass, .. } = data;
    for (i, a) in turns(robot, (dof, axis), contact.link) {
        qdd[i] += a.dot(&torque);
        let resists = -turning.resists(n, &a) * h;
        for (j, b) in turns(robot, (dof, axis), contact.link).filter(|(j, _)| *j <= i) {
            mass[(i, j)] += b.dot(&resists);
        }
    }
}

/// Columns of the Jacobian of a link's angular velocity, each with its DoF.
pub(super) fn turns<'a>(
    robot: &'a Robot,
    (dof, axis): (&'a [usize], &'a [Motion]),
    link: usize,
) -> impl Iterator<Item = (usize, Vector3<f64>)> + 'a {
    robot.ancestors(link).flat_map(move |i| {
        let own = robot.links[i].joint.is_some();
        (0..if own { 1 } else { 3 }).map(move |k| if own { (dof[i], axis[i].ang) } else { (k, Vector3::ith(k, 1.0)) })
    })
}
