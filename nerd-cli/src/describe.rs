//! Describes solvers for tables and legends.

use nerd_model::{base::Base, form::View, transformer::Architecture};

use crate::prelude::*;

/// Describes a model by its form and size (million parameters), any other solver by its text.
pub fn title(spec: &SolverSpec) -> Result<String> {
    let Some(folder) = spec.folder() else { return Ok(spec.to_string()) };
    let model = ModelConfig::read(folder)?;
    let form = match model.network.architecture {
        Architecture::Chain => "along the chain",
        Architecture::Transformer if model.base == Base::State && model.view == View::Own => "paper's form",
        _ => "pure",
    };
    Ok(format!("NeRD {form}, {:.2} M", model.network.parameters() as f64 / 1e6))
}

/// Returns the bytes that a solver keeps for each environment, besides the batch.
pub fn bytes(spec: &SolverSpec) -> Result<usize> {
    let Some(folder) = spec.folder() else { return Ok(0) };
    let network = ModelConfig::read(folder)?.network;
    // Numbers of one frame in the history: its token, and the keys and values of every layer.
    let token = network.inputs.saturating_add(network.layers.saturating_mul(network.embedding).saturating_mul(2));
    Ok(network.history.saturating_mul(token).saturating_mul(8))
}
