//! The trait of tasks: observation, action, reward and end of an episode, in Gymnasium's terms.

use nerd_sim::{articulated::device::Reach, prelude::*, range::within, sampling::hurry};
use rand_chacha::ChaCha8Rng;

/// Limits: numbers of an observation and of an action, steps of an episode, and frames of a step (at 0.1 s each, a minute and a half).
const MOST_SEEN: f64 = 65_536.0;
const MOST_ACTIONS: f64 = 4096.0;
const MOST_STEPS: f64 = 1e6;
const MOST_FRAMES: f64 = 1000.0;
/// Most times that a fast start's velocity is halved.
const HALVINGS: usize = 12;

/// One environment as seen by a task.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// State `[q, qd]`.
    pub state: &'a [f64],
    /// The episode's goal, [`Task::goal_dim`] numbers; empty for most tasks.
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
    /// Refuses a task without observation, action or steps, or one too large for any run.
    pub fn check(&self) -> Result<(), String> {
        let whole = |key: &str, n: u64, most: f64| within(key, n as f64, 1.0..=most, "");
        whole("observation", self.observation as u64, MOST_SEEN)?;
        whole("action", self.action as u64, MOST_ACTIONS)?;
        whole("steps", self.steps, MOST_STEPS)?;
        whole("frames", self.frames, MOST_FRAMES)
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

    /// The given robot with the task's settings: frame time, substeps, rotors, terrain.
    ///
    /// # Errors
    /// If a setting is out of range for this robot.
    fn fit(&self, robot: Arc<System>) -> Result<Arc<System>, SystemError> {
        Ok(robot)
    }

    /// The text it was read from, for a task from a file ([`crate::FileTask`]).
    fn text(&self) -> Option<&str> {
        None
    }

    /// Whether a goal's first three numbers are a position in the world (m), to be shown.
    fn place(&self) -> bool {
        self.goal_dim() >= 3
    }

    /// Numbers in an episode's goal.
    fn goal_dim(&self) -> usize {
        0
    }

    /// Names and ranges of a goal's numbers, for a task that names them.
    fn commands(&self) -> Vec<(String, [f64; 2])> {
        Vec::new()
    }

    /// Numbers at a goal's end that hold the last action and the one before it, and maybe the steps of the episode so far; zeros at first.
    /// The caller that steps a task updates them by [`Task::remember`].
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

    /// Index of the level among the goal's numbers, and the number of levels. The level is a factor on the terrain's heights, 1 unless
    /// [`crate::Episodes::climb`] changes it. The next number is the sum of errors over the last half of the episode.
    fn levels(&self) -> Option<(usize, usize)> {
        None
    }

    /// Draws an episode's goal.
    fn draw_goal(&self, _rng: &mut ChaCha8Rng, _out: &mut [f64]) {}

    /// Advances a goal by a frame, if it moves.
    fn advance(&self, _goal: &mut [f64]) {}

    /// A start `[q, qd]`; drawn from the robot's own `reset` ranges unless a task has another.
    fn reset(&self, system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        start(system, Start::Reset, rng)
    }

    /// Writes the observation: every one of [`About::observation`] numbers.
    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]);

    /// Writes the joint torques (N m or N) of an action, which is clamped to [-1, 1]. Nothing limits them afterwards.
    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]);

    /// Whether its torques come from the robot's own controller alone, which may then act as servos inside a frame ([`Simulation::serve`]).
    fn controlled(&self) -> bool {
        false
    }

    /// Reward for arriving here; `torques` acted in the last frame.
    fn reward(&self, view: View, torques: &[f64], work: &mut Work) -> f64;

    /// Names of the reward's terms, for a task that names them.
    fn terms(&self) -> &[String] {
        &[]
    }

    /// The reward, followed by its terms.
    fn rewards(&self, view: View, torques: &[f64], work: &mut Work) -> Vec<f64> {
        vec![self.reward(view, torques, work)]
    }

    /// Error relative to the tolerance; `None` for a task that does not define success. An episode has succeeded if the mean over the last
    /// half of its steps is at most 1.
    fn miss(&self, _view: View, _work: &mut Work) -> Option<f64> {
        None
    }

    /// The tolerance (the error that counts as 1), and its unit.
    fn allowed(&self) -> (f64, &str) {
        (1.0, "")
    }

    /// Whether this state ends the episode.
    fn terminated(&self, _view: View, _work: &mut Work) -> bool {
        false
    }

    /// Its gradients, if it is written in formulas ([`crate::formula`]).
    fn slopes(&self) -> Option<&dyn Slopes> {
        None
    }

    /// The task as kernels for a GPU ([`crate::formula`]), for a batch of this reach, with functions for its gradients or without.
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

/// Vector-Jacobian products of a task: upstream gradients with respect to its results become gradients with respect to the state, in its
/// tangent space ([`nerd_core::tangent`]), to action and to torques, and are added. Held constant are goals, the assignment of contact
/// points to nearest surfaces and, under a position law with prediction, the robot's mass matrix and bias.
pub trait Slopes: Send + Sync {
    /// Of [`Task::observe`].
    fn observe_back(&self, view: View, work: &mut Work, by: &[f64], slope: &mut [f64]);

    /// Of [`Task::act`], with respect to the clamped action.
    fn act_back(&self, view: View, action: &[f64], work: &mut Work, by: &[f64], slope: &mut [f64], by_action: &mut [f64]);

    /// Of [`Task::reward`].
    fn reward_back(&self, view: View, torques: &[f64], work: &mut Work, by: f64, slope: &mut [f64], by_torques: &mut [f64]);
}

/// A start of a task at velocities that only a good policy reaches ([`hurry`]), for a model to learn beforehand. Where the task would end
/// at once, the velocities are halved until it does not. A task's end must not depend on its goal: here there is no episode.
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
