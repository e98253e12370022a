//! Motions worth seeing: a robot let go, or under a policy, in the truth and in the learned simulator side by side.

use std::path::Path;
use std::sync::Arc;

use nerd_model::folder::{Model, ModelConfig};
use nerd_model::pick::learned;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use nerd_tasks::{Episodes, named};

use super::replay::Replay;
use crate::error::Result;
use crate::ppo::folder;
use crate::ppo::rollout::Running;

/// The truth that a model learned, and the model itself as a solver, with their names.
fn both(system: &Arc<System>, model: &Path) -> Result<[(String, Box<dyn Solver>); 2]> {
    let truth = ModelConfig::truth_of(model)?;
    Ok([
        ("NeRD".into(), learned(Model::load(model, system, None)?, system)?),
        (format!("the truth, {}", truth.name()), truth.solver(system)),
    ])
}

/// Passive motion of a model's robot from its reset law, and the truth's from the same start.
///
/// # Errors
/// If the model cannot be loaded, or a solver cannot step.
pub fn passive(robot: &str, scene: &str, model: &Path, frames: usize, seed: u64) -> Result<Replay> {
    let system = System::named(robot)?;
    let scene = system.scene(scene)?;
    let state = start(&system, Start::Reset, &mut stream(seed, 0));
    let batch = Batch::new(&system, &scene, 1);
    let mut replay = Replay::new(&format!("{} in {}", system.name, scene.name), &batch, system.frame_time);
    let torques = vec![0.0; system.robot.joint_count()];
    for (name, solver) in both(&system, model)? {
        let mut simulation = Simulation { batch: Batch::new(&system, &scene, 1), solver };
        simulation.reset(0, &state);
        replay.begin(&name);
        for _ in 0..frames {
            replay.add(&simulation.batch);
            simulation.step(&torques)?;
        }
    }
    Ok(replay)
}

/// The first steps of an episode under a policy's mean actions, in a model and in the truth it learned.
///
/// # Errors
/// If policy or model cannot be loaded, or a solver cannot step.
pub fn policy(policy: &Path, model: &Path, steps: usize, seed: u64) -> Result<Replay> {
    let (config, policy) = folder::load(policy)?;
    let system = System::named(named(&config.task)?.robot())?;
    let mut replay: Option<Replay> = None;
    for (name, solver) in both(&system, model)? {
        let task = named(&config.task)?;
        let (batch, dt) = (Batch::new(&system, &system.scene(task.scene())?, 1), system.frame_time * task.frames() as f64);
        let mut episodes = Episodes::new(task, Simulation { batch, solver }, seed);
        let replay = replay.get_or_insert_with(|| Replay::new(&config.task, &episodes.simulation.batch, dt));
        replay.begin(&name);
        let (mut running, mut reached, mut total) = (Running::new(&episodes, policy.shape.stack), Vec::new(), 0.0);
        for _ in 0..steps {
            replay.add(&episodes.simulation.batch);
            if replay.tracks.len() == 1 {
                replay.goals.push(episodes.view(0).goal.iter().map(|x| *x as f32).collect());
                replay.rewards.push(total as f32);
            }
            let mean = policy.answer(&running.stack.rows).mean;
            let actions: Vec<f64> = mean.into_iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
            let stepped = running.step(&mut episodes, &actions, &mut reached)?;
            total += stepped.result.rewards[0];
            if !stepped.ended.is_empty() {
                break;
            }
        }
    }
    Ok(replay.unwrap_or_else(|| unreachable!("two solvers were played")))
}
