//! What anything that was learned has to beat: the base alone, and a linear map on the same inputs.

use std::sync::Arc;

use nalgebra::DMatrix;
use nerd_model::features::Features;
use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{ForwardError, Stream};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::instruments::Hold;
use nerd_sim::prelude::*;
use nerd_sim::range::Range;
use rayon::prelude::*;

use crate::error::Result;
use crate::prepare::{generate, normalize};
use crate::ranks::Ranks;
use crate::windows::Windows;

/// Transitions that the map is fitted to, some fifty for each of its inputs, and frames of their trajectories.
const TRANSITIONS: usize = 16_384;
const FRAMES: usize = 64;
/// Tokens of a product.
const ROWS: usize = 1024;

/// A map of the newest token alone: rows of weights by input, then one that is added.
pub(super) struct Linear {
    outputs: usize,
    weights: Vec<f32>,
}

impl Stream for Linear {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let (weights, added) = self.weights.split_at(self.weights.len() - self.outputs);
        let inputs = weights.len() / self.outputs;
        out.clear();
        for env in asked {
            let first = out.len();
            out.extend_from_slice(added);
            for (x, row) in tokens[env * inputs..][..inputs].iter().zip(weights.chunks_exact(self.outputs)) {
                out[first..].iter_mut().zip(row).for_each(|(y, w)| *y += x * w);
            }
        }
        Ok(())
    }

    fn clear(&mut self, _env: usize) {}
}

/// The normal equations of a linear map from normalised tokens to normalised targets: means of `u u'` and `u y'`, with `u = [x, 1]`.
pub(super) struct Normal {
    square: DMatrix<f64>,
    cross: DMatrix<f64>,
}

impl Normal {
    /// Of transitions that a model's truth is recorded in: half passive, half from where evaluations start.
    pub(super) fn of(model: &Model, system: &Arc<System>, truth: Truth, seed: u64) -> Result<Self> {
        let (torque_scale, shard_trajectories) = (Range { low: -1.0, high: 1.0 }, 16);
        let mut config = GenerateConfig { transitions: TRANSITIONS, frames: FRAMES, seed, shard_trajectories, ..Default::default() };
        (config.torque_scale, config.resets) = (torque_scale, 0.5);
        let solver = || truth.solver(system);
        let mut windows = generate(&Ranks::default(), system, &solver, &config, (1, model.config.form()), &|_| ())?.windows;
        normalize(&mut windows, &model.normalizer);
        Ok(Self::of_windows(&windows))
    }

    fn of_windows(windows: &Windows) -> Self {
        let Windows { inputs, outputs, x, y, .. } = windows;
        let part = |(x, y): (&[f32], &[f32])| {
            let with_one = x.chunks_exact(*inputs).flat_map(|row| row.iter().map(|x| f64::from(*x)).chain([1.0]));
            let u = DMatrix::from_iterator(inputs + 1, x.len() / inputs, with_one);
            let y = DMatrix::from_iterator(*outputs, y.len() / outputs, y.iter().map(|y| f64::from(*y)));
            (&u * u.transpose(), &u * y.transpose())
        };
        // Added in order: the same sums on any number of threads.
        let parts: Vec<_> = x.par_chunks(ROWS * inputs).zip(y.par_chunks(ROWS * outputs)).map(part).collect();
        let (mut square, mut cross) = (DMatrix::zeros(inputs + 1, inputs + 1), DMatrix::zeros(inputs + 1, *outputs));
        for (s, c) in parts {
            square += s;
            cross += c;
        }
        let rows = (x.len() / inputs) as f64;
        Self { square: square / rows, cross: cross / rows }
    }

    /// The map of least squares with `ridge` times the squares of its weights, in shares of an input's variance; none where the
    /// equations have no solution.
    pub(super) fn solve(&self, ridge: f64) -> Option<Linear> {
        let n = self.square.nrows();
        let weights = (&self.square + DMatrix::identity(n, n) * ridge).cholesky()?.solve(&self.cross);
        Some(Linear { outputs: weights.ncols(), weights: weights.transpose().iter().map(|w| *w as f32).collect() })
    }
}

/// A model with a linear map in place of its network.
pub(super) fn with(model: &Model, system: &Arc<System>, map: Linear) -> Box<dyn Solver> {
    Box::new(Neural::new(model.clone(), system, Box::new(map)))
}

/// What a model's predictions are added to, alone: where that is the state, nothing moves.
pub(super) fn base(model: &Model, system: &Arc<System>) -> Box<dyn Solver> {
    if !model.config.base.moves() {
        return Box::new(Hold);
    }
    let (inputs, outputs, state) = (model.config.network.inputs, model.config.network.outputs, system.default_state());
    let mut nothing = vec![0.0f32; outputs];
    Features::new(system, model.config.form()).target(&state, &state, &state, &mut nothing);
    let mean = nothing.into_iter().map(f64::from).collect();
    let moments = Moments { mean, ..Moments::identity(outputs) };
    let normalizer = Normalizer { inputs: model.normalizer.inputs.clone(), outputs: moments };
    with(&Model { normalizer, ..model.clone() }, system, Linear { outputs, weights: vec![0.0; (inputs + 1) * outputs] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_map_is_found_again_and_a_ridge_makes_it_smaller() {
        let x: Vec<f32> = (0..3 * 5000).map(|i| (i as f32 * 1.618 + (i as f32 * 0.31).sin() * 3.0).sin() * 1.4).collect();
        let y: Vec<f32> = x.chunks(3).flat_map(|x| [x[0] - 0.5 * x[1] + 0.25, x[2]]).collect();
        let normal = Normal::of_windows(&Windows { inputs: 3, outputs: 2, frames: 5, history: 1, x: x.clone(), y: y.clone() });
        let mut exact = normal.solve(1e-9).expect("a solution");
        let mut out = Vec::new();
        exact.push(&x[..30], &[1, 4], &mut out).expect("two predictions");
        let error = out.iter().zip([y[2], y[3], y[8], y[9]]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("weights {:?}, largest error {error:.1e}", exact.weights);
        assert!(error < 1e-5, "{out:?} for {:?}", &y[..10]);
        let size = |ridge: f64| normal.solve(ridge).expect("a solution").weights.iter().map(|w| w * w).sum::<f32>();
        assert!(size(1.0) < size(0.1) && size(0.1) < size(1e-9), "{} {} {}", size(1.0), size(0.1), size(1e-9));
    }
}
