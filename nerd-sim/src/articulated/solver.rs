//! The solver over a batch: environments are independent, so threads change nothing but the time it takes.

use rayon::prelude::*;

use super::ArticulatedConfig;
use super::frame::Workspace;
use crate::batch::Batch;
use crate::solver::{Solver, StepError, check_torques, commit};

/// Environments that one thread steps in a row.
const CHUNK: usize = 64;

/// Articulated dynamics as a [`Solver`]. Allocates at its first step (or when the batch grows), then no more.
pub struct Articulated {
    config: ArticulatedConfig,
    workspaces: Vec<Workspace>,
    next: Vec<f64>,
}

impl Articulated {
    /// A solver with these settings.
    pub fn new(config: ArticulatedConfig) -> Self {
        Self { config, workspaces: Vec::new(), next: Vec::new() }
    }
}

impl Solver for Articulated {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        check_torques(batch, torques)?;
        let (system, config) = (&*batch.system, &self.config);
        let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
        let chunks = batch.len().div_ceil(CHUNK);
        while self.workspaces.len() < chunks {
            self.workspaces.push(Workspace::new(&system.robot));
        }
        self.next.clone_from(&batch.states);
        let run = |(chunk, (states, workspace)): (usize, (&mut [f64], &mut Workspace))| {
            for (i, state) in states.chunks_exact_mut(d).enumerate() {
                let env = chunk * CHUNK + i;
                let tau = &torques[env * joints..(env + 1) * joints];
                let failed = |reason| StepError::Environment { env, frame: batch.frames[env], reason };
                workspace.step(system, &batch.scenes[env], config, state, tau).map_err(failed)?;
            }
            Ok(())
        };
        if chunks <= 1 {
            self.next.chunks_mut(CHUNK * d).zip(&mut self.workspaces).enumerate().try_for_each(run)?;
        } else {
            self.next.par_chunks_mut(CHUNK * d).zip(self.workspaces.par_iter_mut()).enumerate().try_for_each(run)?;
        }
        commit(batch, &mut self.next)
    }
}
