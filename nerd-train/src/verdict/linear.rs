//! What anything that was learned has to beat: the base alone, and a linear map on the same inputs.

use nalgebra::DMatrix;
use nerd_sim::instruments::Hold;

use crate::prelude::*;
use crate::prepare::{generate, normalize};

/// Transitions that the map is fitted to, some fifty for each of its inputs, and frames of their trajectories.
const TRANSITIONS: usize = 16_384;
const FRAMES: usize = 64;
/// Weights of squared weights beside squared errors, in shares of a token's variance: the map counts whose rollouts err least.
const RIDGES: [f64; 3] = [1e-6, 1e-3, 1e-1];

/// A map of the newest token alone: rows of weights by input, then one that is added.
pub(super) struct Linear {
    outputs: usize,
    weights: Vec<f32>,
}

impl Stream for Linear {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
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

/// Transitions that a model's truth is recorded in: half passive, half from where evaluations start.
pub(super) fn windows(model: &Model, system: &Arc<System>, truth: Truth, seed: u64) -> Result<Windows> {
    let (torque_scale, shard_trajectories) = (Range { low: -1.0, high: 1.0 }, 16);
    // Of a robot with very many contact points fewer, as memory has it.
    let transitions = TRANSITIONS.min((1 << 23) / model.config.network.inputs);
    let mut config = GenerateConfig { transitions, frames: FRAMES, seed, shard_trajectories, ..Default::default() };
    (config.torque_scale, config.resets) = (torque_scale, 0.5);
    let solver = || truth.solver(system);
    Ok(generate(system, &solver, &config, (1, model.config.form()), &|_| ())?.windows)
}

/// Linear maps from a model's normalised tokens to its normalised targets, of least squares over these transitions. One for each ridge; none
/// where the equations have no solution.
pub(super) fn maps(model: &Model, mut windows: Windows) -> Vec<Linear> {
    normalize(&mut windows, &model.normalizer);
    let Windows { inputs, outputs, x, y, .. } = &windows;
    // A token and 1 in a column.
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

/// What a model's predictions are added to, alone: where that is the state, nothing moves; by the trapezoid rule all go on as they do.
pub(super) fn base(model: &Model, system: &System) -> Box<dyn Solver> {
    if model.config.base == Base::State {
        return Box::new(Hold);
    }
    let (inputs, outputs) = (model.config.network.inputs, model.config.network.outputs);
    let mut mean = vec![0.0; outputs];
    if system.robot.floating() {
        // No turn, as a quaternion.
        mean[6] = 1.0;
    }
    let moments = Moments { mean, ..Moments::identity(outputs) };
    let normalizer = Normalizer { inputs: model.normalizer.inputs.clone(), outputs: moments };
    with(&Model { normalizer, ..model.clone() }, Linear { outputs, weights: vec![0.0; (inputs + 1) * outputs] })
}
