//! Episodes that begin fast: in states that a policy comes to only once it is good, and a model should know before.

use std::sync::Arc;

use nerd_sim::sampling::hurry;
use nerd_sim::system::System;
use rand_chacha::ChaCha8Rng;

use crate::{Task, View, Work};

/// Times that a start is slowed down by half, at most.
const HALVINGS: usize = 12;

/// A start of a task with the velocities of [`hurry`]. Where the task would be over at once it is slowed down by halves until it is
/// not. What ends a task must not depend on its goal: none of an episode is known here.
pub fn fast_start(task: &dyn Task, system: &Arc<System>, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut state = task.reset(system, rng);
    hurry(system, &mut state, rng);
    let Ok(scene) = system.scene(task.scene()) else { return state };
    let (goal, mut work) = (vec![0.0; task.goal_dim()], Work::new(system));
    for _ in 0..HALVINGS {
        if !task.terminated(View { state: &state, goal: &goal, scene: &scene }, &mut work) {
            break;
        }
        state[system.robot.nq()..].iter_mut().for_each(|rate| *rate *= 0.5);
    }
    state
}

/// A task whose episodes begin with [`fast_start`]; all else is the task's own, its name too.
pub struct Fast {
    task: Box<dyn Task>,
    system: Arc<System>,
}

impl Fast {
    /// Of a task and its robot.
    pub fn new(task: Box<dyn Task>, system: &Arc<System>) -> Self {
        Self { task, system: system.clone() }
    }
}

impl Task for Fast {
    fn name(&self) -> &'static str {
        self.task.name()
    }

    fn robot(&self) -> &'static str {
        self.task.robot()
    }

    fn scene(&self) -> &'static str {
        self.task.scene()
    }

    fn observation_dim(&self) -> usize {
        self.task.observation_dim()
    }

    fn action_dim(&self) -> usize {
        self.task.action_dim()
    }

    fn episode_length(&self) -> u64 {
        self.task.episode_length()
    }

    fn frames(&self) -> u64 {
        self.task.frames()
    }

    fn goal_dim(&self) -> usize {
        self.task.goal_dim()
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        self.task.draw_goal(rng, out);
    }

    fn advance(&self, goal: &mut [f64]) {
        self.task.advance(goal);
    }

    fn reset(&self, _system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        fast_start(&*self.task, &self.system, rng)
    }

    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        self.task.observe(view, work, out);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        self.task.act(view, action, work, torques);
    }

    fn reward(&self, view: View, torques: &[f64], work: &mut Work) -> f64 {
        self.task.reward(view, torques, work)
    }

    fn miss(&self, view: View, work: &mut Work) -> Option<f64> {
        self.task.miss(view, work)
    }

    fn kernels(&self, _system: &System, _colliders: usize) -> Result<String, String> {
        Err(format!("episodes of `{}` that begin fast have no kernels, so the task stays on the CPU", self.name()))
    }

    fn terminated(&self, view: View, work: &mut Work) -> bool {
        self.task.terminated(view, work)
    }
}
