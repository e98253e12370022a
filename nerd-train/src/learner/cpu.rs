//! Gradients of shards on the CPU, over the network's program ([`nerd_model::program::cpu`]). A test compares them with
//! those of [`super::BurnLearner`]: equal up to rounding, in a fraction of the time.

use nerd_model::program::cpu::Pass as Tokens;

use super::sharded::{Pass, Shard, Sharded};
use crate::prelude::*;

/// Trains a network on the CPU, shard by shard.
pub type CpuLearner = Sharded<Fused>;

/// Keeps idle networks with their memory for the next update.
#[derive(Default)]
pub struct Fused {
    idle: Mutex<Vec<(Loaded, Memory)>>,
}

impl Sharded<Fused> {
    /// Resumes `state` on training and validation windows, in shards of 32 windows on all cores.
    ///
    /// # Errors
    /// If shapes of windows and network differ, a set is empty, or the state's vectors differ in length.
    pub fn new(config: LearnerConfig, state: LearnerState, sets: [Arc<Windows>; 2]) -> LearnResult<Self> {
        Self::with(Fused::default(), config, state, sets)
    }
}

impl Pass for Fused {
    type Worker = (Loaded, Memory);

    fn worker(&self, weights: &Weights, _: bool) -> Self::Worker {
        match self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop() {
            Some((mut network, memory)) => {
                network.load(&weights.flat);
                (network, memory)
            }
            None => (Loaded::new(weights.config.program(), &weights.flat), Memory::default()),
        }
    }

    fn rest(&self, worker: Self::Worker) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(worker);
    }

    fn squares(&self, worker: &mut Self::Worker, shard: Shard) -> LearnResult<f64> {
        Ok(squares(&errors(worker, &shard)))
    }

    fn gradient(
        &self,
        worker: &mut Self::Worker,
        shard: Shard,
        scale: f64,
        huber: Option<f32>,
    ) -> LearnResult<(f64, Vec<f32>)> {
        let mut error = errors(worker, &shard);
        let squares = squares(&error) * scale;
        let factor = scale as f32;
        match huber {
            None => error.iter_mut().for_each(|e| *e *= 2.0 * factor),
            Some(d) => error.iter_mut().for_each(|e| *e *= 2.0 * factor / (1.0 + (*e / d) * (*e / d)).sqrt()),
        }
        let (network, memory) = worker;
        Ok((squares, network.backward(shard.tokens, &error, memory, false).0))
    }
}

/// Predictions minus targets, `[windows][tokens][outputs]`.
fn errors((network, memory): &mut (Loaded, Memory), shard: &Shard) -> Vec<f32> {
    let predicted = network.forward(&shard.x, memory, Tokens::Kept(shard.tokens));
    predicted.iter().zip(&shard.y).map(|(p, y)| p - y).collect()
}

fn squares(error: &[f32]) -> f64 {
    error.iter().map(|e| f64::from(e * e)).sum()
}
