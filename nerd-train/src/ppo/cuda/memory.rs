//! Memory on a card: of a rollout, of what passes read of it, and where an update is.

use super::*;

/// Parts that sums over all steps are made in.
pub(super) const PARTS: usize = 1024;

/// What is kept of a rollout beside what passes read.
pub(super) struct Kept {
    pub(super) environments: usize,
    pub(super) horizon: usize,
    pub(super) step: usize,
    pub(super) observations: Buffer<f64>,
    /// Values in units of reward, by step, of the last answer too.
    pub(super) values: Buffer<f64>,
    /// Values of what was reached where time ran out.
    pub(super) cut: Buffer<f64>,
    /// Advantages and returns.
    pub(super) both: Buffer<f64>,
    /// What came of each step (`gae.rs`).
    pub(super) rewards: Buffer<f64>,
    pub(super) ends: Buffer<u8>,
    /// Rows outside of a step, raw and normalised, and their environments.
    pub(super) rows: Buffer<f64>,
    pub(super) inputs: Buffer<f32>,
    pub(super) which: Buffer<u32>,
    /// Actions within their bounds.
    pub(super) actions: Buffer<f32>,
    /// Mean and inverse scale of the observations; mean and scale of the returns.
    pub(super) seen: [Buffer<f64>; 2],
    pub(super) returns: [f64; 2],
    pub(super) partial: Buffer<f64>,
    pub(super) means: [Buffer<f64>; 2],
    /// Of a step on the device: the policy has answered, the task has judged.
    pub(super) marks: [Event; 2],
    /// Of a rollout there: rows where time ran out with their number by environment, and for how many of each there is room.
    pub(super) over: Option<(Buffer<f64>, Buffer<u32>)>,
    pub(super) slots: usize,
}

impl Kept {
    pub(super) fn new(net: &Network, shape: &Shape, config: &PpoConfig, environments: usize) -> Result<Self, DeviceError> {
        let (device, n, steps, width) = (&net.device, environments, environments * config.horizon, shape.inputs());
        let (numbers, columns) = (|len: usize| device.zeros::<f64>(len), width.max(2));
        Ok(Self {
            environments: n,
            horizon: config.horizon,
            step: 0,
            observations: numbers(steps * width)?,
            values: numbers(steps + n)?,
            cut: numbers(steps)?,
            both: numbers(2 * steps)?,
            rewards: numbers(steps)?,
            ends: device.zeros(steps)?,
            rows: numbers(n * width)?,
            inputs: device.zeros(n * net.plan.padded)?,
            which: device.zeros(n)?,
            actions: device.zeros(n * shape.action)?,
            seen: [numbers(width)?, numbers(width)?],
            returns: [0.0, 1.0],
            partial: numbers(PARTS * columns)?,
            means: [numbers(columns)?, numbers(columns)?],
            marks: [device.event()?, device.event()?],
            over: None,
            slots: 0,
        })
    }
}

/// What passes read of a rollout, by step.
pub(super) struct Steps {
    pub(super) inputs: Buffer<f32>,
    pub(super) advantages: Buffer<f32>,
    pub(super) goals: Buffer<f32>,
    pub(super) values: Buffer<f32>,
    pub(super) surprise: Buffer<f32>,
    pub(super) actions: Buffer<f32>,
    pub(super) means: Buffer<f32>,
    pub(super) spreads: Buffer<f32>,
}

impl Steps {
    /// Of so many steps, whose inputs and actions are so wide.
    pub(super) fn new(device: &Device, n: usize, padded: usize, action: usize) -> Result<Self, DeviceError> {
        let zeros = |width: usize| device.zeros(n * width);
        Ok(Self {
            inputs: zeros(padded)?,
            advantages: zeros(1)?,
            goals: zeros(1)?,
            values: zeros(1)?,
            surprise: zeros(1)?,
            actions: zeros(action)?,
            means: zeros(action)?,
            spreads: zeros(action)?,
        })
    }
}

/// Mirror of the struct in `kernels.cu`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(super) struct PassState {
    pub(super) rate: f64,
    pub(super) sums: [f64; 6],
    pub(super) norms: f64,
    pub(super) batches: f64,
    pub(super) step: u64,
    pub(super) factors: [f32; 4],
}
