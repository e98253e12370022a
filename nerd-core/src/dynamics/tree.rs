//! The inverse of the mass matrix by articulated-body inertias, without the matrix. The sweeps of this method are in
//! `sweeps.rs`.

use nalgebra::{Cholesky, Const, Matrix6, Vector6};

use super::Factor;
use crate::robot::Robot;
use crate::spatial::{Motion, Wrench};

/// Solves `(M + sum_i J_i^T K_i J_i + diag e) x = tau` in O(n). `J_i` is the Jacobian of link i's twist. `K_i` is a
/// symmetric 6x6 matrix (angular part first, about `data.origin`). The vector e has one number for each DoF.
///
/// The method is that of the two inertia sweeps of the articulated-body algorithm (Featherstone 2008, section 7.3),
/// without velocities. A resistance `K_i` to the motion of a link adds to the inertia that its ancestors feel. Mimic
/// joints couple branches, which this recursion cannot express. `data.stand_ins` is ignored.
#[derive(Clone, Debug)]
pub struct TreeFactor {
    pub(super) articulated: Vec<Matrix6<f64>>,
    /// `U = I^A S` of each link, and in `inverse` the number `1 / D` with `D = S . U + armature + e`.
    pub(super) gain: Vec<Vector6<f64>>,
    pub(super) inverse: Vec<f64>,
    pub(super) root: Option<Cholesky<f64, Const<6>>>,
    /// Inverse operational-space inertia of each link: the link's acceleration per unit wrench on it, see
    /// [`TreeFactor::spread`].
    pub(super) inv_inertia: Vec<Matrix6<f64>>,
    /// Bound on the magnitudes summed into each articulated inertia. Rounding errors are judged relative to this bound.
    pub(super) size: Vec<f64>,
    pub(super) force: Vec<Vector6<f64>>,
    pub(super) residual: Vec<f64>,
    /// Accelerations of the links in the last [`TreeFactor::solve`].
    pub(super) acceleration: Vec<Vector6<f64>>,
    pub(super) lost: usize,
}

impl TreeFactor {
    /// Working memory for a robot; `None` for one with mimic joints.
    pub fn new(robot: &Robot) -> Option<Self> {
        let n = robot.links.len();
        (!robot.mimics()).then(|| Self {
            articulated: vec![Matrix6::zeros(); n],
            gain: vec![Vector6::zeros(); n],
            inverse: vec![0.0; n],
            root: None,
            inv_inertia: vec![Matrix6::zeros(); n],
            size: vec![0.0; n],
            force: vec![Vector6::zeros(); n],
            residual: vec![0.0; n],
            acceleration: vec![Vector6::zeros(); n],
            lost: 0,
        })
    }

    /// Acceleration `J_i x` of link i = `link` in the last solution x.
    pub fn acceleration(&self, link: usize) -> Motion {
        Motion::from_slice(self.acceleration[link].as_slice())
    }

    /// Acceleration of a link in response to a wrench on it. Needs [`TreeFactor::spread`].
    pub fn response(&self, link: usize, wrench: &Wrench) -> Motion {
        Motion::from_slice((self.inv_inertia[link] * wrench.vector()).as_slice())
    }

    /// Inverse effective mass of a link's joint: the diagonal entry, at the joint's DoF, of the inverse matrix. Needs
    /// [`TreeFactor::spread`].
    pub fn inv_mass(&self, robot: &Robot, link: usize) -> f64 {
        let gain = &self.gain[link];
        let inverse = self.inverse[link];
        let above = robot.links[link].parent.map_or(0.0, |p| gain.dot(&(self.inv_inertia[p] * gain)));
        inverse + above * inverse * inverse
    }

    /// The DoF at which the last factorisation failed.
    pub fn lost(&self) -> usize {
        self.lost
    }
}

/// Inverse of a robot's mass matrix.
#[derive(Clone, Debug)]
pub enum Inverse {
    /// Articulated-body inertias, O(n).
    Tree(Box<TreeFactor>),
    /// Factor of the mass matrix, for robots with mimic joints. Mimic joints couple branches of the tree, so no
    /// recursion applies.
    Matrix(Factor),
}

impl Inverse {
    /// Articulated-body inertias for a robot without mimic joints, else the factor of the mass matrix.
    pub fn new(robot: &Robot) -> Self {
        TreeFactor::new(robot).map_or_else(|| Self::Matrix(Factor::new(robot)), |tree| Self::Tree(Box::new(tree)))
    }
}
