//! [`CudaEngine`]: rollouts and PPO updates on a GPU. Episodes of a task with kernels run on the GPU too ([`World`]),
//! so that whole rollouts stay there. Other episodes exchange observations and actions with the CPU at every step.

mod acting;
mod engine;
mod episodes;
mod memory;
mod pass;
mod roll;
mod shac;
mod world;

use std::sync::mpsc::Receiver;

use nerd_cuda::{Arg, Buffer, Device, DeviceError, DeviceResult, Precision, Replay, args};
use nerd_sim::articulated::device::{BLOCK, RANDOM, Reach, Resident, Trail};
use nerd_sim::rig::LATEST;
use nerd_sim::solver::Fault;

use super::noise::key;
use crate::learner::cuda::{Network, Plan, kernels};
use memory::{Kept, PassState, RollKey, Steps};
use world::World;

use super::*;
pub use episodes::{CudaEpisodes, Shown};
pub use shac::CudaShac;

const SOURCE: [&str; 4] =
    [include_str!("kernels.cu"), RANDOM, include_str!("acting.cu"), include_str!("shac/kernels.cu")];
/// `THREADS`: threads of a block. `SQUARES`: blocks of the first stage of the gradient norm.
const THREADS: usize = 128;
const SQUARES: usize = 64;
const TERMS: usize = 6;
/// Permutations of an update, one per pass.
type Orders = Receiver<Vec<u32>>;

/// Memory on a GPU for rollouts and updates of one shape.
pub struct CudaEngine {
    /// Whether episodes with kernels run on the GPU.
    pub steps_episodes: bool,
    /// Whether rollouts are differentiated, as SHAC needs.
    returns: bool,
    net: Network,
    shape: Shape,
    kept: Kept,
    steps: Steps,
    sizes: [usize; 2],
    order: Buffer<u32>,
    /// Gradients with respect to the log standard deviation parameters, by row of a minibatch.
    spread: Buffer<f32>,
    terms: Buffer<f64>,
    squares: Buffer<f64>,
    weights: Buffer<f32>,
    gradient: Buffer<f32>,
    moments: [Buffer<f32>; 2],
    state: Buffer<PassState>,
    replay: Replay<(u64, PpoConfig)>,
    rolls: Replay<RollKey>,
    beta: [f64; 2],
    /// Permutations of the next update, with their settings and key.
    orders: Option<(PpoConfig, StreamKey, Orders)>,
    /// The episodes on the GPU, once requested; `Some(None)` if they cannot run there.
    world: Option<Option<World>>,
}

impl CudaEngine {
    /// Memory for a policy's rollouts and updates under these settings.
    pub fn new(shape: &Shape, config: &PpoConfig) -> Result<Self> {
        let own = config.environments;
        let sizes = sizes(config);
        let rows = sizes[1];
        // The network sees an observation as a window of one token.
        let plan = Plan::new(shape.program(), 1)?;
        let padded = plan.padded;
        let parameters = plan.parameters();
        // SHAC's backward pass needs all steps at once, and the bootstrap rows.
        let all = if config.algorithm == Algorithm::Shac { (config.horizon + 1) * own } else { 0 };
        let mut net = Network::new(plan, rows.max(own).max(all), Precision::F32, true)?;
        net.device.add(&SOURCE.concat(), &SOURCE.into_iter().flat_map(kernels).collect_vec())?;
        let device = &net.device;
        let n = own * config.horizon;
        let zeros = |len: usize| net.device.zeros::<f32>(len);
        Ok(Self {
            steps_episodes: true,
            returns: config.algorithm == Algorithm::Shac,
            kept: Kept::new(&net, shape, config, own)?,
            steps: Steps::new(device, n, padded, shape.action)?,
            sizes,
            order: device.zeros(n)?,
            spread: zeros(rows * shape.action)?,
            terms: device.zeros(TERMS * rows.div_ceil(THREADS))?,
            squares: device.zeros(SQUARES)?,
            weights: zeros(parameters)?,
            gradient: zeros(parameters + TERMS)?,
            moments: [zeros(parameters)?, zeros(parameters)?],
            state: device.zeros(1)?,
            replay: Replay::default(),
            rolls: Replay::default(),
            beta: [0.9, 0.999],
            orders: None,
            world: None,
            shape: shape.clone(),
            net,
        })
    }

    /// Whether the episodes run on the GPU.
    pub fn has_episodes(&self) -> bool {
        matches!(self.world, Some(Some(_)))
    }

    fn over(&self, kernel: &str, entries: usize, args: &[Arg]) -> DeviceResult {
        self.net.device.launch_each(kernel, entries, THREADS, args)
    }

    /// Address of the log standard deviation parameters; 0 if they are outputs.
    fn parameter(&self) -> u64 {
        if self.shape.state_dependent_std { 0 } else { self.weights.at(self.weights.len - self.shape.action) }
    }
}

/// The solver's batch on the device.
fn on_card(simulation: &mut Simulation) -> Result<&dyn Resident> {
    match simulation.solver.resident() {
        Some(resident) => Ok(resident),
        None => refuse!("the solver has left the device"),
    }
}

/// Number of steps in an iteration and in a minibatch.
fn sizes(config: &PpoConfig) -> [usize; 2] {
    [config.steps(), config.minibatch.min(config.steps())]
}
