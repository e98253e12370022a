//! A network brought to other robots than it learned, by few frames of each: its last layer is refitted for each robot, in closed form.
//!
//! Of the last activations h of a robot's frames, and a 1, and what its targets y lie off the predictions `W^T h`, in normalised units,
//! `D = argmin sum |y - (W + D)^T h|^2 + lambda |D|^2` (ridge regression towards no change).

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::program::Op;
use crate::transformer::{Architecture, Forward, ForwardError, PackedForward, Stream, TransformerConfig, Weights};

/// Normalised tokens and targets of a robot's frames, in order.
#[derive(Clone, Debug, Default)]
pub struct Shown {
    /// `[frame][inputs]`.
    pub tokens: Vec<f32>,
    /// `[frame][outputs]`.
    pub targets: Vec<f32>,
}

/// A network that sees one frame, with a last layer for each environment.
pub struct Refit {
    hidden: PackedForward,
    /// By environment, `[1 + width][outputs]`, what is added first.
    layers: Vec<DMatrix<f32>>,
    rows: Vec<f32>,
}

impl Refit {
    /// Whether a network of this shape can be refitted.
    pub fn can(config: &TransformerConfig) -> bool {
        config.reach() == 1 && config.architecture != Architecture::Chain
    }

    /// Of a network's weights, for as many environments as there are robots of which frames are shown; and the penalty of each, in sums of
    /// squares of a mean activation over its frames. Without one, or a frame, a robot's layer stays as it was learned.
    ///
    /// # Errors
    /// Of no robots, a network that sees more than one frame, or what is not as wide as its tokens and predictions.
    pub fn new(weights: &Weights, shown: &[(Shown, Option<f64>)]) -> Result<Self, ForwardError> {
        let (config, failed) = (weights.config, |message: String| Err(ForwardError { message }));
        let program = config.program();
        let last = program.steps.last().map(|step| step.op);
        let (Some(Op::Linear { weight, scale, bias, add: false }), true) = (last, Self::can(&config)) else {
            return failed(format!("sees {} frames, or a chain: the last layer of one that sees one frame is refitted", config.reach()));
        };
        if shown.is_empty() {
            return failed("no robot is shown: a layer for each is asked".into());
        }
        let wide = |(s, _): &&(Shown, _)| {
            s.tokens.len() * config.outputs != s.targets.len() * config.inputs || s.tokens.len() % config.inputs != 0
        };
        if let Some((s, _)) = shown.iter().find(wide) {
            return failed(format!("{} numbers of tokens and {} of targets are shown", s.tokens.len(), s.targets.len()));
        }
        let starts = program.starts();
        let tensor = |k: usize| &weights.flat[starts[k]..starts[k + 1]];
        let width = program.tensors[weight.0].shape[0];
        let mut own = DMatrix::<f32>::zeros(1 + width, config.outputs);
        own.rows_mut(1, width).copy_from(&DMatrix::from_row_slice(width, config.outputs, tensor(weight.0)));
        if let Some(scale) = scale {
            own.rows_mut(1, width).row_iter_mut().zip(tensor(scale.0)).for_each(|(mut row, scale)| row *= *scale);
        }
        if let Some(bias) = bias {
            own.row_mut(0).copy_from_slice(tensor(bias.0));
        }
        let layer = |hidden: &mut PackedForward, (shown, penalty): &(Shown, Option<f64>)| -> Result<DMatrix<f32>, ForwardError> {
            let (Some(penalty), false) = (penalty, shown.tokens.is_empty()) else { return Ok(own.clone()) };
            let mut rows = Vec::new();
            hidden.forward(&shown.tokens, 1, &vec![0; shown.tokens.len() / config.inputs], &mut rows)?;
            let h = with_one(&rows, width).cast::<f64>();
            let y = DMatrix::from_row_slice(h.nrows(), config.outputs, &shown.targets).cast::<f64>();
            let change = change(&h, &(y - &h * own.clone().cast::<f64>()), *penalty);
            Ok(change.map_or_else(|| own.clone(), |change| &own + change.cast::<f32>()))
        };
        let begin = || PackedForward::before_last(weights);
        let layers = shown.par_iter().map_init(begin, layer).collect::<Result<_, _>>()?;
        Ok(Self { hidden: begin(), layers, rows: Vec::new() })
    }
}

/// Rows of activations, each behind a 1.
fn with_one(rows: &[f32], width: usize) -> DMatrix<f32> {
    DMatrix::from_row_slice(rows.len() / width, width, rows).insert_column(0, 1.0)
}

/// The change of a layer that frames' activations and residuals ask for.
fn change(h: &DMatrix<f64>, residual: &DMatrix<f64>, penalty: f64) -> Option<DMatrix<f64>> {
    let (mut square, n) = (h.tr_mul(h), h.ncols());
    let unit = square.trace() / n as f64;
    square.set_diagonal(&(square.diagonal() + DVector::repeat(n, penalty * unit)));
    Some(square.cholesky()?.solve(&h.tr_mul(residual)))
}

impl Stream for Refit {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let envs = self.layers.len();
        self.hidden.forward(tokens, 1, &vec![0; envs], &mut self.rows)?;
        out.clear();
        for (row, layer) in self.rows.chunks_exact(self.rows.len() / envs.max(1)).zip(&self.layers) {
            let h = DVector::from_column_slice(row);
            let outputs = layer.rows(1, row.len()).tr_mul(&h) + layer.row(0).transpose();
            out.extend_from_slice(outputs.as_slice());
        }
        Ok(())
    }

    fn clear(&mut self, _env: usize) {}
}
