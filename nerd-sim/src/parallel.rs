//! The batch loop that the analytic solvers share. Environments are independent and each is stepped by one thread, so
//! the number of threads changes nothing but the time it takes.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use crate::batch::Batch;
use crate::drive::Drive;
use crate::scene::Scene;
use crate::solver::{Fault, StepError, check, commit, sound};
use crate::system::System;

/// Working memory that advances one environment at a time by one frame; nothing in it outlives a frame.
pub(crate) trait Frame: Send + Sized {
    /// Settings of the solver.
    type Config: Sync;
    /// Environments that one thread steps in a row.
    const CHUNK: usize;
    /// Whether it has drives inside its frame.
    const DRIVEN: bool = false;

    /// Memory for a system; `Err` says why it cannot be simulated.
    fn new(system: &System) -> Result<Self, String>;

    /// Advances `state` under joint torques `tau`; `Err` says why not.
    fn step(&mut self, system: &System, scene: &Scene, config: &Self::Config, state: &mut [f64], tau: &[f64]) -> Result<(), String>;

    /// Takes over the drives of the environment that is stepped next.
    fn drive(&mut self, _drives: &[Drive]) {}
}

/// Steps the environments of a batch in chunks. Allocates at its first step (or when the batch grows or its robot
/// changes), then no more.
pub(crate) struct Parallel<F> {
    system: Option<Arc<System>>,
    frames: Vec<F>,
    next: Vec<f64>,
    faults: Mutex<Vec<Fault>>,
}

impl<F: Frame> Parallel<F> {
    pub(crate) fn new() -> Self {
        Self { system: None, frames: Vec::new(), next: Vec::new(), faults: Mutex::default() }
    }

    /// One frame of every environment that can be stepped; see [`crate::solver::Solver::step`].
    pub(crate) fn step(&mut self, config: &F::Config, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let faults = self.faults.get_mut().unwrap_or_else(PoisonError::into_inner);
        // Who knows no drives refuses them before anything is stepped.
        if F::DRIVEN { sound(batch, torques, faults) } else { check(batch, torques, faults) }?;
        if !self.system.as_ref().is_some_and(|s| Arc::ptr_eq(s, &batch.system)) {
            self.frames.clear();
            self.system = Some(batch.system.clone());
        }
        let system = &*batch.system;
        let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
        let chunks = batch.len().div_ceil(F::CHUNK);
        while self.frames.len() < chunks {
            self.frames.push(F::new(system).map_err(StepError::Solver)?);
        }
        self.next.clone_from(&batch.states);
        // Who is no number from the start is not stepped at all.
        let bad: Vec<usize> = faults.iter().map(|f| f.env).collect();
        let faults = &self.faults;
        let run = |(chunk, (states, frame)): (usize, (&mut [f64], &mut F))| {
            for (i, state) in states.chunks_exact_mut(d).enumerate() {
                let env = chunk * F::CHUNK + i;
                if bad.contains(&env) {
                    continue;
                }
                let tau = &torques[env * joints..(env + 1) * joints];
                frame.drive(batch.driven(env));
                if let Err(reason) = frame.step(system, &batch.scenes[env], config, state, tau) {
                    let mut faults = faults.lock().unwrap_or_else(PoisonError::into_inner);
                    faults.push(Fault { env, frame: batch.frames[env], reason });
                }
            }
        };
        if chunks <= 1 {
            self.next.chunks_mut(F::CHUNK * d).zip(&mut self.frames).enumerate().for_each(run);
        } else {
            self.next.par_chunks_mut(F::CHUNK * d).zip(self.frames.par_iter_mut()).enumerate().for_each(run);
        }
        commit(batch, &mut self.next, self.faults.get_mut().unwrap_or_else(PoisonError::into_inner))
    }
}
