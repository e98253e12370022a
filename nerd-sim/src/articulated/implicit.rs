//! Implicit substep of second order: contact, limits and joint damping by the theta method, each force stable alone.
//!
//! A substep is a leapfrog step: half a drift of the positions, a kick of the velocities by the forces at the middle,
//! half a drift. A touch is a contact, a limit, a drive or dry friction. A touch's force depends on the change of
//! velocity over the substep, so that change is solved for. The touching place has velocity v at the substep's start
//! and v' at its end. The touch's damper and drag see the velocity `v + theta (v' - v)`; its spring sees the gap
//! `g + theta h (v' - v)`, with g at the middle. A spring's theta is 1/4, which takes the mean of the gaps at both ends
//! and so conserves the spring's energy. A damper's theta is 1/2, the trapezoidal rule; 1 would be implicit Euler. Both
//! thetas grow where the force is too stiff for the touch's own inertia, `1 / w = 1 / n^T J M^-1 J^T n`:
//!
//! ```text
//! theta_k = max(1/4, 1/2 - 1 / (2 h^2 k w)),   theta_d = max(1/2, 1 - 1 / (h d w)),   theta_c of the drag c likewise
//! (M + h sum J^T D J) qdd = tau - bias + sum J^T (f - D u),   u = h (omega x p_dot + J_dot qd)
//! D = (theta_k h k + theta_d d) n n^T + theta_c c (1 - n n^T),   f = -(k g + d v_n) n - c (v_t - s_0)
//! v = J qd - h/2 J_dot qd,   v' - v = h J qdd + u
//! ```
//!
//! In a `Contact` v is `start`, u is `turn`, `s_0` is `slip_offset`, and `push` returns `f - D u` and D. The implicit
//! resistance of a touch is its `h D`, an inertia that the matrix gains. Places and J are those of the substep's
//! middle. The damping d holds while a point approaches; while it parts, d is k times the material's `release`. The
//! velocity that the damper sees decides between the two, by iteration. Sticking friction starts from its last force:
//! through the slip offset `s_0` the drag gives that force at zero slip (`stick.rs`).
//!
//! In u, omega is the root's angular velocity and `p_dot` its velocity. A free root's `qdd` is its spatial
//! acceleration; `p_dot` changes by that plus `omega x p_dot`. The spatial acceleration of a rolling ball is
//! `-omega x p_dot`, so its `p_dot` is constant. Without `omega x p_dot` in u, each of its contacts would predict an
//! upward motion.
//!
//! `J_dot qd` is the rate of change of a touching place's velocity at zero `qdd`. With omega and a of the link it is
//! `a + omega_dot x r + omega x r_dot`, less the root's `omega x p_dot`. In the code omega is `w` and the place r is
//! `x`. The place moves with the centre of a ball, with a corner, or round the rim of a disc. At theta 1/2 `J_dot qd`
//! cancels: v lacks half of it, and theta u adds that half. Stiff friction has theta near 1, where `J_dot qd` does not
//! cancel. Without `J_dot qd`, stiff friction would stop the slip in the axes of the middle, and so accelerate a
//! wobbling coin.
//!
//! A point may be inside its surface during only a part of the substep. The gap g is then the mean gap over that part.
//! That fraction of the substep multiplies k and d, and the drag c of a sliding point. So the instant of landing
//! matters little. The drag c is friction over slip by the friction law, at the slip that the drag sees; it is found by
//! iteration. A point that would pull has parted: it is dropped and the system solved again. A joint beyond its limit
//! is a touch without friction that may pull. A joint's dry friction is a constant force, or below 1e-3 rad/s (m/s) a
//! drag, so a joint that it holds creeps. A drive ([`crate::drive`]) may pull; at its effort limit its force is
//! constant.
//!
//! A joint's own damper and spring are no touches: they act in every substep. The forces of damper and spring are part
//! of tau, and their implicit resistance (`shares`) is added to M. The spring's theta is that of a touch. The damper's
//! theta is 1/2 up to `z_d = h d w` of 1, and beyond it is `1 / (1 - exp(-z_d)) - 1 / z_d`, exact for a lone damper. A
//! spring too stiff for the substep, with large `z_k = h^2 k w`, would oscillate undamped and disturb other joints. So
//! the damping used is the larger of the joint's own and `h k min(z_k, 1/2)`, which is of third order in h.
//!
//! A touch couples only the joints above its link, so the matrix keeps the zeros of M, and its factorisation costs no
//! more. For long chains the same equations are solved along the tree (`along.rs`). `find.rs` collects the touches,
//! `touch.rs` has their forces, and `kick.rs` solves for `qdd`. `frame.rs` repeats a frame that gains energy
//! (`energy.rs`) with more substeps.

use nerd_core::dynamics::{crba, drift, inertias, to_local, to_world};

use super::spin::{centre, kinematics_about_com};
use super::touch::{Contact, MEAN_THETA, Touch, spring_theta};
use super::{config::Asked, fold::fold, kick::Substep, touches::Touches, workspace::Workspace};
use crate::prelude::*;
use crate::solver::gone;

/// Largest added damping of a joint's spring, in units of `h k`.
pub(super) const MAX_SPRING_DAMPING: f64 = 0.5;
/// Most halvings of a substep.
pub(super) const MAX_HALVINGS: usize = 6;

impl Workspace {
    /// Steps a frame; contacts are queried in each of its substeps.
    pub(super) fn implicit(&mut self, asked: &Asked, substeps: usize, state: &mut [f64]) -> Result<(), String> {
        let Asked { system, scene, .. } = *asked;
        let robot = &system.robot;
        let (q, qd) = state.split_at_mut(robot.nq());
        centre(robot, q, 1.0);
        to_local(robot, q, qd);
        self.touches.begin(robot, scene);
        let h = system.frame_time / substeps as f64;
        let (settled, passes) = self.settling;
        let settings = Substep { asked, settled: settled / substeps as f64, passes, h };
        for substep in 0..substeps {
            self.substep(&settings, substep == 0, MAX_HALVINGS, q, qd)?;
        }
        to_world(robot, q, qd);
        centre(robot, q, -1.0);
        Ok(())
    }

    /// Steps one substep. Two halves replace it where the solve finds no velocity at the middle, which the bias forces
    /// need (`kick.rs`). `halvings`: how often the substep may still be halved.
    fn substep(
        &mut self,
        settings: &Substep,
        first: bool,
        halvings: usize,
        q: &mut [f64],
        qd: &mut [f64],
    ) -> Result<(), String> {
        let Asked { system, scene, config, .. } = *settings.asked;
        let h = settings.h;
        let robot = &system.robot;
        let half = 0.5 * h;
        if self.touches.tree.is_some() {
            self.touches.before.copy_from_slice(q);
        }
        drift(robot, q, qd, half);
        kinematics_about_com(robot, q, &mut self.data);
        self.query(system, scene, qd, h, h * h * scene.gravity.norm())
            .map_err(|error| gone(system, q).unwrap_or(error))?;
        self.find(system, scene, q, qd, h);
        if !system.folds.is_empty() {
            self.touches.may_gain_energy |=
                fold(system, &self.stiff.bounds.folds, self.first_h, h, config.friction, &mut self.data);
        }
        match self.touches.tree {
            Some(_) => inertias(robot, &mut self.data),
            None => crba(robot, &mut self.data),
        }
        self.touches.factorised = false;
        if self.touches.damped_h != h {
            self.damp(robot, h)?;
        }
        self.set_thetas(robot, h, config.friction)?;
        // A frame's first substep has no rate that predicts its middle velocity: a second solve corrects that velocity.
        if first {
            self.touches.rate.fill(0.0);
        }
        let lost = !self.accelerate_ahead(settings, qd, first)? && halvings > 0;
        if let Some(kept) = &mut self.kept {
            kept.step(h, q, qd, &self.touches, lost);
        }
        if lost {
            q.copy_from_slice(&self.touches.before);
            let halved = Substep { h: half, ..*settings };
            self.substep(&halved, first, halvings - 1, q, qd)?;
            return self.substep(&halved, false, halvings - 1, q, qd);
        }
        self.touches.add_work(robot.root_dofs(), h, qd);
        let rates = qd.iter().zip(&self.touches.rate).skip(robot.root_dofs());
        let moves = rates.map(|(v, a)| h * v.abs().max((v + h * a).abs()));
        self.touches.may_gain_energy |= moves.zip(&self.touches.fast_moves).any(|(way, fast)| way > *fast);
        qd.iter_mut().zip(&self.touches.rate).for_each(|(v, a)| *v += h * a);
        self.touches.add_forces(h / system.frame_time, &mut self.forces);
        self.touches.keep_wrenches();
        drift(robot, q, qd, half);
        Ok(())
    }

    /// Computes each joint's damping, and the implicit resistance of its damper and spring. These values serve the
    /// whole frame, unless h changes, so they must not depend on the velocity.
    fn damp(&mut self, robot: &Robot, h: f64) -> Result<(), String> {
        self.touches.damped_h = h;
        for (i, joint) in robot.joints().enumerate() {
            let mut w = 0.0;
            if Damped::needs_inv_mass(joint, h, self.stiff.bounds.least[i]) {
                self.factorise_plain(robot)?;
                w = self.joint_inv_mass(robot, i);
            }
            let damped = Damped::of(joint, h, w);
            self.touches.damping_used[i] = damped.damping_used;
            self.touches.shares[i] = damped.share;
        }
        Ok(())
    }

    /// Factorises the mass matrix M, without touches and joint damping, unless done in this substep. Inverse effective
    /// masses need this factor.
    fn factorise_plain(&mut self, robot: &Robot) -> Result<(), String> {
        if std::mem::replace(&mut self.touches.factorised, true) {
            return Ok(());
        }
        let (sound, fault) = match &mut self.touches.tree {
            Some(tree) => (tree.plain(robot, &self.data), Some(tree.lost())),
            None => (self.factor.refill(&self.data.mass), None),
        };
        if sound { Ok(()) } else { Err(self.factor.fault_at(robot, fault)) }
    }

    /// Inverse effective mass w of a joint (1/(kg m^2) or 1/kg), `(M^-1)_ii`; needs [`Self::factorise_plain`].
    fn joint_inv_mass(&mut self, robot: &Robot, joint: usize) -> f64 {
        let Touches { joint_column, tree, .. } = &mut self.touches;
        if let Some(tree) = tree {
            return tree.inv_mass(robot, joint);
        }
        let k = robot.root_dofs() + joint;
        joint_column[..k].fill([0.0].into());
        joint_column[k] = [1.0].into();
        self.factor.inv_mass(k, joint_column).x
    }

    /// Inverse effective mass w of a contact (1/kg), `J M^-1 J^T`: along its normal, and summed over both tangential
    /// directions. Needs [`Self::factorise_plain`].
    fn contact_inv_masses(&mut self, contact: &Contact) -> (f64, f64) {
        let Touches { columns, point_columns, tree, .. } = &mut self.touches;
        let w = if let Some(tree) = tree {
            Matrix3::from_columns(&[0, 1, 2].map(|k| tree.response(contact, &Vector3::ith(k, 1.0))))
        } else {
            let mut last = 0;
            let columns = &columns[contact.columns.clone()];
            point_columns.fill(Vector3::zeros());
            for (k, a) in columns {
                // Mimic joints share a column.
                point_columns[*k] += a;
                last = last.max(*k);
            }
            self.factor.inv_mass(last, point_columns)
        };
        let along = contact.normal.dot(&(w * contact.normal));
        (along, w.trace() - along)
    }

    /// Chooses theta of each touch's spring, damper and drag for stability, from the touch's own inertia
    /// `1 / w = 1 / n^T J M^-1 J^T n`. Also computes the initial drags, and notes touches that may gain energy.
    fn set_thetas(&mut self, robot: &Robot, h: f64, friction: Friction) -> Result<(), String> {
        let mut touches = std::mem::take(&mut self.touches.touches);
        for touch in &mut touches {
            if let Touch::Friction(dry) = touch {
                dry.drag = dry.drag(dry.rate, friction);
            }
            let Some(index) = touch.index() else { continue };
            let w = match self.touches.weights[index] {
                Some(w) => w,
                None => {
                    self.factorise_plain(robot)?;
                    let w = match touch {
                        Touch::Contact(contact) => {
                            let (along, across) = self.contact_inv_masses(contact);
                            self.touches.slides[contact.index].0 = across;
                            along
                        }
                        Touch::Limit(spring) | Touch::Drive { spring, .. } => self.joint_inv_mass(robot, spring.joint),
                        Touch::Friction(_) => 0.0,
                    };
                    *self.touches.weights[index].insert(if w > 0.0 { w } else { f64::INFINITY })
                }
            };
            // A point that comes or leaves within the substep has a positive gap at one end. Then the mean gap plus
            // half of the distance covered is positive, too.
            self.touches.may_gain_energy |= match touch {
                Touch::Contact(contact) => contact.gap + 0.5 * h * contact.normal.dot(&contact.velocity).abs() > 0.0,
                Touch::Limit(spring) => spring.gap + 0.5 * h * spring.rate.abs() > 0.0,
                Touch::Drive { .. } | Touch::Friction(_) => false,
            };
            match touch {
                Touch::Contact(contact) => {
                    let (across, held) = &self.touches.slides[contact.index];
                    contact.set_thetas(w, *across, held, h, friction);
                    // A single contact spring too stiff for the substep gains no energy; several on one body may.
                    self.touches.may_gain_energy |= contact.theta[0] > MEAN_THETA;
                }
                Touch::Limit(spring) | Touch::Drive { spring, .. } => spring.set_thetas(w, h),
                Touch::Friction(_) => {}
            }
            match touch {
                Touch::Contact(contact) if self.touches.mean_theta => {
                    contact.theta = [MEAN_THETA, 0.5, 0.5];
                    contact.dampers.iter_mut().for_each(|damper| damper[1] = 0.5);
                }
                Touch::Limit(spring) if self.touches.mean_theta => spring.theta = [MEAN_THETA, 0.5],
                _ => {}
            }
        }
        self.touches.touches = touches;
        Ok(())
    }
}

/// A joint's damping, and the implicit resistance of its damper and spring.
pub(super) struct Damped {
    /// Damping used (N m s/rad or N s/m), see `Touches::damping_used`.
    pub(super) damping_used: f64,
    /// Implicit resistance (kg m^2 or kg), `theta h d + theta h^2 k`.
    pub(super) share: f64,
}

impl Damped {
    /// Whether a joint's w matters, since its damper or spring may be stiff for its inertia of at least `least`. If
    /// not, w counts as 0: thetas are 1/2 and 1/4, and its spring is not damped.
    pub(super) fn needs_inv_mass(joint: &Joint, h: f64, least: f64) -> bool {
        h * joint.damping.max(h * joint.stiffness) > least
    }

    fn of(joint: &Joint, h: f64, w: f64) -> Self {
        let z_k = h * h * joint.stiffness * w;
        let damping_used = joint.damping.max(h * joint.stiffness * z_k.min(MAX_SPRING_DAMPING));
        Self {
            damping_used,
            share: exponential_theta(h * damping_used * w) * h * damping_used
                + spring_theta(z_k) * h * h * joint.stiffness,
        }
    }

    /// Derivatives of (`damping_used`, `share`) with respect to w, then to the joint's own damping.
    pub(super) fn gradients(joint: &Joint, h: f64, w: f64) -> [(f64, f64); 2] {
        let h2_k = h * h * joint.stiffness;
        let damping_used = Self::of(joint, h, w).damping_used;
        let is_own = damping_used == joint.damping;
        let by_w = if h2_k * w < MAX_SPRING_DAMPING && !is_own { h2_k * h2_k / h } else { 0.0 };
        let z_d = h * damping_used * w;
        // Derivative of `exponential_theta`.
        let theta_by_z = if z_d > 1.0 { 1.0 / (z_d * z_d) - (-z_d).exp() / (-z_d).exp_m1().powi(2) } else { 0.0 };
        // Derivative of the damper's part of `share`, from those of `damping_used` and `z_d`.
        let damper = |by: f64, z_by: f64| theta_by_z * z_by * h * damping_used + exponential_theta(z_d) * h * by;
        let by_spring = if spring_theta(h2_k * w) > MEAN_THETA { 0.5 / (w * w) } else { 0.0 };
        let by_own = f64::from(is_own);
        [(by_w, damper(by_w, h * (damping_used + w * by_w)) + by_spring), (by_own, damper(by_own, h * w * by_own))]
    }
}

/// Theta of a joint's own damper: 1/2, or beyond `z = h d w` of 1 the theta that makes the decay
/// `1 - z / (1 + theta z)` exact, `exp(-z)`. For dampers of touches see `damper` in `touch.rs`.
fn exponential_theta(z: f64) -> f64 {
    if z > 1.0 { -1.0 / (-z).exp_m1() - 1.0 / z } else { 0.5 }
}
