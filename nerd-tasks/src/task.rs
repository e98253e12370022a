//! The trait, and a batch of episodes of one task on any solver.

use nerd_sim::sampling::stream;
use nerd_sim::solver::{Simulation, StepError};
use rand_chacha::ChaCha8Rng;

/// One task. States are `[q, qd]` of its robot; all methods are pure.
pub trait Task: Send + Sync {
    /// Robot, as [`nerd_sim::system::System::named`] knows it.
    fn robot(&self) -> &'static str;
    /// Numbers in an observation.
    fn observation_dim(&self) -> usize;
    /// Numbers in an action, each in [-1, 1].
    fn action_dim(&self) -> usize;
    /// Frames after which an episode is truncated.
    fn episode_length(&self) -> u64;
    /// Writes the observation of a state.
    fn observe(&self, state: &[f64], out: &mut [f64]);
    /// Writes the joint torques (N m or N) of an action in a state; actions are clamped to [-1, 1].
    fn act(&self, state: &[f64], action: &[f64], torques: &mut [f64]);
    /// Reward for arriving in a state under these torques.
    fn reward(&self, state: &[f64], torques: &[f64]) -> f64;
    /// Whether a state ends the episode.
    fn terminated(&self, state: &[f64]) -> bool;
    /// A start.
    fn reset(&self, rng: &mut ChaCha8Rng) -> Vec<f64>;
}

/// What a frame gave, by environment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepResult {
    /// Rewards.
    pub rewards: Vec<f64>,
    /// Episodes that ended in a terminal state.
    pub terminated: Vec<bool>,
    /// Episodes that ran out of time.
    pub truncated: Vec<bool>,
}

/// Episodes of one task in every environment of a simulation; ended ones start anew at once.
pub struct Episodes {
    /// The task.
    pub task: Box<dyn Task>,
    /// The simulation; its solver may be any.
    pub simulation: Simulation,
    streams: Vec<ChaCha8Rng>,
    torques: Vec<f64>,
}

impl Episodes {
    /// Starts an episode in every environment.
    pub fn new(task: Box<dyn Task>, simulation: Simulation, seed: u64) -> Self {
        let n = simulation.batch.len();
        let torques = vec![0.0; n * simulation.batch.system.robot.joint_count()];
        let streams = (0..n as u64).map(|env| stream(seed, env)).collect();
        let mut episodes = Self { task, simulation, streams, torques };
        (0..n).for_each(|env| episodes.restart(env));
        episodes
    }

    fn restart(&mut self, env: usize) {
        let state = self.task.reset(&mut self.streams[env]);
        self.simulation.reset(env, &state);
    }

    /// Observations `[env][observation_dim]` of the present states, fresh also after a reset.
    pub fn observations(&self) -> Vec<f64> {
        let (n, width) = (self.simulation.batch.len(), self.task.observation_dim());
        let mut out = vec![0.0; n * width];
        out.chunks_exact_mut(width).enumerate().for_each(|(env, row)| self.task.observe(self.simulation.batch.state(env), row));
        out
    }

    /// One frame under `actions` (`[env][action_dim]`).
    pub fn step(&mut self, actions: &[f64]) -> Result<StepResult, StepError> {
        let (n, width) = (self.simulation.batch.len(), self.task.action_dim());
        let joints = self.torques.len() / n.max(1);
        for env in 0..n {
            let tau = &mut self.torques[env * joints..(env + 1) * joints];
            self.task.act(self.simulation.batch.state(env), &actions[env * width..(env + 1) * width], tau);
        }
        self.simulation.step(&self.torques)?;
        let mut result = StepResult::default();
        for env in 0..n {
            let state = self.simulation.batch.state(env);
            let terminated = self.task.terminated(state);
            let truncated = !terminated && self.simulation.batch.frames[env] >= self.task.episode_length();
            result.rewards.push(self.task.reward(state, &self.torques[env * joints..(env + 1) * joints]));
            result.terminated.push(terminated);
            result.truncated.push(truncated);
        }
        for env in 0..n {
            if result.terminated[env] || result.truncated[env] {
                self.restart(env);
            }
        }
        Ok(result)
    }
}
