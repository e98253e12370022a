//! The articulated solver on a GPU.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError};

use super::back::{back_program, goes_back};
use super::motion::{BLOCK, Motion};
use super::program::{Reach, Real, has_kernels, program};
use super::roll::OnDevice;
use crate::prelude::*;
use crate::robots::motors::LATEST;
use crate::solver::device::{Back, Held, Trail, failed};

/// [`super::super::Articulated`] on a GPU, one thread per environment. Steps the same frames, for any robot.
///
/// Refuses settings of the reference ([`has_kernels`]) and shapes other than planes, boxes, cylinders, balls, capsules,
/// hulls and height fields. For a family ([`crate::vary`]) it also steps the actuator and sensor model, as
/// [`crate::rig::Rig`] does on the CPU.
pub type CudaArticulated = OnDevice<Whole>;

/// Motion of articulated robots: one kernel steps whole frames, with a loop over frames.
pub struct Whole {
    config: ArticulatedConfig,
    real: Real,
    device: Option<Device>,
    reach: Reach,
    /// Whether the kernel for gradients was compiled.
    returns: bool,
    /// Memory of a family's actuator model.
    rig: Option<Rig>,
}

struct Rig {
    /// Commanded torques (N m or N) of the last frames, newest first, `[env][LATEST][joint]`; and how many frames of
    /// each environment are in memory.
    asked: Buffer<f64>,
    known: Buffer<u32>,
    /// Frame count of each environment that would continue its memory.
    next: Vec<u64>,
}

impl CudaArticulated {
    /// A solver with these settings; its first step opens the device.
    pub fn new(config: ArticulatedConfig, real: Real) -> Self {
        Self::by(Whole { config, real, device: None, reach: Reach::default(), returns: false, rig: None })
    }
}

impl Motion for Whole {
    fn capabilities(&self) -> Capabilities {
        Capabilities { drives: true, forces: true, systems: true }
    }

    fn check(&self, _: &Batch) -> Result<(), StepError> {
        self.config.check().map_err(StepError::Solver)?;
        has_kernels(&self.config)
    }

    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError> {
        (self.device, self.reach, self.returns, self.rig) = (None, reach, false, None);
        let text = program(&batch.system, &self.config, self.real, reach);
        let device = Device::open(&text, &["advance"]).map_err(failed)?;
        if reach.own.rigged() {
            let n = batch.len();
            let joints = batch.system.robot.joint_count();
            let asked = device.zeros(n * LATEST as usize * joints);
            let known = device.zeros(n);
            self.rig =
                Some(Rig { asked: asked.map_err(failed)?, known: known.map_err(failed)?, next: vec![u64::MAX; n] });
        }
        self.device = Some(device);
        Ok(())
    }

    fn device(&self) -> Option<&Device> {
        self.device.as_ref()
    }

    fn advance(&mut self, held: &Held, first: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError> {
        self.follow(first)?;
        self.launch(held, frames, hold)?;
        let Some((device, rig)) = self.device.as_ref().zip(self.rig.as_mut()) else { return Ok(()) };
        let (went, faults) = (device.download(&held.done)?, device.download(&held.faults)?);
        let next = first.iter().zip(went).zip(faults);
        rig.next =
            next.map(|((first, went), fault)| if fault == 0 { first + u64::from(went) } else { u64::MAX }).collect();
        Ok(())
    }

    fn follow(&mut self, first: &[u64]) -> Result<(), DeviceError> {
        let Some((device, rig)) = self.device.as_ref().zip(self.rig.as_mut()) else { return Ok(()) };
        let follows = first.iter().zip(&rig.next).map(|(frame, next)| u32::from(*frame > 0 && frame == next));
        device.write(&rig.known, &follows.collect::<Vec<_>>())?;
        rig.next.fill(u64::MAX);
        Ok(())
    }

    fn memory(&self) -> u64 {
        self.rig.as_ref().map_or(0, |rig| rig.known.ptr)
    }

    fn reset(&mut self, env: usize) {
        if let Some(next) = self.rig.as_mut().and_then(|rig| rig.next.get_mut(env)) {
            *next = u64::MAX;
        }
    }

    fn goes_back(&self, batch: &Batch) -> Result<(), StepError> {
        if Reach::of(batch).own.rigged() {
            return Err(StepError::Refused(
                "a family's motors and sensors have no gradients: leave them out of [vary]".into(),
            ));
        }
        goes_back(&self.config, batch)
    }

    fn keep(&mut self, batch: &Batch, _: usize) -> Result<(), StepError> {
        if let Some(device) = self.device.as_mut().filter(|_| !self.returns) {
            let text = back_program(&batch.system, &self.config, self.real, self.reach);
            device.add(&text, &["gradients"]).map_err(failed)?;
            self.returns = true;
        }
        Ok(())
    }

    fn back(&self, held: &Held, trail: Trail, back: Back) -> Result<(), DeviceError> {
        let Some(device) = &self.device else { return Ok(()) };
        let at = |of: u64, all: usize| of + (8 * all * back.frame) as u64;
        let given = [
            at(trail.states, held.states.len),
            at(trail.torques, held.n * held.joints),
            held.records.ptr,
            held.scene_of.ptr,
        ];
        let found = [held.drives.ptr, back.grad_next, back.next[0], back.by_states, back.by_torques, back.next[1]];
        let args = [&given.map(Ptr)[..], &found.map(Ptr), &[Int(held.n), Int(back.rows)]].concat();
        device.launch("gradients", (held.n.div_ceil(BLOCK), back.rows), (BLOCK, 1), 0, &args)
    }

    fn frame(&self, held: &Held) -> Result<(), DeviceError> {
        self.launch(held, 1, true)
    }
}

impl Whole {
    fn launch(&self, held: &Held, frames: usize, hold: bool) -> Result<(), DeviceError> {
        let Some(device) = &self.device else { return Ok(()) };
        let Held { states, torques, records, scene_of, drives, faults, done, n, .. } = held;
        let world =
            [states.ptr, torques.ptr, records.ptr, scene_of.ptr, drives.ptr, held.forces(), faults.ptr, done.ptr]
                .map(Ptr);
        let mut args = [&world[..], &[*n, frames, usize::from(hold)].map(Int)].concat();
        if let Some(Rig { asked, known, .. }) = &self.rig {
            args.extend([asked.ptr, known.ptr].map(Ptr));
        }
        device.launch("advance", (n.div_ceil(BLOCK), 1), (BLOCK, 1), 0, &args)
    }
}
