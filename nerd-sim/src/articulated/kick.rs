//! Change of velocity over an implicit substep, by repeated solves.

use nalgebra::DVector;
use nerd_core::dynamics::bias;

use super::press::{moved, press, press_turns, turns};
use super::spin::{SPIN_PASSES, Spin};
use super::stick::{BREAKAWAY_SOLVES, HELD_FACTOR};
use super::touch::Touch;
use super::{config::Asked, touches::Touches, workspace::Workspace};
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

/// Progress of a substep's solves.
struct Search {
    /// Whether the middle velocity is to be set: all of it, from the last rate, or the root's `spin` alone.
    stale: bool,
    all: bool,
    spin: Option<Vector3<f64>>,
    /// Whether the next rate corrects the middle velocity, and whether one has.
    correct: bool,
    corrected: bool,
    /// Whether the last solution changed no touch, and whether its middle velocity was within [`LOST`].
    quiet: bool,
    found: bool,
    /// `w x v` of the root at the middle.
    turn: Vector3<f64>,
}

impl Search {
    fn new(correct: bool) -> Self {
        Self {
            stale: true,
            all: true,
            spin: None,
            correct,
            corrected: false,
            quiet: false,
            found: true,
            turn: Vector3::zeros(),
        }
    }

    /// Whether a middle velocity can be found, after a solution with the error `jump` ([`Workspace::jump`]). In a chain
    /// that whips, the last substep's rate predicts this substep's middle velocity badly.
    fn predicts(&mut self, jump: f64, changed: bool) -> bool {
        self.found = jump <= LOST;
        // A jump of the velocity because a point has parted is no whip.
        if !jump.is_finite() || self.corrected && self.quiet && !self.found {
            return false;
        }
        self.correct |= jump > if self.corrected { LOST } else { OFF };
        self.quiet = !changed;
        true
    }
}

impl Workspace {
    /// Computes `rate`, the rate of change of local velocities over h, from the forces at the substep's middle. `false`
    /// if the substep is too long to find its middle velocity.
    pub(super) fn accelerate_ahead(&mut self, own: &Substep, qd: &[f64], first: bool) -> Result<bool, String> {
        let Substep { h, settled, .. } = *own;
        let robot = &own.asked.system.robot;
        self.add_shares(robot);
        let spins = Spin::of(robot, &self.data, (h, settled), qd);
        // A root that turns fast may gain energy, as a joint may.
        self.touches.may_gain_energy |= spins.is_some();
        let passes = own.passes + if spins.is_some() { SPIN_PASSES } else { 0 };
        if let Some(kept) = &mut self.kept {
            kept.stages.clear();
        }
        let mut search = Search::new(first);
        for pass in 0..passes {
            if search.stale {
                self.renew(own, qd, &mut search, pass);
            }
            self.solve(robot, h, pass > 0)?;
            let changed = self.settle(robot, h, settled, own.asked.config.friction, pass);
            // A rate found before all drives are within their bounds does not correct the middle velocity.
            let wait = changed && !self.drives.is_empty();
            if self.touches.tree.is_some() && !search.predicts(self.jump(robot, h, qd), changed) {
                return Ok(false);
            }
            self.take_rate(robot, &search.turn);
            let turned = search.spin.is_some();
            let Touches { middle, rate, .. } = &self.touches;
            let free = !(search.correct && wait);
            search.spin = spins.as_ref().filter(|_| free).and_then(|spins| spins.next(qd, middle, rate));
            let done = !changed && !search.correct && search.spin.is_none();
            search.all = search.correct && !wait;
            if done || search.all || pass + 1 == passes {
                let spun = spins.is_some().then_some(turned || !search.all);
                self.record(h, qd, search.all, pass == 0, spun);
            }
            search.stale = search.all || search.spin.is_some();
            if done {
                return Ok(true);
            }
            search.correct &= wait;
            search.corrected |= search.all;
        }
        self.touches.may_gain_energy = true;
        Ok(search.found)
    }

    /// Adds the joints' implicit resistance to the mass matrix, and keeps the sum for further solves.
    fn add_shares(&mut self, robot: &Robot) {
        let Touches { touches, shares, mass, tree, .. } = &mut self.touches;
        if tree.is_some() {
            return;
        }
        let dofs = robot.root_dofs();
        shares.iter().enumerate().for_each(|(i, share)| self.data.mass[(dofs + i, dofs + i)] += share);
        if !touches.is_empty() {
            mass.as_mut_slice().copy_from_slice(self.data.mass.as_slice());
        }
    }

    /// Sets the middle velocity, and computes what follows from it: bias, right-hand side, and the contacts' velocities.
    fn renew(&mut self, own: &Substep, qd: &[f64], search: &mut Search, pass: usize) {
        let Asked { system, scene, config, tau, .. } = *own.asked;
        let h = own.h;
        let robot = &system.robot;
        let dofs = robot.root_dofs();
        let Touches { touches, middle, rate, right, pull, damping_used, .. } = &mut self.touches;
        if search.all {
            middle.iter_mut().zip(qd.iter().zip(rate.iter())).for_each(|(m, (v, a))| *m = v + 0.5 * h * a);
        }
        if let Some(w) = search.spin {
            middle[..3].copy_from_slice(Vector3::as_slice(&w));
        }
        bias(robot, middle, &scene.gravity, &mut self.data);
        if robot.floating() {
            // The derivative of the root's velocity is its spatial acceleration plus w x v.
            search.turn = vector(&middle[..3]).cross(&vector(&middle[3..6]));
        }
        let free = scene.gravity - search.turn;
        let holds = search.all && pass > 0 && config.friction == Friction::Coulomb;
        for touch in touches.iter_mut() {
            let Touch::Contact(contact) = touch else { continue };
            if holds {
                contact.hold(&(contact.wrench() * HELD_FACTOR));
            }
            contact.bend(&robot.contact_points[contact.point], &self.data, &free, &search.turn, h);
        }
        right.iter_mut().zip(self.data.tau.as_slice()).for_each(|(r, t)| *r = -t);
        for (i, right) in right[dofs..].iter_mut().enumerate() {
            *right += tau[i] + pull[i] - damping_used[i] * qd[dofs + i];
        }
    }

    /// Largest error (rad or m) of a joint's middle velocity in the last solution, times h.
    fn jump(&self, robot: &Robot, h: f64, qd: &[f64]) -> f64 {
        let joints = self.touches.middle.iter().zip(qd.iter().zip(self.data.qdd.iter())).skip(robot.root_dofs());
        joints.fold(0.0f64, |most, (m, (v, a))| most.max((v + 0.5 * h * a - m).abs())) * h
    }

    /// Takes the rate of local velocities from the last solution; `turn`: `w x v` of the root.
    fn take_rate(&mut self, robot: &Robot, turn: &Vector3<f64>) {
        let rate = &mut self.touches.rate;
        rate.copy_from_slice(self.data.qdd.as_slice());
        if robot.floating() {
            (0..3).for_each(|k| rate[3 + k] += turn[k]);
        }
    }

    /// Records a stage for the backward pass. `all`: whether the rate is to correct the middle velocity. `spun`: for a
    /// root that spins, whether the stage's rate found its middle angular velocity.
    fn record(&mut self, h: f64, qd: &[f64], all: bool, first: bool, spun: Option<bool>) {
        let Some(kept) = &mut self.kept else { return };
        kept.stage(&self.touches, all && first, spun.unwrap_or(false));
        if spun.is_some()
            && !all
            && let Some(stage) = kept.stages.last_mut()
        {
            // For the gradient the recorded middle is the mean of both ends to rounding, not to the tolerance.
            (0..3).for_each(|k| stage.middle[k] = qd[k] + 0.5 * h * self.touches.rate[k]);
        }
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
        let Touches { touches, columns, tree, may_gain_energy, creeps, .. } = &mut self.touches;
        *creeps = false;
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
                    *creeps |= contact.creeps;
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
