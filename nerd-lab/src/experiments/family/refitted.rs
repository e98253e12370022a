//! A model of the robot that a family is like, brought to each robot by what is shown of it: its last layer is refitted.

use nerd_model::features::Features;
use nerd_model::neural::Neural;
use nerd_model::refit::{Refit, Shown};
use nerd_train::evaluate::Pieces;
use rayon::prelude::*;

use crate::prelude::*;

/// The model with a last layer for each of the pieces, of whose frames it is shown the first. None where nothing is shown.
pub fn refitted(model: &Model, pieces: &Pieces) -> Result<Option<Box<dyn Solver>>> {
    if pieces.before == 0 {
        return Ok(None);
    }
    let shown: Vec<Shown> = (0..pieces.count()).into_par_iter().map(|k| shown(model, pieces, k)).collect();
    Ok(Some(Box::new(Neural::new(model.clone(), Box::new(Refit::new(&model.weights, &shown)?)))))
}

/// What is shown of the k-th robot, as a run would learn it.
fn shown(model: &Model, pieces: &Pieces, k: usize) -> Shown {
    let (system, scene, network) = (&pieces.system, &pieces.scenes[k], model.config.network);
    let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
    let state = |frame: usize| &pieces.states[frame][k * d..(k + 1) * d];
    let (mut features, mut data, mut events) = (Features::new(system, model.config.form()), Data::new(&system.robot), Vec::new());
    let zeros = |width: usize| vec![0.0; pieces.before * width];
    let mut shown = Shown { tokens: zeros(network.inputs), targets: zeros(network.outputs) };
    let rows = shown.tokens.chunks_exact_mut(network.inputs).zip(shown.targets.chunks_exact_mut(network.outputs));
    for (frame, (token, target)) in rows.enumerate() {
        contacts(&system.robot, scene, state(frame), &mut data, &mut events);
        features.token(state(frame), &events, &pieces.torques[frame][k * joints..][..joints], &scene.gravity, token);
        features.target(state(frame), state(frame + 1), target);
    }
    model.normalizer.inputs.normalize(&mut shown.tokens);
    model.normalizer.outputs.normalize(&mut shown.targets);
    shown
}
