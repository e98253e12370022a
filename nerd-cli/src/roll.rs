//! Batches from a robot's start distributions, and rollouts without torques.

use crate::prelude::*;

/// Makes a batch of `n` environments. Each starts at a state drawn by `law` from its own random stream of `seed`.
pub fn begun(system: &Arc<System>, scene: &Arc<Scene>, n: usize, law: Start, seed: u64) -> Batch {
    let mut batch = Batch::new(system, scene, n);
    (0..n).for_each(|env| batch.reset(env, &start(system, law, &mut stream(seed, env as u64))));
    batch
}

pub fn idle(batch: &Batch) -> Vec<f64> {
    vec![0.0; batch.len() * batch.system.robot.joint_count()]
}

/// Says why a solver cannot step a robot in a scene at all. `None` if it can, or if it only gives up the tried state.
pub fn refusal(solver: &mut dyn Solver, system: &Arc<System>, scene: &Arc<Scene>) -> Option<String> {
    let mut batch = Batch::new(system, scene, 1);
    let torques = idle(&batch);
    solver.step(&mut batch, &torques).err()?.faults().err().map(|reason| reason.to_string())
}

pub fn rolled(mut batch: Batch, solver: &mut dyn Solver, frames: usize) -> Result<Batch, StepError> {
    let torques = idle(&batch);
    (0..frames).try_for_each(|_| solver.step(&mut batch, &torques)).map(|()| batch)
}
