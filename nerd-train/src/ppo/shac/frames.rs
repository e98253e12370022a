//! Backward pass through a solver's frames.

use super::*;

/// Backward pass through the solver's frames.
pub(super) struct Frames<'a> {
    solver: &'a mut dyn Solver,
    batch: Batch,
    torques: Vec<f64>,
    /// `without`: environments with a frame that has no gradients. `lost`: environments that failed in the present
    /// step, so that it has no gradient.
    pub without: Vec<bool>,
    pub lost: Vec<bool>,
}

impl<'a> Frames<'a> {
    pub fn new(solver: &'a mut dyn Solver, batch: Batch) -> Self {
        let n = batch.len();
        Self { solver, batch, torques: Vec::new(), without: vec![false; n], lost: vec![false; n] }
    }

    /// Replaces `behind`, gradients with respect to the states after a frame, by gradients with respect to the states
    /// before it. Returns gradients with respect to torques. In place of an excluded environment, the solver steps a
    /// copy of another one.
    pub fn step_back(&mut self, states: &[f64], torques: &[f64], behind: &mut Vec<f64>) -> Result<Vec<f64>> {
        let n = self.batch.len();
        let robot = &self.batch.system.robot;
        let d = robot.state_dim();
        let joints = robot.joint_count();
        let wide = 2 * robot.nv();
        loop {
            let gone = |env: usize| self.without[env] || self.lost[env];
            let Some(sound) = (0..n).find(|env| !gone(*env)) else {
                behind.fill(0.0);
                return Ok(vec![0.0; n * joints]);
            };
            self.batch.states.copy_from_slice(states);
            torques.clone_into(&mut self.torques);
            for env in (0..n).filter(|env| gone(*env)) {
                self.batch.states[env * d..][..d].copy_from_slice(&states[sound * d..][..d]);
                self.torques[env * joints..][..joints].copy_from_slice(&torques[sound * joints..][..joints]);
                behind[env * wide..][..wide].fill(0.0);
            }
            match self.solver.vjp(&self.batch, &self.torques, 1, behind) {
                Ok(found) => {
                    *behind = found.states;
                    return Ok(found.torques);
                }
                Err(error) => {
                    let faults = error.faults()?;
                    if faults.iter().all(|fault| gone(fault.env)) {
                        return Err(StepError::Environments(faults).into());
                    }
                    faults.iter().for_each(|fault| self.without[fault.env] = true);
                }
            }
        }
    }
}
