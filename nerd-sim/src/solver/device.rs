//! Batches that stay in a GPU's memory.

use nerd_cuda::{Buffer, Device, DeviceError};

use crate::prelude::*;

/// An error of the device as one of a step.
pub fn failed(error: DeviceError) -> StepError {
    StepError::Solver(error.to_string())
}

/// A batch that stays on a device while others work on it there, too.
pub trait Resident {
    /// Takes a batch over; refuses what has no kernel. What the host has of it grows old from here on.
    fn hold(&mut self, batch: &Batch) -> Result<(), StepError>;

    /// The device, and what is held there.
    fn held(&self) -> Option<(&Device, &Held)>;

    /// Where it counts on the device, in 32 bits, the frames that it remembers of each environment; 0 if it remembers nothing.
    fn memory(&self) -> u64;

    /// One frame of what is held, on the device's main stream. Environments whose fault is not 0 may stay as they are.
    fn frame(&self) -> Result<(), DeviceError>;

    /// Makes room for the way back over so many frames of what is held; refuses what has none.
    fn keep(&mut self, batch: &Batch, frames: usize) -> Result<(), StepError>;

    /// Finds, on the device's main stream, what the way back over these frames needs of all of them, for as many as there is room for.
    fn recall(&self, trail: Trail) -> Result<(), DeviceError>;

    /// Goes back over one of them.
    fn back(&self, trail: Trail, back: Back) -> Result<(), DeviceError>;
}

/// Frames on a device, one after the other: addresses of the states before them and of the torques in them, `[frame][env]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trail {
    /// `[q, qd]`, f64.
    pub states: u64,
    /// f64.
    pub torques: u64,
    /// Frames.
    pub frames: usize,
}

/// A way back over one frame of a [`Trail`]: addresses of gradients `[env][row]`, f64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Back {
    /// Which frame.
    pub frame: usize,
    /// Gradients of each environment.
    pub rows: usize,
    /// By the next states, in their tangent space.
    pub by_next: u64,
    /// Where those by states go; may be the same place. Zeros where an environment's frame cannot be made.
    pub by_states: u64,
    /// Where those by torques go.
    pub by_torques: u64,
    /// Where the next states go, and as i32 why there are none; or 0.
    pub next: [u64; 2],
}

/// Memory for so many environments, and the scenes that the device knows.
pub struct Held {
    /// Environments.
    pub n: usize,
    /// Joints of each.
    pub joints: usize,
    /// `[env][q, qd]`.
    pub states: Buffer<f64>,
    /// Five numbers a joint, where there are drives.
    pub drives: Buffer<f64>,
    /// Of each environment, or `[frame]` of each.
    pub torques: Buffer<f64>,
    /// Scenes, one after the other, each with what the robot there has of its own, and which of them is whose.
    pub records: Buffer<f64>,
    /// See `records`.
    pub scene_of: Buffer<i32>,
    /// Why an environment went no further, or 0.
    pub faults: Buffer<i32>,
    /// Frames that went well.
    pub done: Buffer<u32>,
    forces: Buffer<f64>,
    pub(crate) watched: bool,
    pub(crate) scenes: Vec<Arc<Scene>>,
    pub(crate) systems: Vec<Arc<System>>,
}

impl Held {
    /// Memory for a batch.
    pub fn new(device: &Device, batch: &Batch) -> Result<Self, DeviceError> {
        let (n, robot) = (batch.len(), &batch.system.robot);
        Ok(Self {
            n,
            joints: robot.joint_count(),
            states: device.zeros(n * robot.state_dim())?,
            drives: device.zeros(5 * batch.drives.len())?,
            torques: device.zeros(n * robot.joint_count())?,
            records: device.zeros(0)?,
            scene_of: device.zeros(n)?,
            faults: device.zeros(n)?,
            done: device.zeros(n)?,
            forces: device.zeros(3 * n * robot.contact_points.len())?,
            watched: false,
            scenes: Vec::new(),
            systems: Vec::new(),
        })
    }

    /// Where contact forces go; 0 unless requested.
    pub fn forces(&self) -> u64 {
        if self.watched { self.forces.ptr } else { 0 }
    }

    /// States and forces after the frames; each environment's fault and the frames that it made.
    pub(crate) fn give(&self, device: &Device, batch: &mut Batch, next: &mut Vec<f64>) -> Result<Vec<(i32, u32)>, DeviceError> {
        next.resize(batch.states.len(), 0.0);
        device.read(&self.states, next)?;
        let (mut wrong, mut went) = (vec![0i32; self.n], vec![0u32; self.n]);
        device.read(&self.faults, &mut wrong)?;
        device.read(&self.done, &mut went)?;
        if self.watched {
            let mut forces = vec![0.0; 3 * batch.forces.len()];
            device.read(&self.forces, &mut forces)?;
            batch.forces.iter_mut().zip(forces.as_chunks::<3>().0).for_each(|(f, x)| *f = Vector3::from(*x));
        }
        Ok(wrong.into_iter().zip(went).collect())
    }
}
