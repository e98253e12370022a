//! Forward passes over a plan's parts, as kernels and matrix products.
//!
//! In all of them `w` is the address of the parameters, whose scales were folded before ([`Network::fold`]).

use std::ops::Range;

use nerd_cuda::Arg::{Int, Long, Ptr};
use nerd_cuda::{Arg, DeviceError, Lane, Op as Operand};
use nerd_model::program::{Activation, Op, Slot, Step, Weight};

use super::network::Network;
use super::plan::Part;

/// Computes an attention; takes its number in the program and the addresses of `[q k v]` and of its output.
pub(super) type Attend<'a> = &'a dyn Fn(usize, u64, u64) -> Result<(), DeviceError>;

/// Of a product `x W`: rows of x, columns of x, columns of W.
#[derive(Clone, Copy)]
pub(super) struct Size {
    pub rows: usize,
    pub inner: usize,
    pub columns: usize,
}

/// An activation's kernels, forward and backward.
pub(super) fn activation_kernels(f: Activation) -> [&'static str; 2] {
    match f {
        Activation::Gelu => ["gelu_forward", "gelu_backward"],
        Activation::Relu => ["relu_forward", "relu_backward"],
        Activation::Tanh => ["tanh_forward", "tanh_backward"],
        Activation::Elu => ["elu_forward", "elu_backward"],
    }
}

impl Network {
    /// Values of all slots over windows, as a backward pass needs them.
    pub fn forward(&self, w: u64, rows: usize) -> Result<(), DeviceError> {
        self.forward_from(self.at(Slot(0)), w, rows)
    }

    /// The same for tokens at another address, padded as slot 0 is.
    pub fn forward_from(&self, tokens: u64, w: u64, rows: usize) -> Result<(), DeviceError> {
        let mut at = self.addresses();
        at[0] = tokens;
        self.run(w, 0..self.plan.parts.len(), &at, rows * self.plan.tokens, &|_, qkv, out| self.attention(rows, qkv, out))
    }

    /// Predictions for all tokens of windows. The one kernel of a program that has one keeps no other slot.
    pub fn predict(&self, w: u64, rows: usize) -> Result<(), DeviceError> {
        if let Some(whole) = &self.whole {
            let args = [Ptr(w), Ptr(self.at(Slot(0))), Ptr(self.predictions().ptr), Int(rows)];
            return self.device.launch("whole_pass", (rows.div_ceil(whole.windows), 1), (whole.threads, 1), whole.shared, &args);
        }
        self.forward(w, rows)
    }

    /// Predictions for one token of each window, whose number in its window is at `tokens`.
    pub fn predict_one(&self, w: u64, rows: usize, tokens: u64) -> Result<(), DeviceError> {
        if self.whole.is_some() && self.plan.tokens == 1 {
            return self.predict(w, rows);
        }
        let (mut at, first, all) = (self.addresses(), self.plan.independent_from(), self.plan.parts.len());
        let attend = |_, qkv, out| self.attention(rows, qkv, out);
        self.run(w, 0..first, &at, rows * self.plan.tokens, &attend)?;
        for (slot, chosen) in &self.chosen {
            let args = [Ptr(at[slot.0]), Ptr(tokens), Ptr(chosen.ptr), Int(self.plan.width(*slot))];
            self.device.launch("select_rows", (rows, 1), (128, 1), 0, &args)?;
            at[slot.0] = chosen.ptr;
        }
        self.run(w, first..all, &at, rows, &attend)
    }

    /// Some parts over `n` rows of slots, whose addresses are in `at`.
    pub(super) fn run(&self, w: u64, parts: Range<usize>, at: &[u64], n: usize, attend: Attend) -> Result<(), DeviceError> {
        let plan = &self.plan;
        let optional = |weight: Option<Weight>| Ptr(weight.map_or(0, |weight| self.tensor(w, weight)));
        let (mut attentions, mut shift) = (0, [Ptr(0); 2]);
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
                    let (width, count) = (plan.width(slot), n * plan.width(slot));
                    let args = [Ptr(at[slot.0]), optional(bias), optional(positions), Int(width), Long(count as u64)];
                    self.launch_each("shift", count, &args)?;
                }
                Part::Step(Step { from, to, op: Op::Attend { .. } }) => {
                    attend(attentions, at[from.0], at[to.0])?;
                    attentions += 1;
                }
                Part::Step(step) => self.run_step(i, step, [at[step.from.0], at[step.to.0]], n, shift)?,
            }
            shift = [Ptr(0); 2];
        }
        Ok(())
    }

    /// The step that is part `i`, from `n` rows at `x` to rows at `y`; `shift`, a bias and positions, is added to x first.
    fn run_step(&self, i: usize, step: Step, [x, y]: [u64; 2], n: usize, shift: [Arg; 2]) -> Result<(), DeviceError> {
        let (from, to) = (self.plan.width(step.from), self.plan.width(step.to));
        match step.op {
            Op::Norm => {
                let args = [Ptr(x), shift[0], shift[1], Ptr(y), Ptr(self.saved[i].ptr), Int(n)];
                self.device.launch("norm_forward", (n.div_ceil(8), 1), (256, 1), 0, &args)
            }
            Op::Neighbours(apart) => {
                self.launch_each("neighbours_forward", n * to, &[Ptr(x), Ptr(y), Int(from), Int(apart), Long((n * to) as u64)])
            }
            Op::Activate(f) => {
                let quads = (n * to).div_ceil(4);
                self.launch_each(activation_kernels(f)[0], quads, &[Ptr(x), shift[0], Ptr(y), Int(to), Long(quads as u64)])
            }
            Op::Gate => {
                let quads = n * to / 4;
                self.launch_each("gate_forward", quads, &[Ptr(x), Ptr(y), Int(to), Long(quads as u64)])
            }
            // `run` has other parts for the first two, and calls `attend` for the third.
            Op::Linear { .. } | Op::Place(_) | Op::Attend { .. } => Ok(()),
        }
    }

    /// `y = x W + beta y`, where rows of x are `stride` apart.
    ///
    /// cuBLAS is column-major: what is `[rows, columns]` here is its transpose there, so it computes `y^T = W^T x^T`.
    pub(super) fn linear(&self, (x, stride): (u64, usize), w: u64, y: u64, size: Size, beta: f32) -> Result<(), DeviceError> {
        let Size { rows, inner, columns } = size;
        let shape = (columns, rows, inner);
        self.device.product(Lane::Main, (Operand::Plain, Operand::Plain), shape, (w, columns), (x, stride), beta, (y, columns))
    }

    fn attention(&self, windows: usize, qkv: u64, out: u64) -> Result<(), DeviceError> {
        self.plan.attention.map_or(Ok(()), |a| a.forward(&self.device, windows, qkv, out, self.rotations.ptr))
    }
}
