//! The trait of tasks: observation, action, reward and end of an episode, in Gymnasium's terms.

use nerd_sim::{articulated::device::Reach, prelude::*, sampling::hurry};
use rand_chacha::ChaCha8Rng;

/// Times that a fast start is slowed down by half, at most.
const HALVINGS: usize = 12;

/// One environment as a task sees it.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// State `[q, qd]`.
    pub state: &'a [f64],
    /// What this episode asks for, [`Task::goal_dim`] numbers; empty for most tasks.
    pub goal: &'a [f64],
    /// The scene.
    pub scene: &'a Scene,
}

/// Working memory of one thread. Nothing in it outlives a call.
pub struct Work {
    /// The robot.
    pub system: Arc<System>,
    /// Its kinematics.
    pub data: Data,
    /// Its own controller, for tasks that command positions.
    pub controller: Controller,
    /// Contact events.
    pub events: Vec<ContactEvent>,
    /// Numbers.
    pub numbers: Vec<f64>,
}

impl Work {
    /// For a system.
    pub fn new(system: &Arc<System>) -> Self {
        let (data, controller) = (Data::new(&system.robot), Controller::new(system));
        Self { system: system.clone(), data, controller, events: Vec::new(), numbers: Vec::new() }
    }
}

/// Names and sizes of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct About {
    /// Name, as on the command line.
    pub name: &'static str,
    /// Robot, as [`System::named`] knows it; a relative path is from the working directory.
    pub robot: &'static str,
    /// Scene, as [`System::scene`] knows it.
    pub scene: &'static str,
    /// Numbers in an observation.
    pub observation: usize,
    /// Numbers in an action, each in [-1, 1].
    pub action: usize,
    /// Steps after which an episode is truncated.
    pub steps: u64,
    /// Control frames of one step.
    pub frames: u64,
}

impl About {
    /// Refuses a task that does not see, act or last.
    pub fn check(&self) -> Result<(), String> {
        let sizes =
            [("observation", self.observation as u64), ("action", self.action as u64), ("steps", self.steps), ("frames", self.frames)];
        let none = sizes.into_iter().find(|(_, size)| *size == 0);
        none.map_or(Ok(()), |(field, _)| Err(format!("{field} is 0; at least 1 is needed")))
    }
}

/// One task, of one environment at a time: [`crate::Episodes`] makes batches of it. All methods are pure, so an episode's
/// past is its state, its goal and its number of steps.
pub trait Task: Send + Sync {
    /// Its names and sizes.
    fn about(&self) -> About;

    /// Its robot.
    fn system(&self) -> Result<Arc<System>, SystemError> {
        System::named(self.robot())
    }

    /// A robot like its own, with what the task says of robots: frames, substeps, rotors, terrain.
    ///
    /// # Errors
    /// If that is out of its range for this one.
    fn fit(&self, robot: Arc<System>) -> Result<Arc<System>, SystemError> {
        Ok(robot)
    }

    /// The text that it was read from, if it was ([`crate::FileTask`]).
    fn text(&self) -> Option<&str> {
        None
    }

    /// Whether a goal's first three numbers are a place in the world (m), and shown.
    fn place(&self) -> bool {
        self.goal_dim() >= 3
    }

    /// Numbers in an episode's goal.
    fn goal_dim(&self) -> usize {
        0
    }

    /// Names and ranges of a goal's numbers, of a task that names them.
    fn commands(&self) -> Vec<(String, [f64; 2])> {
        Vec::new()
    }

    /// Numbers at a goal's end that are the last action and the one before it, and maybe the steps of the episode so far; zeros at first.
    /// Whoever steps a task writes them by [`Task::remember`].
    fn memory(&self) -> usize {
        0
    }

    /// After a step: its action, clamped, becomes the last one.
    fn remember(&self, goal: &mut [f64], action: &[f64]) {
        if self.memory() > 0 {
            let first = goal.len() - self.memory();
            let kept = &mut goal[first..];
            kept.copy_within(..action.len(), action.len());
            if let Some(steps) = kept.get_mut(2 * action.len()) {
                *steps += 1.0;
            }
            kept.iter_mut().zip(action).for_each(|(kept, a)| *kept = a.clamp(-1.0, 1.0));
        }
    }

    /// Where the level of an episode is among its goal's numbers, and how many levels there are: the level is a share of the heights of the
    /// terrain, 1 unless [`crate::Episodes::climb`] moves it. Behind it is the sum of misses over the last half of the episode.
    fn levels(&self) -> Option<(usize, usize)> {
        None
    }

    /// Draws an episode's goal.
    fn draw_goal(&self, _rng: &mut ChaCha8Rng, _out: &mut [f64]) {}

    /// Moves a goal on by a frame, where it moves.
    fn advance(&self, _goal: &mut [f64]) {}

    /// A start `[q, qd]`; drawn from the robot's own `reset` ranges unless a task has another.
    fn reset(&self, system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        start(system, Start::Reset, rng)
    }

    /// Writes the observation: every one of [`About::observation`] numbers.
    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]);

    /// Writes the joint torques (N m or N) of an action, which is clamped to [-1, 1]. Nothing limits them afterwards.
    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]);

    /// Reward for arriving here; `torques` acted in the last frame.
    fn reward(&self, view: View, torques: &[f64], work: &mut Work) -> f64;

    /// Names of what its reward is made of, of a task that names it.
    fn terms(&self) -> &[String] {
        &[]
    }

    /// The reward, and behind it the terms.
    fn rewards(&self, view: View, torques: &[f64], work: &mut Work) -> Vec<f64> {
        vec![self.reward(view, torques, work)]
    }

    /// How far this is from what is asked for, in units of what may be missed; none of a task that does not speak of success. An episode
    /// has succeeded in which the mean over the last half of its steps is 1 at most.
    fn miss(&self, _view: View, _work: &mut Work) -> Option<f64> {
        None
    }

    /// What a miss of 1 is, and its unit.
    fn allowed(&self) -> (f64, &str) {
        (1.0, "")
    }

    /// Whether being here ends the episode.
    fn terminated(&self, _view: View, _work: &mut Work) -> bool {
        false
    }

    /// Its slopes, if it is written in formulas ([`crate::formula`]).
    fn slopes(&self) -> Option<&dyn Slopes> {
        None
    }

    /// The task as kernels for a graphics card ([`crate::formula`]), for a batch of this reach, with functions for its slopes or without.
    ///
    /// # Errors
    /// If there are none, as for a task without [`crate::formula::Formulas`].
    fn kernels(&self, _system: &System, _reach: Reach, _slopes: bool) -> Result<String, String> {
        Err(format!("task `{}` is not written in formulas (nerd_tasks::formula), so it stays on the CPU", self.name()))
    }

    /// [`About::name`].
    fn name(&self) -> &'static str {
        self.about().name
    }

    /// [`About::robot`].
    fn robot(&self) -> &'static str {
        self.about().robot
    }

    /// [`About::scene`].
    fn scene(&self) -> &'static str {
        self.about().scene
    }

    /// [`About::observation`].
    fn observation_dim(&self) -> usize {
        self.about().observation
    }

    /// [`About::action`].
    fn action_dim(&self) -> usize {
        self.about().action
    }

    /// [`About::steps`].
    fn episode_length(&self) -> u64 {
        self.about().steps
    }

    /// [`About::frames`].
    fn frames(&self) -> u64 {
        self.about().frames
    }
}

/// Vector-Jacobian products of a task: gradients by what it says become gradients by the state, in its tangent space
/// ([`nerd_core::tangent`]), by action and by torques, and are added up. Goals, which contact points are nearest to what, and under a
/// position law that looks ahead the robot's mass matrix and bias count as constant.
pub trait Slopes: Send + Sync {
    /// Of [`Task::observe`].
    fn observe_back(&self, view: View, work: &mut Work, by: &[f64], slope: &mut [f64]);

    /// Of [`Task::act`], by the action as it is clamped.
    fn act_back(&self, view: View, action: &[f64], work: &mut Work, by: &[f64], slope: &mut [f64], by_action: &mut [f64]);

    /// Of [`Task::reward`].
    fn reward_back(&self, view: View, torques: &[f64], work: &mut Work, by: f64, slope: &mut [f64], by_torques: &mut [f64]);
}

/// A start of a task with velocities that a policy comes to only once it is good ([`hurry`]), and that a model should know before. Where
/// the task would be over at once it is slowed down by halves until it is not. What ends a task must not depend on its goal: none of an
/// episode is known here.
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
