//! The plan of a program on a GPU: its steps as parts with kernels, and offsets of rows and parameters. `lowering.rs`
//! makes the plan.
//!
//! A scale is folded into the matrix after it, `W' = diag(w) W`, once per update. The gradients of W and w follow from
//! the gradient of `W'`: `dW = diag(w) dW'` and `dw_i = sum_j dW'_ij W_ij`.

use super::*;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// `y = x W'`, or `y += x W'`. `folded` is the offset of W' in the folded matrices; without one, W' is W.
    Linear { from: Slot, to: Slot, weight: Weight, folded: Option<usize>, add: bool },
    /// `x += bias + P[k]` for the token at position k, in place. If fused, the next part adds both as it reads x.
    Shift { slot: Slot, bias: Option<Weight>, positions: Option<Weight>, fused: bool },
    /// Any other step of the program.
    Step(Step),
}

/// A program for windows of a fixed number of tokens.
pub(crate) struct Plan {
    pub program: Program,
    pub tokens: usize,
    pub(super) parts: Vec<Part>,
    /// Offsets of tensors in the flat vector, then its length.
    pub starts: Vec<usize>,
    /// For each row of a folded matrix: offsets of the row of W, of its scale and of the row of W', and the number of
    /// columns.
    pub folds: Vec<[i32; 4]>,
    /// Number of floats in all folded matrices.
    pub folded: usize,
    /// Columns of a token on the GPU, padded to a multiple of four for cuBLAS.
    pub padded: usize,
    pub(super) attention: Option<Attention>,
    /// Width of all norms; 0 without a norm.
    pub norm: usize,
}

pub(super) struct Layout {
    /// Index of each slot's buffer.
    pub buffer_of: Vec<usize>,
    /// Floats in a row of each buffer.
    pub widths: Vec<usize>,
}

impl Plan {
    pub fn of(config: &TransformerConfig, tokens: usize) -> LearnResult<Self> {
        config.check()?;
        Self::new(config.program(), tokens)
    }

    /// A plan for one token at a time. Refuses a network that needs whole windows; banded attention uses stored keys
    /// and values.
    pub fn stream(config: &TransformerConfig) -> LearnResult<Self> {
        let plan = Self::of(config, 1)?;
        let streams = |op: &Op| match op {
            Op::Place(_) | Op::Neighbours(_) => false,
            Op::Attend { heads, band } => band.is_some() && config.embedding <= 32 * heads,
            Op::Linear { .. } | Op::Norm | Op::Activate(_) | Op::Gate => true,
        };
        if plan.program.steps.iter().all(|step| streams(&step.op)) {
            return Ok(plan);
        }
        Err(LearnError::Mismatch(format!(
            "on the device, frames one by one want a network that sees no windows, and heads of at most 32 columns: {config:?}"
        )))
    }

    pub fn parameters(&self) -> usize {
        self.starts.last().copied().unwrap_or(0)
    }

    pub fn inputs(&self) -> usize {
        self.program.width(Slot(0))
    }

    pub fn outputs(&self) -> usize {
        self.program.width(self.program.predictions())
    }

    /// Floats in a row of a slot on the GPU.
    pub fn width(&self, slot: Slot) -> usize {
        if slot == Slot(0) { self.padded } else { self.program.width(slot) }
    }

    /// Whether any activation of the program is fused with a bias.
    pub fn biased(&self) -> bool {
        let fused = |pair: &[Part]| {
            matches!(pair, [Part::Shift { fused: true, .. }, Part::Step(Step { op: Op::Activate(_), .. })])
        };
        self.parts.windows(2).any(fused)
    }

    /// Index of the first part after all mixing: from there on, no token depends on another or on its position.
    pub fn independent_from(&self) -> usize {
        let mixes = |part: &Part| match part {
            Part::Shift { positions, .. } => positions.is_some(),
            Part::Step(step) => matches!(step.op, Op::Attend { .. } | Op::Neighbours(_)),
            _ => false,
        };
        // The part fused with the positions belongs to the mixing parts.
        let next = |i: usize| i + 1 + usize::from(matches!(self.parts[i], Part::Shift { fused: true, .. }));
        self.parts.iter().rposition(mixes).map_or(0, next)
    }

    /// Slots that are live before part `first`: written by an earlier part, and read by `first` or a later part.
    pub fn live(&self, first: usize) -> Vec<Slot> {
        let slots = (0..self.program.widths.len()).map(Slot);
        let written = |slot: Slot| slot == Slot(0) || self.parts[..first].iter().any(|part| part.to() == slot);
        let read =
            |slot: Slot| self.parts[first..].iter().any(|part| part.reads(slot)) || slot == self.program.predictions();
        slots.filter(|slot| written(*slot) && read(*slot)).collect()
    }

    /// Assigns a buffer to each slot. With `keep`, for a backward pass, no buffer is shared; else slots share buffers
    /// while they are not live together.
    pub(super) fn layout(&self, keep: bool) -> Layout {
        let mut buffer_of = vec![usize::MAX; self.program.widths.len()];
        let mut widths = vec![self.padded];
        let mut free = Vec::new();
        buffer_of[0] = 0;
        for (i, part) in self.parts.iter().enumerate() {
            let to = part.to();
            let width = self.width(part.to());
            if buffer_of[to.0] == usize::MAX {
                let found = free.iter().position(|buffer| widths[*buffer] == width).map(|k| free.swap_remove(k));
                buffer_of[to.0] = found.unwrap_or_else(|| {
                    widths.push(width);
                    widths.len() - 1
                });
            }
            let done = |slot: &Slot| slot.0 > 0 && part.reads(*slot) && !self.live(i + 1).contains(slot);
            free.extend((0..buffer_of.len()).map(Slot).filter(done).filter(|_| !keep).map(|slot| buffer_of[slot.0]));
        }
        Layout { buffer_of, widths }
    }
}

impl Part {
    pub fn to(&self) -> Slot {
        match *self {
            Self::Linear { to, .. } | Self::Step(Step { to, .. }) | Self::Shift { slot: to, .. } => to,
        }
    }

    fn reads(&self, slot: Slot) -> bool {
        match *self {
            Self::Linear { from, to, add, .. } => from == slot || add && to == slot,
            Self::Step(Step { from, .. }) | Self::Shift { slot: from, .. } => from == slot,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use nerd_model::program::specimens::{TOKENS, networks, operations};

    use super::*;

    #[test]
    fn slots_that_share_a_buffer_are_never_live_together() {
        for specimen in operations().into_iter().chain(networks()) {
            let plan = Plan::new(specimen.program, TOKENS).expect("a plan");
            let Layout { buffer_of, widths } = plan.layout(false);
            for i in 0..plan.parts.len() {
                // The slot that part i writes is included: its buffer must not overlap its inputs.
                let slots: BTreeSet<usize> =
                    plan.live(i).into_iter().chain([plan.parts[i].to()]).map(|slot| slot.0).collect();
                let buffers: BTreeSet<usize> = slots.iter().map(|slot| buffer_of[*slot]).collect();
                assert_eq!(buffers.len(), slots.len(), "{}, part {i}", specimen.name);
                assert!(
                    slots.iter().all(|slot| widths[buffer_of[*slot]] == plan.width(Slot(*slot))),
                    "{}, part {i}",
                    specimen.name
                );
            }
        }
    }
}
