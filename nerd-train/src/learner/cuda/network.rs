//! Memory of a program on a GPU, and the addresses of its buffers.
//!
//! The passes are in `passes.rs` and `backward.rs`, the plan that they follow in `plan.rs`.

use std::cell::RefCell;

use nerd_model::device::{Products, Whole, held_in_f16, whole_program};

use super::*;

/// Floats for partial sums over rows; a wider row gets more.
pub(super) const SUMS: usize = 1 << 17;

/// A program on a GPU, with memory for `rows` windows.
pub(crate) struct Network {
    pub device: Device,
    pub plan: Plan,
    /// Largest number of windows in a pass.
    pub rows: usize,
    /// Targets `[rows][T][outputs]`; after [`Network::loss`], the gradient of the loss with respect to the predictions.
    pub targets: Buffer<f32>,
    /// Values of slots. The first buffer holds the tokens, `[rows][T][padded]`.
    values: Vec<Buffer<f32>>,
    /// Index in `values` of each slot's buffer.
    buffer_of: Vec<usize>,
    /// Slots read after the last part that mixes tokens, with memory for one token of every window.
    pub(super) chosen: Vec<(Slot, Buffer<f32>)>,
    /// `folded`: matrices with folded scales. `folds`: [`Plan::folds`] on the device.
    folded: Buffer<f32>,
    folds: Buffer<[i32; 4]>,
    /// Cosine and sine of rotary positions.
    pub(super) rotations: Buffer<[f32; 2]>,
    /// Reciprocal standard deviations `[part][token]`; empty for a part that is no norm.
    pub(super) saved: Vec<Buffer<f32>>,
    pub(super) partial_sums: Buffer<f32>,
    /// Fused kernel for a whole pass, if the program has one.
    pub(super) whole: Option<Whole>,
    /// Padded tokens on the host, before upload.
    staging: Vec<f32>,
    pub(super) back: Option<BackwardMemory>,
}

pub(super) struct BackwardMemory {
    /// Buffers for gradients of slots, allocated in the first pass. Each event marks the end of the side stream's reads
    /// of its buffer.
    pub buffers: RefCell<Vec<(Buffer<f32>, Event)>>,
    pub fork: Event,
    pub join: Event,
}

impl Network {
    /// Opens the GPU and allocates memory. `train` adds memory for the backward pass.
    pub fn new(plan: Plan, rows: usize, precision: Precision, train: bool) -> LearnResult<Self> {
        let layout = plan.layout(train);
        // Kernels, products and launches count entries and blocks in 31 bits.
        let warps = plan.attention.map_or(32, |a| 32 * a.heads);
        let most = i32::MAX as usize / (plan.tokens * layout.widths.iter().fold(warps, |most, width| most.max(*width)));
        if !(1..=most).contains(&rows) {
            mismatch!("{rows} rows at once: 1 to {most} fit the CUDA engine");
        }
        let (text, kernels) = source(&plan);
        let mut device = Device::open(&text, &kernels)?.with_products(precision)?;
        let most = device.shared()?;
        let of = |products| whole_program(&plan.program, plan.tokens, products);
        // The f16 kernel needs compute capability 8. In training, the weights would have to be packed again after every
        // update.
        let half = precision == Precision::F16 && device.capability()? >= (8, 0) && !train;
        let whole = half
            .then(|| of(Products::F16).filter(|whole| whole.shared <= most))
            .flatten()
            .or_else(|| of(Products::F32));
        if let Some(whole) = &whole {
            device.add(&whole.text, &["whole_pass"])?;
        }
        let n = rows * plan.tokens;
        let zeros = |len: usize| device.zeros::<f32>(len.next_multiple_of(4));
        let saved = |part: &Part| zeros(if matches!(part, Part::Step(Step { op: Op::Norm, .. })) { n } else { 0 });
        let widest = plan.program.widths.iter().max().copied().unwrap_or(0);
        let partial_sums = SUMS.max(plan.tokens * widest);
        let chosen = if plan.tokens > 1 && !train { plan.live(plan.independent_from()) } else { Vec::new() };
        let back = || {
            Ok::<_, DeviceError>(BackwardMemory {
                buffers: RefCell::default(),
                fork: device.event()?,
                join: device.event()?,
            })
        };
        Ok(Self {
            targets: zeros(n * plan.outputs())?,
            values: layout.widths.iter().map(|width| zeros(n * width)).collect::<Result<_, _>>()?,
            buffer_of: layout.buffer_of,
            chosen: chosen
                .into_iter()
                .map(|slot| Ok((slot, zeros(rows * plan.width(slot))?)))
                .collect::<DeviceResult<_>>()?,
            folded: zeros(plan.folded)?,
            folds: device.upload(&plan.folds)?,
            rotations: device.upload(&plan.attention.map_or(Vec::new(), |a| a.rotations(&plan.program.frequencies)))?,
            saved: plan.parts.iter().map(saved).collect::<Result<_, _>>()?,
            partial_sums: zeros(partial_sums)?,
            whole,
            staging: Vec::new(),
            back: train.then(back).transpose()?,
            rows,
            plan,
            device,
        })
    }

    /// Like [`Network::new`], with the weights `flat` uploaded and their scales folded. F16 becomes F32 for weights
    /// that f16 cannot hold.
    pub fn with_weights(
        plan: Plan,
        flat: &[f32],
        rows: usize,
        precision: Precision,
        train: bool,
    ) -> LearnResult<(Self, Buffer<f32>)> {
        let parameters = plan.parameters();
        if flat.len() != parameters {
            mismatch!("{} weights for a network of {parameters}", flat.len());
        }
        let exact = precision != Precision::F16 || held_in_f16(&plan.program, flat);
        let network = Self::new(plan, rows, if exact { precision } else { Precision::F32 }, train)?;
        if let Some(whole) = &network.whole {
            let weights = network.device.upload(&whole.packed(&network.plan.program, flat))?;
            return Ok((network, weights));
        }
        let weights = network.device.upload(flat)?;
        network.fold(weights.ptr)?;
        Ok((network, weights))
    }

    /// Uploads `inputs`, windows of `tokens` tokens each, to slot 0. In slot 0 every window has memory for
    /// `plan.tokens` tokens, and rows are padded. The rest of slot 0 keeps its values.
    pub fn load(&mut self, inputs: &[f32], tokens: usize) -> DeviceResult {
        let width = self.plan.inputs();
        let padded = self.plan.padded;
        let all = self.plan.tokens;
        self.staging.resize(self.staging.len().max(inputs.len() / width / tokens * all * padded), 0.0);
        for (window, staged) in inputs.chunks_exact(tokens * width).zip(self.staging.chunks_exact_mut(all * padded)) {
            let rows = window.chunks_exact(width).zip(staged.chunks_exact_mut(padded));
            rows.for_each(|(row, staged)| staged[..width].copy_from_slice(row));
        }
        self.device.write(&self.values[0], &self.staging)
    }

    pub fn at(&self, slot: Slot) -> u64 {
        self.values[self.buffer_of[slot.0]].ptr
    }

    pub(super) fn addresses(&self) -> Vec<u64> {
        (0..self.buffer_of.len()).map(|slot| self.at(Slot(slot))).collect()
    }

    /// Predictions of the last pass, in the first rows of the buffer.
    pub fn predictions(&self) -> &Buffer<f32> {
        &self.values[self.buffer_of[self.plan.program.predictions().0]]
    }

    /// Address of a tensor in the flat vector of parameters or gradients at `base`.
    pub(super) fn tensor(&self, base: u64, weight: Weight) -> u64 {
        base + 4 * self.plan.starts[weight.0] as u64
    }

    /// Address of a matrix of the parameters at `w`, with its scale folded in where it has one.
    pub(super) fn matrix(&self, w: u64, weight: Weight, folded: Option<usize>) -> u64 {
        folded.map_or_else(|| self.tensor(w, weight), |at| self.folded.at(at))
    }

    /// Folds the scales of the parameters at `w` into the matrices behind them.
    pub fn fold(&self, w: u64) -> DeviceResult {
        self.each_fold("fold", &args![w, &self.folded, &self.folds])
    }

    /// Turns gradients at `g` with respect to folded matrices into gradients of matrices and scales.
    pub(super) fn unfold(&self, w: u64, g: u64) -> DeviceResult {
        self.each_fold("unfold", &args![w, g, &self.folds])
    }

    fn each_fold(&self, kernel: &str, args: &[Arg]) -> DeviceResult {
        if self.folds.len == 0 { Ok(()) } else { self.device.launch_blocks(kernel, self.folds.len, 128, args) }
    }
}

/// Source and kernel names for the program's operations. The source begins with the program's shapes.
fn source(plan: &Plan) -> (String, Vec<&'static str>) {
    let Plan { tokens, padded, norm, attention, .. } = plan;
    let (inputs, outputs) = (plan.inputs(), plan.outputs());
    let any = |is: fn(&Op) -> bool| plan.program.steps.iter().any(|step| is(&step.op));
    let texts = [
        (true, include_str!("kernels/common.cu")),
        (true, include_str!("kernels/optimiser.cu")),
        (*norm > 0, include_str!("kernels/norm.cu")),
        (attention.is_some(), include_str!("kernels/attention.cu")),
        (any(|op| matches!(op, Op::Activate(_))), include_str!("kernels/activate.cu")),
        (any(|op| matches!(op, Op::Gate)), include_str!("kernels/gate.cu")),
        (any(|op| matches!(op, Op::Neighbours(_))), include_str!("kernels/neighbours.cu")),
    ];
    let texts = texts.into_iter().filter(|(has, _)| *has).map(|(_, text)| text).collect_vec();
    let constants = format!(
        "constexpr int T = {tokens}, IN = {inputs}, LDX = {padded}, OUT = {outputs}, NORM = {norm};\n\
         constexpr bool BIASED = {};\n{}\n",
        plan.biased(),
        attention.map_or(String::new(), |attention| attention.constants()),
    );
    (constants + &texts.concat(), texts.into_iter().flat_map(kernels).collect())
}

/// Names of the kernels in a source.
pub(crate) fn kernels(text: &'static str) -> impl Iterator<Item = &'static str> {
    text.split("extern \"C\" __global__ void ").skip(1).filter_map(|rest| rest.split('(').next())
}
