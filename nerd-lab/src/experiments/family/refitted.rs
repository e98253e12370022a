//! A model of the robot that a family is like, brought to each robot by what is shown of it: its last layer is refitted, towards no change.
//!
//! How strongly, rollouts over the last third of what is shown say, by a layer that was fitted to what is before; then all of it is fitted.

use nerd_model::features::Features;
use nerd_model::neural::Neural;
use nerd_model::refit::{Refit, Shown};
use nerd_model::{base::Base, form::Form};
use nerd_train::evaluate::Pieces;
use rayon::prelude::*;

use crate::prelude::*;

/// Penalties that are tried beside no change.
const PENALTIES: [f64; 7] = [1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0];
/// Frames of a rollout by which one is chosen.
const LENGTH: usize = 30;

/// The model with a last layer for each of the pieces, of whose frames it is shown the first. None where nothing is shown.
pub fn refitted(model: &Model, pieces: &Pieces) -> Result<Option<Box<dyn Solver>>> {
    if pieces.before == 0 {
        return Ok(None);
    }
    let first = 2 * pieces.before / 3;
    let [told, all] = [first, pieces.before].map(|n| (0..pieces.count()).into_par_iter().map(|k| shown(model, pieces, k, n)).collect());
    let (told, all): (Vec<Shown>, Vec<Shown>) = (told, all);
    let mut best = rolled(model, pieces, first, told.iter().map(|own| (own.clone(), None)).collect())?;
    let mut chosen = vec![None; best.len()];
    for penalty in PENALTIES {
        let errors = rolled(model, pieces, first, told.iter().map(|own| (own.clone(), Some(penalty))).collect())?;
        for ((best, chosen), error) in best.iter_mut().zip(&mut chosen).zip(errors) {
            if error < *best {
                (*best, *chosen) = (error, Some(penalty));
            }
        }
    }
    Ok(Some(Box::new(solver(model, &all.into_iter().zip(chosen).collect::<Vec<_>>())?)))
}

fn solver(model: &Model, shown: &[(Shown, Option<f64>)]) -> Result<Neural> {
    Ok(Neural::new(model.clone(), Box::new(Refit::new(&model.weights, shown)?)))
}

/// By robot, how far short rollouts are from what is shown from frame `first` on: the sum over frames and numbers, each in deviations of the
/// model's targets. Infinite where one cannot be stepped.
fn rolled(model: &Model, pieces: &Pieces, first: usize, shown: Vec<(Shown, Option<f64>)>) -> Result<Vec<f64>> {
    let (n, d, mut solver) = (pieces.count(), pieces.system.robot.state_dim(), solver(model, &shown)?);
    let mut batch = Batch::new(&pieces.system, &pieces.scenes[0], n);
    batch.scenes.clone_from(&pieces.scenes);
    let mut features = Features::new(&pieces.system, Form { base: Base::State, ..model.config.form() });
    let (mut errors, mut apart) = (vec![0.0; n], vec![0.0; d]);
    for frame in first..pieces.before {
        if (frame - first).is_multiple_of(LENGTH) {
            batch.states.copy_from_slice(&pieces.states[frame]);
        }
        if let Err(error) = solver.step(&mut batch, &pieces.torques[frame]) {
            error.faults()?.iter().for_each(|fault| errors[fault.env] = f64::INFINITY);
        }
        for (env, error) in errors.iter_mut().enumerate() {
            features.target(&pieces.states[frame + 1][env * d..(env + 1) * d], batch.state(env), &mut apart);
            // Of a turn its vector part: none is the quaternion 0 0 0 1.
            let turn = pieces.system.robot.floating().then_some(6);
            let scaled = apart.iter().zip(model.normalizer.outputs.scale()).enumerate().filter(|(k, _)| Some(*k) != turn);
            *error += scaled.map(|(_, (x, scale))| f64::from(x.abs()) / scale).sum::<f64>();
        }
    }
    Ok(errors)
}

/// The first frames that are shown of the k-th robot, as a run would learn them.
fn shown(model: &Model, pieces: &Pieces, k: usize, frames: usize) -> Shown {
    let (system, scene, network) = (&pieces.system, &pieces.scenes[k], model.config.network);
    let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
    let state = |frame: usize| &pieces.states[frame][k * d..(k + 1) * d];
    let (mut features, mut data, mut events) = (Features::new(system, model.config.form()), Data::new(&system.robot), Vec::new());
    let zeros = |width: usize| vec![0.0; frames * width];
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
