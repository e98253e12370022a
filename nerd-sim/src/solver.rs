//! What advances a batch by one control frame, and the simulation that holds it.

use crate::batch::Batch;
use nerd_core::state::wrap_state;

/// Why a frame could not be stepped.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// A coordinate is not finite after the step.
    #[error("environment {env}, frame {frame}: `{coordinate}` is {value}; the state before it is the last good one")]
    NotFinite {
        /// Environment.
        env: usize,
        /// Frame counted from the environment's reset.
        frame: u64,
        /// Name of the first bad coordinate.
        coordinate: String,
        /// What it is.
        value: f64,
    },
    /// The torques are not `environments x joints` numbers.
    #[error("{found} torques for {environments} environments of {joints} joints")]
    Torques {
        /// Numbers given.
        found: usize,
        /// Environments of the batch.
        environments: usize,
        /// Joints of the robot.
        joints: usize,
    },
    /// The solver cannot step this environment.
    #[error("environment {env}, frame {frame}: {reason}")]
    Environment {
        /// Environment.
        env: usize,
        /// Frame counted from the environment's reset.
        frame: u64,
        /// One line.
        reason: String,
    },
    /// The solver as a whole failed.
    #[error("{0}")]
    Solver(String),
}

/// Advances every environment of a batch by one control frame.
pub trait Solver {
    /// One frame. `torques` are `[env][joint]` (N m or N), held over the frame. Angles of endless joints come back
    /// wrapped to [-pi, pi). On an error the states are those before the step.
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError>;

    /// Forgets whatever is remembered of an environment.
    fn reset(&mut self, _env: usize) {}
}

impl Solver for Box<dyn Solver> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        (**self).step(batch, torques)
    }

    fn reset(&mut self, env: usize) {
        (**self).reset(env);
    }
}

/// Refuses torques of another length than the batch needs.
pub fn check_torques(batch: &Batch, torques: &[f64]) -> Result<(), StepError> {
    let joints = batch.system.robot.joint_count();
    if torques.len() == batch.len() * joints {
        return Ok(());
    }
    Err(StepError::Torques { found: torques.len(), environments: batch.len(), joints })
}

/// Ends a frame: wraps angles, counts it, and takes over `next` only if every coordinate is finite.
pub fn commit(batch: &mut Batch, next: &mut Vec<f64>) -> Result<(), StepError> {
    let system = batch.system.clone();
    let d = system.robot.state_dim();
    if let Some(at) = next.iter().position(|x| !x.is_finite()) {
        let (env, column) = (at / d, at % d);
        let coordinate = system.spec.state_columns[column].clone();
        return Err(StepError::NotFinite { env, frame: batch.frames[env], coordinate, value: next[at] });
    }
    for state in next.chunks_exact_mut(d) {
        wrap_state(&system.robot, state);
    }
    std::mem::swap(&mut batch.states, next);
    batch.frames.iter_mut().for_each(|f| *f += 1);
    Ok(())
}

/// A batch with the solver that advances it; assign `solver` to swap it mid-run.
pub struct Simulation {
    /// States and scenes.
    pub batch: Batch,
    /// What advances them.
    pub solver: Box<dyn Solver>,
}

impl Simulation {
    /// From a batch and a solver.
    pub fn new(batch: Batch, solver: impl Solver + 'static) -> Self {
        Self { batch, solver: Box::new(solver) }
    }

    /// One frame; see [`Solver::step`].
    pub fn step(&mut self, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(&mut self.batch, torques)
    }

    /// Puts one environment at `state`; the solver forgets its past.
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        self.batch.reset(env, state);
        self.solver.reset(env);
    }
}
