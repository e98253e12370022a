//! Errors of passive rollouts: a solver's states against the truth's, from equal starts, without actions (paper 5.1).
//! The protocol is the reference simulator's. Starts are drawn as at a robot's reset. The error is the mean absolute
//! difference over all steps and trajectories; unlimited angles are wrapped. A robot's position law holds the default
//! pose; without such a law there is no torque.
//!
//! The baseline `hold` predicts the start state at every step. Diverged rollouts are counted and stay in every mean.
//! `tally.rs` sums the errors of these rollouts and of rollouts against recorded motion (`pieces.rs`). A step is one
//! frame here. `crate::verdict` compares a model's errors with other solvers' errors, computed by the same functions.

use std::fmt;

mod gaps;
mod held;
mod pieces;
mod random;
mod tally;

pub use gaps::{Gaps, quantities, summary, summary_names};
pub use held::Held;
pub use pieces::Pieces;
use random::Random;
pub use tally::PassiveReport;
use tally::Tally;

use crate::prelude::*;

/// Frames per rollout in the paper's passive protocol, by robot name.
pub fn horizon(robot: &str) -> usize {
    match robot.strip_suffix("-paper").unwrap_or(robot) {
        "cartpole" => 1000,
        "ant" | "anymal" => 500,
        _ => 100,
    }
}

/// Settings of an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassiveConfig {
    /// Number of trajectories (paper: 2048).
    pub starts: usize,
    /// Frames of a trajectory (paper: 100 for the pendulum, 1000 for Cartpole).
    pub steps: usize,
    /// Seed of the starts (reference: 500).
    pub seed: u64,
    /// What drives the joints during the rollouts.
    #[serde(default)]
    pub action: Action,
}

impl PassiveConfig {
    /// Refuses counts and factors out of range, and recorded motion, which has starts and torques of its own.
    pub fn check(&self) -> Result<(), String> {
        within("starts", self.starts as f64, 1.0..=1e9, "")?;
        within("steps", self.steps as f64, 1.0..=1e9, "")?;
        match self.action {
            Action::Random(factor) => within("drive", factor, -1e6..=1e6, ""),
            Action::Held(size) => within("targets", size, 0.0..=10.0, " rad or m"),
            Action::Recorded(_) => Err("recorded motion has starts and torques of its own".into()),
            _ => Ok(()),
        }
    }

    /// Targets of [`Action::Held`]; none for other actions.
    pub fn held(&self, system: &System) -> Option<Held> {
        let Action::Held(size) = self.action else { return None };
        Some(Held::new(system, size, [self.starts, self.steps], self.seed))
    }
}

/// Torques or drives at the joints during a rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Action 0 of the robot's controller: its position law holds the default pose. Without a controller, no torque
    /// (paper).
    #[default]
    Zero,
    /// No torque, even with a controller.
    Limp,
    /// Random torques as in training data, times this factor. They are drawn at the truth's state; truth and solver get
    /// the same torques.
    Random(f64),
    /// Drives with the robot's gains and random targets ([`Held`]) within this distance (rad or m) of the default pose.
    Held(f64),
    /// Recorded torques from recorded starts, each after this many frames of history ([`Pieces`]).
    Recorded(usize),
}

/// The suffix of a protocol's description; empty for [`Action::Zero`].
impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Zero => Ok(()),
            Self::Limp => f.write_str(", limp"),
            Self::Random(factor) => write!(f, ", torques x {factor}"),
            Self::Held(size) => write!(f, ", held at targets within {size}"),
            Self::Recorded(before) => write!(f, " with their torques, {before} frames seen before each"),
        }
    }
}

/// Rolls out `truth` and `solver` from the same starts. `progress` gets the number of steps done after each step.
pub fn passive(
    system: &Arc<System>,
    scene: &Arc<Scene>,
    truth: &mut dyn Solver,
    solver: &mut dyn Solver,
    config: PassiveConfig,
    progress: &mut dyn FnMut(usize),
) -> Result<PassiveReport, StepError> {
    config.check().map_err(StepError::Solver)?;
    let robot = &system.robot;
    let (n, joints) = (config.starts, robot.joint_count());
    let mut real = Batch::new(system, scene, n);
    for env in 0..n {
        let state = start(system, Start::Reset, &mut stream(config.seed, env as u64));
        real.reset(env, &state);
    }
    let mut learned = real.clone();
    (0..n).for_each(|env| {
        truth.reset(env);
        solver.reset(env);
    });
    let first = real.clone();
    let mut tally = Tally::new(system, n);
    let mut controller = Controller::new(system);
    let mut random = match config.action {
        Action::Random(factor) => Some(Random::new(&real, factor, config.seed.wrapping_add(1))),
        _ => None,
    };
    let held = config.held(system);
    let (action, mut torques) = (vec![0.0; joints], [vec![0.0; n * joints], vec![0.0; n * joints]]);
    for step in 1..=config.steps {
        if let Some(held) = held.as_ref().filter(|held| (step - 1) % held.every == 0) {
            real.drives = held.drives((step - 1) / held.every, n);
            learned.drives.clone_from(&real.drives);
        }
        if let Some(random) = &mut random {
            random.draw(&real, &mut torques[0]);
            torques[1] = torques[0].clone();
        } else if config.action == Action::Zero {
            for (batch, torques) in [&real, &learned].into_iter().zip(&mut torques) {
                for env in 0..n {
                    controller.torques(batch.state(env), &action, &mut torques[env * joints..(env + 1) * joints]);
                }
            }
        }
        truth.step(&mut real, &torques[0])?;
        tally.step(solver, (&mut learned, &torques[1]), [&real.states, &first.states])?;
        progress(step);
    }
    Ok(tally.report(config.steps))
}
