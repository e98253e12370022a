//! Frames of a batch that stays on a device, for any solver there.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_cuda::{Device, DeviceError};

use super::program::{Reach, fault};
use super::rows::Rows;
use super::scenes::take;
use crate::articulated::config::ArticulatedConfig;
use crate::batch::Batch;
use crate::solver::device::{Back, Held, Resident, Trail, acting, failed};
use crate::solver::{Capabilities, Fault, Slopes, Solver, StepError, finish, sound};
use crate::system::System;

/// Environments of a block: a full warp, since an access of local memory costs as much for fewer; no more, so that a small batch spreads
/// over the whole device. Measured on an H200 with 2 to 64.
pub const BLOCK: usize = 32;

/// What moves environments on a device.
pub trait Motion: Send {
    /// What it can do beside stepping states.
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    /// Refuses a batch that it has no kernel for, whatever its capabilities.
    ///
    /// # Errors
    /// What that is, and where it can be stepped.
    fn check(&self, _batch: &Batch) -> Result<(), StepError> {
        Ok(())
    }

    /// The settings by which scenes are put in order.
    fn config(&self) -> &ArticulatedConfig;

    /// Makes kernels for a batch of this reach, and forgets all that was before.
    ///
    /// # Errors
    /// If there is no device, or not enough memory.
    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError>;

    /// The device with its kernels, once opened.
    fn device(&self) -> Option<&Device>;

    /// So many frames of the batch that `held` took over, the first of them `frames[env]` by the environments' own count. Torques are held
    /// over all frames, or there is a set for each.
    ///
    /// # Errors
    /// If the device fails.
    fn advance(&mut self, held: &Held, first: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError>;

    /// Refuses a batch whose frames it cannot go back over.
    ///
    /// # Errors
    /// What that is, and where there are slopes.
    fn goes_back(&self, _batch: &Batch) -> Result<(), StepError> {
        Err(StepError::Refused("this solver has no slopes on a card: take them on the CPU".into()))
    }

    /// Makes room for the way back over so many frames of the batch, which [`Motion::goes_back`] has admitted.
    ///
    /// # Errors
    /// If there is not enough memory.
    fn keep(&mut self, _batch: &Batch, _frames: usize) -> Result<(), StepError> {
        Ok(())
    }

    /// See [`Resident::recall`].
    ///
    /// # Errors
    /// If the device fails.
    fn recall(&self, _held: &Held, _trail: Trail) -> Result<(), DeviceError> {
        Ok(())
    }

    /// See [`Resident::back`].
    ///
    /// # Errors
    /// If the device fails.
    fn back(&self, _held: &Held, _trail: Trail, _back: Back) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Clears what is remembered of an environment.
    fn reset(&mut self, _env: usize) {}

    /// Whether the next frame depends on some before.
    fn remembers(&self) -> bool {
        false
    }

    /// What is remembered of environments that do not follow on these frames of theirs is forgotten, as [`Motion::advance`] begins. From
    /// here on whoever calls [`Motion::frame`] sees to that, by [`Motion::memory`].
    ///
    /// # Errors
    /// If the device fails.
    fn follow(&mut self, _first: &[u64]) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Where it counts on the device, in 32 bits, the frames that it remembers of each environment; 0 if it remembers nothing.
    fn memory(&self) -> u64 {
        0
    }

    /// One frame of what `held` holds, on the device's main stream. Environments whose fault is not 0 may stay as they are.
    ///
    /// # Errors
    /// If the device fails.
    fn frame(&self, held: &Held) -> Result<(), DeviceError>;
}

impl<M: Motion> Resident for OnDevice<M> {
    fn hold(&mut self, batch: &Batch) -> Result<(), StepError> {
        let torques = vec![0.0; batch.len() * batch.system.robot.joint_count()];
        sound(batch, &torques, &mut self.faults)?;
        if !self.faults.is_empty() {
            return Err(StepError::Environments(std::mem::take(&mut self.faults)));
        }
        self.motion.capabilities().admit(batch)?;
        self.motion.check(batch)?;
        self.prepare(batch)?;
        let Some((Made { held, reach, .. }, device)) = self.made.as_mut().zip(self.motion.device()) else { return Ok(()) };
        take(held, device, batch, self.motion.config(), *reach, (&torques, 0))?;
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

/// A [`Solver`] that makes many frames in a row, as [`OnDevice::roll`].
pub trait Roll: Solver {
    /// See [`OnDevice::roll`].
    ///
    /// # Errors
    /// As that.
    fn roll(&mut self, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError>;
}

impl<M: Motion> Roll for OnDevice<M> {
    fn roll(&mut self, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError> {
        OnDevice::roll(self, batch, torques, frames)
    }
}

/// A [`Solver`] whose batch is on a device.
pub struct OnDevice<M> {
    motion: M,
    made: Option<Made>,
    next: Vec<f64>,
    faults: Vec<Fault>,
}

/// What kernels and memory were made for.
struct Made {
    system: Arc<System>,
    reach: Reach,
    held: Held,
    rows: Option<Rows>,
}

impl<M: Motion> OnDevice<M> {
    /// Nothing is opened before its first step.
    pub fn by(motion: M) -> Self {
        Self { motion, made: None, next: Vec::new(), faults: Vec::new() }
    }

    /// So many frames in a row without leaving the device. `torques` are `[env][joint]`, held over all of them, or `[frame][env][joint]`.
    ///
    /// # Errors
    /// As [`Solver::step`]. An environment that fails keeps its state before that frame, which the error names.
    pub fn roll(&mut self, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError> {
        let (n, joints) = (batch.len(), batch.system.robot.joint_count());
        let width = n * joints;
        let hold = torques.len() == width;
        if frames == 0 || (!hold && torques.len() != frames * width) {
            return Err(StepError::torques(torques.len(), n, joints));
        }
        sound(batch, &torques[..width], &mut self.faults)?;
        let columns = acting(torques, joints);
        if columns.is_none()
            && let Some(at) = torques[width..].iter().position(|x| !x.is_finite())
        {
            let (frame, env, x) = (1 + at / width, at % width / joints, torques[width + at]);
            return Err(StepError::Solver(format!("a torque of environment {env} in frame {frame} of the roll is {x}")));
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
        let Some((Made { held, reach, .. }, device)) = self.made.as_mut().zip(self.motion.device()) else { return Ok(()) };
        take(held, device, batch, self.motion.config(), *reach, (torques, columns.unwrap_or(joints)))?;
        self.motion.advance(held, &batch.frames, frames, hold).map_err(failed)?;
        let Some(device) = self.motion.device() else { return Ok(()) };
        let done = held.give(device, batch, &mut self.next).map_err(failed)?;
        let d = batch.system.robot.state_dim();
        for (env, (code, went)) in done.into_iter().enumerate() {
            batch.frames[env] += u64::from(went.saturating_sub(u32::from(code == 0)));
            if code != 0 && self.faults.iter().all(|f| f.env != env) {
                // What it reached before the frame that failed is kept.
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

    /// Kernels and memory that fit the batch.
    fn prepare(&mut self, batch: &Batch) -> Result<(), StepError> {
        let asked = Reach::of(batch);
        let fits = |m: &Made| {
            let enough = m.reach.colliders >= asked.colliders && m.reach.driven == asked.driven;
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

impl<M: Motion> Solver for OnDevice<M> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.roll(batch, torques, 1)
    }

    fn back(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        self.motion.goes_back(batch)?;
        let wide = batch.len() * rows * 2 * batch.system.robot.nv();
        if wide == 0 || by_next.len() != wide {
            return Err(StepError::Solver(format!("{} numbers of gradients, {wide} are needed, and some", by_next.len())));
        }
        sound(batch, torques, &mut self.faults)?;
        if !self.faults.is_empty() {
            return Err(StepError::Environments(std::mem::take(&mut self.faults)));
        }
        self.motion.capabilities().admit(batch)?;
        self.motion.check(batch)?;
        self.prepare(batch)?;
        self.motion.keep(batch, 1)?;
        let Some((Made { held, reach, rows: memory, .. }, device)) = self.made.as_mut().zip(self.motion.device()) else {
            return Ok(Slopes::default());
        };
        take(held, device, batch, self.motion.config(), *reach, (torques, batch.system.robot.joint_count()))?;
        if !memory.as_ref().is_some_and(|memory| memory.fits(rows)) {
            *memory = Some(Rows::new(device, batch, rows).map_err(failed)?);
        }
        memory.as_ref().map_or(Ok(Slopes::default()), |memory| memory.back(&self.motion, held, batch, by_next))
    }

    fn reset(&mut self, env: usize) {
        self.motion.reset(env);
    }

    fn remembered(&self, _env: usize) -> Result<Vec<f64>, StepError> {
        if self.motion.remembers() {
            return Err(StepError::Refused("what this network remembers stays on the card: fork it on the CPU".into()));
        }
        Ok(Vec::new())
    }

    fn capabilities(&self) -> Capabilities {
        self.motion.capabilities()
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        Some(self)
    }
}
