//! A substep h of second order, with contact, limits and joint damping looking ahead so that each by itself is stable at any
//! length.
//!
//! Half a drift, a kick with the forces found there, half a drift (leapfrog). A spring, damper or friction of a touch sees
//! the velocity `v + a (v' - v)` between the substep's start and its end, and a spring the gap `g + a h (v' - v)`, each with
//! its own share a: a quarter for a spring, the mean of the gaps at both ends, which keeps its energy, and half for a damper while that is
//! stable, more as they grow stiff for the touch's own inertia, `1 / w = 1 / n^T J M^-1 J^T n`:
//!
//! ```text
//! spring a = max(1/4, 1/2 - 1 / (2 h^2 k w))      damper a = max(1/2, 1 - 1 / (h d w))      (friction's drag likewise)
//! (M + h sum J^T D J) qdd = tau - bias + sum J^T f,    D = (a_k h k + a_d d) n n^T + a_c c (1 - n n^T)
//! f = -(k g + d min(v_n, 0)) n - c v_t,    v = J qd - h/2 J_dot qd,    v' - v = h (J qdd + w x p_dot + J_dot qd)
//! ```
//!
//! Places and J are those of the middle. A free root's `qdd` is its spatial acceleration; its velocity `p_dot` changes by that and `w x p_dot`,
//! so a ball that rolls, with the spatial acceleration `-w x p_dot`, expects no change. Without the second term each contact would expect to
//! be thrown upward. `J_dot qd` is what the velocity of a touching place x changes by as it moves, `a + w_dot x x + w x x_dot` of its link
//! at zero `qdd`, less `w x p_dot`: x moves with the centre of a ball, with a corner, round the rim of a disc. A force that looks to the
//! middle, a = 1/2, sees nothing of it; one that looks to the end, as stiff friction does, would hold what slides in the middle's axes,
//! and a coin that wobbles would be driven by its friction.
//!
//! The gap g is the mean over that part of the substep in which the point is inside, and k, d, c act with that part only,
//! so that it matters little where in a substep a point lands. The drag c is the law's at the velocity seen, found by
//! repetition. A point that would pull has parted; it is dropped and the system solved again. A joint beyond its limit is a
//! touch without friction that may pull; its own damper always acts, with the share that makes a damper alone exact,
//! `a = 1 / (1 - exp(-z)) - 1 / z`, where `z = h d w` is beyond 1. A joint's dry friction rubs under a constant force, and holds up to 1 mm/s of
//! creep. A joint's spring, `z = h^2 k w`, is damped by `h k min(z, 1/2)` at least: what a substep is too long to follow would ring for ever, and
//! shake what it can follow. That is of third order in h, and nothing beside a damper that lets the spring come to rest. A drive
//! ([`crate::drive`]) may pull, until its effort holds it at a constant force. A touch couples only the joints above it, so the matrix keeps the
//! tree's zeros and the factorisation its cost. A frame that gives energy is stepped again, finer (`energy.rs`). Where chains are long, the same equations are solved along the tree (`along.rs`).

use nerd_core::dynamics::{crba, inertias, to_local, to_world};

use super::spin::{centre, stand};
use super::touch::{Contact, EVEN, Touch, ahead};
use super::{config::Asked, energy::WHIRL, fold::fold, kick::Substep, touches::Touches, workspace::Workspace};
use crate::prelude::*;
use crate::solver::gone;

/// Largest share of `h k` by which a joint's spring is damped.
pub(super) const CALM: f64 = 0.5;
/// How often a substep is halved at most.
pub(super) const HALVINGS: usize = 6;

impl Workspace {
    /// A frame of so many substeps; contacts are looked for in each.
    pub(super) fn implicit(&mut self, asked: &Asked, substeps: usize, state: &mut [f64]) -> Result<(), String> {
        let Asked { system, scene, .. } = *asked;
        let robot = &system.robot;
        let (q, qd) = state.split_at_mut(robot.nq());
        centre(robot, q, 1.0);
        to_local(robot, q, qd);
        self.touches.begin(robot, scene);
        let h = system.frame_time / substeps as f64;
        let (settled, passes) = self.settling;
        let all = Substep { asked, settled: settled / substeps as f64, passes, h };
        for substep in 0..substeps {
            self.substep(&all, substep == 0, HALVINGS, q, qd)?;
        }
        to_world(robot, q, qd);
        centre(robot, q, -1.0);
        Ok(())
    }

    /// One substep, in halves if it is too long to be solved.
    fn substep(&mut self, own: &Substep, first: bool, halvings: usize, q: &mut [f64], qd: &mut [f64]) -> Result<(), String> {
        let (Asked { system, scene, config, .. }, h) = (*own.asked, own.h);
        let robot = &system.robot;
        let half = 0.5 * h;
        if self.touches.tree.is_some() {
            self.touches.before.copy_from_slice(q);
        }
        drift(robot, q, qd, half);
        stand(robot, q, &mut self.data);
        self.query(system, scene, qd, h, h * h * scene.gravity.norm()).map_err(|lost| gone(system, q).unwrap_or(lost))?;
        self.find(system, scene, q, qd, h);
        if !system.folds.is_empty() {
            self.touches.eventful |= fold(system, &self.stiff.bounds.folds, self.whole, h, config.friction, &mut self.data);
        }
        match self.touches.tree {
            Some(_) => inertias(robot, &mut self.data),
            None => crba(robot, &mut self.data),
        }
        self.touches.plain = false;
        if self.touches.shared != h {
            self.damp(robot, h)?;
        }
        self.weigh(robot, h, config.friction)?;
        // The first substep of a frame knows no rate yet, and finds its middle by a second solve.
        if first {
            self.touches.rate.fill(0.0);
        }
        let lost = !self.accelerate_ahead(own, qd, first)? && halvings > 0;
        if let Some(kept) = &mut self.kept {
            kept.step(h, q, qd, &self.touches, lost);
        }
        if lost {
            q.copy_from_slice(&self.touches.before);
            let halved = Substep { h: half, ..*own };
            self.substep(&halved, first, halvings - 1, q, qd)?;
            return self.substep(&halved, false, halvings - 1, q, qd);
        }
        self.touches.drive(robot.root_dofs(), h, qd);
        let rates = qd.iter().zip(&self.touches.rate).skip(robot.root_dofs());
        self.touches.eventful |= rates.map(|(v, a)| v.abs().max((v + h * a).abs())).any(|fastest| h * fastest > WHIRL);
        qd.iter_mut().zip(&self.touches.rate).for_each(|(v, a)| *v += h * a);
        self.touches.tell(h / system.frame_time, &mut self.forces);
        drift(robot, q, qd, half);
        Ok(())
    }

    /// Dampings of the joints, and what they and their springs resist with.
    fn damp(&mut self, robot: &Robot, h: f64) -> Result<(), String> {
        self.touches.shared = h;
        for (i, joint) in robot.joints().enumerate() {
            let mut w = 0.0;
            if Damped::weighed(joint, h, self.stiff.bounds.least[i]) {
                self.plain(robot)?;
                w = self.ease(robot, i);
            }
            let damped = Damped::of(joint, h, w);
            self.touches.braked[i] = damped.braked;
            self.touches.shares[i] = damped.share;
        }
        Ok(())
    }

    /// The inverse of the mass matrix alone, if it is not there yet.
    fn plain(&mut self, robot: &Robot) -> Result<(), String> {
        if std::mem::replace(&mut self.touches.plain, true) {
            return Ok(());
        }
        let (sound, lost) = match &mut self.touches.tree {
            Some(tree) => (tree.plain(robot, &self.data), Some(tree.lost())),
            None => (self.factor.refill(&self.data.mass), None),
        };
        if sound { Ok(()) } else { Err(self.factor.fault_at(robot, lost)) }
    }

    /// w of a joint, by the inverse that [`Self::plain`] has made.
    fn ease(&mut self, robot: &Robot, joint: usize) -> f64 {
        let Touches { right, tree, .. } = &mut self.touches;
        if let Some(tree) = tree {
            return tree.ease(robot, joint);
        }
        let k = robot.root_dofs() + joint;
        right[..k].fill(0.0);
        right[k] = 1.0;
        self.factor.ease(k, right)
    }

    /// w of a contact along its normal.
    fn eased(&mut self, contact: &Contact) -> f64 {
        let Touches { columns, right, tree, .. } = &mut self.touches;
        if let Some(tree) = tree {
            return tree.eased(contact);
        }
        let (mut last, columns) = (0, &columns[contact.columns.clone()]);
        right.fill(0.0);
        for (k, a) in columns {
            // Joints that follow one share its column.
            right[*k] += contact.normal.dot(a);
            last = last.max(*k);
        }
        self.factor.ease(last, right)
    }

    /// How far ahead each force must look to be stable, from the touch's own inertia `1 / w = 1 / n^T J M^-1 J^T n`.
    fn weigh(&mut self, robot: &Robot, h: f64, friction: Friction) -> Result<(), String> {
        let mut touches = std::mem::take(&mut self.touches.touches);
        for touch in &mut touches {
            if let Touch::Friction(dry) = touch {
                dry.across = dry.drag(dry.rate, friction);
            }
            let Some(index) = touch.index() else { continue };
            let w = match self.touches.weights[index] {
                Some(w) => w,
                None => {
                    self.plain(robot)?;
                    let w = match touch {
                        Touch::Contact(contact) => self.eased(contact),
                        Touch::Limit(spring) | Touch::Drive { spring, .. } => self.ease(robot, spring.joint),
                        Touch::Friction(_) => 0.0,
                    };
                    *self.touches.weights[index].insert(if w > 0.0 { w } else { f64::INFINITY })
                }
            };
            // Beyond its surface for a part of the substep, if its gap at one end is positive.
            self.touches.eventful |= match touch {
                Touch::Contact(contact) => contact.gap + 0.5 * h * contact.normal.dot(&contact.velocity).abs() > 0.0,
                Touch::Limit(spring) => spring.gap + 0.5 * h * spring.rate.abs() > 0.0,
                Touch::Drive { .. } | Touch::Friction(_) => false,
            };
            match touch {
                Touch::Contact(contact) => contact.weigh(w, h, friction),
                Touch::Limit(spring) | Touch::Drive { spring, .. } => spring.weigh(w, h),
                Touch::Friction(_) => {}
            }
            match touch {
                Touch::Contact(contact) if self.touches.even => contact.ahead = [EVEN, 0.5, 0.5],
                Touch::Limit(spring) if self.touches.even => spring.ahead = [EVEN, 0.5],
                _ => {}
            }
        }
        self.touches.touches = touches;
        Ok(())
    }
}

/// A joint's damping, and what its damper and spring resist with.
pub(super) struct Damped {
    pub(super) braked: f64,
    pub(super) share: f64,
}

impl Damped {
    /// Whether a joint of at least so much inertia asks for its w; 0 is as good else.
    pub(super) fn weighed(joint: &Joint, h: f64, least: f64) -> bool {
        h * joint.damping.max(h * joint.stiffness) > least
    }

    fn of(joint: &Joint, h: f64, w: f64) -> Self {
        let z = h * h * joint.stiffness * w;
        let braked = joint.damping.max(h * joint.stiffness * z.min(CALM));
        Self { braked, share: exponential(h * braked * w) * h * braked + ahead(z) * h * h * joint.stiffness }
    }

    /// Slopes of both by w, and by the joint's damping.
    pub(super) fn slopes(joint: &Joint, h: f64, w: f64) -> [(f64, f64); 2] {
        let k = h * h * joint.stiffness;
        let braked = Self::of(joint, h, w).braked;
        let own = braked == joint.damping;
        let by_w = if k * w < CALM && !own { k * k / h } else { 0.0 };
        let z = h * braked * w;
        // Of `exponential`.
        let slope = if z > 1.0 { 1.0 / (z * z) - (-z).exp() / (-z).exp_m1().powi(2) } else { 0.0 };
        let damper = |braked_by: f64, z_by: f64| slope * z_by * h * braked + exponential(z) * h * braked_by;
        let by_spring = if ahead(k * w) > EVEN { 0.5 / (w * w) } else { 0.0 };
        let by_own = f64::from(own);
        [(by_w, damper(by_w, h * (braked + w * by_w)) + by_spring), (by_own, damper(by_own, h * w * by_own))]
    }
}

/// The share of a damper with `z = h d w` beyond 1 that makes its decay, `1 - z / (1 + a z)`, exact: `exp(-z)`.
fn exponential(z: f64) -> f64 {
    if z > 1.0 { -1.0 / (-z).exp_m1() - 1.0 / z } else { 0.5 }
}

/// The pose after a time at local velocities.
fn drift(robot: &Robot, q: &mut [f64], qd: &[f64], time: f64) {
    let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
    for (x, v) in q[coords..].iter_mut().zip(&qd[dofs..]) {
        *x += v * time;
    }
    if robot.floating() {
        let (w, v) = (vector(&qd[..3]), vector(&qd[3..6]));
        let p = vector(&q[..3]) + v * time;
        q[..3].copy_from_slice(p.as_slice());
        let turned = UnitQuaternion::from_scaled_axis(w * time) * quaternion(&q[3..7]);
        write_quaternion(&mut q[3..7], &turned);
    }
}
