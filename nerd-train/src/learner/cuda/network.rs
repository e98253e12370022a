//! Forward passes over a program's parts, as kernels and matrix products on preallocated memory.
//!
//! Row-major `y = x W` with `x [n, i]`, `W [i, o]` is column-major `y^T = W^T x^T`, so cuBLAS sees every matrix transposed.

use std::cell::RefCell;
use std::ops::Range;

use nerd_cuda::Arg::{Float, Int, Long, Ptr};
use nerd_cuda::{Arg, Buffer, Device, DeviceError, Event, Lane, Op as Operand};
use nerd_model::device::{Products, whole_program};
use nerd_model::program::Op::{self, Attend};
use nerd_model::program::{Activation, Slot, Step, Weight};

use super::Precision;
use super::plan::{Part, Plan};
use super::source::source;
use crate::learner::LearnError;

/// Rows of partial sums of losses.
const LOSSES: usize = 264;
/// Floats of partial sums of rows, and most rows of them.
const SUMS: usize = 1 << 17;
const CHUNKS: usize = 256;

/// Mixes tokens; takes the number of the attention, `[q k v]`, and where mixed values go.
pub(super) type Mix<'a> = &'a dyn Fn(usize, u64, u64) -> Result<(), DeviceError>;

/// An activation's kernels, forward and back.
pub(super) fn kernels(f: Activation) -> [&'static str; 2] {
    match f {
        Activation::Gelu => ["gelu_forward", "gelu_backward"],
        Activation::Relu => ["relu_forward", "relu_backward"],
        Activation::Tanh => ["tanh_forward", "tanh_backward"],
        Activation::Elu => ["elu_forward", "elu_backward"],
    }
}

/// A matrix product's rows, inner size and columns.
pub(super) type Size = (usize, usize, usize);

/// Memory of the way back, taken in its first pass.
pub(super) struct Back {
    pub buffers: RefCell<Vec<(Buffer<f32>, Event)>>,
    pub fork: Event,
    pub join: Event,
}

impl Back {
    fn new(device: &Device) -> Result<Self, DeviceError> {
        Ok(Self { buffers: RefCell::default(), fork: device.event()?, join: device.event()? })
    }
}

/// A program on a device, with memory for `rows` windows.
pub(crate) struct Network {
    pub device: Device,
    pub plan: Plan,
    pub rows: usize,
    /// Targets `[rows][T][outputs]`; after a loss without a head, its gradient.
    pub targets: Buffer<f32>,
    /// Rows of slots: of tokens first, `[rows][T][padded]`.
    values: Vec<Buffer<f32>>,
    homes: Vec<usize>,
    /// Newest rows of the slots that parts after the last mixing one read.
    newest: Vec<(Slot, Buffer<f32>)>,
    folded: Buffer<f32>,
    table: Buffer<[i32; 4]>,
    pub turns: Buffer<[f32; 2]>,
    /// By part: of a norm reciprocal deviations; of a cell states found, what is kept, and the states' inputs to the gates.
    pub asides: Vec<Vec<Buffer<f32>>>,
    partial: Buffer<f32>,
    /// Threads of a block that makes whole passes of a small program, and how many windows it passes.
    whole: Option<[usize; 2]>,
    staging: Vec<f32>,
    pub(super) back: Option<Back>,
}

impl Network {
    /// On this process's GPU; `train` adds what the way back needs.
    pub fn new(plan: Plan, rows: usize, precision: Precision, train: bool) -> Result<Self, LearnError> {
        let (homes, widths) = plan.homes(train);
        // Kernels and products count entries, and launches their blocks, in 31 bits.
        let warps = plan.attention.map_or(32, |a| 32 * a.heads);
        let most = i32::MAX as usize / (plan.tokens * widths.iter().fold(warps, |most, width| most.max(*width)));
        if !(1..=most).contains(&rows) {
            return Err(LearnError::Mismatch(format!("{rows} rows at once: 1 to {most} fit the CUDA engine")));
        }
        let (text, kernels) = source(&plan);
        let mut device = Device::open(nerd_cuda::ordinal(), &text, &kernels)?.with_products(precision)?;
        // Older cards have no tensor cores for TF32.
        let tensor = precision != Precision::F32 && device.capability()? >= (8, 0);
        let products = if tensor { Products::Tf32 } else { Products::F32 };
        let whole = whole_program(&plan.program, plan.tokens, products);
        if let Some(whole) = &whole {
            device.add(&whole.text, &["whole_pass"])?;
        }
        let n = rows * plan.tokens;
        let zeros = |len: usize| device.zeros::<f32>(len.next_multiple_of(4));
        let aside = |part: &Part| -> Result<Vec<_>, DeviceError> {
            match *part {
                Part::Step(Step { op: Op::Norm, .. }) => Ok(vec![zeros(n)?]),
                Part::Step(Step { from, to, op: Op::Cell { .. } }) => {
                    let (wide, e) = (plan.width(from), plan.width(to));
                    Ok(vec![zeros(n * e)?, zeros(n * (wide + e))?, zeros(rows * wide)?])
                }
                _ => Ok(Vec::new()),
            }
        };
        let (mixing, windows) = (plan.mixing(), plan.tokens > 1 && !train);
        let newest = if windows { plan.open(mixing) } else { Vec::new() };
        let widest = plan.program.widths.iter().max().copied().unwrap_or(0);
        let partial = (LOSSES * plan.head_columns()).max(SUMS).max(plan.tokens * widest);
        Ok(Self {
            targets: zeros(n * plan.outputs())?,
            values: widths.iter().map(|width| zeros(n * width)).collect::<Result<_, _>>()?,
            homes,
            newest: newest.into_iter().map(|slot| Ok((slot, zeros(rows * plan.width(slot))?))).collect::<Result<_, DeviceError>>()?,
            folded: zeros(plan.folded)?,
            table: device.upload(&plan.table)?,
            turns: device.upload(&plan.attention.map_or(Vec::new(), |a| a.turns(&plan.program.frequencies)))?,
            asides: plan.parts.iter().map(aside).collect::<Result<_, _>>()?,
            partial: zeros(partial)?,
            whole: whole.map(|whole| [whole.threads, whole.windows]),
            staging: Vec::new(),
            back: if train { Some(Back::new(&device)?) } else { None },
            rows,
            plan,
            device,
        })
    }

    /// The same with parameters, whose scales are folded.
    pub fn with(plan: Plan, flat: &[f32], rows: usize, precision: Precision, train: bool) -> Result<(Self, Buffer<f32>), LearnError> {
        let parameters = plan.parameters();
        if flat.len() != parameters {
            return Err(LearnError::Mismatch(format!("{} weights for a network of {parameters}", flat.len())));
        }
        let network = Self::new(plan, rows, precision, train)?;
        let weights = network.device.upload(flat)?;
        network.fold(weights.ptr)?;
        Ok((network, weights))
    }

    /// Copies windows of so many tokens `[window][token][inputs]` to the device, where windows have all their tokens and rows are padded.
    /// What is missing is left from before.
    pub fn load(&mut self, inputs: &[f32], tokens: usize) -> Result<(), DeviceError> {
        let (width, padded, all) = (self.plan.inputs(), self.plan.padded, self.plan.tokens);
        self.staging.resize(self.staging.len().max(inputs.len() / width / tokens * all * padded), 0.0);
        for (window, staged) in inputs.chunks_exact(tokens * width).zip(self.staging.chunks_exact_mut(all * padded)) {
            let rows = window.chunks_exact(width).zip(staged.chunks_exact_mut(padded));
            rows.for_each(|(row, staged)| staged[..width].copy_from_slice(row));
        }
        self.device.write(&self.values[0], &self.staging)
    }

    pub fn at(&self, slot: Slot) -> u64 {
        // Slots inside a fused kernel have no rows.
        self.values.get(self.homes[slot.0]).map_or(0, |rows| rows.ptr)
    }

    /// Predictions after a pass, of as many rows as it had.
    pub fn predictions(&self) -> &Buffer<f32> {
        &self.values[self.homes[self.plan.program.predictions().0]]
    }

    /// A tensor of the flat vector at `base`.
    pub fn tensor(&self, base: u64, weight: Weight) -> u64 {
        base + 4 * self.plan.starts[weight.0] as u64
    }

    /// A matrix with its scale, of the parameters at `w`.
    pub fn matrix(&self, w: u64, weight: Weight, folded: Option<usize>) -> u64 {
        folded.map_or_else(|| self.tensor(w, weight), |at| self.folded.at(at))
    }

    /// Folds the scales of the parameters at `w` into the matrices that follow them.
    pub fn fold(&self, w: u64) -> Result<(), DeviceError> {
        self.each_row("fold", &[Ptr(w), Ptr(self.folded.ptr), Ptr(self.table.ptr)])
    }

    /// The same for gradients at `g`, back.
    pub fn unfold(&self, w: u64, g: u64) -> Result<(), DeviceError> {
        self.each_row("unfold", &[Ptr(w), Ptr(g), Ptr(self.table.ptr)])
    }

    fn each_row(&self, kernel: &str, args: &[Arg]) -> Result<(), DeviceError> {
        if self.table.len == 0 { Ok(()) } else { self.device.launch(kernel, (self.table.len, 1), (128, 1), 0, args) }
    }

    /// All parts over whole windows, but for a head.
    pub fn windows(&self, w: u64, rows: usize) -> Result<(), DeviceError> {
        self.windows_at(self.at(Slot(0)), w, rows)
    }

    /// The same for tokens elsewhere, padded as here.
    pub fn windows_at(&self, tokens: u64, w: u64, rows: usize) -> Result<(), DeviceError> {
        let (parts, mut at) = (self.plan.parts.len() - usize::from(self.plan.head().is_some()), self.addresses());
        at[0] = tokens;
        self.run(w, 0..parts, &at, rows * self.plan.tokens, &|_, qkv, out| self.attention(rows, qkv, out))
    }

    /// Predictions of windows: of all their tokens, or only of those whose numbers in their windows are at `last`. Of a small program
    /// nothing else is kept, and its products have 32 bits or those of TF32.
    pub fn predict(&self, w: u64, rows: usize, last: Option<u64>) -> Result<(), DeviceError> {
        if let (Some([threads, windows]), None) = (self.whole, last) {
            let args = [Ptr(w), Ptr(self.at(Slot(0))), Ptr(self.predictions().ptr), Int(rows)];
            return self.device.launch("whole_pass", (rows.div_ceil(windows), 1), (threads, 1), 0, &args);
        }
        let (mut at, mut n, mut first, all) = (self.addresses(), rows * self.plan.tokens, 0, self.plan.parts.len());
        let attend = |_, qkv, out| self.attention(rows, qkv, out);
        if let Some(last) = last {
            first = self.plan.mixing();
            self.run(w, 0..first, &at, n, &attend)?;
            n = rows;
            for (slot, newest) in &self.newest {
                let args = [Ptr(at[slot.0]), Ptr(last), Ptr(newest.ptr), Int(self.plan.width(*slot))];
                self.device.launch("select_rows", (rows, 1), (128, 1), 0, &args)?;
                at[slot.0] = newest.ptr;
            }
        }
        self.run(w, first..all, &at, n, &attend)
    }

    /// Some parts over `n` rows of slots at `at`.
    pub fn run(&self, w: u64, parts: Range<usize>, at: &[u64], n: usize, attend: Mix) -> Result<(), DeviceError> {
        let (plan, d) = (&self.plan, &self.device);
        let (mut attentions, mut shift) = (0, [Ptr(0); 2]);
        for i in parts {
            let x = |slot: Slot| Ptr(at[slot.0]);
            let optional = |weight: Option<Weight>| Ptr(weight.map_or(0, |weight| self.tensor(w, weight)));
            match plan.parts[i] {
                Part::Linear { from, to, weight, folded, add } => {
                    let size = (n, plan.program.width(from), plan.width(to));
                    let x = (at[from.0], plan.width(from));
                    self.linear(x, self.matrix(w, weight, folded), at[to.0], size, f32::from(u8::from(add)))?;
                }
                Part::Shift { bias, table, joined: true, .. } => {
                    shift = [optional(bias), optional(table)];
                    continue;
                }
                Part::Shift { at, bias, table, .. } => {
                    let (width, count) = (plan.width(at), n * plan.width(at));
                    let args = [x(at), optional(bias), optional(table), Int(width), Long(count as u64)];
                    self.each("shift", count, &args)?;
                }
                Part::Step(Step { from, to, op: Attend { .. } }) => {
                    attend(attentions, at[from.0], at[to.0])?;
                    attentions += 1;
                }
                Part::Step(step) => self.step(w, i, step, [at[step.from.0], at[step.to.0]], n, shift)?,
                Part::Head { from, to, bias } => {
                    let [b1, w2, b2] = self.head(w, bias).map(Ptr);
                    d.launch("head_predict", (n.div_ceil(8), 1), (256, 1), 0, &[x(from), b1, w2, b2, x(to), Int(n)])?;
                }
            }
            shift = [Ptr(0); 2];
        }
        Ok(())
    }

    /// The step that is part `i`, of rows at `x` to those at `y`; `shift` is added to what it reads.
    fn step(&self, w: u64, i: usize, step: Step, [x, y]: [u64; 2], n: usize, shift: [Arg; 2]) -> Result<(), DeviceError> {
        let (from, to) = (self.plan.width(step.from), self.plan.width(step.to));
        match step.op {
            Op::Norm => {
                let args = [Ptr(x), shift[0], shift[1], Ptr(y), Ptr(self.asides[i][0].ptr), Int(n)];
                self.device.launch("norm_forward", (n.div_ceil(8), 1), (256, 1), 0, &args)
            }
            Op::Neighbours(apart) => {
                self.each("neighbours_forward", n * to, &[Ptr(x), Ptr(y), Int(from), Int(apart), Long((n * to) as u64)])
            }
            Op::Activate(f) => {
                let quads = (n * to).div_ceil(4);
                self.each(kernels(f)[0], quads, &[Ptr(x), shift[0], Ptr(y), Int(to), Long(quads as u64)])
            }
            Op::Cell { weight, bias, lstm } => {
                let matrices = [weight, bias].map(|weight| self.tensor(w, weight));
                self.cell(&self.asides[i], (n / self.plan.tokens, to, lstm), matrices, (x, shift[0]), y)
            }
            // Parts of their own.
            Op::Linear { .. } | Op::Place(_) | Op::Attend { .. } => Ok(()),
        }
    }

    /// Squared error of the first `n` tokens against the targets, which are among `all` of a mean, after the gradient at `g`. Its
    /// gradient ([`crate::learner::LearnerConfig::huber`]) takes the place of targets, or of the hidden layer, and then the last three
    /// tensors have their gradients.
    pub fn loss(&self, w: u64, n: usize, all: usize, huber: Option<f32>, g: u64) -> Result<(), DeviceError> {
        let (outputs, partial) = (self.plan.outputs(), Ptr(self.partial.ptr));
        let bent = [Float(2.0 / (all * outputs) as f32), Float(huber.map_or(0.0, |d| (d * d).recip()))];
        if let Some(Part::Head { from, bias, .. }) = self.plan.parts.last().copied() {
            let (blocks, [b1, w2, b2]) = (n.div_ceil(8).min(LOSSES), self.head(w, bias).map(Ptr));
            let args = [Ptr(self.at(from)), b1, w2, b2, Ptr(self.targets.ptr), partial, Int(n), bent[0], bent[1]];
            self.device.launch("head_loss", (blocks, 1), (256, 1), 0, &args)?;
            return self.column_sum(self.partial.ptr, blocks, self.plan.head_columns(), self.tensor(g, bias));
        }
        let blocks = (n * outputs).div_ceil(256).min(LOSSES);
        let args = [Ptr(self.predictions().ptr), Ptr(self.targets.ptr), partial, Long((n * outputs) as u64), bent[0], bent[1]];
        self.device.launch("loss", (blocks, 1), (256, 1), 0, &args)?;
        self.column_sum(self.partial.ptr, blocks, 1, g + 4 * self.plan.parameters() as u64)
    }

    fn head(&self, w: u64, bias: Weight) -> [u64; 3] {
        [0, 1, 2].map(|k| self.tensor(w, Weight(bias.0 + k)))
    }

    /// Gradients of what is added to all tokens of so many windows, from the gradient at `dy`: of the places in a window, and of a bias.
    pub fn sum_rows(&self, dy: u64, (rows, width): (usize, usize), bias: Option<u64>, table: Option<u64>) -> Result<(), DeviceError> {
        let tokens = self.plan.tokens;
        let (rows, wide) = if table.is_some() { (rows, tokens * width) } else { (rows * tokens, width) };
        let chunks = rows.min(SUMS / wide).clamp(1, CHUNKS);
        let args = [Ptr(dy), Int(rows), Int(wide), Ptr(self.partial.ptr)];
        self.device.launch("row_partial", (wide.div_ceil(128), chunks), (128, 1), 0, &args)?;
        if let Some(sums) = table.or(bias) {
            self.column_sum(self.partial.ptr, chunks, wide, sums)?;
        }
        // A bias is added at every place.
        if let (Some(table), Some(bias)) = (table, bias) { self.column_sum(table, tokens, width, bias) } else { Ok(()) }
    }

    fn column_sum(&self, src: u64, rows: usize, width: usize, out: u64) -> Result<(), DeviceError> {
        self.device.launch("column_sum", (width.div_ceil(32), 1), (32, 8), 0, &[Ptr(src), Int(rows), Int(width), Ptr(out)])
    }

    /// A kernel of a thread for each of `count` things.
    pub fn each(&self, kernel: &str, count: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.device.launch(kernel, (count.div_ceil(256), 1), (256, 1), 0, args)
    }

    /// `y = x W + beta y`, `x [n, i]` with rows `ld` apart, `W [i, o]`.
    pub fn linear(&self, (x, ld): (u64, usize), w: u64, y: u64, (n, i, o): Size, beta: f32) -> Result<(), DeviceError> {
        self.device.product(Lane::Main, (Operand::Plain, Operand::Plain), (o, n, i), (w, o), (x, ld), beta, (y, o))
    }

    fn attention(&self, windows: usize, qkv: u64, out: u64) -> Result<(), DeviceError> {
        self.plan.attention.map_or(Ok(()), |a| a.forward(&self.device, windows, qkv, out, self.turns.ptr))
    }

    pub fn addresses(&self) -> Vec<u64> {
        (0..self.homes.len()).map(|slot| self.at(Slot(slot))).collect()
    }
}
