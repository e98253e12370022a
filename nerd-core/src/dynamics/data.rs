//! Working memory of the dynamics algorithms for one robot.

use nalgebra::{DMatrix, DVector};

use super::tree::Inverse;
use crate::prelude::*;

/// Working memory for one robot, made once. Results depend on the arguments and `external` alone, not on earlier calls.
/// The next call overwrites the references returned. Methods that return references do not allocate:
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
/// The public fields hold the results of the stages (`kinematics`, `crba`, `rnea` and others), for solvers of this
/// workspace that call the stages themselves.
#[derive(Clone, Debug)]
pub struct Data {
    /// World position of the common origin (m): the root's position, unless [`super::kinematics_about`] chose another.
    #[doc(hidden)]
    pub origin: Vector3<f64>,
    /// Index in `qd` of each link's joint, see [`Robot::dofs`].
    #[doc(hidden)]
    pub dof: Vec<usize>,
    /// Rotation of each link frame, link to world.
    #[doc(hidden)]
    pub rotation: Vec<Matrix3<f64>>,
    /// Position of each link frame from the common origin (world axes, m).
    #[doc(hidden)]
    pub position: Vec<Vector3<f64>>,
    /// Joint axis `S` of each link: the link's motion per unit rate of the coordinate that moves it. For a mimic joint
    /// `S` includes the multiplier. Unused for a floating root.
    #[doc(hidden)]
    pub axis: Vec<Motion>,
    /// Inertia of each link about the common origin; filled by `crba`, `aba` or `inertias`.
    #[doc(hidden)]
    pub inertia: Vec<SpatialInertia>,
    /// For each link, the link whose inertia CRBA uses instead; the bias keeps the true inertia. Empty for correct
    /// physics. Set only for comparison with a simulator that pairs links and inertias wrongly.
    #[doc(hidden)]
    pub stand_ins: Vec<usize>,
    /// Twist of each link about the common origin (rad/s, m/s; world axes).
    #[doc(hidden)]
    pub velocity: Vec<Motion>,
    /// External wrench on each link about the common origin (N m, N). The caller sets and clears these wrenches.
    #[doc(hidden)]
    pub external: Vec<Wrench>,
    /// Mass matrix, `nv` by `nv`, both triangles filled by `crba`.
    #[doc(hidden)]
    pub mass: DMatrix<f64>,
    /// Torques `[nv]` from the last call of `bias` or `rnea`.
    #[doc(hidden)]
    pub tau: DVector<f64>,
    /// Accelerations `qdd`, `[nv]`.
    #[doc(hidden)]
    pub qdd: DVector<f64>,
    /// Jacobian of a frame, 6 by `nv`, and its time derivative.
    pub(super) jacobian: DMatrix<f64>,
    pub(super) rate: DMatrix<f64>,
    /// Spatial acceleration of each link; gravity is included as an upward acceleration of the base. Filled by `bias`
    /// and `rnea`.
    #[doc(hidden)]
    pub acceleration: Vec<Motion>,
    pub(super) force: Vec<Wrench>,
    pub(super) composite: Vec<SpatialInertia>,
    /// Factorisation used by [`super::aba`], made at its first call.
    pub(super) inverse: Option<Box<Inverse>>,
}

impl Data {
    /// Working memory for `robot`.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.links.len();
        let nv = robot.nv();
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
