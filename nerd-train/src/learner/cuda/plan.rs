//! The plan of a program on a device: fused operations, the kernels' constants, places of rows and parameters.
//!
//! A scale is folded into the matrix that follows it, `W' = diag(w) W`, once an update. Both gradients follow from that of `W'`:
//! `dW = diag(w) dW'` and `dw_i = sum_j dW'_ij W_ij`. Biases and positions are added by the next kernel where there is one, and a last
//! hidden layer is one kernel with its loss.

use nerd_model::program::{Activation, Op, Program, Slot, Step, Weight};
use nerd_model::transformer::TransformerConfig;

use super::attention::Attention;
use crate::learner::LearnError;

/// Floats that a block's fixed shared memory has room for in the head.
const HEAD: usize = 12 << 10;

/// Steps that are computed together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// `y = x W'`, or `y += x W'`; without an offset in the folded vector, W' is W.
    Linear { from: Slot, to: Slot, weight: Weight, folded: Option<usize>, add: bool },
    /// `x += bias + P[k]` in place, or while the next part reads it, if it is joined to that.
    Shift { at: Slot, bias: Option<Weight>, table: Option<Weight>, joined: bool },
    /// Any other step.
    Step(Step),
    /// Predictions `relu(z + bias) W + c`, W and c being the last tensors, after the bias.
    Head { from: Slot, to: Slot, bias: Weight },
}

/// A program for windows of so many tokens.
pub(crate) struct Plan {
    pub program: Program,
    pub tokens: usize,
    pub(super) parts: Vec<Part>,
    /// Offsets of tensors, and the number of parameters.
    pub starts: Vec<usize>,
    /// Of each folded row: offsets of W, w and W', and columns.
    pub table: Vec<[i32; 4]>,
    pub folded: usize,
    /// Columns of a token on the device: cuBLAS likes rows aligned.
    pub padded: usize,
    pub(super) attention: Option<Attention>,
    /// Columns of rows that are normed, if any are.
    pub norm: usize,
}

impl Plan {
    /// Of a network's program; a hidden layer at its end is one kernel.
    pub fn of(config: &TransformerConfig, tokens: usize) -> Result<Self, LearnError> {
        config.check().map_err(LearnError::Mismatch)?;
        Self::new(config.program(), tokens, true)
    }

    /// For one token at a time.
    pub fn stream(config: &TransformerConfig) -> Result<Self, LearnError> {
        let plan = Self::of(config, 1)?;
        let alone = |op: &Op| match op {
            Op::Place(_) | Op::Neighbours(_) | Op::Cell { .. } => false,
            Op::Attend { heads, band } => band.is_some() && config.embedding <= 32 * heads,
            Op::Linear { .. } | Op::Norm | Op::Activate(_) => true,
        };
        match plan.program.steps.iter().all(|step| alone(&step.op)) {
            true => Ok(plan),
            false => Err(LearnError::Mismatch(format!(
                "on the device, frames one by one want a network that sees no windows, and heads of at most 32 columns: {config:?}"
            ))),
        }
    }

    /// Refuses what the kernels do not cover; `head`: whether a last hidden layer may be one kernel.
    pub fn new(program: Program, tokens: usize, head: bool) -> Result<Self, LearnError> {
        let (starts, padded) = (program.starts(), program.width(Slot(0)).next_multiple_of(4));
        let mut plan = Self { tokens, parts: Vec::new(), starts, table: Vec::new(), folded: 0, padded, attention: None, norm: 0, program };
        // Kernels count entries of the flat vector in 31 bits.
        if plan.parameters() > i32::MAX as usize / 4 {
            return Err(LearnError::Mismatch(format!("{} parameters are too many for the CUDA engine", plan.parameters())));
        }
        for i in 0..plan.program.steps.len() {
            plan.add(i)?;
        }
        for i in 1..plan.parts.len() {
            let (next, steps) = (plan.parts[i], &plan.program.steps);
            let Part::Shift { at, table, joined, .. } = &mut plan.parts[i - 1] else { continue };
            let alone = table.is_none() && steps.iter().filter(|step| step.from == *at).count() == 1;
            *joined = match next {
                Part::Step(Step { from, op: Op::Norm, .. }) => from == *at,
                Part::Step(Step { from, op: Op::Activate(_) | Op::Cell { .. }, .. }) => from == *at && alone,
                _ => false,
            };
        }
        if head {
            plan.join_head();
        }
        match plan.mixing() < plan.parts.len() {
            true => Ok(plan),
            false => Err(LearnError::Mismatch("the CUDA engine needs a last operation in which tokens are independent".into())),
        }
    }

    fn add(&mut self, i: usize) -> Result<(), LearnError> {
        let step = self.program.steps[i];
        let (from, to) = (step.from, step.to);
        let refuse = |what: &str| Err(LearnError::Mismatch(format!("{what} for the CUDA engine")));
        if from == Slot(0) && !matches!(step.op, Op::Linear { .. }) || to == Slot(0) {
            return refuse("tokens go through a product first");
        }
        // Norms and products alone add to a gradient.
        let meets = |other: &&Step| match other.op {
            Op::Place(_) => false,
            Op::Linear { add: true, .. } => [other.from, other.to].contains(&from),
            _ => other.from == from,
        };
        if self.program.steps.iter().filter(meets).count() > 1 && !matches!(step.op, Op::Linear { .. } | Op::Norm | Op::Place(_)) {
            return refuse("what several steps read, or add to, is read by norms and products alone");
        }
        // On the way back a product asks for what it read, which must still be there.
        let changes = |later: &Step| later.to == from && matches!(later.op, Op::Linear { add: true, .. } | Op::Place(_));
        if matches!(step.op, Op::Linear { .. }) && self.program.steps[i + 1..].iter().any(changes) {
            return refuse("what a later step changes is read by norms alone");
        }
        match step.op {
            Op::Linear { weight, scale, bias, add } => {
                let folded = scale.map(|scale| self.fold(weight, scale));
                self.parts.push(Part::Linear { from, to, weight, folded, add });
                self.parts.extend(bias.map(|bias| Part::Shift { at: to, bias: Some(bias), table: None, joined: false }));
                return Ok(());
            }
            Op::Place(place) => {
                match self.parts.last_mut() {
                    Some(Part::Shift { at, table: table @ None, .. }) if *at == to => *table = Some(place),
                    _ => self.parts.push(Part::Shift { at: to, bias: None, table: Some(place), joined: false }),
                }
                return Ok(());
            }
            Op::Norm => {
                let width = self.program.width(to);
                if !width.is_multiple_of(2) || ![0, width].contains(&self.norm) {
                    return refuse("norms have one width, an even one,");
                }
                self.norm = width;
            }
            Op::Attend { heads, band } => {
                let attention = Attention::new(self.program.width(to), heads, band, self.tokens)?;
                if self.attention.is_some_and(|one| one != attention) {
                    return refuse("attentions have one shape");
                }
                self.attention = Some(attention);
            }
            Op::Neighbours(_) | Op::Activate(_) | Op::Cell { .. } => {}
        }
        self.parts.push(Part::Step(step));
        Ok(())
    }

    fn fold(&mut self, weight: Weight, scale: Weight) -> usize {
        let shape = &self.program.tensors[weight.0].shape;
        let (at, rows, columns) = (self.folded, shape[0], shape[1]);
        let row = |r: usize| [self.starts[weight.0] + r * columns, self.starts[scale.0] + r, at + r * columns, columns];
        self.table.extend((0..rows).map(row).map(|entries| entries.map(|x| x as i32)));
        self.folded += rows * columns;
        at
    }

    /// A hidden layer with relu before the last product is one kernel, if that has room.
    fn join_head(&mut self) {
        let count = self.program.tensors.len();
        let [
            ..,
            Part::Linear { .. },
            Part::Shift { at, bias: Some(bias), .. },
            relu,
            last,
            Part::Shift { at: to, bias: Some(end), table: None, .. },
        ] = self.parts[..]
        else {
            return;
        };
        let Part::Linear { weight, folded: None, add: false, .. } = last else { return };
        let (hidden, outputs) = (self.program.width(at), self.program.width(to));
        let (relu, tail) =
            (matches!(relu, Part::Step(Step { from, op: Op::Activate(Activation::Relu), .. }) if from == at), [bias, weight, end]);
        if relu && tail.map(|w| w.0 + 3) == [count, count + 1, count + 2] && hidden * (outputs + 1) + outputs < HEAD {
            self.parts.truncate(self.parts.len() - 4);
            self.parts.push(Part::Head { from: at, to, bias });
        }
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

    /// Floats of a row of a slot on the device.
    pub fn width(&self, slot: Slot) -> usize {
        if slot == Slot(0) { self.padded } else { self.program.width(slot) }
    }

    /// Whether an activation adds a bias to what it reads.
    pub fn biased(&self) -> bool {
        let joined = |pair: &[Part]| matches!(pair, [Part::Shift { joined: true, .. }, Part::Step(Step { op: Op::Activate(_), .. })]);
        self.parts.windows(2).any(joined)
    }

    /// Width of the hidden layer that is one kernel with its loss.
    pub fn head(&self) -> Option<usize> {
        self.parts.iter().find_map(|part| if let Part::Head { from, .. } = part { Some(self.program.width(*from)) } else { None })
    }

    /// Columns of a row of its gradients and squared error.
    pub fn head_columns(&self) -> usize {
        self.head().map_or(1, |hidden| (hidden + 1) * (self.outputs() + 1))
    }

    /// The number of parts in which tokens look at each other or at their places, and of those before them.
    pub fn mixing(&self) -> usize {
        let mixes = |part: &Part| match part {
            Part::Shift { table, .. } => table.is_some(),
            Part::Step(step) => matches!(step.op, Op::Attend { .. } | Op::Neighbours(_) | Op::Cell { .. }),
            _ => false,
        };
        // A part fused with the next one is done with that.
        self.parts.iter().rposition(mixes).map_or(0, |i| i + 1 + usize::from(matches!(self.parts[i], Part::Shift { joined: true, .. })))
    }

    /// Slots that parts from `first` on read though others wrote them.
    pub fn open(&self, first: usize) -> Vec<Slot> {
        let slots = (0..self.program.widths.len()).map(Slot);
        let written = |slot: Slot| slot == Slot(0) || self.parts[..first].iter().any(|part| part.to() == slot);
        let read = |slot: Slot| self.parts[first..].iter().any(|part| part.reads(slot)) || slot == self.program.predictions();
        slots.filter(|slot| written(*slot) && read(*slot)).collect()
    }

    /// The buffer of each slot, and the floats of a row of each buffer. Slots share one if one is done before the other begins, unless all
    /// are to be kept.
    pub fn homes(&self, keep: bool) -> (Vec<usize>, Vec<usize>) {
        let (mut homes, mut widths, mut free) = (vec![usize::MAX; self.program.widths.len()], vec![self.padded], Vec::new());
        homes[0] = 0;
        for (i, part) in self.parts.iter().enumerate() {
            let (to, width) = (part.to(), self.width(part.to()));
            if homes[to.0] == usize::MAX {
                let found = free.iter().position(|home| widths[*home] == width).map(|k| free.swap_remove(k));
                homes[to.0] = found.unwrap_or_else(|| {
                    widths.push(width);
                    widths.len() - 1
                });
            }
            let done = |slot: &Slot| slot.0 > 0 && part.reads(*slot) && !self.open(i + 1).contains(slot);
            free.extend((0..homes.len()).map(Slot).filter(done).filter(|_| !keep).map(|slot| homes[slot.0]));
        }
        (homes, widths)
    }
}

impl Part {
    pub fn to(&self) -> Slot {
        match *self {
            Self::Linear { to, .. } | Self::Step(Step { to, .. }) | Self::Head { to, .. } | Self::Shift { at: to, .. } => to,
        }
    }

    fn reads(&self, slot: Slot) -> bool {
        match *self {
            Self::Linear { from, to, add, .. } => from == slot || add && to == slot,
            Self::Step(Step { from, .. }) | Self::Head { from, .. } | Self::Shift { at: from, .. } => from == slot,
        }
    }
}

#[cfg(test)]
mod tests {
    use nerd_model::program::specimens::{TOKENS, networks, operations};
    use nerd_model::transformer::Init;

    use super::*;

    #[test]
    fn what_has_no_kernel_is_refused() {
        let refused = |build: fn(&mut Program, Slot)| {
            let mut p = Program::new(3);
            let x = p.linear("first", p.tokens(), 42, [Init::Constant(0.0); 2]);
            build(&mut p, x);
            let y = p.predictions();
            p.linear("last", y, 2, [Init::Constant(0.0); 2]);
            Plan::new(p, TOKENS, true).err().map(|e| e.to_string())
        };
        let all: [fn(&mut Program, Slot); 4] = [
            // Heads of seven columns; a slot that two steps read which add to no gradient; norms of two widths; a product that
            // reads what a later step adds to.
            |p, x| _ = p.then(x, 14, Op::Attend { heads: 2, band: None }),
            |p, x| _ = [Activation::Gelu, Activation::Relu].map(|f| p.then(x, 42, Op::Activate(f))),
            |p, x| _ = (p.normed("a", "b", x, 10, Init::Constant(0.0)), p.normed("c", "d", Slot(3), 8, Init::Constant(0.0))),
            |p, x| {
                let y = p.linear("other", x, 42, [Init::Constant(0.0); 2]);
                let z = p.then(y, 42, Op::Activate(Activation::Gelu));
                p.residual("back", z, x, Init::Constant(0.0));
            },
        ];
        for (i, build) in all.into_iter().enumerate() {
            let error = refused(build);
            assert!(error.as_ref().is_some_and(|error| !error.contains('\n')), "{i}: {error:?}");
        }
        assert_eq!(refused(|_, _| {}), None);
    }

    #[test]
    fn slots_that_share_a_buffer_are_never_open_together() {
        for specimen in operations().into_iter().chain(networks()) {
            let plan = Plan::new(specimen.program, TOKENS, true).expect("a plan");
            let (homes, widths) = plan.homes(false);
            for i in 0..plan.parts.len() {
                // What is read now may not be written over by the same part.
                let open = plan.open(i).into_iter().chain([plan.parts[i].to()]).map(|slot| slot.0);
                let slots: std::collections::BTreeSet<usize> = open.filter(|slot| homes[*slot] != usize::MAX).collect();
                let buffers: std::collections::BTreeSet<usize> = slots.iter().map(|slot| homes[*slot]).collect();
                assert_eq!(buffers.len(), slots.len(), "{}, part {i}", specimen.name);
                assert!(slots.iter().all(|slot| widths[homes[*slot]] == plan.width(Slot(*slot))), "{}, part {i}", specimen.name);
            }
        }
    }
}
