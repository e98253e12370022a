//! GPU memory of a rollout, of the inputs of its passes, and of an update's state.

use super::*;

/// Parts that sums over all steps are made in.
pub(super) const PARTS: usize = 1024;

/// What is kept of a rollout beside what passes read.
pub(super) struct Kept {
    pub(super) environments: usize,
    pub(super) horizon: usize,
    pub(super) step: usize,
    pub(super) observations: Buffer<f64>,
    /// Values in units of reward: of every step, of the states after the last step, and of the states at time-outs by step.
    pub(super) values: Buffer<f64>,
    pub(super) both: Buffer<f64>,
    /// What came of each step (`gae.rs`).
    pub(super) rewards: Buffer<f64>,
    pub(super) ends: Buffer<u8>,
    /// Rows that steps led to, raw and normalised, and where their values go: of the last step, then of every environment's first time that
    /// ran out in a rollout on the device, and so on, for how many of which there is room.
    pub(super) rows: Buffer<f64>,
    pub(super) inputs: Buffer<f32>,
    pub(super) which: Buffer<u32>,
    pub(super) slots: usize,
    /// How many have.
    pub(super) cuts: Buffer<u32>,
    /// Actions within their bounds.
    pub(super) actions: Buffer<f32>,
    /// Number of the first step's noise.
    pub(super) noise: Buffer<u64>,
    /// Mean and inverse scale of the observations; mean and scale of the returns.
    pub(super) seen: [Buffer<f64>; 2],
    pub(super) units: Buffer<f64>,
    pub(super) partial: Buffer<f64>,
    pub(super) means: [Buffer<f64>; 2],
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
            values: numbers(2 * steps + n)?,
            both: numbers(2 * steps)?,
            rewards: numbers(steps)?,
            ends: device.zeros(steps)?,
            rows: numbers(n * width)?,
            inputs: device.zeros(n * net.plan.padded)?,
            which: device.zeros(n)?,
            slots: 0,
            cuts: device.zeros(n)?,
            actions: device.zeros(n * shape.action)?,
            noise: device.zeros(1)?,
            seen: [numbers(width)?, numbers(width)?],
            units: numbers(2)?,
            partial: numbers(PARTS * columns)?,
            means: [numbers(columns)?, numbers(columns)?],
        })
    }

    /// Makes room for `slots` time-outs in every environment.
    pub(super) fn slots(&mut self, net: &Network, slots: usize) -> Result<(), DeviceError> {
        if self.slots < slots {
            let (device, n, all) = (&net.device, self.environments, (1 + slots) * self.environments);
            (self.rows, self.inputs) = (device.zeros(all * self.rows.len / n / (1 + self.slots))?, device.zeros(all * net.plan.padded)?);
            (self.which, self.slots) = (device.zeros(all)?, slots);
        }
        Ok(())
    }

    /// Address of the values of the states at time-outs, by step.
    pub(super) fn cut(&self, step: usize) -> u64 {
        self.values.at((self.horizon + 1 + step) * self.environments)
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
    /// For `n` steps, with `padded` inputs and `action` actions each.
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

/// What a captured rollout is of: the world, what its steps are kept for, and the seed of its noise.
pub(super) type RollKey = (u64, usize, [u64; 4]);
