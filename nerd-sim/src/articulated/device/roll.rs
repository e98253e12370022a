//! Steps batches that stay on a device, for any solver on that device.

use nerd_cuda::{Device, DeviceError};

use super::program::{Reach, fault};
use super::{motion::Motion, rows::Rows, scenes::take};
use crate::prelude::*;
use crate::solver::device::{Back, Held, Resident, Trail, failed};
use crate::solver::{Fault, Gradients, finish, numbers, sound};

impl<M: Motion> Resident for OnDevice<M> {
    fn hold(&mut self, batch: &Batch) -> Result<(), StepError> {
        let torques = vec![0.0; batch.len() * batch.system.robot.joint_count()];
        self.take_all(batch, &torques)?;
        let Some((Made { held, reach, .. }, device)) = self.made.as_mut().zip(self.motion.device()) else {
            return Ok(());
        };
        take(held, device, batch, *reach, &torques)?;
        device.write(&held.faults, &vec![0; held.n]).map_err(failed)?;
        self.motion.follow(&batch.frames).map_err(failed)
    }

    fn held(&self) -> Option<(&Device, &Held)> {
        self.motion.device().zip(self.made.as_ref().map(|made| &made.held))
    }

    fn memory(&self) -> u64 {
        self.motion.memory()
    }

    fn frame(&self) -> Result<(), DeviceError> {
        self.made.as_ref().map_or(Ok(()), |made| self.motion.frame(&made.held))
    }

    fn keep(&mut self, batch: &Batch, frames: usize) -> Result<(), StepError> {
        self.motion.goes_back(batch)?;
        self.motion.keep(batch, frames)
    }

    fn recall(&self, trail: Trail) -> Result<(), DeviceError> {
        self.made.as_ref().map_or(Ok(()), |made| self.motion.recall(&made.held, trail))
    }

    fn back(&self, trail: Trail, back: Back) -> Result<(), DeviceError> {
        self.made.as_ref().map_or(Ok(()), |made| self.motion.back(&made.held, trail, back))
    }
}

/// A [`Solver`] that steps many frames in one call.
pub trait Roll: Solver {
    /// Steps `frames` frames without leaving the device. `torques` are `[env][joint]`, constant over all frames, or
    /// `[frame][env][joint]`.
    ///
    /// # Errors
    /// Those of [`Solver::step`]. An environment that fails keeps its state before the failed frame; the error has that
    /// frame's number.
    fn roll(&mut self, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError>;
}

/// A [`Solver`] for batches on a device.
pub struct OnDevice<M> {
    motion: M,
    made: Option<Made>,
    next: Vec<f64>,
    faults: Vec<Fault>,
}

/// Memory on the device, with the system and reach for which memory and kernels were made.
struct Made {
    system: Arc<System>,
    reach: Reach,
    held: Held,
    rows: Option<Rows>,
}

/// Checks batch and torques as every solver does, except that the actuators of a family are allowed.
fn looked_at(batch: &Batch, torques: &[f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    if Reach::of(batch).own.rigged() { numbers(batch, torques, faults) } else { sound(batch, torques, faults) }
}

impl<M: Motion> OnDevice<M> {
    /// A solver that opens nothing before its first step.
    pub fn by(motion: M) -> Self {
        Self { motion, made: None, next: Vec::new(), faults: Vec::new() }
    }

    /// Checks the batch, then makes its kernels and memory.
    fn take_all(&mut self, batch: &Batch, torques: &[f64]) -> Result<(), StepError> {
        looked_at(batch, torques, &mut self.faults)?;
        if !self.faults.is_empty() {
            return Err(StepError::Environments(std::mem::take(&mut self.faults)));
        }
        self.motion.capabilities().admit(batch)?;
        self.motion.check(batch)?;
        self.prepare(batch)
    }

    /// Makes kernels and memory unless the present ones fit the batch.
    fn prepare(&mut self, batch: &Batch) -> Result<(), StepError> {
        let asked = Reach::of(batch);
        let fits = |m: &Made| {
            let kinds = [m.reach, asked].map(|r| (r.driven, r.servo, r.paired, r.turns, r.hulls));
            let enough = m.reach.colliders >= asked.colliders && kinds[0] == kinds[1];
            enough && m.held.n == batch.len() && Arc::ptr_eq(&m.system, &batch.system)
        };
        if self.made.as_ref().is_some_and(fits) {
            return Ok(());
        }
        self.made = None;
        self.motion.open(batch, asked)?;
        let Some(device) = self.motion.device() else { return Ok(()) };
        let held = Held::new(device, batch).map_err(failed)?;
        self.made = Some(Made { system: batch.system.clone(), reach: asked, held, rows: None });
        Ok(())
    }
}

impl<M: Motion> Roll for OnDevice<M> {
    fn roll(&mut self, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError> {
        let n = batch.len();
        let joints = batch.system.robot.joint_count();
        let width = n * joints;
        let hold = torques.len() == width;
        if frames == 0 || (!hold && torques.len() != frames * width) {
            return Err(StepError::torques(torques.len(), n, joints));
        }
        looked_at(batch, &torques[..width], &mut self.faults)?;
        if let Some(at) = torques[width..].iter().position(|x| !x.is_finite()) {
            let frame = 1 + at / width;
            let env = at % width / joints;
            let x = torques[width + at];
            return Err(StepError::Solver(format!(
                "a torque of environment {env} in frame {frame} of the roll is {x}"
            )));
        }
        let capabilities = self.motion.capabilities();
        capabilities.admit(batch)?;
        self.motion.check(batch)?;
        if !capabilities.forces {
            batch.forces.clear();
        }
        if n == 0 {
            return Ok(());
        }
        self.prepare(batch)?;
        let Some((Made { held, reach, .. }, device)) = self.made.as_mut().zip(self.motion.device()) else {
            return Ok(());
        };
        take(held, device, batch, *reach, torques)?;
        self.motion.advance(held, &batch.frames, frames, hold).map_err(failed)?;
        let Some(device) = self.motion.device() else { return Ok(()) };
        let done = held.give(device, batch, &mut self.next).map_err(failed)?;
        let d = batch.system.robot.state_dim();
        for (env, (code, went)) in done.into_iter().enumerate() {
            batch.frames[env] += u64::from(went.saturating_sub(u32::from(code == 0)));
            if code != 0 && self.faults.iter().all(|f| f.env != env) {
                // Keep the state before the failed frame.
                batch.states[env * d..(env + 1) * d].copy_from_slice(&self.next[env * d..(env + 1) * d]);
                self.faults.push(Fault { env, frame: batch.frames[env], reason: fault(&batch.system.robot, code) });
            }
        }
        let points = if batch.forces.is_empty() { 0 } else { batch.system.robot.contact_points.len() };
        for fault in &self.faults {
            batch.forces[fault.env * points..][..points].fill(Vector3::zeros());
        }
        finish(batch, &mut self.next, &mut self.faults)
    }
}

impl<M: Motion> Solver for OnDevice<M> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.roll(batch, torques, 1)
    }

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        self.motion.goes_back(batch)?;
        let wide = batch.len() * rows * 2 * batch.system.robot.nv();
        if wide == 0 || grad_next.len() != wide {
            return Err(StepError::Solver(format!(
                "{} numbers of gradients, {wide} are needed, and some",
                grad_next.len()
            )));
        }
        self.take_all(batch, torques)?;
        self.motion.keep(batch, 1)?;
        let Some((Made { held, reach, rows: memory, .. }, device)) = self.made.as_mut().zip(self.motion.device())
        else {
            return Ok(Gradients::default());
        };
        take(held, device, batch, *reach, torques)?;
        if !memory.as_ref().is_some_and(|memory| memory.fits(rows)) {
            *memory = Some(Rows::new(device, batch, rows).map_err(failed)?);
        }
        memory.as_ref().map_or(Ok(Gradients::default()), |memory| memory.back(&self.motion, held, batch, grad_next))
    }

    fn reset(&mut self, env: usize) {
        self.motion.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.motion.capabilities()
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        Some(self)
    }
}
