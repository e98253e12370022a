//! [`CudaEngine`]: a policy that answers and learns on a GPU. Where episodes have kernels there, too ([`World`]), whole rollouts are made
//! without leaving it; else environments say what they show and what came of the actions. Of several ranks each has a card: it computes the
//! steps of a minibatch that are its own, gradients are added up, and every card makes the same step.

mod acting;
mod engine;
mod episodes;
mod memory;
mod pass;
mod roll;
mod shac;
mod world;

use std::sync::mpsc::Receiver;

use nerd_cuda::Arg::{self, Double, Float, Int, Long, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError, Precision, Replay, Sums};
use nerd_sim::articulated::device::{BLOCK, RANDOM, Reach, Resident, Trail, failed};
use nerd_sim::rig::LATEST;
use nerd_sim::solver::Fault;

use super::noise::key;
use crate::learner::cuda::{Network, Plan, joined, kernels};
use memory::{Kept, PassState, RollKey, Steps};
use world::World;

use super::*;
pub use episodes::{CudaEpisodes, Shown};
pub use shac::CudaShac;

const SOURCE: [&str; 4] = [include_str!("kernels.cu"), RANDOM, include_str!("acting.cu"), include_str!("shac/kernels.cu")];
/// Threads of a block, and blocks of the gradient norm's first stage.
const THREADS: usize = 128;
const SQUARES: usize = 64;
/// Terms of the loss, after a gradient that is added up over cards.
const TERMS: usize = 6;
/// No step: where a minibatch has fewer of this card than there is room for.
const NONE: u32 = u32::MAX;
/// Deviations by which a card's steps in a minibatch may be more than its share.
const FAR: f64 = 8.0;

/// The order of each pass, as it is drawn.
type Orders = Receiver<Result<Vec<u32>, String>>;

/// Memory on a GPU for rollouts and updates of one shape.
pub struct CudaEngine {
    /// Whether episodes that have kernels are stepped on the card.
    pub steps_episodes: bool,
    /// Whether their rollouts are gone back over.
    returns: bool,
    net: Network,
    shape: Shape,
    kept: Kept,
    steps: Steps,
    /// Steps of an iteration, and of a minibatch, of all cards; and rows of a minibatch for which there is room here.
    sizes: [usize; 2],
    rows: usize,
    order: Buffer<u32>,
    /// Gradients by a spread that is a parameter, by row.
    spread: Buffer<f32>,
    terms: Buffer<f64>,
    squares: Buffer<f64>,
    weights: Buffer<f32>,
    gradient: Buffer<f32>,
    moments: [Buffer<f32>; 2],
    state: Buffer<PassState>,
    replay: Replay<(u64, PpoConfig)>,
    rolls: Replay<RollKey>,
    /// Decay of Adam's moments.
    beta: [f64; 2],
    /// What is drawn of the next update: its settings, its seeds, and the order of each pass.
    orders: Option<(PpoConfig, StreamKey, Orders)>,
    team: Team,
    /// Over the cards of several ranks.
    sums: Option<Sums>,
    /// The episodes on the card, once they have been asked for; none of those that cannot be there.
    world: Option<Option<World>>,
}

impl CudaEngine {
    /// Memory for a policy's rollouts and updates under these settings, of this rank's share of the environments.
    pub fn new(shape: &Shape, config: &PpoConfig, ranks: &Arc<Ranks>) -> Result<Self> {
        let (team, sizes) = (Team::new(ranks, config.environments), sizes(config));
        let (own, rows) = (team.part.len(), room(&team, config));
        // An observation is a window of one token.
        let plan = Plan::new(shape.program(), 1)?;
        let (padded, parameters) = (plan.padded, plan.parameters());
        // The way back goes over all steps at once, and over what they led to.
        let all = if config.algorithm == Algorithm::Shac { (config.horizon + 1) * own } else { 0 };
        let mut net = Network::new(plan, rows.max(own).max(all), Precision::F32, true)?;
        net.device.add(&SOURCE.concat(), &SOURCE.into_iter().flat_map(kernels).collect::<Vec<_>>())?;
        let sums = joined(ranks, &net.device)?;
        let (device, n, zeros) = (&net.device, own * config.horizon, |len: usize| net.device.zeros::<f32>(len));
        Ok(Self {
            steps_episodes: true,
            returns: config.algorithm == Algorithm::Shac,
            kept: Kept::new(&net, shape, config, own)?,
            steps: Steps::new(device, n, padded, shape.action)?,
            sizes,
            rows,
            order: device.zeros(n.max(rows * sizes[0].div_ceil(sizes[1])))?,
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
            sums,
            team,
            world: None,
            shape: shape.clone(),
            net,
        })
    }

    /// Whether the episodes are on the card.
    pub fn has_episodes(&self) -> bool {
        matches!(self.world, Some(Some(_)))
    }

    /// A kernel over so many entries.
    fn over(&self, kernel: &str, entries: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.net.device.launch(kernel, (entries.div_ceil(THREADS), 1), (THREADS, 1), 0, args)
    }

    /// The spread's parameters; 0 if it is an output.
    fn parameter(&self) -> u64 {
        if self.shape.spread_by_state { 0 } else { self.weights.at(self.weights.len - self.shape.action) }
    }

    /// What the network says.
    fn said(&self) -> u64 {
        self.net.predictions().ptr
    }
}

/// Steps of an iteration, and of a minibatch.
fn sizes(config: &PpoConfig) -> [usize; 2] {
    [config.steps(), config.minibatch.min(config.steps())]
}

/// Steps of a minibatch of all cards for which this one has room.
fn room(team: &Team, config: &PpoConfig) -> usize {
    let (all, share) = (config.minibatch.min(config.steps()) as f64, team.part.len() as f64 / team.all as f64);
    ((all * share + FAR * (all * share * (1.0 - share)).sqrt()) as usize + if team.alone() { 0 } else { 8 }).min(all as usize)
}

/// This card's steps in an order of all, minibatch by minibatch, each filled up to its room.
fn own(team: &Team, order: &[u32], config: &PpoConfig) -> Result<Vec<u32>, String> {
    let room = room(team, config);
    let mut mine = Vec::with_capacity(order.len().div_ceil(config.minibatch) * room);
    for batch in order.chunks(config.minibatch) {
        let before = mine.len();
        mine.extend(team.own(batch));
        let found = mine.len() - before;
        if found > room {
            return Err(format!("a minibatch has {found} steps of this card, there is room for {room}: take larger ones"));
        }
        mine.resize(before + room, NONE);
    }
    Ok(mine)
}
