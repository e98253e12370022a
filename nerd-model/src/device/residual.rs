//! A residual network as one kernel, `whole_pass`, with f16 matrix products on tensor cores. This file makes the
//! kernel's text, and puts the weights in the order in which the kernel reads them.

use std::borrow::Cow;

use half::f16;
use nerd_sim::articulated::device::Text;

use super::whole::{Products, Whole, shape};
use crate::program::config::{Architecture, TransformerConfig};
use crate::{program::Program, program::op::padded};

/// Rows that a block computes, and warps of a block. The block keeps all sums in registers and reads every weight once.
const ROWS: usize = 64;
const WARPS: usize = 8;
/// Number of steps whose weights are prefetched; a step covers sixteen numbers of the inner dimension. Prefetching also
/// reads beyond the last step.
const AHEAD: usize = 4;
/// Inner dimensions are padded to a multiple of this, so that the prefetch ring makes whole turns.
const TURN: usize = 16 * AHEAD;

/// Whether f16 represents the matrices of a program's blocks exactly, as for models stored in f16.
pub fn held_in_f16(program: &Program, flat: &[f32]) -> bool {
    let tensors = program.tensors.iter().zip(program.starts());
    let mut blocks = tensors.filter(|(t, _)| t.shape.len() == 2 && t.name.starts_with("blocks."));
    blocks.all(|(t, at)| flat[at..at + t.len()].iter().all(|x| f16::from_f32(*x).to_f32() == *x))
}

/// The kernel of a residual network, if the network fits into the kernel.
pub(super) fn residual(program: &Program) -> Option<Whole> {
    let TransformerConfig { inputs, outputs, embedding: e, layers, .. } = shape(program, Architecture::Residual)?;
    if !e.is_multiple_of(8 * WARPS) || e > 256 || outputs > e {
        return None;
    }
    let taken = inputs.next_multiple_of(TURN);
    // Shared memory: normalised rows, two buffers of activations, two sums for each row and warp.
    let x = taken.max(e) + 8;
    let floats = ROWS * (x + x.max(2 * (e + 8))) / 2 + 2 * ROWS * WARPS;
    let mut text = Text::default();
    text.define([("T", 1), ("WINDOWS", ROWS), ("ROWS", ROWS), ("WARPS", WARPS), ("AHEAD", AHEAD), ("LAYERS", layers)]);
    text.define([("INPUTS", padded(inputs)), ("TAKEN", taken), ("E", e), ("OUTPUTS", outputs), ("FLOATS", floats)]);
    let text =
        [&text.0, include_str!("whole.cuh"), include_str!("whole_f16.cuh"), include_str!("whole_main.cuh")].concat();
    Some(Whole { text, threads: 32 * WARPS, windows: ROWS, shared: 4 * floats, products: Products::F16 })
}

impl Whole {
    /// The weights in the order in which the kernel reads them. Without f16 products, that order is the order of
    /// `flat`.
    pub fn packed<'a>(&self, program: &Program, flat: &'a [f32]) -> Cow<'a, [f32]> {
        if self.products == Products::F16 { packed(program, flat).into() } else { flat.into() }
    }
}

/// Packs the matrices, E columns wide and in order of use, as pairs of f16. Then come biases and norm weights, E
/// numbers each.
fn packed(program: &Program, flat: &[f32]) -> Vec<f32> {
    let e = program.steps.first().map_or(0, |step| program.width(step.to));
    let mut tensors =
        program.tensors.iter().zip(program.starts()).map(|(t, at)| (&t.shape[..], &flat[at..at + t.len()])).peekable();
    let mut words = Vec::new();
    let mut vectors = Vec::new();
    while let Some((shape, x)) = tensors.next() {
        match (shape, tensors.peek()) {
            ([_], _) => vectors.extend(x.iter().copied().chain(std::iter::repeat(0.0)).take(e)),
            // Gated units, E at a time with the two factors of a unit side by side; then the matrix that adds their
            // product to the residual stream.
            ([rows, wide], Some(([inner, _], down))) if *wide == 6 * e && *inner == 3 * e => {
                for k in 0..3 {
                    for first in [k * e, k * e + e / 2] {
                        let column = |c: usize| first + c / 2 + c % 2 * inner;
                        pack(&mut words, *rows, e, |row, c| f16::from_f32(x[row * wide + column(c)]));
                    }
                    pack(&mut words, e, e, |row, c| f16::from_f32(down[(k * e + row) * e + c]));
                }
                tensors.next();
            }
            // Files keep matrices outside the blocks in f32. So the f16 rounding residuals of matrix and row are
            // multiplied, too.
            ([rows, columns], _) => {
                for part in [f16::from_f32, |x| f16::from_f32(x - f16::from_f32(x).to_f32()), f16::from_f32] {
                    pack(
                        &mut words,
                        *rows,
                        e,
                        |row, c| if c < *columns { part(x[row * columns + c]) } else { f16::ZERO },
                    );
                }
            }
            _ => {}
        }
    }
    words.resize(words.len() + AHEAD * 8 * e, 0.0);
    [words, vectors].concat()
}

/// E columns of a matrix in the lane layout of mma.m16n8k16. Per step, tile of eight columns and lane: two pairs of
/// rows, eight rows apart.
fn pack(words: &mut Vec<f32>, rows: usize, e: usize, x: impl Fn(usize, usize) -> f16) {
    let at = |row: usize, c: usize| if row < rows { u32::from(x(row, c).to_bits()) } else { 0 };
    for (step, tile, lane) in (0..rows.next_multiple_of(TURN) / 16)
        .flat_map(|s| (0..e / 8).flat_map(move |t| (0..32).map(move |l| (s, t, l))))
    {
        let (row, c) = (16 * step + 2 * (lane % 4), 8 * tile + lane / 4);
        words.extend([row, row + 8].map(|row| f32::from_bits(at(row, c) | at(row + 1, c) << 16)));
    }
}
