//! One update on a GPU, kernel by kernel: what it reads, what it writes, and in which order.

use std::ops::Range;

use super::muon::{Muon, Vectors};
use super::network::Network;
use crate::learner::{LearnError, LearnerConfig};
use nerd_cuda::Arg::{Double, Float, Int, Long, Ptr};
use nerd_cuda::{Buffer, Graph, Sums};

/// Blocks of the gradient norm's first stage.
pub(super) const NORM_BLOCKS: usize = 528;

/// Mirror of the struct in `kernels.cu`.
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
pub(super) struct Step<'a> {
    pub network: &'a Network,
    pub config: LearnerConfig,
    pub rows: Range<usize>,
    pub sums: Option<&'a Sums>,
    pub train: &'a Data,
    pub weights: &'a Buffer<f32>,
    pub average: &'a Buffer<f32>,
    pub m: &'a Buffer<f32>,
    pub v: &'a Buffer<f32>,
    pub gradients: &'a Buffer<f32>,
    pub norms: &'a Buffer<f32>,
    pub scalars: &'a Buffer<Scalars>,
    pub muon: Option<&'a Muon>,
}

impl Step<'_> {
    /// From the sum of squared errors to the loss.
    pub fn mean(&self) -> f32 {
        let c = self.network.layout.config;
        1.0 / (self.config.batch * self.network.layout.tokens * c.outputs) as f32
    }

    pub fn gradient(&self) -> Result<(), LearnError> {
        let (net, w, rows, LearnerConfig { batch, seed, huber, .. }) = (self.network, self.weights.ptr, self.rows.len(), self.config);
        gather(net, self.train, rows, Choice::Drawn { scalars: self.scalars.ptr, seed, first: self.rows.start })?;
        net.fold(w)?;
        net.windows(w, rows)?;
        net.top(w, net.x.ptr, rows * net.layout.tokens)?;
        Ok(net.backward(w, batch, huber, self.gradients.ptr)?)
    }

    /// Adds up the gradients and squared errors of all ranks.
    fn sum(&self) -> Result<(), LearnError> {
        self.sums.map_or(Ok(()), |sums| Ok(sums.sum(&self.network.device, self.gradients)?))
    }

    pub fn all(&self) -> Result<(), LearnError> {
        self.gradient()?;
        self.sum()?;
        let (d, p, s) = (&self.network.device, self.network.layout.parameters, Ptr(self.scalars.ptr));
        let [w, g, m, v, a] = [self.weights, self.gradients, self.m, self.v, self.average].map(|b| Ptr(b.ptr));
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
        let blocks = if self.muon.is_some() { self.network.layout.config.layers } else { 0 };
        let first = self.network.layout.first_block() as u64;
        d.launch("adam", (p.div_ceil(256), 1), (256, 1), 0, &[w, g, m, v, a, s, Long(p as u64), Long(first), Int(blocks)])?;
        let address = |b: &Buffer<f32>| b.ptr;
        let vectors = Vectors {
            weights: address(self.weights),
            gradients: address(self.gradients),
            m: address(self.m),
            average: address(self.average),
            scalars: self.scalars.ptr,
        };
        self.muon.map_or(Ok(()), |muon| Ok(muon.update(d, &vectors)?))
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
    let from = [Ptr(data.x.ptr), Ptr(data.y.ptr), Ptr(net.inputs.ptr), Ptr(net.targets.ptr), Ptr(scalars), Long(seed)];
    Ok(net.device.launch("gather", (rows, 1), (128, 1), 0, &[&from[..], &[windows, per, frames, Ptr(numbers), Long(first)]].concat())?)
}
