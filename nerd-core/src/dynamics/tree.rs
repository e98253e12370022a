//! The mass matrix's inverse along the tree, without the matrix; its sweeps are in `sweeps.rs`.

use nalgebra::{Cholesky, Const, Matrix6, Vector6};

use super::Factor;
use crate::robot::Robot;
use crate::spatial::{Motion, Wrench};

/// Solves `(M + sum_i J_i^T K_i J_i + diag e) x = tau` in O(n), where `J_i` is the Jacobian of link i's twist, `K_i` a symmetric 6x6 matrix
/// (words as in [`crate::spatial`], about `data.origin`) and e a number a DoF.
///
/// The articulated-body algorithm's two sweeps (Featherstone 2008, section 7.3) without velocities: whatever resists the motion of a link
/// as `K_i` does is inertia to all links above it. Joints that follow others couple branches, which this cannot express; it also ignores
/// `data.stand_ins`.
#[derive(Clone, Debug)]
pub struct TreeFactor {
    pub(super) articulated: Vec<Matrix6<f64>>,
    /// `U = I^A S`, and `1 / D` with `D = S . U + armature + e`.
    pub(super) gain: Vec<Vector6<f64>>,
    pub(super) inverse: Vec<f64>,
    pub(super) root: Option<Cholesky<f64, Const<6>>>,
    /// Accelerations of links under a unit wrench on them, see [`TreeFactor::spread`].
    pub(super) ease: Vec<Matrix6<f64>>,
    /// Bound on the magnitudes summed into each link's inertia, against which rounding is judged.
    pub(super) size: Vec<f64>,
    pub(super) force: Vec<Vector6<f64>>,
    pub(super) residual: Vec<f64>,
    /// Accelerations of the links in the last [`TreeFactor::solve`].
    pub(super) acceleration: Vec<Vector6<f64>>,
    pub(super) lost: usize,
}

impl TreeFactor {
    /// Working memory for a robot; `None` if the tree does not determine the whole mass matrix.
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

    /// `J_i x` of the last solution: the acceleration of a link.
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

/// Solver with a robot's mass matrix.
#[derive(Clone, Debug)]
pub enum Inverse {
    /// Along the tree.
    Tree(Box<TreeFactor>),
    /// By the matrix's factor, for robots with joints that follow others: these couple branches of the tree, so no recursion applies.
    Matrix(Factor),
}

impl Inverse {
    /// The solver for a robot.
    pub fn new(robot: &Robot) -> Self {
        TreeFactor::new(robot).map_or_else(|| Self::Matrix(Factor::new(robot)), |tree| Self::Tree(Box::new(tree)))
    }
}
