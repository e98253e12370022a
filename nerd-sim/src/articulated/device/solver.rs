//! The articulated solver on a GPU.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Device, DeviceError};

use super::back::{back_program, goes_back};
use super::motion::{BLOCK, Motion};
use super::program::{Reach, Real, program};
use super::roll::OnDevice;
use crate::prelude::*;
use crate::solver::device::{Back, Held, Trail, failed};

/// [`super::super::Articulated`] on a GPU, one thread an environment: the same frame, the same settings, any robot.
///
/// It refuses what it has no kernel for: scenes with other shapes than planes, boxes and pegs, for explicit steps with more than one plane,
/// robots that differ by environment.
pub type CudaArticulated = OnDevice<Whole>;

/// A frame as one kernel, which loops over frames.
pub struct Whole {
    config: ArticulatedConfig,
    real: Real,
    device: Option<Device>,
    /// What its kernels were made for.
    reach: Reach,
    /// Whether its way back has been made.
    returns: bool,
}

impl CudaArticulated {
    /// A solver with these settings; the device is opened at its first step.
    pub fn new(config: ArticulatedConfig, real: Real) -> Self {
        Self::by(Whole { config, real, device: None, reach: Reach::default(), returns: false })
    }
}

impl Motion for Whole {
    fn capabilities(&self) -> Capabilities {
        Capabilities { drives: true, forces: true, systems: false }
    }

    fn check(&self, _: &Batch) -> Result<(), StepError> {
        self.config.check().map_err(StepError::Solver)
    }

    fn config(&self) -> &ArticulatedConfig {
        &self.config
    }

    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError> {
        (self.device, self.reach, self.returns) = (None, reach, false);
        let text = program(&batch.system, &self.config, self.real, reach);
        self.device = Some(Device::open(nerd_cuda::ordinal(), &text, &["advance"]).map_err(failed)?);
        Ok(())
    }

    fn device(&self) -> Option<&Device> {
        self.device.as_ref()
    }

    fn advance(&mut self, held: &Held, _: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError> {
        self.launch(held, frames, hold)
    }

    fn goes_back(&self, batch: &Batch) -> Result<(), StepError> {
        goes_back(&self.config, batch)
    }

    fn keep(&mut self, batch: &Batch, _: usize) -> Result<(), StepError> {
        if let Some(device) = self.device.as_mut().filter(|_| !self.returns) {
            let text = back_program(&batch.system, &self.config, self.real, self.reach);
            device.add(&text, &["slopes"]).map_err(failed)?;
            self.returns = true;
        }
        Ok(())
    }

    fn back(&self, held: &Held, trail: Trail, back: Back) -> Result<(), DeviceError> {
        let Some(device) = &self.device else { return Ok(()) };
        let at = |of: u64, all: usize| of + (8 * all * back.frame) as u64;
        let given = [at(trail.states, held.states.len), at(trail.torques, held.n * held.joints), held.records.ptr, held.scene_of.ptr];
        let found = [held.drives.ptr, back.by_next, back.next[0], back.by_states, back.by_torques, back.next[1]];
        let args = [&given.map(Ptr)[..], &found.map(Ptr), &[Int(held.n), Int(back.rows)]].concat();
        device.launch("slopes", (held.n.div_ceil(BLOCK), back.rows), (BLOCK, 1), 0, &args)
    }

    fn frame(&self, held: &Held) -> Result<(), DeviceError> {
        self.launch(held, 1, true)
    }
}

impl Whole {
    fn launch(&self, held: &Held, frames: usize, hold: bool) -> Result<(), DeviceError> {
        let Some(device) = &self.device else { return Ok(()) };
        let Held { states, torques, records, scene_of, drives, faults, done, n, .. } = held;
        let world = [states.ptr, torques.ptr, records.ptr, scene_of.ptr, drives.ptr, held.forces(), faults.ptr, done.ptr].map(Ptr);
        let args = [&world[..], &[*n, frames, usize::from(hold)].map(Int)].concat();
        device.launch("advance", (n.div_ceil(BLOCK), 1), (BLOCK, 1), 0, &args)
    }
}
