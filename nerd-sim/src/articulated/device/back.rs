//! Gradients of a frame on a device: one kernel, one thread per environment and gradient.
//!
//! A thread steps the frame and records each substep. Its start and rate take `8 NQ + 2 NV sizeof(real)` bytes. The
//! record also has a bit per touch and drive for whether it was idle, and the force (and torque) that each contact
//! holds. The backward pass runs from the last substep to the first. The backward pass finds the contacts again but
//! repeats no solve; Runge-Kutta stages are computed again. The record has room for eight times the substeps of the
//! settings. A frame that the energy check (`energy.rs`) would refine further takes no more substeps than that.

use super::program::{Reach, Real, functions, whips};
use crate::articulated::gradients::covered;
use crate::prelude::*;

const KERNELS: [&str; 6] = [
    include_str!("adjoint.cuh"),
    include_str!("law.cuh"),
    include_str!("row.cuh"),
    include_str!("stage.cuh"),
    include_str!("flight.cuh"),
    include_str!("back.cuh"),
];

/// CUDA text of the kernel `gradients` for one robot.
pub fn back_program(system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    functions(system, config, real, reach, true).0 + &KERNELS.concat()
}

/// Refuses settings and robots without gradients on a device.
///
/// # Errors
/// Unsupported settings or robots; the error's text says where they are supported.
pub fn goes_back(config: &ArticulatedConfig, batch: &Batch) -> Result<(), StepError> {
    covered(config, batch)?;
    if whips(&batch.system) {
        return Err(StepError::Refused(
            "chains this deep have no gradients on a card yet: take them on the CPU".into(),
        ));
    }
    Ok(())
}
