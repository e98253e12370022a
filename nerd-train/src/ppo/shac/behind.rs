//! Gradients of all environments on the backward pass through a rollout.

use nerd_tasks::Work;

use super::*;

/// Environments in one parallel chunk.
const ROWS: usize = 64;

/// Gradients of one environment with respect to its state, torques and action.
pub(super) struct Env<'a> {
    pub gradient: &'a mut [f64],
    pub by_torques: &'a mut [f64],
    pub by_action: &'a mut [f64],
}

/// Gradients with respect to the states, torques and actions of all environments, `[env][..]`.
pub(super) struct Behind {
    pub by_states: Vec<f64>,
    pub by_torques: Vec<f64>,
    pub by_action: Vec<f64>,
    works: Vec<Work>,
    wide: usize,
    joints: usize,
    action: usize,
}

impl Behind {
    pub fn new(system: &Arc<System>, n: usize, action: usize) -> Self {
        let joints = system.robot.joint_count();
        let wide = 2 * system.robot.nv();
        Self {
            by_states: vec![0.0; n * wide],
            by_torques: vec![0.0; n * joints],
            by_action: vec![0.0; n * action],
            works: (0..n.div_ceil(ROWS)).map(|_| Work::new(system)).collect(),
            wide,
            joints,
            action,
        }
    }

    /// Calls `one` for every environment, in parallel.
    pub fn each(&mut self, one: impl Fn(usize, Env, &mut Work) + Sync) {
        let Self { wide, joints, action, .. } = *self;
        let chunks = self
            .by_states
            .par_chunks_mut(ROWS * wide)
            .zip(self.by_torques.par_chunks_mut(ROWS * joints))
            .zip(self.by_action.par_chunks_mut(ROWS * action));
        chunks.zip(&mut self.works).enumerate().for_each(|(chunk, (((gradients, torques), actions), work))| {
            let rows = gradients
                .chunks_exact_mut(wide)
                .zip(torques.chunks_exact_mut(joints))
                .zip(actions.chunks_exact_mut(action));
            for (i, ((gradient, by_torques), by_action)) in rows.enumerate() {
                one(chunk * ROWS + i, Env { gradient, by_torques, by_action }, work);
            }
        });
    }

    /// Sets gradients that are not finite to 0, and marks their environments in `without`.
    pub fn exclude(&mut self, without: &mut [bool]) {
        let Self { wide, action, .. } = *self;
        for (env, without) in without.iter_mut().enumerate() {
            let own = [&mut self.by_states[env * wide..][..wide], &mut self.by_action[env * action..][..action]];
            if !own.iter().all(|numbers| numbers.iter().all(|g| g.is_finite())) {
                *without = true;
                own.into_iter().for_each(|numbers| numbers.fill(0.0));
            }
        }
    }
}
