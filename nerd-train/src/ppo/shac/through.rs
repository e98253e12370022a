//! Backward pass through a network for many rows at once.

use super::*;

/// Least number of rows per parallel task, and largest number of tasks.
const ROWS: usize = 64;
const PARTS: usize = 256;

/// What a gradient is taken with respect to: raw observations or parameters.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum By {
    Rows,
    Parameters,
}

/// Gradients through a network, with respect to raw observations, or to parameters (summed). For each row, `say`
/// reads the outputs, writes the gradient with respect to these outputs and returns a number. Also returns the sum of
/// these numbers.
pub(super) fn through(
    policy: &Policy,
    network: &Loaded,
    rows: &[f64],
    by: By,
    say: impl Fn(usize, &[f32], &mut [f32]) -> f64 + Sync,
) -> (Vec<f64>, f64) {
    let (width, outputs) = (policy.shape.inputs(), policy.shape.outputs());
    let size = ROWS.max((rows.len() / width).div_ceil(PARTS));
    let part = |(first, rows): (usize, &[f64])| {
        let mut inputs = Vec::new();
        let mut memory = Memory::default();
        policy.seen.rows(rows, &mut inputs);
        let said = network.forward(&inputs, &mut memory, Pass::Kept(1)).clone();
        let mut upstream = vec![0.0; said.len()];
        let both = said.chunks_exact(outputs).zip(upstream.chunks_exact_mut(outputs)).enumerate();
        let sum: f64 = both.map(|(i, (said, by))| say(first * size + i, said, by)).sum();
        let found = match by {
            By::Parameters => network.backward(1, &upstream, &mut memory, false).0,
            By::Rows => network.backward_to_tokens(1, &upstream, &mut memory),
        };
        (found, sum)
    };
    let parts: Vec<_> = rows.par_chunks(size * width).enumerate().map(part).collect();
    let sum = parts.iter().map(|part| part.1).sum();
    let found = parts.iter().flat_map(|part| &part.0);
    if by == By::Rows {
        return (
            found.enumerate().map(|(i, g)| policy.seen.gradient(i % width, rows[i]) * f64::from(*g)).collect(),
            sum,
        );
    }
    let mut flat = vec![0.0; policy.flat.len()];
    parts.iter().for_each(|(part, _)| flat.iter_mut().zip(part).for_each(|(sum, g)| *sum += f64::from(*g)));
    (flat, sum)
}
