//! The mass matrix's inverse along the tree, without the matrix: its factor is filled, solved with, and spread by sweeps.

use nalgebra::{Cholesky, Const, Matrix6, Vector6};

use super::Factor;
use crate::prelude::*;

/// Solves `(M + sum_i J_i^T K_i J_i + diag e) x = tau` in O(n), where `J_i` is the Jacobian of link i's twist, `K_i` a symmetric 6x6 matrix
/// (words as in [`crate::spatial`], about `data.origin`) and e a number a DoF.
///
/// The articulated-body algorithm's two sweeps (Featherstone 2008, section 7.3) without velocities: whatever resists the motion of a link
/// as `K_i` does is inertia to all above it. Joints that follow others couple branches, which this cannot say; nor does it
/// know `data.stand_ins`.
#[derive(Clone, Debug)]
pub struct TreeFactor {
    pub(super) articulated: Vec<Matrix6<f64>>,
    /// `U = I^A S`, and `1 / D` with `D = S . U + armature + e`.
    pub(super) gain: Vec<Vector6<f64>>,
    pub(super) inverse: Vec<f64>,
    pub(super) root: Option<Cholesky<f64, Const<6>>>,
    /// Accelerations of links under a unit wrench on them, see [`TreeFactor::spread`].
    pub(super) ease: Vec<Matrix6<f64>>,
    /// A bound on what was added up in each link's inertia, by which rounding is known.
    pub(super) size: Vec<f64>,
    pub(super) force: Vec<Vector6<f64>>,
    pub(super) residual: Vec<f64>,
    /// Accelerations of the links in the last [`TreeFactor::solve`].
    pub(super) acceleration: Vec<Vector6<f64>>,
    pub(super) lost: usize,
}

impl TreeFactor {
    /// Room for a robot; none if the tree does not say all of its mass matrix.
    pub fn new(robot: &Robot) -> Option<Self> {
        let n = robot.links.len();
        (!robot.mimics()).then(|| Self {
            articulated: vec![Matrix6::zeros(); n],
            gain: vec![Vector6::zeros(); n],
            inverse: vec![0.0; n],
            root: None,
            ease: vec![Matrix6::zeros(); n],
            size: vec![0.0; n],
            force: vec![Vector6::zeros(); n],
            residual: vec![0.0; n],
            acceleration: vec![Vector6::zeros(); n],
            lost: 0,
        })
    }

    /// `J_i x` of the last solution: what it does to a link.
    pub fn acceleration(&self, link: usize) -> Motion {
        Motion::from_slice(self.acceleration[link].as_slice())
    }

    /// The twist that a wrench on a link gives it, after [`TreeFactor::spread`].
    pub fn eased(&self, link: usize, wrench: &Wrench) -> Motion {
        Motion::from_slice((self.ease[link] * wrench.vector()).as_slice())
    }

    /// The diagonal entry of the inverse at the joint of a link, after [`TreeFactor::spread`].
    pub fn ease(&self, robot: &Robot, link: usize) -> f64 {
        let (gain, inverse) = (&self.gain[link], self.inverse[link]);
        let above = robot.links[link].parent.map_or(0.0, |p| gain.dot(&(self.ease[p] * gain)));
        inverse + above * inverse * inverse
    }

    /// The DoF at which the last sum was not positive definite.
    pub fn lost(&self) -> usize {
        self.lost
    }
}

/// What solves with a robot's mass matrix.
#[derive(Clone, Debug)]
pub(super) enum Inverse {
    /// Along the tree.
    Tree(Box<TreeFactor>),
    /// Where joints follow others, which couples branches of the tree, no recursion does.
    Matrix(Factor),
}

impl Inverse {
    pub(super) fn new(robot: &Robot) -> Self {
        TreeFactor::new(robot).map_or_else(|| Self::Matrix(Factor::new(robot)), |tree| Self::Tree(Box::new(tree)))
    }
}

/// Share of what was added up that rounding may leave of a zero.
const ROUNDING: f64 = 1e-14;

impl TreeFactor {
    /// Factorises. Needs [`super::kinematics`] and [`super::inertias`]; `links` are the `K_i`, `joints` the e of the joints, in their order; empty:
    /// none. `false` if the sum is not positive definite; then do not solve.
    #[must_use]
    pub fn refill(&mut self, robot: &Robot, data: &Data, links: &[Matrix6<f64>], joints: &[f64]) -> bool {
        let (first, dofs) = (usize::from(robot.floating()), robot.root_dofs());
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
                // Entry by entry, in place: matrices that come and go as values cost more than their sums.
                let (above, own) = self.articulated.split_at_mut(i);
                for c in 0..6 {
                    let share = gain[c] * self.inverse[i];
                    let (above, own) = (&mut above[p].data.0[c], &own[0].data.0[c]);
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

    /// Replaces `x` (length `nv`) by the solution for torques `x` and wrenches `press` on the links (about `data.origin`; empty: none).
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

    /// Works out what wrenches and torques of one each do, for [`TreeFactor::eased`] and [`TreeFactor::ease`]: from the root outward,
    /// `E_i = S S^T / D + (1 - S U^T / D) E_p (1 - U S^T / D)`.
    pub fn spread(&mut self, robot: &Robot, data: &Data) {
        let first = usize::from(robot.floating());
        if let Some(root) = &self.root {
            self.ease[0] = root.inverse();
        }
        for i in first..robot.links.len() {
            let (s, inverse) = (data.axis[i].vector(), self.inverse[i]);
            let above = robot.links[i].parent.map_or(Matrix6::zeros(), |p| self.ease[p]);
            // (1 - S U^T / D) E_p, then the same from the right.
            let half = above - s * ((self.gain[i].transpose() * above) * inverse);
            self.ease[i] = half - (half * self.gain[i]) * (s.transpose() * inverse) + s * (s.transpose() * inverse);
        }
    }
}
