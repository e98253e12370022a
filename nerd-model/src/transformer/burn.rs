//! [`Forward`] over windows on any device of burn.

use burn::tensor::{Device, Int, Tensor, TensorData};

use super::forward::{Forward, ForwardError, ForwardResult, check};
use super::weights::Weights;
use crate::{program::BurnNetwork, program::config::TransformerConfig};

/// A network on a device of burn.
pub struct BurnForward {
    config: TransformerConfig,
    network: BurnNetwork,
}

impl BurnForward {
    /// Copies `weights` to the device.
    pub fn new(weights: &Weights, device: &Device) -> Self {
        Self { config: weights.config, network: BurnNetwork::new(weights.config.program(), &weights.flat, device) }
    }
}

impl Forward for BurnForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> ForwardResult {
        check(&self.config, inputs, tokens, last)?;
        out.clear();
        if last.is_empty() {
            return Ok(());
        }
        let all = self.network.forward(self.network.tensor(inputs.to_vec(), last.len(), tokens));
        let rows: Vec<i64> = last.iter().enumerate().map(|(w, l)| (w * tokens + *l as usize) as i64).collect();
        let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [last.len()]), &all.device());
        let newest = all.reshape([last.len() * tokens, self.config.outputs]).select(0, rows);
        let data = newest.try_into_data().map_err(|e| ForwardError { message: format!("{e:?}") })?;
        out.extend(data.iter::<f32>());
        Ok(())
    }
}
