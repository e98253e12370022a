//! The way back over a frame on a device: a kernel, a thread an environment and a gradient.
//!
//! A thread steps the frame and keeps of its substeps where they began, their rates and which touches were idle: `8 NQ + 2 NV sizeof(real)` bytes and a bit
//! for each touch and drive. From the last to the first it looks again at what touched, and goes back without another solve. Of Runge-Kutta's substeps the stages are found
//! again. Kept are eight times the substeps of the settings; a frame that its energy asks to be finer than that (`energy.rs`) is stepped with those that are
//! kept. In 32 bits and with eight substeps a thread needs `29072` bytes for an Ant and `33648` for an ANYmal.

use super::program::{Reach, Real, functions, whips};
use crate::articulated::slopes::covered;
use crate::prelude::*;

const KERNELS: [&str; 6] = [
    include_str!("adjoint.cuh"),
    include_str!("law.cuh"),
    include_str!("row.cuh"),
    include_str!("stage.cuh"),
    include_str!("flight.cuh"),
    include_str!("back.cuh"),
];

/// The text for one robot: the kernel `slopes`.
pub fn back_program(system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    functions(system, config, real, reach, true).0 + &KERNELS.concat()
}

/// Refuses what has no slopes on a device.
///
/// # Errors
/// What has none, and where it has.
pub fn goes_back(config: &ArticulatedConfig, batch: &Batch) -> Result<(), StepError> {
    covered(config, batch)?;
    if whips(&batch.system) {
        return Err(StepError::Refused("chains this deep have no slopes on a card yet: take them on the CPU".into()));
    }
    Ok(())
}
