//! The trait of tasks: observation, action, reward and end of an episode, in Gymnasium's terms.

use nerd_sim::{prelude::*, range::within};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::formula::{Sight, Tape, Traced};

/// Limits: widths of observation and action, steps per episode, and frames per step (1000 frames of 0.1 s last 100 s).
const MOST_SEEN: f64 = 65_536.0;
const MOST_ACTIONS: f64 = 4096.0;
const MOST_STEPS: f64 = 1e6;
const MOST_FRAMES: f64 = 1000.0;

/// A task's view of one environment.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// State `[q, qd]`.
    pub state: &'a [f64],
    /// Goal of the episode, `goal_dim` numbers; empty for most tasks.
    pub goal: &'a [f64],
    /// The scene.
    pub scene: &'a Scene,
}

/// Working memory of one thread. No call relies on the content that an earlier call left.
pub struct Work {
    /// The robot.
    pub system: Arc<System>,
    /// Dynamics data of the robot.
    pub data: Data,
    /// Controller of the robot, for tasks that command positions.
    pub controller: Controller,
    /// Contact events.
    pub events: Vec<ContactEvent>,
    /// Scratch numbers.
    pub numbers: Vec<f64>,
}

impl Work {
    /// Working memory for a system.
    pub fn new(system: &Arc<System>) -> Self {
        let data = Data::new(&system.robot);
        let controller = Controller::new(system);
        Self { system: system.clone(), data, controller, events: Vec::new(), numbers: Vec::new() }
    }
}

/// Names and sizes of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct About {
    /// Name, as on the command line.
    pub name: &'static str,
    /// Robot, as in [`System::named`]; a relative path is from the working directory.
    pub robot: &'static str,
    /// Scene, as in [`System::scene`].
    pub scene: &'static str,
    /// Width of an observation.
    pub observation: usize,
    /// Width of an action; entries are in [-1, 1].
    pub action: usize,
    /// Steps after which an episode is truncated.
    pub steps: u64,
    /// Frames per step.
    pub frames: u64,
}

impl About {
    /// Refuses a task with a size of 0, or one too large for any run.
    pub fn check(&self) -> Result<(), String> {
        let whole = |key: &str, n: u64, most: f64| within(key, n as f64, 1.0..=most, "");
        whole("observation", self.observation as u64, MOST_SEEN)?;
        whole("action", self.action as u64, MOST_ACTIONS)?;
        whole("steps", self.steps, MOST_STEPS)?;
        whole("frames", self.frames, MOST_FRAMES)
    }
}

/// One task. Observation, torques, reward, error and end are formulas ([`crate::formula`]), written once.
/// [`crate::Compiled`] evaluates them on the CPU, gives their gradients and writes them as GPU kernels;
/// [`crate::Episodes`] runs batches. All methods are pure, so an episode's past is in its state, its goal and its number
/// of steps.
pub trait Task: Send + Sync {
    /// Names and sizes.
    fn about(&self) -> About;

    /// The robot.
    fn system(&self) -> Result<Arc<System>, SystemError> {
        System::named(self.robot())
    }

    /// The given robot with the task's settings: frame time, substeps, rotors, terrain.
    ///
    /// # Errors
    /// If a setting is out of range for this robot.
    fn fit(&self, robot: Arc<System>) -> Result<Arc<System>, SystemError> {
        Ok(robot)
    }

    /// Text of the file, for a task from a file ([`crate::FileTask`]).
    fn text(&self) -> Option<&str> {
        None
    }

    /// Ranges `[low, high)` of the first numbers of an episode's goal, drawn in this order before the start state.
    fn goal(&self) -> &[[f64; 2]] {
        &[]
    }

    /// Whether the first three numbers of a goal are a world position (m) to be displayed.
    fn place(&self) -> bool {
        self.goal().len() + self.plain().map_or(0, Plain::goal_dim) >= 3
    }

    /// Names and ranges `[low, high]` of the goal's numbers, for a task that names them as commands.
    fn commands(&self) -> Vec<(String, [f64; 2])> {
        Vec::new()
    }

    /// Width of the memory at the goal's end: the last action, then the action before it. If the width is odd, the last
    /// number counts the steps of the episode so far. The memory starts as zeros.
    fn memory(&self) -> usize {
        0
    }

    /// Index of the level in the goal, and the number of levels. The level is a factor on the terrain's heights, 1
    /// unless [`crate::Episodes::climb`] changes it. The next number in the goal is the sum of errors over the last
    /// half of the episode.
    fn levels(&self) -> Option<(usize, usize)> {
        None
    }

    /// Writes the observation: all [`About::observation`] numbers.
    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]);

    /// Writes the joint torques (N m or N) for an action, clamped to [-1, 1]. `torques[joint]` initially holds zeros.
    /// No limit applies to the torques afterwards.
    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]);

    /// Whether torques come from the robot's controller alone, which may then act as a servo inside the frame
    /// ([`Simulation::serve`]).
    fn controlled(&self) -> bool {
        false
    }

    /// Reward at the state reached; `torques[joint]` acted in the last frame. For a task with [`Self::controlled`], the
    /// torques are clamped to the torque limits, since the controller's commands are unbounded.
    fn reward<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Traced<'a>;

    /// Names of the reward's terms, if any.
    fn terms(&self) -> &[String] {
        &[]
    }

    /// The reward, followed by its terms.
    fn rewards<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Vec<Traced<'a>> {
        vec![self.reward(sight, torques)]
    }

    /// Error relative to the tolerance; `None` for a task without a success criterion. An episode succeeds if the mean
    /// error over the last half of its steps is at most 1.
    fn error<'a>(&self, _sight: &Sight<'a>) -> Option<Traced<'a>> {
        None
    }

    /// Tolerance (the error that counts as 1), and its unit.
    fn tolerance(&self) -> (f64, &str) {
        (1.0, "")
    }

    /// Whether this state terminates the episode: 1 or 0.
    fn terminated<'a>(&self, _sight: &Sight<'a>) -> Traced<'a> {
        0.0.into()
    }

    /// What the task computes in plain code. A task with plain code runs on the CPU alone.
    fn plain(&self) -> Option<&dyn Plain> {
        None
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

/// What formulas cannot express, in plain code: other starts, goals that move, numbers of any origin.
pub trait Plain: Send + Sync {
    /// Count of goal numbers from plain code. In the goal these stand between the numbers drawn from [`Task::goal`] and
    /// the memory.
    fn goal_dim(&self) -> usize {
        0
    }

    /// Draws the goal numbers of plain code into `_out[goal_dim]`.
    fn draw_goal(&self, _rng: &mut ChaCha8Rng, _out: &mut [f64]) {}

    /// Advances a moving goal by a frame; `_goal` is the whole goal.
    fn advance(&self, _goal: &mut [f64]) {}

    /// Draws a start state `[q, qd]`, by default from the robot's `reset` ranges.
    fn reset(&self, system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        start(system, Start::Reset, rng)
    }

    /// Count of numbers that formulas read by [`Sight::plain`]; they have no gradients.
    fn numbers_dim(&self) -> usize {
        0
    }

    /// Writes the numbers that formulas read by [`Sight::plain`] into `_out[numbers_dim]`.
    fn numbers(&self, _view: View, _work: &mut Work, _out: &mut [f64]) {}
}

impl dyn Task + '_ {
    /// The view of a robot that the task's formulas read, recorded on `tape`.
    pub fn sight<'a>(&self, tape: &'a Tape, system: &'a System) -> Sight<'a> {
        Sight::new(tape, system, self.goal_dim(), self.plain().map_or(0, Plain::numbers_dim))
    }

    /// Number of entries of an episode's goal.
    pub fn goal_dim(&self) -> usize {
        self.goal().len() + self.plain().map_or(0, Plain::goal_dim) + self.memory()
    }

    /// Draws an episode's goal into `out[goal_dim]`, with zeros as memory.
    pub fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        let (drawn, rest) = out.split_at_mut(self.goal().len());
        drawn.iter_mut().zip(self.goal()).for_each(|(x, [low, high])| *x = low + (high - low) * rng.random::<f64>());
        rest.fill(0.0);
        if let Some(plain) = self.plain() {
            plain.draw_goal(rng, &mut rest[..plain.goal_dim()]);
        }
    }

    /// Advances a moving goal by a frame.
    pub fn advance(&self, goal: &mut [f64]) {
        if let Some(plain) = self.plain() {
            plain.advance(goal);
        }
    }

    /// Updates the memory after a step: the step's action, clamped to [-1, 1], becomes the last action in the goal.
    pub fn remember(&self, goal: &mut [f64], action: &[f64]) {
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

    /// Draws a start state `[q, qd]`.
    pub fn reset(&self, system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        match self.plain() {
            Some(plain) => plain.reset(system, rng),
            None => start(system, Start::Reset, rng),
        }
    }
}
