//! Batches resident in GPU memory.

use nerd_cuda::{Buffer, Device, DeviceError};

use crate::prelude::*;

impl From<DeviceError> for StepError {
    fn from(error: DeviceError) -> Self {
        Self::Solver(error.to_string())
    }
}

/// Converts a device error to a step error.
pub fn failed(error: DeviceError) -> StepError {
    error.into()
}

/// A solver with a batch resident on a GPU, which other kernels also access.
pub trait Resident {
    /// Uploads a batch; refuses a batch that has no kernels. The host's copy is stale afterwards.
    fn hold(&mut self, batch: &Batch) -> Result<(), StepError>;

    /// The device, and the resident batch.
    fn held(&self) -> Option<(&Device, &Held)>;

    /// Device address of the number of frames in memory (32 bits) of each environment; 0 for a solver without memory.
    fn memory(&self) -> u64;

    /// Steps one frame of the resident batch on the device's main stream. Environments with a nonzero fault may stay
    /// unchanged.
    fn frame(&self) -> Result<(), DeviceError>;

    /// Allocates memory for gradients over `frames` frames of the resident batch; refuses a solver without gradients.
    fn keep(&mut self, batch: &Batch, frames: usize) -> Result<(), StepError>;

    /// Prepares gradients over the frames of `trail` on the device's main stream, as far as memory was allocated.
    fn recall(&self, trail: Trail) -> Result<(), DeviceError>;

    /// Vector-Jacobian product of a frame of `trail`.
    fn back(&self, trail: Trail, back: Back) -> Result<(), DeviceError>;
}

/// Consecutive frames on a device: addresses of the states before each frame and of its torques, `[frame][env]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trail {
    /// Address of states `[q, qd]`, f64.
    pub states: u64,
    /// Address of torques, f64.
    pub torques: u64,
    /// Number of frames.
    pub frames: usize,
}

/// A vector-Jacobian product of a frame of a [`Trail`]: addresses of gradients `[env][row]`, f64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Back {
    /// Index of the frame.
    pub frame: usize,
    /// Gradients (rows) per environment.
    pub rows: usize,
    /// Input: gradients with respect to the next states, in their tangent space.
    pub grad_next: u64,
    /// Output: gradients with respect to the states before the frame. May equal `grad_next`, whose memory is then
    /// overwritten. Zero where an environment's frame fails.
    pub by_states: u64,
    /// Output: gradients with respect to torques.
    pub by_torques: u64,
    /// Output: addresses of the next states, and of the faults as i32; address 0 skips an output.
    pub next: [u64; 2],
}

/// Device memory for the environments of a batch and their scenes.
pub struct Held {
    /// Number of environments.
    pub n: usize,
    /// Joints per environment.
    pub joints: usize,
    /// States `[env][q, qd]`.
    pub states: Buffer<f64>,
    /// Drives, five numbers per joint; empty without drives.
    pub drives: Buffer<f64>,
    /// Torques `[env][joint]`, or `[frame][env][joint]`.
    pub torques: Buffer<f64>,
    /// Scenes one after the other, each with the parameters of its robot; `scene_of` maps environments to scenes.
    pub records: Buffer<f64>,
    /// Scene of each environment, see `records`.
    pub scene_of: Buffer<i32>,
    /// Fault of each environment, 0 without.
    pub faults: Buffer<i32>,
    /// Number of successful frames of each environment.
    pub done: Buffer<u32>,
    forces: Buffer<f64>,
    pub(crate) watched: bool,
    pub(crate) scenes: Vec<Arc<Scene>>,
    pub(crate) systems: Vec<Arc<System>>,
}

impl Held {
    /// Allocates memory for a batch.
    pub fn new(device: &Device, batch: &Batch) -> Result<Self, DeviceError> {
        let n = batch.len();
        let robot = &batch.system.robot;
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

    /// Device address of contact forces; 0 unless requested.
    pub fn forces(&self) -> u64 {
        if self.watched { self.forces.ptr } else { 0 }
    }

    /// Downloads states and forces after frames. Returns each environment's fault and its number of completed frames.
    pub(crate) fn give(
        &self,
        device: &Device,
        batch: &mut Batch,
        next: &mut Vec<f64>,
    ) -> Result<Vec<(i32, u32)>, DeviceError> {
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
