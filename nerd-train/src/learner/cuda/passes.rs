//! Forward passes over a plan's parts, the loss, and sums over rows. For a sum, each block writes a partial sum and a
//! second kernel adds these. The number of blocks depends on the sizes alone, so the order of a sum never changes.
//!
//! `w` is always the address of the parameters; their scales were folded before ([`Network::fold`]).

use std::ops::Range;

use nerd_cuda::Op as Operand;
use nerd_model::program::Activation;

use super::network::SUMS;
use super::*;

/// Computes an attention, from its number in the program and the addresses of `[q k v]` and of the output.
pub(super) type Attend<'a> = &'a dyn Fn(usize, u64, u64) -> DeviceResult;

/// Sizes of a product `x W`: rows of x, columns of x, columns of W.
#[derive(Clone, Copy)]
pub(super) struct Size {
    pub rows: usize,
    pub inner: usize,
    pub columns: usize,
}

/// Most blocks of a loss; each writes a partial sum.
const LOSS_BLOCKS: usize = 264;
/// Most rows of partial sums in [`Network::sum_rows`].
const CHUNKS: usize = 256;

/// Kernels of an activation, forward and backward.
pub(super) fn activation_kernels(f: Activation) -> [&'static str; 2] {
    match f {
        Activation::Gelu => ["gelu_forward", "gelu_backward"],
        Activation::Relu => ["relu_forward", "relu_backward"],
        Activation::Tanh => ["tanh_forward", "tanh_backward"],
        Activation::Elu => ["elu_forward", "elu_backward"],
    }
}

impl Network {
    /// Computes the values of all slots over `rows` windows, as the backward pass needs them.
    pub fn forward(&self, w: u64, rows: usize) -> DeviceResult {
        self.forward_from(self.at(Slot(0)), w, rows)
    }

    /// Like [`Network::forward`], for tokens at another address, padded as in slot 0.
    pub fn forward_from(&self, tokens: u64, w: u64, rows: usize) -> DeviceResult {
        let mut at = self.addresses();
        at[0] = tokens;
        self.run(w, 0..self.plan.parts.len(), &at, rows * self.plan.tokens, &|_, qkv, out| {
            self.attention(rows, qkv, out)
        })
    }

    /// Computes predictions for all tokens of `rows` windows. A fused kernel, if there is one, leaves all other slots
    /// unchanged.
    pub fn predict(&self, w: u64, rows: usize) -> DeviceResult {
        if let Some(whole) = &self.whole {
            let args = args![w, self.at(Slot(0)), self.predictions(), rows];
            let blocks = (rows.div_ceil(whole.windows), 1);
            return self.device.launch("whole_pass", blocks, (whole.threads, 1), whole.shared, &args);
        }
        self.forward(w, rows)
    }

    /// Computes predictions for one token of each window. The array at address `tokens` holds the index of this token
    /// by window.
    pub fn predict_one(&self, w: u64, rows: usize, tokens: u64) -> DeviceResult {
        if self.whole.is_some() && self.plan.tokens == 1 {
            return self.predict(w, rows);
        }
        let mut at = self.addresses();
        let first = self.plan.independent_from();
        let all = self.plan.parts.len();
        let attend = |_, qkv, out| self.attention(rows, qkv, out);
        self.run(w, 0..first, &at, rows * self.plan.tokens, &attend)?;
        for (slot, chosen) in &self.chosen {
            let args = args![at[slot.0], tokens, chosen, self.plan.width(*slot)];
            self.device.launch_blocks("select_rows", rows, 128, &args)?;
            at[slot.0] = chosen.ptr;
        }
        self.run(w, first..all, &at, rows, &attend)
    }

    /// Runs some parts over `n` rows of slots. `at` holds the address of each slot.
    pub(super) fn run(&self, w: u64, parts: Range<usize>, at: &[u64], n: usize, attend: Attend) -> DeviceResult {
        let plan = &self.plan;
        let optional = |weight: Option<Weight>| weight.map_or(0, |weight| self.tensor(w, weight));
        let mut attentions = 0;
        let mut shift = [0; 2];
        for i in parts {
            match plan.parts[i] {
                Part::Linear { from, to, weight, folded, add } => {
                    let size = Size { rows: n, inner: plan.program.width(from), columns: plan.width(to) };
                    let x = (at[from.0], plan.width(from));
                    self.linear(x, self.matrix(w, weight, folded), at[to.0], size, f32::from(u8::from(add)))?;
                }
                Part::Shift { bias, positions, fused: true, .. } => {
                    shift = [optional(bias), optional(positions)];
                    continue;
                }
                Part::Shift { slot, bias, positions, .. } => {
                    let width = plan.width(slot);
                    let count = n * plan.width(slot);
                    let args = args![at[slot.0], optional(bias), optional(positions), width, count];
                    self.device.launch_each("shift", count, 256, &args)?;
                }
                Part::Step(Step { from, to, op: Op::Attend { .. } }) => {
                    attend(attentions, at[from.0], at[to.0])?;
                    attentions += 1;
                }
                Part::Step(step) => self.run_step(i, step, [at[step.from.0], at[step.to.0]], n, shift)?,
            }
            shift = [0; 2];
        }
        Ok(())
    }

    /// Runs step number `i` of the parts, from `n` rows at `x` to rows at `y`. `shift` (bias and positions) is added to
    /// x first.
    fn run_step(&self, i: usize, step: Step, [x, y]: [u64; 2], n: usize, shift: [u64; 2]) -> DeviceResult {
        let d = &self.device;
        let from = self.plan.width(step.from);
        let to = self.plan.width(step.to);
        match step.op {
            Op::Norm => {
                let args = args![x, shift[0], shift[1], y, &self.saved[i], n];
                d.launch_blocks("norm_forward", n.div_ceil(8), 256, &args)
            }
            Op::Neighbours(apart) => {
                d.launch_each("neighbours_forward", n * to, 256, &args![x, y, from, apart, n * to])
            }
            Op::Activate(f) => {
                let quads = (n * to).div_ceil(4);
                d.launch_each(activation_kernels(f)[0], quads, 256, &args![x, shift[0], y, to, quads])
            }
            Op::Gate => {
                let quads = n * to / 4;
                d.launch_each("gate_forward", quads, 256, &args![x, y, to, quads])
            }
            // Products and positions are parts of other kinds, and `run` calls `attend` itself.
            Op::Linear { .. } | Op::Place(_) | Op::Attend { .. } => Ok(()),
        }
    }

    /// `y = x W + beta y`, with rows of x `stride` apart.
    ///
    /// cuBLAS is column-major and sees every array transposed, so it computes `y^T = W^T x^T`.
    pub(super) fn linear(&self, (x, stride): (u64, usize), w: u64, y: u64, size: Size, beta: f32) -> DeviceResult {
        let Size { rows, inner, columns } = size;
        let shape = (columns, rows, inner);
        self.device.product(
            Lane::Main,
            (Operand::Plain, Operand::Plain),
            shape,
            (w, columns),
            (x, stride),
            beta,
            (y, columns),
        )
    }

    fn attention(&self, windows: usize, qkv: u64, out: u64) -> DeviceResult {
        self.plan.attention.map_or(Ok(()), |a| a.forward(&self.device, windows, qkv, out, self.rotations.ptr))
    }

    /// Mean loss of the first `rows` rows ([`crate::learner::LearnerConfig::huber`]). Its gradient replaces the
    /// targets. The sum of squared errors is written after the end of the gradient vector at `g`.
    pub fn loss(&self, rows: usize, huber: Option<f32>, g: u64) -> DeviceResult {
        let numbers = rows * self.plan.tokens * self.plan.outputs();
        let scale = 2.0 / numbers as f32;
        let bend = huber.map_or(0.0, |d| (d * d).recip());
        let blocks = numbers.div_ceil(256).min(LOSS_BLOCKS);
        let args = args![self.predictions(), &self.targets, &self.partial_sums, numbers, scale, bend];
        self.device.launch_blocks("loss", blocks, 256, &args)?;
        self.column_sum(self.partial_sums.ptr, blocks, 1, g + 4 * self.plan.parameters() as u64)
    }

    /// Sums a gradient at `dy`, of `rows` windows and `width` columns. The sum over windows is the gradient of
    /// positions; the sum over all tokens is the gradient of a bias.
    pub fn sum_rows(
        &self,
        dy: u64,
        rows: usize,
        width: usize,
        bias: Option<u64>,
        positions: Option<u64>,
    ) -> DeviceResult {
        let tokens = self.plan.tokens;
        let (rows, columns) = if positions.is_some() { (rows, tokens * width) } else { (rows * tokens, width) };
        let chunks = rows.min(SUMS / columns).clamp(1, CHUNKS);
        let args = args![dy, rows, columns, &self.partial_sums];
        self.device.launch("row_partial", (columns.div_ceil(128), chunks), (128, 1), 0, &args)?;
        if let Some(sums) = positions.or(bias) {
            self.column_sum(self.partial_sums.ptr, chunks, columns, sums)?;
        }
        // A bias is added at every position.
        if let (Some(positions), Some(bias)) = (positions, bias) {
            self.column_sum(positions, tokens, width, bias)
        } else {
            Ok(())
        }
    }

    fn column_sum(&self, src: u64, rows: usize, width: usize, out: u64) -> DeviceResult {
        self.device.launch("column_sum", (width.div_ceil(32), 1), (32, 8), 0, &args![src, rows, width, out])
    }
}
