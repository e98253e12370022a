//! Replays motions in a learned model and in its truth, the solver that made the model's dataset.

use nerd_model::solver::learned;
use nerd_train::replay::Replay;

use crate::{prelude::*, roll::begun};

/// Loads the solvers of a model and of its truth, each with its name.
pub fn model_and_truth(system: &Arc<System>, model: &Path) -> Result<[(String, Box<dyn Solver>); 2]> {
    let truth = ModelConfig::truth_of(model)?;
    let model = learned(Model::load(model, system, None)?, system)?;
    Ok([("NeRD".into(), model), (format!("the truth, {}", truth.name()), truth.solver(system))])
}

/// Replays a passive motion in a model and in its truth. Both begin at one state, drawn from the robot's reset ranges.
pub fn passive(robot: &str, scene: &str, model: &Path, frames: usize, seed: u64) -> Result<Replay> {
    let system = System::named(robot)?;
    let batch = begun(&system, &system.scene(scene)?, 1, Start::Reset, seed);
    let title = format!("{} in {}", system.name, batch.scenes[0].name);
    side_by_side(&title, &batch, model, &vec![0.0; frames * system.robot.joint_count()], frames)
}

/// Rolls out a model and its truth from one start state, under `torques[frame][joint]` (N m or N).
pub fn side_by_side(title: &str, start: &Batch, model: &Path, torques: &[f64], frames: usize) -> Result<Replay> {
    let system = &start.system;
    let mut replay = Replay::new(title, start, system.frame_time);
    let joints = system.robot.joint_count();
    for (name, solver) in model_and_truth(system, model)? {
        let mut simulation = Simulation { batch: start.clone(), solver };
        replay.begin(&name);
        for frame in 0..frames {
            replay.add(&simulation.batch);
            simulation.step(&torques[frame * joints..][..joints])?;
        }
    }
    replay.compare(&system.robot);
    Ok(replay)
}
