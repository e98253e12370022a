//! Articulated-body sweeps of [`TreeFactor`]: factorisation, solution and inverse operational-space inertias; also
//! forward dynamics (ABA).

use nalgebra::{DVector, Matrix6, Vector6};

use super::{Inverse, TreeFactor, bias, crba, inertias};
use crate::prelude::*;

/// A sum smaller than this share of the magnitudes added counts as rounding error of zero.
const ROUNDING: f64 = 1e-14;

impl TreeFactor {
    /// Factorises the matrix of [`TreeFactor`]. Needs [`super::kinematics`] and [`super::inertias`]. `links[link]` are
    /// the `K_i`. `joints` are the numbers e of the joints, in the order of `qd`. An empty slice means zeros. Returns
    /// `false` if the matrix is not positive definite; then do not solve.
    #[must_use]
    pub fn refill(&mut self, robot: &Robot, data: &Data, links: &[Matrix6<f64>], joints: &[f64]) -> bool {
        let first = usize::from(robot.floating());
        let dofs = robot.root_dofs();
        for (i, (own, size)) in self.articulated.iter_mut().zip(&mut self.size).enumerate() {
            *own = data.inertia[i].matrix();
            if let Some(more) = links.get(i) {
                *own += more;
            }
            *size = own.trace();
        }
        for i in (first..robot.links.len()).rev() {
            let Some(joint) = &robot.links[i].joint else { continue };
            let s = data.axis[i].vector();
            let gain = self.articulated[i] * s;
            let pivot = s.dot(&gain) + joint.armature + joints.get(data.dof[i] - dofs).copied().unwrap_or(0.0);
            if pivot.is_nan() || pivot <= ROUNDING * self.size[i] * s.norm_squared() {
                self.lost = data.dof[i];
                return false;
            }
            (self.gain[i], self.inverse[i]) = (gain, pivot.recip());
            if let Some(p) = robot.links[i].parent {
                // Entry by entry, in place: copying whole matrices costs more than adding them.
                let (above, own) = self.articulated.split_at_mut(i);
                for c in 0..6 {
                    let share = gain[c] * self.inverse[i];
                    let above = &mut above[p].data.0[c];
                    let own = &own[0].data.0[c];
                    (0..6).for_each(|r| above[r] += own[r] - gain[r] * share);
                }
                self.size[p] += self.size[i];
            }
        }
        if robot.floating() {
            self.lost = 0;
            self.root = self.articulated[0].cholesky();
            return self.root.is_some();
        }
        true
    }

    /// Replaces the torques `x[nv]` by the solution under these torques and the wrenches `press[link]`. The wrenches
    /// are about `data.origin`; an empty slice means none.
    pub fn solve(&mut self, robot: &Robot, data: &Data, press: &[Wrench], x: &mut [f64]) {
        let first = usize::from(robot.floating());
        for (i, force) in self.force.iter_mut().enumerate() {
            *force = press.get(i).map_or(Vector6::zeros(), |w| -w.vector());
        }
        for i in (first..robot.links.len()).rev() {
            let s = data.axis[i].vector();
            self.residual[i] = x[data.dof[i]] - s.dot(&self.force[i]);
            if let Some(p) = robot.links[i].parent {
                let passed = self.force[i] + self.gain[i] * (self.residual[i] * self.inverse[i]);
                self.force[p] += passed;
            }
        }
        if let Some(root) = &self.root {
            let mut wrench = Vector6::from_column_slice(&x[..6]) - self.force[0];
            root.solve_mut(&mut wrench);
            x[..6].copy_from_slice(wrench.as_slice());
            self.acceleration[0] = wrench;
        }
        for i in first..robot.links.len() {
            let above = robot.links[i].parent.map_or(Vector6::zeros(), |p| self.acceleration[p]);
            let own = (self.residual[i] - self.gain[i].dot(&above)) * self.inverse[i];
            x[data.dof[i]] = own;
            self.acceleration[i] = above + data.axis[i].vector() * own;
        }
    }

    /// Computes the inverse operational-space inertias `E_i` for [`TreeFactor::response`] and [`TreeFactor::inv_mass`],
    /// from the root outward: `E_i = S S^T / D + (1 - S U^T / D) E_p (1 - U S^T / D)`. Needs `TreeFactor::refill`.
    pub fn spread(&mut self, robot: &Robot, data: &Data) {
        let first = usize::from(robot.floating());
        if let Some(root) = &self.root {
            self.inv_inertia[0] = root.inverse();
        }
        for i in first..robot.links.len() {
            let s = data.axis[i].vector();
            let inverse = self.inverse[i];
            let above = robot.links[i].parent.map_or(Matrix6::zeros(), |p| self.inv_inertia[p]);
            // (1 - S U^T / D) E_p, then the same factor transposed from the right.
            let half = above - s * ((self.gain[i].transpose() * above) * inverse);
            self.inv_inertia[i] =
                half - (half * self.gain[i]) * (s.transpose() * inverse) + s * (s.transpose() * inverse);
        }
    }
}

impl Inverse {
    /// Factorises the mass matrix. Needs [`super::kinematics`]; fills `data.inertia`. Returns `false` if some part of
    /// the robot has no inertia; then do not solve.
    #[must_use]
    pub fn refill(&mut self, robot: &Robot, data: &mut Data) -> bool {
        match self {
            Self::Tree(tree) => {
                inertias(robot, data);
                tree.refill(robot, data, &[], &[])
            }
            Self::Matrix(factor) => {
                crba(robot, data);
                factor.refill(&data.mass)
            }
        }
    }

    /// Replaces the torques `x[nv]` by the accelerations `M^-1 x`.
    pub fn solve(&mut self, robot: &Robot, data: &Data, x: &mut [f64]) {
        match self {
            Self::Tree(tree) => tree.solve(robot, data, &[], x),
            Self::Matrix(factor) => factor.solve(x),
        }
    }
}

/// Forward dynamics (ABA): writes the accelerations `M^-1 (tau - c)` to `data.qdd`, for torques `tau[nv]` and local
/// velocities `qd[nv]`. Needs `kinematics`; includes the wrenches `data.external`. Returns `false` if a subtree has no
/// inertia to accelerate.
///
/// Without mimic joints the cost is O(n): [`bias`] gives the bias forces and [`TreeFactor`] the inverse. With mimic
/// joints the mass matrix is factorised.
#[must_use = "without inertia there is no acceleration"]
pub fn aba(robot: &Robot, qd: &[f64], tau: &[f64], gravity: &Vector3<f64>, data: &mut Data) -> bool {
    bias(robot, qd, gravity, data);
    let mut inverse = data.inverse.take().unwrap_or_else(|| Box::new(Inverse::new(robot)));
    let mut qdd = std::mem::replace(&mut data.qdd, DVector::zeros(0));
    qdd.iter_mut().zip(tau.iter().zip(data.tau.iter())).for_each(|(a, (tau, c))| *a = tau - c);
    let sound = inverse.refill(robot, data);
    if sound {
        inverse.solve(robot, data, qdd.as_mut_slice());
    }
    (data.inverse, data.qdd) = (Some(inverse), qdd);
    sound
}
