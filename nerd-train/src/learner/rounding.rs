//! Hidden matrices as f16.

use half::f16;
use nalgebra::DMatrix;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::program::{Op, Step};
use nerd_model::transformer::{Architecture, Weights};
use rayon::prelude::*;

use super::LearnError;
use super::sharded::shard;
use crate::windows::Windows;

/// Windows of a shard.
const SHARD: usize = 32;
/// Damping, as a share of the mean square of an input.
const DAMPING: f64 = 1e-6;

/// The network with every [hidden matrix](nerd_model::transformer::TensorSpec::hidden) rounded to what f16 can hold; all other
/// tensors are as they were. `windows` are normalised tokens like those it was trained on; some ten thousand are enough.
///
/// The nearest f16 of each weight moves a layer's outputs `x W` by some 3e-4 of themselves, which a long rollout makes much of.
/// But the inputs x of a layer lie near a space of far fewer dimensions than W has rows, so most of an error in one row can
/// be taken back in the rows after it. With `H = mean x^T x` over tokens of training data (inputs times their norm's weights)
/// and `U^T U = (H + damping)^-1`, rows are rounded one after another, the largest inputs first (Frantar et al. 2022, GPTQ):
///
/// ```text
/// q_i = f16(w_i)        w_j -= U_ij (w_i - q_i) / U_ii   for all rows j behind i
/// ```
///
/// # Errors
/// If the network is no Transformer, there is no window, or its inputs are not finite.
pub fn round_hidden(weights: &Weights, windows: &Windows) -> Result<Weights, LearnError> {
    if weights.config.architecture != Architecture::Transformer || windows.is_empty() {
        return Err(LearnError::Mismatch("rounding needs a Transformer and windows of its tokens".into()));
    }
    let moments = moments(weights, windows)?;
    let mut rounded = weights.clone();
    let (mut matrices, mut rest) = (Vec::new(), rounded.flat.as_mut_slice());
    for tensor in weights.config.tensors() {
        let (entries, behind) = rest.split_at_mut(tensor.len());
        rest = behind;
        if tensor.hidden() {
            matrices.push((tensor.shape[0], entries));
        }
    }
    matrices.into_par_iter().zip(moments).try_for_each(|((rows, entries), h)| round(rows, entries, h))?;
    Ok(rounded)
}

/// `sum x^T x` of each hidden matrix's inputs.
fn moments(weights: &Weights, windows: &Windows) -> Result<Vec<DMatrix<f64>>, LearnError> {
    let network = Loaded::new(weights.config.program(), &weights.flat);
    let hidden = |step: &Step| match step.op {
        Op::Linear { weight, scale, .. } if network.program.tensors[weight.0].hidden() => Some((step.from, scale)),
        _ => None,
    };
    let read: Vec<_> = network.program.steps.iter().filter_map(hidden).collect();
    let rows: Vec<u64> = (0..windows.len() as u64).step_by(windows.history).collect();
    let parts = rows.par_chunks(SHARD).fold(Vec::new, |mut sums: Vec<DMatrix<f64>>, rows| {
        let mut memory = Memory::default();
        let shard = shard(windows, rows);
        network.forward(&shard.x, &mut memory, Pass::Kept(shard.tokens));
        for (k, (from, scale)) in read.iter().enumerate() {
            let (x, width) = (network.read(&memory, *from, *scale), network.program.width(*from));
            let x = DMatrix::from_row_iterator(x.len() / width, width, x.iter().map(|x| f64::from(*x)));
            match sums.get_mut(k) {
                Some(sum) => sum.gemm_tr(1.0, &x, &x, 1.0),
                None => sums.push(x.tr_mul(&x)),
            }
        }
        sums
    });
    let add = |mut a: Vec<DMatrix<f64>>, b: Vec<DMatrix<f64>>| {
        if a.is_empty() {
            return b;
        }
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    Ok(parts.reduce(Vec::new, add))
}

/// Rounds `[rows][columns]`.
fn round(rows: usize, entries: &mut [f32], mut h: DMatrix<f64>) -> Result<(), LearnError> {
    let columns = entries.len() / rows;
    let mut order: Vec<usize> = (0..rows).collect();
    order.sort_by(|a, b| h[(*b, *b)].total_cmp(&h[(*a, *a)]));
    let damping = DAMPING * h.trace() / rows as f64;
    (0..rows).for_each(|i| h[(i, i)] += damping);
    let sorted = DMatrix::from_fn(rows, rows, |i, j| h[(order[i], order[j])]);
    let no = || LearnError::Mismatch("the inputs of a layer are not finite".into());
    let inverse = sorted.cholesky().ok_or_else(no)?.inverse();
    let upper = inverse.cholesky().ok_or_else(no)?.l().transpose();
    let mut w: Vec<Vec<f64>> = order.iter().map(|i| entries[i * columns..][..columns].iter().map(|x| f64::from(*x)).collect()).collect();
    for i in 0..rows {
        let (done, behind) = w.split_at_mut(i + 1);
        let mut errors = Vec::with_capacity(columns);
        for (w, out) in done[i].iter().zip(&mut entries[order[i] * columns..][..columns]) {
            *out = f16::from_f64(*w).to_f32();
            errors.push((w - f64::from(*out)) / upper[(i, i)]);
        }
        for (j, row) in behind.iter_mut().enumerate() {
            let u = upper[(i, i + 1 + j)];
            row.iter_mut().zip(&errors).for_each(|(w, e)| *w -= u * e);
        }
    }
    Ok(())
}
