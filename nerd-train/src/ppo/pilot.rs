//! Policies that act in training data, because a learned simulator is used where they go and random torques rarely go there.
//!
//! Future policies go elsewhere still. So all are noisy, some trajectories begin fast, and in some the policies take turns.

use std::fmt;

use nerd_sim::dataset::{Act, Pilot};
use nerd_sim::sampling::FASTEST;
use nerd_tasks::{View, Work, fast_start};

use super::noise::normal;
use super::*;

/// Widest noise on actions, in the policy's own spread: data that its surest actions alone had made says nothing beside them.
const NOISE: f64 = 2.0;
/// Share of the trajectories in which policies take turns, and frames that one acts for, in the mean.
const MIXED: f64 = 0.25;
const TURN: f64 = 30.0;
/// Share of the trajectories that begin with [`fast_start`].
const FAST: f64 = 0.25;

type All = Arc<[(Arc<dyn Task>, Arc<Actor>)]>;

/// Policies, of which one acts in each trajectory, or several in turn.
pub struct Policies {
    of: All,
}

impl Policies {
    /// Policies with their tasks, built-in or not.
    pub fn new(of: Vec<(Arc<dyn Task>, Policy)>) -> Self {
        Self { of: of.into_iter().map(|(task, policy)| (task, Arc::new(Actor::new(policy)))).collect() }
    }
}

/// Data that policies acted in is known by what these were, and how they acted.
impl fmt::Debug for Policies {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_list().entries(self.of.iter().map(|(task, actor)| format!("{} {}", task.name(), actor.policy.sha256()))).finish()?;
        write!(f, " noise {NOISE}, mixed {MIXED} by {TURN} frames, fast {FAST} x {FASTEST}")
    }
}

impl Pilot for Policies {
    fn launch(&self, system: &Arc<System>, rng: &mut ChaCha8Rng) -> (Vec<f64>, Box<dyn Act>) {
        let which = rng.random_range(0..self.of.len());
        let now = Turn::new(&self.of, which, rng);
        let [mixed, fast] = [MIXED, FAST].map(|share| rng.random::<f64>() < share);
        let state = if fast { fast_start(&*now.task, system, rng) } else { now.task.reset(system, rng) };
        (state, Box::new(Acting { all: self.of.clone(), mixed: mixed && self.of.len() > 1, work: Work::new(system), now }))
    }
}

struct Acting {
    all: All,
    mixed: bool,
    work: Work,
    now: Turn,
}

/// One policy, as long as it acts.
struct Turn {
    which: usize,
    task: Arc<dyn Task>,
    actor: Arc<Actor>,
    goal: Vec<f64>,
    noise: f64,
    observation: Vec<f64>,
    action: Vec<f64>,
    stack: Option<Stack>,
    frame: u64,
}

impl Turn {
    /// One of them, with a goal and a noise of its own.
    fn new(all: &All, which: usize, rng: &mut ChaCha8Rng) -> Self {
        let (task, actor) = all[which].clone();
        let mut goal = vec![0.0; task.goal_dim()];
        task.draw_goal(rng, &mut goal);
        let (noise, observation) = (NOISE * rng.random::<f64>(), vec![0.0; task.observation_dim()]);
        Self { which, task, actor, goal, noise, observation, action: Vec::new(), stack: None, frame: 0 }
    }

    fn other(&self, all: &All, rng: &mut ChaCha8Rng) -> Self {
        let which = rng.random_range(0..all.len() - 1);
        Self::new(all, which + usize::from(which >= self.which), rng)
    }

    /// Whether a step of its task begins.
    fn asked(&self) -> bool {
        self.frame.is_multiple_of(self.task.frames())
    }
}

impl Act for Acting {
    fn torques(&mut self, state: &[f64], scene: &Scene, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        if self.mixed && self.now.frame > 0 && self.now.asked() && rng.random::<f64>() * TURN < self.now.task.frames() as f64 {
            self.now = self.now.other(&self.all, rng);
        }
        let (asked, Turn { task, actor, goal, observation, stack, action, noise, .. }) = (self.now.asked(), &mut self.now);
        let view = View { state, goal, scene };
        if asked {
            task.observe(view, &mut self.work, observation);
            match stack {
                Some(stack) => stack.push(observation, &[], |_| false, observation, &mut Vec::new()),
                None => *stack = Some(Stack::new(actor.policy.shape.stack, observation.len(), observation)),
            }
            let answer = actor.answer(stack.as_ref().map_or(&[], |s| &s.rows));
            let (noise, mut spare) = (*noise as f32, None);
            let drawn = answer.mean.iter().zip(&answer.spread).map(|(mu, s)| mu + noise * s.exp() * normal(rng, &mut spare));
            *action = drawn.map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
        }
        task.act(view, action, &mut self.work, out);
        task.advance(goal);
        self.now.frame += 1;
        if self.now.asked() {
            self.now.task.remember(&mut self.now.goal, &self.now.action);
        }
    }
}
