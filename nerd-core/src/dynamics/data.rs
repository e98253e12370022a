//! Working memory of the algorithms for one robot.

use nalgebra::{DMatrix, DVector};

use super::tree::Inverse;
use crate::prelude::*;

/// Working memory for one robot, made once. Its methods are correct for the coordinates they are given, whatever was called before.
/// References they return are overwritten by the next call; methods that return references do not allocate:
///
/// ```
/// # use nerd_core::{nalgebra::Vector3, prelude::*};
/// let robot = Robot::from_urdf(include_str!("../../assets/pendulum.urdf"), Base::fixed())?;
/// let (mut data, q) = (Data::new(&robot), [0.3, 0.2]);
/// let tau = data.gravity_torque(&robot, &q, &Vector3::new(0.0, -9.81, 0.0)).clone();
/// let inertia = data.mass_matrix(&robot, &q);
/// assert!(tau[0] > tau[1] && inertia[(0, 0)] > inertia[(1, 1)]);
/// # Ok::<(), UrdfError>(())
/// ```
///
/// Fields are the stages' own: a solver of this workspace that calls them one by one reads them.
#[derive(Clone, Debug)]
pub struct Data {
    /// Where the common origin is in the world (m): at the root, unless [`super::kinematics_about`] put it elsewhere.
    #[doc(hidden)]
    pub origin: Vector3<f64>,
    /// Index in `qd` of each link's joint, see [`Robot::dofs`].
    #[doc(hidden)]
    pub dof: Vec<usize>,
    /// Rotation of each link frame, link to world.
    #[doc(hidden)]
    pub rotation: Vec<Matrix3<f64>>,
    /// Place of each link frame from the common origin (world axes, m).
    #[doc(hidden)]
    pub position: Vec<Vector3<f64>>,
    /// Motion of each link per unit of its coordinate's rate: the joint's axis, for one that follows times its multiplier; unused for a
    /// floating root.
    #[doc(hidden)]
    pub axis: Vec<Motion>,
    /// Inertia of each link about the common origin; filled by `crba`, `aba` or `inertias`.
    #[doc(hidden)]
    pub inertia: Vec<SpatialInertia>,
    /// For each link, the link whose inertia moves in its place in the mass matrix (not in the bias). Empty, as physics has it, but for
    /// comparison with a simulator that pairs them wrongly.
    #[doc(hidden)]
    pub stand_ins: Vec<usize>,
    /// Twist of each link.
    #[doc(hidden)]
    pub velocity: Vec<Motion>,
    /// External wrench on each link about the common origin; the caller's to set and to clear.
    #[doc(hidden)]
    pub external: Vec<Wrench>,
    /// Mass matrix, `nv` by `nv`, filled on both sides by `crba`.
    #[doc(hidden)]
    pub mass: DMatrix<f64>,
    /// Bias or inverse-dynamics torques, `nv`.
    #[doc(hidden)]
    pub tau: DVector<f64>,
    /// Accelerations, `nv`.
    #[doc(hidden)]
    pub qdd: DVector<f64>,
    /// A Jacobian, 6 by `nv`, and its rate.
    pub(super) jacobian: DMatrix<f64>,
    pub(super) rate: DMatrix<f64>,
    /// Spatial acceleration of each link, with gravity as an upward one of the base; filled by `bias` and `rnea`.
    #[doc(hidden)]
    pub acceleration: Vec<Motion>,
    pub(super) force: Vec<Wrench>,
    pub(super) composite: Vec<SpatialInertia>,
    /// For [`super::aba`], which makes it at its first call, takes it out and puts it back.
    pub(super) inverse: Option<Box<Inverse>>,
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
            stand_ins: Vec::new(),
            velocity: vec![Motion::default(); n],
            external: vec![Wrench::default(); n],
            mass: DMatrix::zeros(nv, nv),
            tau: DVector::zeros(nv),
            qdd: DVector::zeros(nv),
            jacobian: DMatrix::zeros(6, nv),
            rate: DMatrix::zeros(6, nv),
            acceleration: vec![Motion::default(); n],
            force: vec![Wrench::default(); n],
            composite: vec![SpatialInertia::default(); n],
            inverse: None,
        }
    }
}
