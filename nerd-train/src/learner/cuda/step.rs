//! One update on a GPU, kernel by kernel: reads, writes, order.

use std::ops::Range;

use nerd_model::program::Slot;

use super::network::Network;
use super::optimiser::Optimiser;
use crate::learner::{LearnError, LearnerConfig};
use nerd_cuda::Arg::{Long, Ptr};
use nerd_cuda::Buffer;

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
    pub train: Data,
    pub optimiser: Optimiser,
}

impl Step {
    /// From the sum of squared errors to the loss.
    pub fn mean(&self) -> f32 {
        let plan = &self.network.plan;
        1.0 / (self.config.batch * plan.tokens * plan.outputs()) as f32
    }

    pub fn gradient(&self) -> Result<(), LearnError> {
        let (net, own, rows) = (&self.network, &self.optimiser, self.rows.len());
        let (w, g) = (own.weights.ptr, own.gradients.ptr);
        let LearnerConfig { batch, seed, huber, .. } = self.config;
        gather(net, &self.train, rows, Choice::Drawn { scalars: own.scalars(), seed, first: self.rows.start })?;
        net.fold(w)?;
        net.windows(w, rows)?;
        net.loss(w, rows * net.plan.tokens, batch * net.plan.tokens, huber, g)?;
        Ok(net.backward(w, g, rows, None)?)
    }

    pub fn all(&self) -> Result<(), LearnError> {
        self.gradient()?;
        self.optimiser.sum(&self.network.device)?;
        self.optimiser.update(&self.network.device, self.mean())
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
