//! A batch: n environments of one system, each with its own scene.

use crate::internal::*;

/// Why a batch cannot say or do what it is asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// The robot has no such part.
    #[error(transparent)]
    Name(#[from] UnknownName),
    /// The last frame left no forces.
    #[error(
        "no contact forces are known: step a frame with a solver whose capabilities include them (articulated; on a card after `watch`)"
    )]
    NoForces,
    /// A fixed base does not move.
    #[error("the base of robot `{0}` is fixed: it has no pose to set")]
    Fixed(String),
}

/// States and scenes of n environments; row-major f64.
#[derive(Clone)]
pub struct Batch {
    /// The robot of every environment, unless `systems` says otherwise.
    pub system: Arc<System>,
    /// The robot of each environment, where they differ in numbers: masses, dampings, a material (see [`crate::vary`]); empty: they
    /// do not. For solvers that can step them ([`crate::solver::Capabilities`]).
    pub systems: Vec<Arc<System>>,
    /// States `[env][q, qd]`.
    pub states: Vec<f64>,
    /// Scene of each environment.
    pub scenes: Vec<Arc<Scene>>,
    /// Frames stepped since each environment's reset; names the place of an error.
    pub frames: Vec<u64>,
    /// Drives `[env][joint]`, whose torques are added to those of a frame; empty: none. For solvers that can hold them
    /// ([`crate::solver::Capabilities`]).
    pub drives: Vec<Drive>,
    /// Whether the torques of a frame are those of the robots' position laws as it begins, which go on acting inside it as drives within the law's
    /// bounds; then `drives` is empty. For solvers that have drives: [`crate::solver::Simulation::serve`].
    pub servo: bool,
    /// Mean force (N) of the scene on each contact point in the last frame, `[env][point]`, world axes; empty where the solver tells
    /// none. By link: [`Batch::contact_force`].
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

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.scenes.is_empty()
    }

    /// The robot of an environment.
    pub fn of(&self, env: usize) -> &Arc<System> {
        self.systems.get(env).unwrap_or(&self.system)
    }

    /// Refuses a batch whose fields are not of one length: they are public.
    pub fn check(&self) -> Result<(), String> {
        let (n, d) = (self.scenes.len(), self.system.robot.state_dim());
        let (joints, points) = (self.system.robot.joint_count(), self.system.robot.contact_points.len());
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
        Err(format!("a batch of {n} scenes needs {} numbers in `states` and {n} in `frames`, it has {states} and {frames}", n * d))
    }

    /// State `[q, qd]` of an environment.
    pub fn state(&self, env: usize) -> &[f64] {
        let d = self.system.robot.state_dim();
        &self.states[env * d..(env + 1) * d]
    }

    /// The same, to be written.
    pub fn state_mut(&mut self, env: usize) -> &mut [f64] {
        let d = self.system.robot.state_dim();
        &mut self.states[env * d..(env + 1) * d]
    }

    /// Asks a graphics card for contact forces, which stay there otherwise. On the CPU a solver that knows them always tells them.
    pub fn watch(&mut self) {
        self.forces = vec![Vector3::zeros(); self.len() * self.system.robot.contact_points.len()];
    }

    /// Mean forces (N) on the contact points of an environment in the last frame, in their order, world axes; empty where the solver
    /// tells none ([`crate::solver::Capabilities`]).
    pub fn forces_on(&self, env: usize) -> &[Vector3<f64>] {
        let points = if self.forces.is_empty() { 0 } else { self.system.robot.contact_points.len() };
        &self.forces[env * points..(env + 1) * points]
    }

    /// Drives of an environment; empty where there are none.
    pub fn driven(&self, env: usize) -> &[Drive] {
        if self.drives.is_empty() {
            return &[];
        }
        let joints = self.system.robot.joint_count();
        &self.drives[env * joints..(env + 1) * joints]
    }

    /// Puts an environment at `state` and restarts its count of frames. Reset the solver, too
    /// ([`crate::solver::Solver::reset`]), or use [`crate::solver::Simulation::reset`].
    ///
    /// # Panics
    /// If there is no such environment, or `state` has not [`nerd_core::robot::Robot::state_dim`] numbers.
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        let (robot, found) = (&self.system.robot, state.len());
        assert!(found == robot.state_dim(), "a state of {found} numbers; [q, qd] has {} and {}", robot.nq(), robot.nv());
        self.state_mut(env).copy_from_slice(state);
        self.frames[env] = 0;
    }

    /// Makes environment `to` a copy of `from`; [`crate::solver::Simulation::fork`] copies what its solver remembers, too.
    pub(crate) fn fork(&mut self, from: usize, to: usize) {
        let places = (self.len(), from, to);
        copy(&mut self.states, places);
        copy(&mut self.scenes, places);
        copy(&mut self.frames, places);
        copy(&mut self.systems, places);
        copy(&mut self.drives, places);
        copy(&mut self.forces, places);
    }

    /// Position (rad or m) and velocity (rad/s or m/s) of a joint.
    pub fn joint(&self, env: usize, name: &str) -> Result<[f64; 2], UnknownName> {
        let (at, nq) = (self.system.robot.joint(name)?, self.system.robot.nq());
        Ok([self.state(env)[at.q], self.state(env)[nq + at.qd]])
    }

    /// Sets them, within the joint's limits or beyond: there its limit pushes back. Of a run that goes on, tell the solver ([`crate::solver::Solver::reset`]).
    pub fn set_joint(&mut self, env: usize, name: &str, [position, velocity]: [f64; 2]) -> Result<(), UnknownName> {
        let (at, nq) = (self.system.robot.joint(name)?, self.system.robot.nq());
        let state = self.state_mut(env);
        (state[at.q], state[nq + at.qd]) = (position, velocity);
        Ok(())
    }

    /// Where a link or a frame (sole, tool) is in the world.
    pub fn pose(&self, env: usize, name: &str) -> Result<Isometry3<f64>, UnknownName> {
        let robot = &self.of(env).robot;
        Ok(robot.pose(self.state(env), &robot.frame(name)?))
    }

    /// Angular velocity (rad/s) of a link or a frame, and velocity (m/s) of its origin, world axes.
    pub fn velocity(&self, env: usize, name: &str) -> Result<Motion, UnknownName> {
        let robot = &self.of(env).robot;
        let (q, qd) = robot.split(self.state(env));
        Ok(robot.velocity(q, &qd.to_local(robot, q), &robot.frame(name)?))
    }

    /// Puts a free root at a pose, with an angular velocity and a velocity of its origin, world axes. Of a run that goes on, tell the
    /// solver ([`crate::solver::Solver::reset`]).
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

    /// Mean force (N) of the scene on a moving link in the last frame, world axes.
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

/// Of `n` equal rows copies one to another.
fn copy<T: Clone>(rows: &mut [T], (n, from, to): (usize, usize, usize)) {
    let width = rows.len() / n;
    (0..width).for_each(|k| rows[to * width + k] = rows[from * width + k].clone());
}
