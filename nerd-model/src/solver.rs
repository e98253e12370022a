//! A model as a solver on the CPU.

use crate::prelude::*;
use crate::{chain::ChainSolver, folder::ModelError, transformer::Architecture};

/// [`ChainSolver`] for a chain, [`Neural`] for any other robot.
///
/// # Errors
/// If the model is of a chain, and the robot is not a chain with as many rods.
pub fn learned(model: Model, system: &Arc<System>) -> Result<Box<dyn Solver>, ModelError> {
    Ok(match model.config.network.architecture {
        Architecture::Chain => Box::new(ChainSolver::new(&model.weights, &model.normalizer, system)?),
        _ => Box::new(Neural::on_cpu(model)),
    })
}
