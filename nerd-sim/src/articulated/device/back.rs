//! The way back over a frame on a device: a kernel, a thread an environment and a gradient.
//!
//! A thread steps the frame with the starts of its substeps kept, and from the last to the first solves each once more and goes back over it:
//! twice the frame's solves, and `8 NQ + 2 NV sizeof(real)` bytes a substep. Kept are eight times the substeps of the settings; a frame that
//! its energy asks to be finer than that (`energy.rs`) is a fault of its environment. In 32 bits and with eight substeps a thread needs
//! `28080` bytes for an Ant, of which the frame itself takes `11032`, and `32424` for an ANYmal.

use super::super::ArticulatedConfig;
use super::program::{Reach, Real, deep, functions};
use crate::articulated::slopes::covered;
use crate::batch::Batch;
use crate::solver::StepError;
use crate::system::System;

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
    functions(system, config, real, reach) + &KERNELS.concat()
}

/// Refuses what has no slopes on a device.
///
/// # Errors
/// What that is, and where it has.
pub fn goes_back(config: &ArticulatedConfig, batch: &Batch) -> Result<(), StepError> {
    covered(config, batch)?;
    if deep(&batch.system) {
        return Err(StepError::Refused("chains this deep have no slopes on a card yet: take them on the CPU".into()));
    }
    Ok(())
}
