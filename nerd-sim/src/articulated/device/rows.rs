//! What goes to the way back's kernel, and comes from it.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError};

use super::program::fault;
use super::roll::BLOCK;
use crate::batch::Batch;
use crate::solver::device::{Held, failed};
use crate::solver::{Fault, Slopes, StepError};

/// Memory for so many gradients of each environment.
pub(super) struct Rows {
    rows: usize,
    by_next: Buffer<f64>,
    next: Buffer<f64>,
    states: Buffer<f64>,
    torques: Buffer<f64>,
}

impl Rows {
    /// Nothing yet.
    pub(super) fn new(device: &Device) -> Result<Self, DeviceError> {
        let none = || device.zeros(0);
        Ok(Self { rows: 0, by_next: none()?, next: none()?, states: none()?, torques: none()? })
    }

    /// The slopes of what is held, of as many environments every time.
    pub(super) fn back(&mut self, device: &Device, held: &Held, batch: &Batch, rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        let joints = batch.system.robot.joint_count();
        let mut out =
            Slopes { next: vec![0.0; batch.states.len()], states: vec![0.0; by_next.len()], torques: vec![0.0; held.n * rows * joints] };
        let mut faults = vec![0; held.n];
        self.run(device, held, rows, by_next, &mut out, &mut faults).map_err(failed)?;
        let finite = |x: &[f64], env: usize| x[env * x.len() / held.n..(env + 1) * x.len() / held.n].iter().all(|x| x.is_finite());
        let wrong = faults.into_iter().enumerate().filter_map(|(env, code)| {
            let reason = match code {
                0 if finite(&out.states, env) && finite(&out.torques, env) => return None,
                0 => "the frame's slopes are not finite".into(),
                code => fault(&batch.system.robot, code),
            };
            Some(Fault { env, frame: batch.frames[env], reason })
        });
        let wrong: Vec<Fault> = wrong.collect();
        if wrong.is_empty() { Ok(out) } else { Err(StepError::Environments(wrong)) }
    }

    fn run(
        &mut self,
        device: &Device,
        held: &Held,
        rows: usize,
        by_next: &[f64],
        out: &mut Slopes,
        faults: &mut [i32],
    ) -> Result<(), DeviceError> {
        if self.rows != rows {
            (self.by_next, self.states) = (device.zeros(by_next.len())?, device.zeros(by_next.len())?);
            (self.next, self.torques, self.rows) = (device.zeros(out.next.len())?, device.zeros(out.torques.len())?, rows);
        }
        device.write(&self.by_next, by_next)?;
        let given = [&held.states, &held.torques, &held.records].map(|b| Ptr(b.ptr));
        let found = [&self.by_next, &self.next, &self.states, &self.torques].map(|b| Ptr(b.ptr));
        let args = [&given[..], &[Ptr(held.scene_of.ptr)], &found, &[Ptr(held.faults.ptr), Int(held.n), Int(rows)]].concat();
        device.launch("slopes", (held.n.div_ceil(BLOCK), rows), (BLOCK, 1), 0, &args)?;
        device.read(&self.next, &mut out.next)?;
        device.read(&self.states, &mut out.states)?;
        device.read(&self.torques, &mut out.torques)?;
        device.read(&held.faults, faults)
    }
}
