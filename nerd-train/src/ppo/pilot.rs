//! Policies that act while training data is recorded. They visit the states in which a learned simulator is used;
//! random torques rarely reach these states.
//!
//! Future policies visit yet other states. Therefore all policies act with noise. Some trajectories begin at high
//! velocities, and in some several policies alternate.

use std::fmt;
use std::sync::OnceLock;

use nerd_sim::dataset::{Act, Pilot};
use nerd_sim::sampling::FASTEST;
use nerd_tasks::{Compiled, View, Work, fast_start};

use super::noise::normal;
use super::*;

/// Largest standard deviation of action noise, as a multiple of the policy's own. With little noise, data would not
/// cover states near the policy's path.
const NOISE: f64 = 2.0;
/// Share of trajectories with alternating policies, and the mean number of frames between switches.
const MIXED: f64 = 0.25;
const TURN: f64 = 30.0;
/// Share of trajectories that begin with [`fast_start`].
const FAST: f64 = 0.25;

type All = Arc<[One]>;

/// A policy with its task.
struct One {
    task: Arc<dyn Task>,
    actor: Arc<Actor>,
    /// The task compiled for the first robot; it is compiled anew for any other robot.
    first: OnceLock<Arc<Compiled>>,
}

impl One {
    fn compiled(&self, system: &Arc<System>) -> Arc<Compiled> {
        let compile = || Arc::new(Compiled::new(self.task.clone(), system));
        let first = self.first.get_or_init(compile);
        if Arc::ptr_eq(first.recorded_for(), system) { first.clone() } else { compile() }
    }
}

/// Policies for recording: one acts in each trajectory, or several in turn.
pub struct Policies {
    of: All,
}

impl Policies {
    /// Policies with their tasks, built-in or not.
    pub fn new(of: Vec<(Arc<dyn Task>, Policy)>) -> Self {
        let one = |(task, policy)| One { task, actor: Arc::new(Actor::new(policy)), first: OnceLock::new() };
        Self { of: of.into_iter().map(one).collect() }
    }
}

/// Identity of the policies and of their settings; provenance of recorded data contains it.
impl fmt::Debug for Policies {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_list()
            .entries(self.of.iter().map(|one| format!("{} {}", one.task.name(), one.actor.policy.sha256())))
            .finish()?;
        write!(f, " noise {NOISE}, mixed {MIXED} by {TURN} frames, fast {FAST} x {FASTEST}")
    }
}

impl Pilot for Policies {
    fn launch(&self, system: &Arc<System>, rng: &mut ChaCha8Rng) -> (Vec<f64>, Box<dyn Act>) {
        let which = rng.random_range(0..self.of.len());
        let now = Turn::new(&self.of, which, system, rng);
        let [mixed, fast] = [MIXED, FAST].map(|share| rng.random::<f64>() < share);
        let state = if fast { fast_start(&now.task, rng) } else { now.task.reset(system, rng) };
        (
            state,
            Box::new(Acting { all: self.of.clone(), mixed: mixed && self.of.len() > 1, work: Work::new(system), now }),
        )
    }
}

struct Acting {
    all: All,
    mixed: bool,
    work: Work,
    now: Turn,
}

/// The turn of a policy: the frames in which it acts, for one goal.
struct Turn {
    which: usize,
    task: Arc<Compiled>,
    actor: Arc<Actor>,
    goal: Vec<f64>,
    noise: f64,
    observation: Vec<f64>,
    action: Vec<f64>,
    stack: Option<Stack>,
    frame: u64,
}

impl Turn {
    /// Begins a turn of policy `which`, with a drawn goal and noise level.
    fn new(all: &All, which: usize, system: &Arc<System>, rng: &mut ChaCha8Rng) -> Self {
        let task = all[which].compiled(system);
        let actor = all[which].actor.clone();
        let mut goal = vec![0.0; task.goal_dim()];
        task.draw_goal(rng, &mut goal);
        let noise = NOISE * rng.random::<f64>();
        let observation = vec![0.0; task.observation_dim()];
        Self { which, task, actor, goal, noise, observation, action: Vec::new(), stack: None, frame: 0 }
    }

    fn other(&self, all: &All, rng: &mut ChaCha8Rng) -> Self {
        let which = rng.random_range(0..all.len() - 1);
        Self::new(all, which + usize::from(which >= self.which), self.task.recorded_for(), rng)
    }

    /// Whether this frame begins a step of the task, which needs a new action.
    fn asked(&self) -> bool {
        self.frame.is_multiple_of(self.task.frames())
    }
}

impl Act for Acting {
    fn torques(&mut self, state: &[f64], scene: &Scene, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        if self.mixed
            && self.now.frame > 0
            && self.now.asked()
            && rng.random::<f64>() * TURN < self.now.task.frames() as f64
        {
            self.now = self.now.other(&self.all, rng);
        }
        let asked = self.now.asked();
        let Turn { task, actor, goal, observation, stack, action, noise, .. } = &mut self.now;
        let view = View { state, goal, scene };
        if asked {
            task.observe(view, &mut self.work, observation);
            match stack {
                Some(stack) => stack.push(observation, &[], |_| false, observation, &mut Vec::new()),
                None => *stack = Some(Stack::new(actor.policy.shape.stack, observation.len(), observation)),
            }
            let answer = actor.answer(stack.as_ref().map_or(&[], |s| &s.rows));
            let noise = *noise as f32;
            let mut spare = None;
            let drawn =
                answer.mean.iter().zip(&answer.spread).map(|(mu, s)| mu + noise * s.exp() * normal(rng, &mut spare));
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
