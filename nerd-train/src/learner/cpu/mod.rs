//! The Transformer's update on the CPU, written out: its forward and backward pass over faer's products, with the element-wise
//! work fused and in vectors. Equal to burn's ([`super::BurnLearner`]) to rounding (test), at a fraction of the time.

mod attention;
mod elementwise;
mod network;
mod parts;
mod rounding;

use std::sync::{Arc, Mutex, PoisonError};

use nerd_model::transformer::{Architecture, Weights};

use super::sharded::{Loss, Pass, Shard, Sharded};
use super::{LearnError, LearnerConfig, LearnerState};
use crate::windows::Windows;
use network::Network;
pub use rounding::round_hidden;

/// Trains a Transformer on the CPU.
pub type CpuLearner = Sharded<Fused>;

/// Networks between two updates, whose memory the next one uses again.
#[derive(Default)]
pub struct Fused {
    idle: Mutex<Vec<Network>>,
}

impl Sharded<Fused> {
    /// Continues `state`, in shards of 32 windows on every core.
    ///
    /// # Errors
    /// If the network is no Transformer, the windows' widths or history are not the network's, a set is empty, or the state's
    /// vectors differ in length.
    pub fn new(config: LearnerConfig, state: LearnerState, train: Arc<Windows>, validation: Arc<Windows>) -> Result<Self, LearnError> {
        match state.weights.config.architecture {
            Architecture::Transformer => Self::with(Fused::default(), config, state, train, validation),
            other => Err(LearnError::Mismatch(format!("this learner knows the Transformer alone, not {other:?}; burn knows all"))),
        }
    }
}

impl Pass for Fused {
    type Worker = Network;

    fn worker(&self, weights: &Weights, _: bool) -> Network {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut network = idle.unwrap_or_else(|| Network::new(weights.config));
        network.load(&weights.flat);
        network
    }

    fn rest(&self, network: Network) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(network);
    }

    fn squares(&self, network: &mut Network, shard: Shard) -> Result<f64, LearnError> {
        Ok(elementwise::squares(network.forward(&shard)))
    }

    fn gradient(&self, network: &mut Network, shard: Shard, loss: Loss) -> Result<(f64, Vec<f32>), LearnError> {
        let error = network.forward(&shard);
        let squares = elementwise::squares(error) * loss.scale;
        elementwise::slope(error, loss);
        Ok((squares, network.backward(&shard)))
    }
}
