//! Shards through burn's autodiff, on the CPU (`Device::flex()`) or any other burn device; for every architecture.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use nerd_model::program::Network;
use nerd_model::transformer::Weights;

use super::sharded::{Loss, Pass, Shard, Sharded};
use super::{LearnError, LearnerConfig, LearnerState};
use crate::windows::Windows;

/// Trains on a burn device.
pub type BurnLearner = Sharded<Burn>;

/// A burn device.
pub struct Burn {
    device: Device,
}

impl Sharded<Burn> {
    /// Continues `state` on `device` (autodiff is switched on here), in shards of 32 windows on every core.
    ///
    /// # Errors
    /// If the windows' widths or history are not the network's, a set is empty, or the state's vectors differ in length.
    pub fn new(
        config: LearnerConfig,
        state: LearnerState,
        train: Arc<Windows>,
        validation: Arc<Windows>,
        device: &Device,
    ) -> Result<Self, LearnError> {
        Self::with(Burn { device: device.clone().autodiff() }, config, state, train, validation)
    }
}

impl Pass for Burn {
    type Worker = (Network, Device);

    fn worker(&self, weights: &Weights, gradients: bool) -> Self::Worker {
        let device = if gradients { self.device.clone() } else { self.device.clone().inner() };
        (Network::new(weights, &device), device)
    }

    fn squares(&self, worker: &mut Self::Worker, shard: Shard) -> Result<f64, LearnError> {
        let error = errors(worker, shard);
        scalar((error.clone() * error).sum())
    }

    fn gradient(&self, worker: &mut Self::Worker, shard: Shard, loss: Loss) -> Result<(f64, Vec<f32>), LearnError> {
        let error = errors(worker, shard);
        let squares = (error.clone() * error.clone()).sum() * loss.scale;
        let loss = match loss.huber.map(f64::from) {
            None => squares.clone(),
            Some(d) => ((error.clone() * error / (d * d) + 1.0).sqrt() - 1.0).sum() * (2.0 * d * d * loss.scale),
        };
        Ok((scalar(squares)?, worker.0.gradients(&loss.backward())))
    }
}

/// `[windows, tokens, outputs]`.
fn errors((network, device): &(Network, Device), shard: Shard) -> Tensor<3> {
    let Shard { windows, tokens, x, y } = shard;
    let tensor = |data: Vec<f32>| {
        let width = data.len() / (windows * tokens);
        Tensor::<3>::from_data(TensorData::new(data, [windows, tokens, width]), device)
    };
    network.forward(tensor(x)) - tensor(y)
}

/// A scalar tensor's value.
fn scalar(tensor: Tensor<1>) -> Result<f64, LearnError> {
    let data = tensor.try_into_data().map_err(|e| LearnError::Device(format!("{e:?}")))?;
    Ok(data.iter::<f64>().sum())
}
