//! Robots.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_core::dynamics::Data;
use pyo3::prelude::*;

use crate::arrays::{Floats, made};
use crate::dynamics;
use crate::error::value;

/// A robot with everything its file leaves open: frame time, gravity, materials, starts, scenes.
///
/// System("ant"), or the path of a URDF, an MJCF (.xml) or a cable's TOML.
///
/// Raises ValueError, in one line, for an unknown name or an unreadable file.
#[pyclass(frozen, from_py_object, module = "nerd")]
#[derive(Clone)]
pub struct System {
    pub system: Arc<nerd_sim::prelude::System>,
    /// Built-in name of the robot, or absolute path of its file.
    source: String,
}

impl System {
    /// Makes a loaded system with its name or path.
    pub fn of(name: &Path, system: Arc<nerd_sim::prelude::System>) -> Self {
        // An absolute path stays valid in other working directories. Only file names have an extension.
        let file = name.extension().and_then(|_| std::path::absolute(name).ok());
        Self { system, source: file.as_deref().unwrap_or(name).to_string_lossy().into_owned() }
    }
}

#[pymethods]
impl System {
    #[new]
    fn new(name: PathBuf) -> PyResult<Self> {
        Ok(Self::of(&name, nerd_sim::prelude::System::named(&name.to_string_lossy()).map_err(value)?))
    }

    /// Built-in name of the system, or the absolute path of its file.
    #[getter]
    fn source(&self) -> &str {
        &self.source
    }

    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        &self.system.name
    }

    /// Duration of a control frame (s).
    #[getter]
    fn frame_time(&self) -> f64 {
        self.system.frame_time
    }

    /// Length of the coordinates q. A free root comes first: position (m) and quaternion x y z w; then joints (rad or
    /// m).
    #[getter]
    fn nq(&self) -> usize {
        self.system.robot.nq()
    }

    /// Degrees of freedom, the length of the velocities qd. A free root comes first: twist about the world's origin
    /// (rad/s, m/s); then joints (rad/s or m/s).
    #[getter]
    fn nv(&self) -> usize {
        self.system.robot.nv()
    }

    /// Names of all joints, driven or not, in the order of a row of torques.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.system.robot.joints().map(|joint| joint.name.as_str()).collect()
    }

    /// Torque limit of each joint (N m or N), float64 [joints]; infinite if the robot's file gives none. The limits
    /// hold for drives, but not for torques given to step().
    #[getter]
    fn efforts<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        let efforts: Vec<f64> = self.system.robot.joints().map(|joint| joint.effort).collect();
        let joints = efforts.len();
        made(py, efforts, &[joints])
    }

    /// Lower and upper position limit of each joint (rad or m), float64 [joints, 2]; infinite for a joint without
    /// limits.
    #[getter]
    fn limits<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        let free = [-f64::INFINITY, f64::INFINITY];
        let limits: Vec<_> =
            self.system.robot.joints().map(|joint| joint.limit.map_or(free, |l| [l.lower, l.upper])).collect();
        made(py, limits.concat(), &[limits.len(), 2])
    }

    /// Mass of all moving links (kg).
    #[getter]
    fn mass(&self) -> f64 {
        self.system.robot.mass()
    }

    /// Gravity (m/s^2) in world axes; up is the opposite direction.
    #[getter]
    fn gravity(&self) -> [f64; 3] {
        self.system.spec.gravity
    }

    /// The default state [q, qd], with zero velocities, float64 [nq + nv].
    #[getter]
    fn default_state<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        let state = self.system.default_state();
        let width = state.len();
        made(py, state, &[width])
    }

    /// Names of the moving links.
    #[getter]
    fn links(&self) -> Vec<&str> {
        self.system.robot.links.iter().map(|link| link.name.as_str()).collect()
    }

    /// Names of frames fixed on a link or on the base (soles, tools); Simulation.poses and velocities accept them, too.
    #[getter]
    fn frames(&self) -> Vec<&str> {
        self.system.robot.frames.iter().map(|frame| frame.name.as_str()).collect()
    }

    /// Names of the components of a state [q, qd].
    #[getter]
    fn columns(&self) -> Vec<&str> {
        self.system.spec.state_columns.iter().map(String::as_str).collect()
    }

    /// Names of the scenes.
    #[getter]
    fn scenes(&self) -> Vec<&str> {
        self.system.all_scenes()
    }

    /// Name of a simulation's default scene: the scene of the robot's data, or free space.
    #[getter]
    pub fn data_scene(&self) -> &str {
        self.system.spec.data_scene.as_deref().unwrap_or("free")
    }

    /// Assumptions made about the robot's file, a line each.
    #[getter]
    fn notes(&self) -> Vec<&str> {
        self.system.notes.iter().map(String::as_str).collect()
    }

    /// mass_matrix(states): mass matrix M, float64 [n, nv, nv] (kg, kg m, kg m^2, with armatures), for states [n, nq +
    /// nv]. One state [nq + nv] gives one matrix. The kinetic energy (J) is `qd M qd / 2`. Rows and columns, here and
    /// below, follow qd in `columns`: for a free root the twist about the world's origin.
    fn mass_matrix<'py>(&self, py: Python<'py>, states: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
        let nv = self.nv();
        dynamics::each(py, &self.system, states, None, &[nv, nv], |data, state, _| {
            dynamics::mass_matrix(&self.system, data, state)
        })
    }

    /// jacobian(name, states): Jacobian J of a link or a frame, float64 [n, 6, nv], for states as in mass_matrix. `J
    /// qd` is the angular velocity (rad/s), then the velocity of the origin (m/s), of the link or frame in world axes.
    /// `J^T` maps a moment (N m) and a force (N) at this origin to generalised forces.
    fn jacobian<'py>(&self, py: Python<'py>, name: &str, states: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
        let frame = self.system.robot.frame(name).map_err(value)?;
        let of = |data: &mut Data, state: &[f64], _: &[f64]| dynamics::jacobian(&self.system, &frame, data, state);
        dynamics::each(py, &self.system, states, None, &[6, self.nv()], of)
    }

    /// inverse_dynamics(states, accelerations=None): generalised forces `M qdd + h`, float64 [n, nv], for accelerations
    /// qdd [n, nv], the time derivative of qd. Joint forces are in N m or N; for a free root they are the moment about
    /// the world's origin (N m) and the force (N). Without accelerations the result is the bias forces h: gravity,
    /// Coriolis and centrifugal terms. Damping, limits and contact are excluded.
    #[pyo3(signature = (states, accelerations=None))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        states: &Bound<'py, PyAny>,
        accelerations: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Floats<'py>> {
        let of = |data: &mut Data, state: &[f64], rates: &[f64]| {
            dynamics::inverse_dynamics(&self.system, data, state, rates)
        };
        dynamics::each(py, &self.system, states, accelerations, &[self.nv()], of)
    }

    fn __repr__(&self) -> String {
        let robot = &self.system.robot;
        format!("System({:?}, nq={}, nv={}, joints={})", self.system.name, robot.nq(), robot.nv(), robot.joint_count())
    }
}

/// A system that was given as an object, by name or by path.
#[derive(FromPyObject)]
pub enum Named {
    /// A loaded system.
    System(System),
    /// A name or path to load.
    Name(PathBuf),
}

impl Named {
    /// Name or path of the system.
    pub fn source(&self) -> String {
        match self {
            Self::System(system) => system.source.clone(),
            Self::Name(name) => name.display().to_string(),
        }
    }

    /// Loads the system if necessary.
    pub fn read(self) -> PyResult<System> {
        match self {
            Self::System(system) => Ok(system),
            Self::Name(name) => System::new(name),
        }
    }
}
