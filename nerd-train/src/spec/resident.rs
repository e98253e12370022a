//! Solvers whose batch stays in GPU memory.

use nerd_sim::articulated::device::{CudaArticulated, Real, Roll, has_kernels};

use super::SolverSpec;
use crate::{learner::cuda::Precision, prelude::*};

/// Makes a solver on the GPU with the given arithmetic, whatever device `spec` names.
///
/// # Errors
/// If the solver has no kernels, or its model cannot be read.
pub fn resident(spec: &SolverSpec, system: &Arc<System>, real: Real, precision: Precision) -> Result<Box<dyn Roll>> {
    let spec = &spec.clone().found(system)?;
    if let Some(folder) = spec.folder() {
        let whole = crate::learner::cuda::resident(Model::load(folder, system, None)?, system, real, precision);
        return Ok(Box::new(whole.map_err(|why| format!("{}: {why}", folder.display()))?));
    }
    let config =
        spec.config(system).ok_or_else(|| Error::Refused(format!("{spec} has no kernels; step it on the CPU")))?;
    has_kernels(&config).map_err(|why| format!("{spec}: {why}"))?;
    Ok(Box::new(CudaArticulated::new(config, real)))
}
