//! GPU memory of rollouts, of the inputs of passes, and of an update's state.

use super::*;

/// Number of partial sums in a sum over all steps.
pub(super) const PARTS: usize = 1024;

/// Buffers of a rollout that passes do not read.
pub(super) struct Kept {
    pub environments: usize,
    pub horizon: usize,
    pub step: usize,
    pub observations: Buffer<f64>,
    /// Values in units of reward: first of all steps `[step][env]`, then of the states after the last step `[env]`.
    /// Last come those of final states of truncated episodes, by step.
    pub values: Buffer<f64>,
    pub both: Buffer<f64>,
    /// `rewards`: reward of each step. `ends`: whether and how the step ended its episode (`gae.rs`).
    pub rewards: Buffer<f64>,
    pub ends: Buffer<u8>,
    /// `rows`, `inputs`, `which`: bootstrap rows, raw and normalised, and the indices of their values, each
    /// `[1 + slots][env]`. The first row of an environment is the state after the last step. Up to `slots` final states
    /// of truncated episodes follow.
    pub rows: Buffer<f64>,
    pub inputs: Buffer<f32>,
    pub which: Buffer<u32>,
    pub slots: usize,
    /// Number of truncated episodes of each environment so far in the rollout.
    pub cuts: Buffer<u32>,
    /// Actions of the present step, clamped to [-1, 1], `[env][action]`.
    pub actions: Buffer<f32>,
    /// Number of the noise stream of the first step; kernels add the number of the step.
    pub noise: Buffer<u64>,
    /// `seen`: mean and inverse scale of observations. `units`: mean and scale of returns.
    pub seen: [Buffer<f64>; 2],
    pub units: Buffer<f64>,
    pub partial: Buffer<f64>,
    pub means: [Buffer<f64>; 2],
}

impl Kept {
    pub fn new(net: &Network, shape: &Shape, config: &PpoConfig, environments: usize) -> DeviceResult<Self> {
        let device = &net.device;
        let n = environments;
        let steps = environments * config.horizon;
        let width = shape.inputs();
        let numbers = |len: usize| device.zeros::<f64>(len);
        let columns = width.max(2);
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

    /// Allocates bootstrap rows for `slots` truncated episodes per environment.
    pub fn slots(&mut self, net: &Network, slots: usize) -> DeviceResult {
        if self.slots < slots {
            let device = &net.device;
            let n = self.environments;
            let all = (1 + slots) * self.environments;
            (self.rows, self.inputs) =
                (device.zeros(all * self.rows.len / n / (1 + self.slots))?, device.zeros(all * net.plan.padded)?);
            (self.which, self.slots) = (device.zeros(all)?, slots);
        }
        Ok(())
    }

    /// Address of the values of final states, for episodes truncated at a step.
    pub fn cut(&self, step: usize) -> u64 {
        self.values.at((self.horizon + 1 + step) * self.environments)
    }
}

/// Buffers of a rollout that passes read, by step.
pub(super) struct Steps {
    pub inputs: Buffer<f32>,
    pub advantages: Buffer<f32>,
    pub value_targets: Buffer<f32>,
    pub values: Buffer<f32>,
    pub neg_log_prob: Buffer<f32>,
    pub actions: Buffer<f32>,
    pub means: Buffer<f32>,
    pub spreads: Buffer<f32>,
}

impl Steps {
    /// Allocates memory for `n` steps, with `padded` inputs and `action` numbers of an action each.
    pub fn new(device: &Device, n: usize, padded: usize, action: usize) -> DeviceResult<Self> {
        let zeros = |width: usize| device.zeros(n * width);
        Ok(Self {
            inputs: zeros(padded)?,
            advantages: zeros(1)?,
            value_targets: zeros(1)?,
            values: zeros(1)?,
            neg_log_prob: zeros(1)?,
            actions: zeros(action)?,
            means: zeros(action)?,
            spreads: zeros(action)?,
        })
    }
}

/// Mirror of `PassState` in `kernels.cu`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(super) struct PassState {
    pub learning_rate: f64,
    pub sums: [f64; 6],
    pub norms: f64,
    pub batches: f64,
    pub step: u64,
    pub factors: [f32; 4],
}

/// Key of a captured rollout: world, ring index of its first frame, key of the noise.
pub(super) type RollKey = (u64, usize, [u64; 4]);
