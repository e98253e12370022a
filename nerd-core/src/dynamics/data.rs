//! Working memory of the algorithms for one robot.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::Factor;
use crate::robot::Robot;
use crate::spatial::{Motion, SpatialInertia, Wrench};

/// Everything the algorithms compute, by link; made once, reused for ever.
#[derive(Clone, Debug)]
pub struct Data {
    /// Where the common origin stands in the world (m): at the root, unless [`super::kinematics_about`] put it elsewhere.
    pub origin: Vector3<f64>,
    /// Index in `qd` of each link's joint, see [`Robot::dofs`].
    pub dof: Vec<usize>,
    /// Rotation of each link frame, link to world.
    pub rotation: Vec<Matrix3<f64>>,
    /// Place of each link frame from the common origin (world axes, m).
    pub position: Vec<Vector3<f64>>,
    /// Motion of each link per unit of its coordinate's rate: the joint's axis, for one that follows times its multiplier; unused for a
    /// floating root.
    pub axis: Vec<Motion>,
    /// Inertia of each link about the common origin; filled by [`super::crba`], [`super::aba`] or [`super::inertias`].
    pub inertia: Vec<SpatialInertia>,
    /// Twist of each link.
    pub velocity: Vec<Motion>,
    /// External wrench on each link about the common origin; the caller's to set and to clear.
    pub external: Vec<Wrench>,
    /// Mass matrix, `nv` by `nv`, filled on both sides by [`super::crba`].
    pub mass: DMatrix<f64>,
    /// Bias or inverse-dynamics torques, `nv`.
    pub tau: DVector<f64>,
    /// Accelerations, `nv`.
    pub qdd: DVector<f64>,
    pub(super) acceleration: Vec<Motion>,
    pub(super) force: Vec<Wrench>,
    pub(super) composite: Vec<SpatialInertia>,
    pub(super) articulated: Vec<nalgebra::Matrix6<f64>>,
    pub(super) gain: Vec<nalgebra::Vector6<f64>>,
    pub(super) pivot: Vec<f64>,
    pub(super) residual: Vec<f64>,
    /// Where some joint follows another, no recursion gives accelerations.
    pub(super) factor: Option<Box<Factor>>,
}

impl Data {
    /// Working memory for `robot`.
    pub fn new(robot: &Robot) -> Self {
        let (n, nv) = (robot.links.len(), robot.nv());
        Self {
            origin: Vector3::zeros(),
            dof: robot.dofs(),
            rotation: vec![Matrix3::identity(); n],
            position: vec![Vector3::zeros(); n],
            axis: vec![Motion::default(); n],
            inertia: vec![SpatialInertia::default(); n],
            velocity: vec![Motion::default(); n],
            external: vec![Wrench::default(); n],
            mass: DMatrix::zeros(nv, nv),
            tau: DVector::zeros(nv),
            qdd: DVector::zeros(nv),
            acceleration: vec![Motion::default(); n],
            force: vec![Wrench::default(); n],
            composite: vec![SpatialInertia::default(); n],
            articulated: vec![nalgebra::Matrix6::zeros(); n],
            gain: vec![nalgebra::Vector6::zeros(); n],
            pivot: vec![0.0; n],
            residual: vec![0.0; n],
            factor: robot.mimics().then(|| Box::new(Factor::new(robot))),
        }
    }
}
