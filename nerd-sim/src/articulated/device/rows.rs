//! Transfers of a batch's gradients to a device and back.

use nerd_cuda::{Buffer, Device, DeviceError, Replay};

use super::{motion::Motion, program::fault};
use crate::prelude::*;
use crate::solver::device::{Back, Held, Trail, failed};
use crate::solver::{Fault, Gradients};

/// Memory for `rows` gradients of each environment.
pub(super) struct Rows {
    rows: usize,
    grad_next: Buffer<f64>,
    next: Buffer<f64>,
    faults: Buffer<i32>,
    states: Buffer<f64>,
    torques: Buffer<f64>,
    replay: Replay<(Trail, Back)>,
}

impl Rows {
    pub(super) fn new(device: &Device, batch: &Batch, rows: usize) -> Result<Self, DeviceError> {
        let n = batch.len();
        let robot = &batch.system.robot;
        let wide = n * rows * 2 * robot.nv();
        Ok(Self {
            rows,
            grad_next: device.zeros(wide)?,
            next: device.zeros(batch.states.len())?,
            faults: device.zeros(n)?,
            states: device.zeros(wide)?,
            torques: device.zeros(n * rows * robot.joint_count())?,
            replay: Replay::default(),
        })
    }

    pub(super) fn fits(&self, rows: usize) -> bool {
        self.rows == rows
    }

    pub(super) fn back(
        &self,
        motion: &impl Motion,
        held: &Held,
        batch: &Batch,
        grad_next: &[f64],
    ) -> Result<Gradients, StepError> {
        let Some(device) = motion.device() else { return Ok(Gradients::default()) };
        let go = || -> Result<(Gradients, Vec<i32>), DeviceError> {
            device.write(&self.grad_next, grad_next)?;
            let trail = Trail { states: held.states.ptr, torques: held.torques.ptr, frames: 1 };
            let next = [self.next.ptr, self.faults.ptr];
            let [grad_next, by_states, by_torques] = [self.grad_next.ptr, self.states.ptr, self.torques.ptr];
            let back = Back { frame: 0, rows: self.rows, grad_next, by_states, by_torques, next };
            self.replay.run(device, "gradients", (trail, back), || {
                motion.recall(held, trail)?;
                motion.back(held, trail, back)
            })?;
            let [next, states, torques] = [&self.next, &self.states, &self.torques].map(|of| device.download(of));
            Ok((
                Gradients { next: next?, states: states?, torques: torques?, ..Gradients::default() },
                device.download(&self.faults)?,
            ))
        };
        let (out, faults) = go().map_err(failed)?;
        let finite = |x: &[f64], env: usize| {
            x[env * x.len() / held.n..(env + 1) * x.len() / held.n].iter().all(|x| x.is_finite())
        };
        let wrong = faults.into_iter().enumerate().filter_map(|(env, code)| {
            let reason = match code {
                0 if finite(&out.states, env) && finite(&out.torques, env) => return None,
                0 => "the frame's gradients are not finite".into(),
                code => fault(&batch.system.robot, code),
            };
            Some(Fault { env, frame: batch.frames[env], reason })
        });
        let wrong: Vec<Fault> = wrong.collect();
        if wrong.is_empty() { Ok(out) } else { Err(StepError::Environments(wrong)) }
    }
}
