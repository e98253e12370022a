//! CPU engine for programs: forward over windows and streams, backward with respect to weights and tokens.
//!
//! Matrices are packed into panels when weights are loaded, with the preceding norms' weights folded in (`diag(w) W`).
//! Element-wise functions use the widest vectors of the processor. Results equal burn's up to rounding
//! (`tests/program.rs`).

mod activate;
mod attend;
mod backward;
mod elementwise;
mod matrix;
mod neighbours;

use attend::Attention;
pub(crate) use attend::Ring;
pub use elementwise::add;
use elementwise::normalize;
use matrix::Matrix;

use super::{Op, Program, Slot, Weight};

/// A program with weights.
#[derive(Default)]
pub struct Loaded {
    /// Operations and tensors of the network.
    pub program: Program,
    flat: Vec<f32>,
    starts: Vec<usize>,
    /// `diag(scale) W` of each step with a scale.
    folded: Vec<Vec<f32>>,
    /// By step: `panels` is its packed matrix, empty without a product; `back` is the transpose, packed at the first
    /// request.
    panels: Vec<Matrix>,
    back: Vec<std::sync::OnceLock<Matrix>>,
    /// For each slot, the last step that reads or writes it.
    ends: Vec<usize>,
    /// The last step that mixes tokens or adds positions.
    mixing: Option<usize>,
}

/// Activations of one thread; every pass reuses this memory.
#[derive(Default)]
pub struct Memory {
    /// Rows of each slot; after a pass that does not keep them, only the predictions.
    values: Vec<Vec<f32>>,
    /// Values of each step that the backward pass needs besides slots.
    aside: Vec<Vec<f32>>,
    spare: Vec<Vec<f32>>,
    attention: Attention,
    /// Packed gradients.
    gradients: Matrix,
}

/// Attention of a stream: receives the index of the attention in the program, and maps `[q k v]` to its output.
pub type Mix<'a> = &'a mut dyn FnMut(usize, &mut [f32], &mut Vec<f32>);

/// How tokens form windows, and which predictions are needed.
pub enum Pass<'a> {
    /// Windows of this many tokens; keeps everything for the backward pass.
    Kept(usize),
    /// Windows of this many tokens. Gives only the predictions of these rows, in ascending order, counted over all
    /// windows.
    Windows(usize, &'a [usize]),
    /// One new token per environment; the caller computes attention.
    Stream(Mix<'a>),
}

impl Loaded {
    /// Packs the matrices of `flat`.
    pub fn new(program: Program, flat: &[f32]) -> Self {
        let mut ends = vec![0; program.widths.len()];
        program
            .steps
            .iter()
            .enumerate()
            .for_each(|(i, step)| [step.from, step.to].iter().for_each(|slot| ends[slot.0] = i));
        let mixing = program
            .steps
            .iter()
            .rposition(|step| matches!(step.op, Op::Place(_) | Op::Attend { .. } | Op::Neighbours(_)));
        let starts = program.starts();
        let folded = vec![Vec::new(); program.steps.len()];
        let mut loaded = Self { program, starts, folded, ends, mixing, ..Self::default() };
        loaded.load(flat);
        loaded
    }

    /// Replaces the weights by `flat`, and packs the matrices again.
    pub fn load(&mut self, flat: &[f32]) {
        self.flat.clear();
        self.flat.extend_from_slice(flat);
        let mut folded = std::mem::take(&mut self.folded);
        self.panels =
            self.program.steps.iter().zip(&mut folded).map(|(step, folded)| self.cut(step.op, folded)).collect();
        self.folded = folded;
        self.back = self.program.steps.iter().map(|_| Default::default()).collect();
    }

    fn cut(&self, op: Op, folded: &mut Vec<f32>) -> Matrix {
        let Op::Linear { weight, scale, .. } = op else { return Matrix::default() };
        let inner = self.program.tensors[weight.0].shape[0];
        let values = self.tensor(weight);
        let Some(scale) = scale else { return Matrix::new(inner, values) };
        folded.clear();
        let rows = values.chunks_exact(values.len() / inner).zip(self.tensor(scale));
        rows.for_each(|(row, w)| folded.extend(row.iter().map(|x| x * w)));
        Matrix::new(inner, folded)
    }

    fn tensor(&self, weight: Weight) -> &[f32] {
        &self.flat[self.starts[weight.0]..self.starts[weight.0 + 1]]
    }

    /// Predictions `[row][outputs]` for tokens `[row][inputs]`. The result lies in `memory`.
    pub fn forward<'a>(&self, tokens: &[f32], memory: &'a mut Memory, mut pass: Pass) -> &'a mut Vec<f32> {
        memory.values.resize_with(self.program.widths.len(), Vec::new);
        memory.aside.resize_with(self.program.steps.len(), Vec::new);
        if memory.values[0].capacity() == 0 {
            memory.values[0] = taken(&mut memory.spare, tokens.len());
        }
        memory.values[0].clear();
        memory.values[0].extend_from_slice(tokens);
        // An activation step has swapped buffers with its input; swap back.
        for step in self.program.steps.iter().filter(|step| matches!(step.op, Op::Activate(_))) {
            if memory.values[step.from.0].capacity() == 0 {
                memory.values.swap(step.from.0, step.to.0);
            }
        }
        if self.mixing.is_none() {
            self.narrow(memory, &pass);
        }
        let mut attentions = 0..;
        for i in 0..self.program.steps.len() {
            self.step(i, &mut attentions, memory, &mut pass);
            if self.mixing == Some(i) {
                self.narrow(memory, &pass);
            }
        }
        &mut memory.values[self.program.predictions().0]
    }

    fn step(&self, i: usize, attentions: &mut impl Iterator<Item = usize>, memory: &mut Memory, pass: &mut Pass) {
        let super::Step { from, to, op } = self.program.steps[i];
        let width = self.program.width(from);
        let keep = matches!(pass, Pass::Kept(_));
        let Memory { values, aside, spare, attention, .. } = memory;
        let mut x = std::mem::take(&mut values[from.0]);
        let mut y = if to == from { Vec::new() } else { std::mem::take(&mut values[to.0]) };
        if y.capacity() == 0 && to != from && !keep && !matches!(op, Op::Activate(_)) {
            y = taken(spare, x.len() / width * self.program.width(to));
        }
        let aside = &mut aside[if keep { i } else { 0 }];
        match op {
            Op::Linear { bias, add, .. } => {
                let panels = &self.panels[i];
                let bias = bias.map(|bias| self.tensor(bias));
                match (add, bias) {
                    (false, _) => panels.product(&x, bias, &mut y),
                    (true, None) => panels.add_product(&x, &mut y),
                    (true, Some(bias)) => {
                        add_to_rows(&mut y, bias);
                        panels.add_product(&x, &mut y);
                    }
                }
            }
            Op::Place(table) => {
                let tokens = pass.tokens().unwrap_or(1);
                add_to_rows(&mut x, &self.tensor(table)[..tokens * width]);
            }
            Op::Norm => normalize(&x, width, &mut y, aside),
            Op::Attend { heads, band } => match pass {
                Pass::Stream(mix) => mix(attentions.next().unwrap_or(0), &mut x, &mut y),
                Pass::Kept(tokens) | Pass::Windows(tokens, _) => {
                    attention.shape(width / 3, heads, *tokens, band, &self.program.frequencies);
                    attention.forward(&mut x, aside, &mut y);
                }
            },
            Op::Neighbours(apart) => neighbours::forward(&x, width, pass.tokens().unwrap_or(1), apart, &mut y),
            Op::Activate(f) => activate::forward(f, keep, &mut x, &mut y),
            Op::Gate => activate::gate(&x, width, &mut y),
        }
        if !keep && self.ends[from.0] == i && x.capacity() > 0 {
            spare.push(std::mem::take(&mut x));
        }
        if to != from {
            values[to.0] = y;
        }
        values[from.0] = x;
    }

    /// Drops rows whose predictions are not needed, once no later step mixes tokens.
    fn narrow(&self, memory: &mut Memory, pass: &Pass) {
        let Pass::Windows(_, rows) = pass else { return };
        let newest = self.mixing.map_or(Slot(0), |i| self.program.steps[i].to);
        for (&width, x) in self.program.widths.iter().zip(&mut memory.values[..=newest.0]) {
            if x.len() > rows.len() * width {
                // Rows are ascending, so each is read before it is overwritten.
                rows.iter().enumerate().for_each(|(k, row)| x.copy_within(row * width..(row + 1) * width, k * width));
                x.truncate(rows.len() * width);
            }
        }
    }
}

impl Pass<'_> {
    /// Tokens per window; `None` for a stream.
    fn tokens(&self) -> Option<usize> {
        match self {
            Self::Kept(tokens) | Self::Windows(tokens, _) => Some(*tokens),
            Self::Stream(_) => None,
        }
    }
}

fn add_to_rows(x: &mut [f32], row: &[f32]) {
    x.chunks_exact_mut(row.len()).for_each(|x| add(x, row));
}

/// A spare buffer, preferably of this length: another would have to be filled first.
fn taken(spare: &mut Vec<Vec<f32>>, length: usize) -> Vec<f32> {
    let found = spare.iter().position(|s| s.len() == length).or(spare.len().checked_sub(1));
    found.map(|i| spare.swap_remove(i)).unwrap_or_default()
}
