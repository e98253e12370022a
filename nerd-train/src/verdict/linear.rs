//! Baselines of a verdict: the base of the predictions without a network, and a linear map of the model's inputs.

use nalgebra::DMatrix;
use nerd_sim::instruments::Hold;

use crate::prelude::*;
use crate::prepare::{generate, normalize};

/// Number of transitions for fitting the linear map, some fifty per input, and frames per trajectory.
const TRANSITIONS: usize = 16_384;
const FRAMES: usize = 64;
/// Ridge coefficients, relative to the variance of a token. The map with the smallest rollout error counts.
const RIDGES: [f64; 3] = [1e-6, 1e-3, 1e-1];

/// A linear map from the newest token to a prediction. The weights are `[input][output]`, followed by the offsets
/// `[output]`.
pub(super) struct Linear {
    outputs: usize,
    weights: Vec<f32>,
}

impl Stream for Linear {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> ForwardResult {
        let (weights, added) = self.weights.split_at(self.weights.len() - self.outputs);
        let inputs = weights.len() / self.outputs;
        out.clear();
        for token in tokens.chunks_exact(inputs) {
            let first = out.len();
            out.extend_from_slice(added);
            for (x, row) in token.iter().zip(weights.chunks_exact(self.outputs)) {
                out[first..].iter_mut().zip(row).for_each(|(y, w)| *y += x * w);
            }
        }
        Ok(())
    }

    fn clear(&mut self, _env: usize) {}
}

/// Transitions of the model's truth as tokens and targets in the model's form. Half of the trajectories are passive,
/// and half start as in evaluations.
pub(super) fn windows(model: &Model, system: &Arc<System>, truth: Truth, seed: u64) -> Result<Windows> {
    let (torque_scale, shard_trajectories) = (Range { low: -1.0, high: 1.0 }, 16);
    // Fewer transitions for robots with very many inputs, to limit memory.
    let transitions = TRANSITIONS.min((1 << 23) / model.config.network.inputs);
    let mut config = GenerateConfig { transitions, frames: FRAMES, seed, shard_trajectories, ..Default::default() };
    (config.torque_scale, config.resets) = (torque_scale, 0.5);
    let solver = || truth.solver(system);
    Ok(generate(system, &solver, &config, (1, model.config.form()), &|_| ())?.windows)
}

/// Fits least-squares maps from normalised tokens to normalised targets over `windows`. Gives one map for each ridge
/// coefficient that has a solution.
pub(super) fn maps(model: &Model, mut windows: Windows) -> Vec<Linear> {
    normalize(&mut windows, &model.normalizer);
    let Windows { inputs, outputs, x, y, .. } = &windows;
    // Columns of tokens, each with a final 1.
    let u = x.chunks_exact(*inputs).flat_map(|row| row.iter().map(|x| f64::from(*x)).chain([1.0]));
    let u = DMatrix::from_iterator(inputs + 1, x.len() / inputs, u);
    let y = DMatrix::from_iterator(*outputs, y.len() / outputs, y.iter().map(|y| f64::from(*y)));
    let (square, cross, rows) = (&u * u.transpose(), u * y.transpose(), (x.len() / inputs) as f64);
    let solve = |ridge: f64| {
        let weights = (&square + DMatrix::identity(inputs + 1, inputs + 1) * (ridge * rows)).cholesky()?.solve(&cross);
        Some(Linear { outputs: *outputs, weights: weights.transpose().iter().map(|w| *w as f32).collect() })
    };
    RIDGES.into_iter().filter_map(solve).collect()
}

/// A model with a linear map in place of its network.
pub(super) fn with(model: &Model, map: Linear) -> Box<dyn Solver> {
    Box::new(Neural::new(model.clone(), Box::new(map)))
}

/// The model's base alone: nothing moves if the base is the state; by the trapezoid rule all velocities stay constant.
pub(super) fn base(model: &Model, system: &System) -> Box<dyn Solver> {
    if model.config.base == Base::State {
        return Box::new(Hold);
    }
    let (inputs, outputs) = (model.config.network.inputs, model.config.network.outputs);
    let mut mean = vec![0.0; outputs];
    if system.robot.floating() {
        // The identity quaternion.
        mean[6] = 1.0;
    }
    let moments = Moments { mean, ..Moments::identity(outputs) };
    let normalizer = Normalizer { inputs: model.normalizer.inputs.clone(), outputs: moments };
    with(&Model { normalizer, ..model.clone() }, Linear { outputs, weights: vec![0.0; (inputs + 1) * outputs] })
}
