//! Policies that act in training data: a learned simulator is asked where they go, and random torques seldom go there.

use std::fmt;
use std::sync::Arc;

use nerd_sim::dataset::{Act, Pilot};
use nerd_sim::scene::Scene;
use nerd_sim::system::System;
use nerd_tasks::{Task, TaskError, View, Work, named};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::policy::Policy;
use super::rollout::normal;
use super::stack::Stack;

/// Widest noise on actions, in the policy's own spread: data that its surest actions alone had made says nothing beside them.
const NOISE: f64 = 2.0;

/// Policies, one of which acts in each trajectory.
pub struct Policies {
    of: Vec<(Arc<dyn Task>, Arc<Policy>)>,
}

impl Policies {
    /// Policies with the names of built-in tasks.
    ///
    /// # Errors
    /// If there is no such task.
    pub fn new(of: Vec<(String, Policy)>) -> Result<Self, TaskError> {
        let of = of.into_iter().map(|(task, policy)| Ok((Arc::from(named(&task)?), policy)));
        Ok(Self::of(of.collect::<Result<_, TaskError>>()?))
    }

    /// Policies with their tasks, whoever wrote these.
    pub fn of(of: Vec<(Arc<dyn Task>, Policy)>) -> Self {
        Self { of: of.into_iter().map(|(task, policy)| (task, Arc::new(policy))).collect() }
    }
}

/// Data that policies acted in is known by what these were.
impl fmt::Debug for Policies {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_list().entries(self.of.iter().map(|(task, p)| format!("{} {}", task.name(), p.sha256()))).finish()
    }
}

impl Pilot for Policies {
    fn launch(&self, system: &Arc<System>, rng: &mut ChaCha8Rng) -> (Vec<f64>, Box<dyn Act>) {
        let (task, policy) = self.of[rng.random_range(0..self.of.len())].clone();
        let mut goal = vec![0.0; task.goal_dim()];
        task.draw_goal(rng, &mut goal);
        let (state, noise) = (task.reset(system, rng), NOISE * rng.random::<f64>());
        let (work, observation, action) = (Work::new(system), vec![0.0; task.observation_dim()], Vec::new());
        (state, Box::new(Acting { task, policy, goal, work, noise, observation, action, stack: None, frame: 0 }))
    }
}

/// One policy in one trajectory.
struct Acting {
    task: Arc<dyn Task>,
    policy: Arc<Policy>,
    goal: Vec<f64>,
    work: Work,
    noise: f64,
    observation: Vec<f64>,
    action: Vec<f64>,
    stack: Option<Stack>,
    frame: u64,
}

impl Act for Acting {
    fn torques(&mut self, state: &[f64], scene: &Scene, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        let Self { task, policy, goal, work, observation, .. } = self;
        let view = View { state, goal, scene };
        if self.frame.is_multiple_of(task.frames()) {
            task.observe(view, work, observation);
            match &mut self.stack {
                Some(stack) => stack.push(observation, |_| false, observation, &mut Vec::new()),
                None => self.stack = Some(Stack::new(policy.shape.stack, observation.len(), observation)),
            }
            let answer = policy.answer(self.stack.as_ref().map_or(&[], |s| &s.rows));
            let (noise, mut spare) = (self.noise as f32, None);
            let drawn = answer.mean.iter().zip(&answer.spread).map(|(mu, s)| mu + noise * s.exp() * normal(rng, &mut spare));
            self.action = drawn.map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
        }
        task.act(view, &self.action, work, out);
        self.frame += 1;
    }
}
