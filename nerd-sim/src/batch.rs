//! A batch: n environments of one system, each with its own scene.

use crate::internal::*;

/// Errors of queries and changes of a [`Batch`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// The robot has no link, joint or frame of this name.
    #[error(transparent)]
    Name(#[from] UnknownName),
    /// The last frame left no contact forces.
    #[error(
        "no contact forces are known: step a frame with a solver whose capabilities include them (articulated; on a card after `watch`)"
    )]
    NoForces,
    /// The base is fixed, so its pose cannot be set.
    #[error("the base of robot `{0}` is fixed: it has no pose to set")]
    Fixed(String),
}

/// States and scenes of n environments; row-major f64.
#[derive(Clone)]
pub struct Batch {
    /// Robot of every environment, unless `systems` is set.
    pub system: Arc<System>,
    /// Robot of each environment, where parameters such as masses, dampings or a material differ ([`crate::vary`]);
    /// empty where all are equal. Only for solvers with this capability ([`crate::solver::Capabilities`]).
    pub systems: Vec<Arc<System>>,
    /// States `[env][q, qd]`.
    pub states: Vec<f64>,
    /// Scene of each environment.
    pub scenes: Vec<Arc<Scene>>,
    /// Number of frames stepped since each environment's reset; errors name this number.
    pub frames: Vec<u64>,
    /// Drives `[env][joint]`; their torques add to the torques of a frame; empty: none. Only for solvers with this
    /// capability ([`crate::solver::Capabilities`]).
    pub drives: Vec<Drive>,
    /// Whether the torques of a frame come from the robots' position laws, evaluated at the frame's start. The laws
    /// then act as drives inside the frame, within their torque limits. `drives` is then empty. Only for solvers with
    /// drives: [`crate::solver::Simulation::serve`].
    pub servo: bool,
    /// Mean force (N) of the scene on each contact point in the last frame, `[env][point]`, world axes; empty where the
    /// solver reports no forces. Per link: [`Batch::contact_force`].
    pub forces: Vec<Vector3<f64>>,
}

impl Batch {
    /// `n` environments at zero coordinates (identity pose for a floating root) in one scene.
    pub fn new(system: &Arc<System>, scene: &Arc<Scene>, n: usize) -> Self {
        Self {
            system: system.clone(),
            systems: Vec::new(),
            states: system.robot.zero_state().repeat(n),
            scenes: vec![scene.clone(); n],
            frames: vec![0; n],
            drives: Vec::new(),
            servo: false,
            forces: Vec::new(),
        }
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.scenes.len()
    }

    /// Whether the batch has no environments.
    pub fn is_empty(&self) -> bool {
        self.scenes.is_empty()
    }

    /// The robot of an environment.
    pub fn of(&self, env: usize) -> &Arc<System> {
        self.systems.get(env).unwrap_or(&self.system)
    }

    /// Refuses a batch whose public fields have inconsistent lengths.
    pub fn check(&self) -> Result<(), String> {
        let n = self.scenes.len();
        let d = self.system.robot.state_dim();
        let joints = self.system.robot.joint_count();
        let points = self.system.robot.contact_points.len();
        for (field, found, needed, each) in [
            ("drives", self.drives.len(), n * joints, "one a joint of each"),
            ("forces", self.forces.len(), n * points, "one a contact point of each"),
            ("systems", self.systems.len(), n, "one for each"),
        ] {
            if found != 0 && found != needed {
                return Err(format!("a batch of {n} scenes needs {needed} `{field}`, {each}, or none; it has {found}"));
            }
        }
        if self.servo && (!self.drives.is_empty() || self.system.spec.control.is_none()) {
            return Err("a batch whose torques are those of servos has no `drives` beside them, and a robot with a position law".into());
        }
        if self.states.len() == n * d && self.frames.len() == n {
            return Ok(());
        }
        let (states, frames) = (self.states.len(), self.frames.len());
        Err(format!(
            "a batch of {n} scenes needs {} numbers in `states` and {n} in `frames`, it has {states} and {frames}",
            n * d
        ))
    }

    /// State `[q, qd]` of an environment.
    pub fn state(&self, env: usize) -> &[f64] {
        let d = self.system.robot.state_dim();
        &self.states[env * d..(env + 1) * d]
    }

    /// Mutable state `[q, qd]` of an environment.
    pub fn state_mut(&mut self, env: usize) -> &mut [f64] {
        let d = self.system.robot.state_dim();
        &mut self.states[env * d..(env + 1) * d]
    }

    /// Requests contact forces from a GPU solver, which otherwise leaves them on the device. On the CPU a solver that
    /// computes contact forces always reports them.
    pub fn watch(&mut self) {
        self.forces = vec![Vector3::zeros(); self.len() * self.system.robot.contact_points.len()];
    }

    /// Mean forces (N, world axes) on the contact points of an environment in the last frame, in order of the points.
    /// Empty where the solver reports no forces ([`crate::solver::Capabilities`]).
    pub fn forces_on(&self, env: usize) -> &[Vector3<f64>] {
        let points = if self.forces.is_empty() { 0 } else { self.system.robot.contact_points.len() };
        &self.forces[env * points..(env + 1) * points]
    }

    /// Drives of an environment, one per joint; empty where there are no drives.
    pub fn driven(&self, env: usize) -> &[Drive] {
        if self.drives.is_empty() {
            return &[];
        }
        let joints = self.system.robot.joint_count();
        &self.drives[env * joints..(env + 1) * joints]
    }

    /// Sets the state of an environment and restarts its frame count. Also reset the solver
    /// ([`crate::solver::Solver::reset`]), or call [`crate::solver::Simulation::reset`] in place of both.
    ///
    /// # Panics
    /// If there is no such environment, or the length of `state` is not [`nerd_core::robot::Robot::state_dim`].
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        let robot = &self.system.robot;
        let found = state.len();
        assert!(
            found == robot.state_dim(),
            "a state of {found} numbers; [q, qd] has {} and {}",
            robot.nq(),
            robot.nv()
        );
        self.state_mut(env).copy_from_slice(state);
        self.frames[env] = 0;
    }

    /// Position (rad or m) and velocity (rad/s or m/s) of a joint.
    pub fn joint(&self, env: usize, name: &str) -> Result<[f64; 2], UnknownName> {
        let at = self.system.robot.joint(name)?;
        let nq = self.system.robot.nq();
        Ok([self.state(env)[at.q], self.state(env)[nq + at.qd]])
    }

    /// Sets position and velocity of a joint. From a position beyond a joint limit, the limit's spring pushes back. In
    /// a running simulation, also call [`crate::solver::Solver::reset`].
    pub fn set_joint(&mut self, env: usize, name: &str, [position, velocity]: [f64; 2]) -> Result<(), UnknownName> {
        let at = self.system.robot.joint(name)?;
        let nq = self.system.robot.nq();
        let state = self.state_mut(env);
        (state[at.q], state[nq + at.qd]) = (position, velocity);
        Ok(())
    }

    /// World pose of a link or of a frame (sole, tool).
    pub fn pose(&self, env: usize, name: &str) -> Result<Isometry3<f64>, UnknownName> {
        let robot = &self.of(env).robot;
        Ok(robot.pose(self.state(env), &robot.frame(name)?))
    }

    /// Angular velocity (rad/s) of a link or frame, and velocity (m/s) of its origin, world axes.
    pub fn velocity(&self, env: usize, name: &str) -> Result<Motion, UnknownName> {
        let robot = &self.of(env).robot;
        let (q, qd) = robot.split(self.state(env));
        Ok(robot.velocity(q, &qd.to_local(robot, q), &robot.frame(name)?))
    }

    /// Sets pose, angular velocity (rad/s) and velocity of the origin (m/s) of a free root, world axes. In a running
    /// simulation, also call [`crate::solver::Solver::reset`].
    pub fn set_root(&mut self, env: usize, pose: &Isometry3<f64>, velocity: Motion) -> Result<(), BatchError> {
        let system = self.system.clone();
        let robot = &system.robot;
        if !robot.floating() {
            return Err(BatchError::Fixed(robot.name.clone()));
        }
        let (q, qd) = robot.split_mut(self.state_mut(env));
        q[..3].copy_from_slice(pose.translation.vector.as_slice());
        write_quaternion(&mut q[3..7], &pose.rotation);
        qd.0[..6].copy_from_slice(velocity.vector().as_slice());
        LocalVelocity(qd.0).into_twist(robot, q);
        Ok(())
    }

    /// Mean force (N) of the scene on a moving link in the last frame, world axes: the sum over its contact points.
    pub fn contact_force(&self, env: usize, link: &str) -> Result<Vector3<f64>, BatchError> {
        let robot = &self.system.robot;
        let link = robot.link(link)?;
        if self.forces.is_empty() && !robot.contact_points.is_empty() {
            return Err(BatchError::NoForces);
        }
        let points = robot.contact_points.iter().zip(self.forces_on(env));
        Ok(points.filter(|(point, _)| point.link == link).map(|(_, force)| force).sum())
    }
}
