//! Motions of shipped robots and policies, in a learned model and in its truth. Motions are passive, driven by random
//! torques as in the dataset, or controlled by a policy.

use nerd_cli::motions::{model_and_truth, passive, side_by_side};
use nerd_sim::dataset::{GenerateConfig, record};
use nerd_tasks::{Episodes, named};
use nerd_train::ppo::{Actor, folder};
use nerd_train::replay::{self, Replay};
use nerd_train::shipped::{model, policies};

use crate::prelude::*;

/// Seed that no dataset uses: no model was trained on its motions.
const UNSEEN: u64 = 500;

/// What moves the robot of a replay.
#[derive(Clone, Copy)]
pub enum Cause {
    /// No torques: a passive motion in the named scene.
    Release(&'static str),
    /// Torques, start and scene drawn as for the training data, from the seed `UNSEEN`.
    Data,
    /// The first shipped policy of this task that was trained in a model.
    Policy(&'static str),
}

/// Replays a shipped robot in its shipped model and in the truth, for `frames` frames or policy steps. A
/// `Cause::Policy` ignores `robot` and takes the task's robot.
pub fn shipped(robot: &str, cause: Cause, frames: usize) -> Result<Replay> {
    match cause {
        Cause::Release(scene) => passive(robot, scene, &model(Truth::default(), robot), frames, 3),
        Cause::Data => driven(robot, &model(Truth::default(), robot), frames, UNSEEN),
        Cause::Policy(task) => {
            let Some(policy) = policies(&format!("{task}-neural-"))?.into_iter().next() else {
                bail!(
                    "models/policies has no {task}-neural-*: train one with `cargo xtask policy train {task} --solver neural`"
                );
            };
            self::policy(&policy, &model(Truth::default(), named(task)?.robot()), frames, 1)
        }
    }
}

/// Replays in a model and in its truth a motion driven by random torques, as in the model's dataset. [`record`] draws
/// start, scene and torques from `seed`.
pub fn driven(robot: &str, model: &Path, frames: usize, seed: u64) -> Result<Replay> {
    let system = System::named(robot)?;
    let config = GenerateConfig { transitions: frames, frames, seed, ..GenerateConfig::default() };
    let recording = record(&system, &mut *ModelConfig::truth_of(model)?.solver(&system), &config, 0, 1)?;
    let title = format!("{}, moved at random", system.name);
    side_by_side(&title, &recording.begun(&system), model, &recording.torques, frames)
}

/// Replays the first `steps` steps of an episode under a policy's mean actions, in a model and in its truth.
pub fn policy(policy: &Path, model: &Path, steps: usize, seed: u64) -> Result<Replay> {
    let (config, policy) = folder::load(policy)?;
    let actor = Actor::new(policy);
    let system = named(&config.task)?.system()?;
    let mut replay = None;
    for (name, solver) in model_and_truth(&system, model)? {
        let task = named(&config.task)?;
        let batch = Batch::new(&system, &system.scene(task.scene())?, 1);
        let dt = system.frame_time * task.frames() as f64;
        let mut episodes = Episodes::new(task, Simulation { batch, solver }, seed);
        let replay = replay.get_or_insert_with(|| Replay::new(&config.task, &episodes.simulation.batch, dt));
        replay::record(replay, &name, &actor, &mut episodes, steps)?;
    }
    Ok(replay.unwrap_or_else(|| unreachable!("a model and its truth make two tracks")))
}
