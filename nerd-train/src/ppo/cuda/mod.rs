//! [`CudaEngine`]: a policy that answers and learns on a GPU. Where episodes have kernels there, too ([`World`]), whole rollouts are made
//! without leaving it; else environments say what they show and what came of the actions. Of several ranks each has a card: it computes the
//! steps of a minibatch that are its own, gradients are added up, and every card makes the same step.

mod acting;
mod memory;
mod pass;
mod roll;
mod world;

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use nerd_cuda::{Arg, Buffer, Device, DeviceError, Precision, Replay, Sums};
use nerd_sim::articulated::device::RANDOM;
use nerd_sim::solver::StepError;
use nerd_tasks::{Episodes, Snapshot, StepResult, Task};

use super::arena::Arena;
use super::config::PpoConfig;
use super::engine::{Engine, rollout};
use super::error::PpoError;
use super::noise::StreamKey;
use super::policy::{Policy, Shape};
use super::rollout::{Running, Taken};
use super::team::Team;
use super::trainer::Trainer;
use super::update::{self, Adam, Updated};
use crate::error::{Error, Result};
use crate::learner::cuda::{Network, Plan};
use crate::progress::tell;
use crate::ranks::{RankError, Ranks};
use memory::{Kept, PassState, Steps};
use world::World;

const SOURCE: [&str; 3] = [include_str!("kernels.cu"), RANDOM, include_str!("acting.cu")];
const KERNELS: [&str; 13] = [
    "terms_out",
    "terms_back",
    "ppo_gather",
    "ppo_loss",
    "squares",
    "ppo_finish",
    "normalize",
    "act",
    "value",
    "gae",
    "columns",
    "mean",
    "goals",
];
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
    /// Adam's.
    moments: [Buffer<f32>; 2],
    state: Buffer<PassState>,
    /// A pass, by its settings.
    replay: Replay<PpoConfig>,
    /// What is drawn of the next update: its settings, its seeds, and the order of each pass.
    orders: Option<(PpoConfig, StreamKey, Orders)>,
    team: Team,
    /// Over the cards of several ranks.
    sums: Option<Sums>,
    /// The episodes on the card, once they have been asked for; none of those that cannot be there.
    world: Option<Option<World>>,
}

impl CudaEngine {
    /// Memory for a policy's rollouts and updates under these settings.
    ///
    /// # Errors
    /// If there is no GPU, a library is missing or memory runs out.
    pub fn new(shape: &Shape, config: &PpoConfig) -> Result<Self, DeviceError> {
        Self::among(shape, config, &Arc::default())
    }

    /// The same for this rank's share of the environments, beside the cards of the other ranks.
    ///
    /// # Errors
    /// As [`CudaEngine::new`]; if NCCL is missing or fails, or another rank is gone.
    pub fn among(shape: &Shape, config: &PpoConfig, ranks: &Arc<Ranks>) -> Result<Self, DeviceError> {
        let (team, sizes) = (Team::new(ranks, config.environments), sizes(config));
        let (own, rows) = (team.part.len(), room(&team, config));
        // An observation is a window of one token.
        let plan = Plan::new(shape.program(), 1, false)?;
        let (padded, parameters) = (plan.padded, plan.parameters());
        let mut net = Network::new(nerd_cuda::ordinal(), plan, rows.max(own), Precision::F32, true)?;
        net.device.add(&SOURCE.concat(), &KERNELS)?;
        let (device, n, zeros) = (&net.device, own * config.horizon, |len: usize| net.device.zeros::<f32>(len));
        Ok(Self {
            steps_episodes: true,
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
            orders: None,
            sums: joined(device, &team)?,
            team,
            world: None,
            shape: shape.clone(),
            net,
        })
    }

    /// The episodes as a world on the device of their solver, taken out; none where they cannot be, with a line that says why.
    fn world(&mut self, episodes: &mut Episodes) -> Result<Option<World>, StepError> {
        if !self.steps_episodes {
            return Ok(None);
        }
        if let Some(known) = self.world.take() {
            return Ok(known);
        }
        match World::new(episodes) {
            Err(StepError::Refused(why)) => {
                tell(format_args!("{why}; what is seen goes to the card once a step, and actions come back"));
                Ok(None)
            }
            // The solver's own kernels: it says more when it steps.
            Err(StepError::Solver(_)) => Ok(None),
            other => other,
        }
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

/// A trainer of a task in an arena on the GPU, with its policy there, too; of several ranks each has its share of the environments.
///
/// # Errors
/// If task, arena or settings cannot be, or the device fails.
pub fn on_card(arena: &Arena, task: Box<dyn Task>, config: &PpoConfig, seed: u64, ranks: &Arc<Ranks>) -> Result<Trainer> {
    let episodes = arena.part(task, ranks.part(config.environments), seed)?;
    let mut trainer = Trainer::among(ranks, episodes, config.clone(), seed)?;
    let engine = CudaEngine::among(&trainer.state.policy.shape, config, ranks);
    trainer.engine = Box::new(engine.map_err(|e| Error::Refused(format!("--device cuda: {e}")))?);
    Ok(trainer)
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

/// Joins the cards of the other ranks.
fn joined(device: &Device, team: &Team) -> Result<Option<Sums>, DeviceError> {
    if team.alone() {
        return Ok(None);
    }
    let ranks = &team.ranks;
    let id = if ranks.leads() { Sums::id()? } else { Vec::new() };
    let id = ranks.share(0, || id).map_err(lost)?;
    Sums::join(device, &id, ranks.rank(), ranks.world()).map(Some)
}

fn lost(error: RankError) -> DeviceError {
    DeviceError(error.to_string())
}

fn failed(error: DeviceError) -> PpoError {
    PpoError::Device(error.to_string())
}

impl Engine for CudaEngine {
    fn ahead(&mut self, config: &PpoConfig, key: StreamKey) {
        // Orders are drawn while the device rolls, as they are needed.
        let (give, orders) = std::sync::mpsc::sync_channel(config.epochs);
        let (team, settings) = (self.team.clone(), config.clone());
        std::thread::spawn(move || {
            let own = |order: Vec<u32>| if team.alone() { Ok(order) } else { own(&team, &order, &settings) };
            // Who no longer listens needs no more of them.
            let _ = update::orders(&settings, key).try_for_each(|order| give.send(own(order)));
        });
        self.orders = Some((config.clone(), key, orders));
    }

    fn roll(
        &mut self,
        episodes: &mut Episodes,
        running: &mut Running,
        policy: &Policy,
        config: &PpoConfig,
        noise: StreamKey,
    ) -> Result<Taken, PpoError> {
        let mut world = self.world(episodes)?;
        let others = self.team.exchange(vec![u64::from(world.is_some())])?;
        if others.iter().any(|other| *other != others[0]) {
            let wrong = "some ranks have their episodes on the card, others do not: give all of them cards with as much free memory";
            return Err(PpoError::Device(wrong.into()));
        }
        let taken = match world.as_mut().zip(episodes.simulation.solver.resident()) {
            Some(world) => self.stay(world, running, policy, config, noise)?,
            None => rollout(self, episodes, running, policy, config, noise)?,
        };
        self.world = Some(world);
        Ok(self.team.together(taken)?)
    }

    fn begin(&mut self, policy: &Policy) -> Result<(), PpoError> {
        self.take(policy).map_err(failed)
    }

    fn act(&mut self, rows: &[f64], noise: StreamKey, actions: &mut Vec<f64>) -> Result<(), PpoError> {
        self.answer(rows, noise, actions).map_err(failed)
    }

    fn arrive(&mut self, result: &StepResult, reached: &[f64]) -> Result<(), PpoError> {
        self.keep(result, reached).map_err(failed)
    }

    fn finish(&mut self, rows: &[f64], config: &PpoConfig) -> Result<(), PpoError> {
        self.judge(rows, config).map_err(failed)
    }

    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, key: StreamKey) -> Result<Updated, PpoError> {
        let found = sizes(config);
        if found != self.sizes {
            let text = format!("made for {:?} steps of an iteration and of a minibatch, not for {found:?}", self.sizes);
            return Err(PpoError::Device(text));
        }
        if self.orders.as_ref().is_none_or(|(known, asked, _)| known != config || *asked != key) {
            self.ahead(config, key);
        }
        let mut learn = || {
            self.goals(policy)?;
            let Some((_, _, orders)) = self.orders.take() else { return Err(DeviceError("no orders were drawn".into())) };
            let updated = self.passes(policy, adam, config, orders.into_iter())?;
            self.seen(policy)?;
            Ok(updated)
        };
        learn().map_err(failed)
    }
    fn snapshot(&self, episodes: &Episodes) -> Result<Snapshot, StepError> {
        self.world.iter().flatten().next().map_or_else(|| Ok(episodes.snapshot()), World::snapshot)
    }

    fn restore(&mut self, episodes: &mut Episodes, snapshot: &Snapshot) -> Result<(), StepError> {
        self.world = None;
        episodes.restore(snapshot)
    }
}
