//! Passive motion: how far a solver drifts from the truth, from equal starts, without actions (paper 5.1; protocol of
//! the reference system: starts as the robot is reset, mean over every step and every trajectory of the absolute
//! difference, endless angles wrapped; a position law holds its target, elsewhere there is no torque).
//!
//! Each figure has a baseline without dynamics: `hold` repeats the start. A rollout that diverges is counted and stays in every mean.

use std::fmt;

use nerd_sim::dataset::{Act, Drive, Smooth};

mod gaps;
mod held;
mod pieces;
mod tally;

pub use gaps::{Gaps, quantities, summary, summary_names};
pub use held::Held;
pub use pieces::Pieces;
pub use tally::PassiveReport;
use tally::Tally;

use crate::prelude::*;

/// Frames of the paper's passive-motion protocol.
pub fn horizon(robot: &str) -> usize {
    match robot.strip_suffix("-paper").unwrap_or(robot) {
        "cartpole" => 1000,
        "ant" | "anymal" => 500,
        _ => 100,
    }
}

/// What to run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassiveConfig {
    /// Trajectories (paper: 2048).
    pub starts: usize,
    /// Frames (paper: 100 for the pendulum, 1000 for Cartpole).
    pub steps: usize,
    /// Seed of the starts (reference: 500).
    pub seed: u64,
    /// What drives the joints.
    #[serde(default)]
    pub action: Action,
}

impl PassiveConfig {
    /// Refuses what no mean can be taken over.
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

    /// Targets of [`Action::Held`]; none if joints are driven otherwise.
    pub fn held(&self, system: &System) -> Option<Held> {
        let Action::Held(size) = self.action else { return None };
        Some(Held::new(system, size, [self.starts, self.steps], self.seed))
    }
}

/// What drives the joints of a rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Action 0 of the robot's controller: its position law holds the default pose; elsewhere no torque (the paper).
    #[default]
    Zero,
    /// No torque, whatever the controller.
    Limp,
    /// The training data's random torques times this factor, drawn at the truth's state and given to both.
    Random(f64),
    /// Drives with the robot's gains, on their way to random targets within so much (rad or m) of the default pose ([`Held`]).
    Held(f64),
    /// Those that were recorded, from starts that were; a solver has seen so many frames before each ([`Pieces`]).
    Recorded(usize),
}

/// As a protocol's words end with it: nothing for [`Action::Zero`].
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

/// Rolls `truth` and `solver` out from the same starts; `progress` is called after each step.
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
    let (mut controller, mut drive) = (Controller::new(system), Drive::new(system));
    let mut streams: Vec<_> = (0..n as u64).map(|env| stream(config.seed.wrapping_add(1), env)).collect();
    let mut curves: Vec<_> = match config.action {
        Action::Random(factor) => {
            let curve = |(env, rng): (usize, &mut _)| Smooth::new(system, real.state(env), factor, rng);
            streams.iter_mut().enumerate().map(curve).collect()
        }
        _ => Vec::new(),
    };
    let held = config.held(system);
    let (action, mut torques) = (vec![0.0; joints], [vec![0.0; n * joints], vec![0.0; n * joints]]);
    for step in 1..=config.steps {
        if let Some(held) = held.as_ref().filter(|held| (step - 1) % held.every == 0) {
            real.drives = held.drives((step - 1) / held.every, n);
            learned.drives.clone_from(&real.drives);
        }
        match config.action {
            Action::Limp | Action::Held(_) | Action::Recorded(_) => {}
            Action::Zero => {
                for (batch, torques) in [&real, &learned].into_iter().zip(&mut torques) {
                    for env in 0..n {
                        controller.torques(batch.state(env), &action, &mut torques[env * joints..(env + 1) * joints]);
                    }
                }
            }
            Action::Random(factor) => {
                for (env, rng) in streams.iter_mut().enumerate() {
                    let out = &mut torques[0][env * joints..(env + 1) * joints];
                    match &mut curves[env] {
                        Some(curve) => curve.torques(real.state(env), scene, rng, out),
                        None => drive.draw(real.state(env), factor, rng, out),
                    }
                }
                torques[1] = torques[0].clone();
            }
        }
        truth.step(&mut real, &torques[0])?;
        tally.step(solver, (&mut learned, &torques[1]), [&real.states, &first.states])?;
        progress(step);
    }
    Ok(tally.report(config.steps))
}
