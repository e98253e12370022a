//! One update on a GPU, kernel by kernel: what it reads, what it writes, and in which order.

use std::ops::Range;

use nerd_model::program::Slot;

use super::muon::{Muon, Vectors};
use super::network::Network;
use crate::learner::{LearnError, LearnerConfig};
use nerd_cuda::Arg::{Double, Float, Int, Long, Ptr};
use nerd_cuda::{Buffer, Graph, Sums};

/// Blocks of the gradient norm's first stage.
pub(super) const NORM_BLOCKS: usize = 528;

/// Mirror of the struct in `kernels/common.cu`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(super) struct Scalars {
    pub step: u64,
    pub bad_step: u64,
    pub count: u64,
    pub loss_sum: f64,
    pub norm_sum: f64,
    pub lr: f32,
    pub bad_loss: f32,
    pub scale: f32,
    pub rate: f32,
    pub root: f32,
    pub blend: f32,
}

/// Windows on the device.
pub(super) struct Data {
    pub x: Buffer<f32>,
    pub y: Buffer<f32>,
    pub windows: usize,
    pub per: usize,
    pub frames: usize,
}

/// What one update reads and writes.
pub(super) struct Step {
    pub network: Network,
    pub config: LearnerConfig,
    /// Of the batch.
    pub rows: Range<usize>,
    /// Over ranks.
    pub sums: Option<Sums>,
    pub train: Data,
    pub weights: Buffer<f32>,
    pub average: Buffer<f32>,
    pub m: Buffer<f32>,
    pub v: Buffer<f32>,
    /// Gradients, and behind them the squared error.
    pub gradients: Buffer<f32>,
    pub norms: Buffer<f32>,
    pub scalars: Buffer<Scalars>,
    pub muon: Option<Muon>,
}

impl Step {
    /// From the sum of squared errors to the loss.
    pub fn mean(&self) -> f32 {
        let plan = &self.network.plan;
        1.0 / (self.config.batch * plan.tokens * plan.outputs()) as f32
    }

    pub fn gradient(&self) -> Result<(), LearnError> {
        let (net, w, g, rows) = (&self.network, self.weights.ptr, self.gradients.ptr, self.rows.len());
        let LearnerConfig { batch, seed, huber, .. } = self.config;
        gather(net, &self.train, rows, Choice::Drawn { scalars: self.scalars.ptr, seed, first: self.rows.start })?;
        net.fold(w)?;
        net.windows(w, rows)?;
        net.loss(w, rows * net.plan.tokens, batch * net.plan.tokens, huber, g)?;
        Ok(net.backward(w, g, rows, None)?)
    }

    /// Adds up the gradients and squared errors of all ranks.
    fn sum(&self) -> Result<(), LearnError> {
        self.sums.as_ref().map_or(Ok(()), |sums| Ok(sums.sum(&self.network.device, &self.gradients)?))
    }

    pub fn all(&self) -> Result<(), LearnError> {
        self.gradient()?;
        self.sum()?;
        let (d, p, s) = (&self.network.device, self.network.plan.parameters(), Ptr(self.scalars.ptr));
        let [w, g, m, v, a] = [&self.weights, &self.gradients, &self.m, &self.v, &self.average].map(|b| Ptr(b.ptr));
        d.launch("square_partial", (NORM_BLOCKS, 1), (256, 1), 0, &[g, Long(p as u64), Ptr(self.norms.ptr)])?;
        let args = [
            Ptr(self.norms.ptr),
            Int(NORM_BLOCKS),
            Ptr(self.gradients.at(p)),
            Float(self.mean()),
            Float(self.config.clip),
            Double(self.config.average),
            s,
        ];
        d.launch("finish", (1, 1), (256, 1), 0, &args)?;
        let hidden = Ptr(self.muon.as_ref().map_or(0, |muon| muon.entries.ptr));
        d.launch("adam", (p.div_ceil(256), 1), (256, 1), 0, &[w, g, m, v, a, s, Long(p as u64), hidden])?;
        let Some(muon) = &self.muon else { return Ok(()) };
        let [weights, gradients, m, average] = [&self.weights, &self.gradients, &self.m, &self.average].map(|b| b.ptr);
        Ok(muon.update(d, &Vectors { weights, gradients, m, average, scalars: self.scalars.ptr })?)
    }

    /// The whole update as one graph. A gradient first, so that cuBLAS has loaded what it needs, and NCCL is connected.
    pub fn capture(&self) -> Result<Graph, LearnError> {
        self.gradient()?;
        self.sum()?;
        self.network.device.wait()?;
        self.network.device.capture(|| self.all())
    }
}

/// Which windows.
pub(super) enum Choice {
    /// Those of the update counted in `scalars`, from row `first` of the batch on.
    Drawn { scalars: u64, seed: u64, first: usize },
    /// Those of the numbers from this address on.
    These(u64),
}

/// Fills the network's inputs and targets with `rows` windows.
pub(super) fn gather(net: &Network, data: &Data, rows: usize, choice: Choice) -> Result<(), LearnError> {
    let [windows, per, frames] = [data.windows, data.per, data.frames].map(|x| Long(x as u64));
    let (scalars, seed, first, numbers) = match choice {
        Choice::Drawn { scalars, seed, first } => (scalars, seed, first as u64, 0),
        Choice::These(numbers) => (0, 0, 0, numbers),
    };
    let from = [Ptr(data.x.ptr), Ptr(data.y.ptr), Ptr(net.at(Slot(0))), Ptr(net.targets.ptr), Ptr(scalars), Long(seed)];
    Ok(net.device.launch("gather", (rows, 1), (128, 1), 0, &[&from[..], &[windows, per, frames, Ptr(numbers), Long(first)]].concat())?)
}
