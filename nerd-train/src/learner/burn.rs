//! Gradients of shards by burn's autodiff, on any device of burn and for any architecture.

use burn::tensor::Tensor;
use nerd_model::BurnDevice;
use nerd_model::program::BurnNetwork;

use super::sharded::{Pass, Shard, Sharded};
use crate::prelude::*;

/// Trains on a device of burn. On a GPU, set one shard for the whole batch ([`Sharded::shards`]).
pub type BurnLearner = Sharded<Burn>;

pub struct Burn {
    device: BurnDevice,
}

impl Sharded<Burn> {
    /// Resumes `state` on `device` (autodiff is switched on here), in shards of 32 windows on all cores.
    pub fn new(
        config: LearnerConfig,
        state: LearnerState,
        sets: [Arc<Windows>; 2],
        device: &BurnDevice,
    ) -> LearnResult<Self> {
        Self::with(Burn { device: device.clone().autodiff() }, config, state, sets)
    }
}

impl Pass for Burn {
    type Worker = BurnNetwork;

    fn worker(&self, weights: &Weights, gradients: bool) -> BurnNetwork {
        let device = if gradients { self.device.clone() } else { self.device.clone().inner() };
        BurnNetwork::new(weights.config.program(), &weights.flat, &device)
    }

    fn squares(&self, network: &mut BurnNetwork, shard: Shard) -> LearnResult<f64> {
        let error = errors(network, shard);
        Ok(read((error.clone() * error).sum())?.into_iter().map(f64::from).sum())
    }

    fn gradient(
        &self,
        network: &mut BurnNetwork,
        shard: Shard,
        scale: f64,
        huber: Option<f32>,
    ) -> LearnResult<(f64, Vec<f32>)> {
        let error = errors(network, shard);
        let squares = (error.clone() * error.clone()).sum() * scale;
        let loss = match huber.map(f64::from) {
            None => squares.clone(),
            Some(d) => ((error.clone() * error / (d * d) + 1.0).sqrt() - 1.0).sum() * (2.0 * d * d * scale),
        };
        let gradient = read(network.gradients(&loss.backward()))?;
        Ok((read(squares)?.into_iter().map(f64::from).sum(), gradient))
    }
}

fn errors(network: &BurnNetwork, Shard { windows, tokens, x, y }: Shard) -> Tensor<3> {
    network.forward(network.tensor(x, windows, tokens)) - network.tensor(y, windows, tokens)
}

fn read(tensor: Tensor<1>) -> LearnResult<Vec<f32>> {
    let data = tensor.try_into_data().map_err(|e| LearnError::Device(format!("{e:?}")))?;
    Ok(data.iter::<f32>().collect())
}
