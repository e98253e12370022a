//! Batches that stay in a GPU's memory.

use nerd_cuda::{Buffer, Device, DeviceError};

use crate::prelude::*;

/// Converts a device error to a step error.
pub fn failed(error: DeviceError) -> StepError {
    StepError::Solver(error.to_string())
}

/// A solver whose batch stays on a GPU, where other code works on it, too.
pub trait Resident {
    /// Uploads a batch; refuses one without kernels. The host's copy becomes stale from here on.
    fn hold(&mut self, batch: &Batch) -> Result<(), StepError>;

    /// The device, and the batch held there.
    fn held(&self) -> Option<(&Device, &Held)>;

    /// Device address of the counters (32 bits) of frames in memory, by environment; 0 for a solver without memory.
    fn memory(&self) -> u64;

    /// One frame of the held batch, on the device's main stream. Environments whose fault is not 0 may stay as they are.
    fn frame(&self) -> Result<(), DeviceError>;

    /// Allocates memory for gradients over `frames` frames of the held batch; refuses a solver without gradients.
    fn keep(&mut self, batch: &Batch, frames: usize) -> Result<(), StepError>;

    /// Prepares gradients over these frames, on the device's main stream, for as many frames as there is room for.
    fn recall(&self, trail: Trail) -> Result<(), DeviceError>;

    /// Vector-Jacobian product of one of them.
    fn back(&self, trail: Trail, back: Back) -> Result<(), DeviceError>;
}

/// Consecutive frames on a device: addresses of the states before them and of the torques in them, `[frame][env]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trail {
    /// `[q, qd]`, f64.
    pub states: u64,
    /// f64.
    pub torques: u64,
    /// Frames.
    pub frames: usize,
}

/// A vector-Jacobian product of one frame of a [`Trail`]: addresses of gradients `[env][row]`, f64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Back {
    /// Which frame.
    pub frame: usize,
    /// Gradients (rows) of each environment.
    pub rows: usize,
    /// Input: with respect to the next states, in their tangent space.
    pub by_next: u64,
    /// Output: with respect to states; may be the same memory. Zeros where an environment's frame fails.
    pub by_states: u64,
    /// Output: with respect to torques.
    pub by_torques: u64,
    /// Output: the next states, and faults as i32; or 0.
    pub next: [u64; 2],
}

/// Memory for the environments of a batch, and the scenes on the device.
pub struct Held {
    /// Environments.
    pub n: usize,
    /// Joints of each.
    pub joints: usize,
    /// `[env][q, qd]`.
    pub states: Buffer<f64>,
    /// Five numbers a joint, where there are drives.
    pub drives: Buffer<f64>,
    /// Torques of each environment, or `[frame]` of them.
    pub torques: Buffer<f64>,
    /// Scenes, one after the other, each with its robot's own parameters; `scene_of` maps environments to them.
    pub records: Buffer<f64>,
    /// See `records`.
    pub scene_of: Buffer<i32>,
    /// Fault of each environment, or 0.
    pub faults: Buffer<i32>,
    /// Frames that succeeded.
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

    /// Address for contact forces; 0 unless requested.
    pub fn forces(&self) -> u64 {
        if self.watched { self.forces.ptr } else { 0 }
    }

    /// Downloads states and forces after the frames; returns each environment's fault and its completed frames.
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
