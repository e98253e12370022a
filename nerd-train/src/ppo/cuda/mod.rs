//! [`CudaEngine`]: a policy that answers and learns on a GPU. Where episodes are a [`World`] there, whole rollouts are made without leaving it; else
//! environments tell what they show and what came of the actions.

mod acting;
mod among;
mod pass;
mod roll;
mod world;

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use nerd_cuda::{Arg, Buffer, DeviceError, Precision, Replay};
use nerd_sim::articulated::device::RANDOM;
use nerd_sim::sampling::stream;
use nerd_tasks::{StepResult, Task};

use super::arena::Arena;
use super::clock::Clock;
use super::config::PpoConfig;
use super::engine::Engine;
use super::environments::Environments;
use super::policy::{Policy, Shape};
use super::rollout::{Running, Taken, rollout};
use super::shared::Shared;
use super::trainer::{PpoError, Trainer};
use super::update::{self, Adam, Updated};
use crate::error::{Error, Result};
use crate::learner::cuda::{Network, Plan};
use crate::ranks::Ranks;
use acting::Kept;
use among::Among;
use pass::Scalars;
pub use world::World;

const SOURCE: [&str; 3] = [include_str!("kernels.cu"), RANDOM, include_str!("acting.cu")];
const KERNELS: [&str; 14] = [
    "tell",
    "hear",
    "ppo_gather",
    "ppo_loss",
    "squares",
    "ppo_finish",
    "ppo_adam",
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
/// Of the loss, behind a gradient that is added up over cards.
const TERMS: usize = 6;

/// The order of each pass, as it is drawn.
type Orders = Receiver<Result<Vec<u32>, String>>;

/// Memory on a GPU for rollouts and updates of one shape.
pub struct CudaEngine {
    net: Network,
    shape: Shape,
    kept: Kept,
    /// Of a rollout, by step: inputs, advantages, goals, values, surprise; actions, means and spreads.
    steps: [Buffer<f32>; 8],
    /// Steps of an iteration, and of a minibatch, of all cards; and rows of a minibatch for which there is room here.
    sizes: [usize; 2],
    rows: usize,
    order: Buffer<u32>,
    /// Slopes by a spread that is a parameter, by row.
    spread: Buffer<f32>,
    terms: Buffer<f64>,
    squares: Buffer<f64>,
    weights: Buffer<f32>,
    gradient: Buffer<f32>,
    moments: [Buffer<f32>; 2],
    scalars: Buffer<Scalars>,
    /// A pass, by its settings.
    replay: Replay<PpoConfig>,
    /// What is drawn of the next update: its settings, its seeds, and the order of each pass.
    orders: Option<(PpoConfig, (u64, u64), Orders)>,
    /// Where other cards take part.
    among: Option<Among>,
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
        let (part, sizes) = (ranks.part(config.environments), sizes(config));
        let rows = if ranks.world() > 1 { Among::room(&part, config) } else { sizes[1] };
        // An observation is a window of one token.
        let plan = Plan::new(shape.program(), 1, false)?;
        let (padded, parameters) = (plan.padded, plan.parameters());
        let mut net = Network::new(nerd_cuda::ordinal(), plan, rows.max(part.len()), Precision::F32, true)?;
        net.device.add(&SOURCE.concat(), &KERNELS)?;
        let device = &net.device;
        let among = if ranks.world() > 1 { Some(Among::join(device, config, ranks)?) } else { None };
        let (n, a, zeros) = (part.len() * config.horizon, shape.action, |len: usize| device.zeros::<f32>(len));
        let [one, all] = [1, a].map(|width| n * width);
        let steps = [zeros(n * padded)?, zeros(one)?, zeros(one)?, zeros(one)?, zeros(one)?, zeros(all)?, zeros(all)?, zeros(all)?];
        Ok(Self {
            kept: Kept::new(&net, shape, config, part.len())?,
            steps,
            sizes,
            rows,
            order: device.zeros(n.max(rows * sizes[0].div_ceil(sizes[1])))?,
            spread: zeros(rows * a)?,
            terms: device.zeros(6 * rows.div_ceil(THREADS))?,
            squares: device.zeros(SQUARES)?,
            weights: zeros(parameters)?,
            gradient: zeros(parameters + TERMS)?,
            moments: [zeros(parameters)?, zeros(parameters)?],
            scalars: device.zeros(1)?,
            replay: Replay::default(),
            orders: None,
            among,
            shape: shape.clone(),
            net,
        })
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
pub fn on_card(
    arena: &Arena,
    task: Box<dyn Task>,
    config: &PpoConfig,
    seed: u64,
    ranks: &Arc<Ranks>,
    clock: &Clock,
) -> Result<Trainer<Shared>> {
    let part = ranks.part(config.environments);
    let own = arena.part(task, part.clone(), seed, clock)?;
    let mut trainer = Trainer::among(ranks, Shared::new(own, part.len(), &Arc::default())?, config.clone(), seed)?;
    let engine = CudaEngine::among(&trainer.state.policy.shape, config, ranks);
    trainer.engine = Box::new(engine.map_err(|e| Error::Refused(format!("--device cuda: {e}")))?);
    Ok(trainer)
}

/// Steps of an iteration, and of a minibatch.
fn sizes(config: &PpoConfig) -> [usize; 2] {
    [config.steps(), config.minibatch.min(config.steps())]
}

fn failed(error: DeviceError) -> PpoError {
    PpoError::Device(error.to_string())
}

impl Engine for CudaEngine {
    fn ahead(&mut self, config: &PpoConfig, seeds: (u64, u64)) {
        // Orders are drawn while the device rolls, as they are needed.
        let (give, orders) = std::sync::mpsc::sync_channel(config.epochs);
        let (part, own_config) = (self.among.as_ref().map(|among| among.part.clone()), config.clone());
        std::thread::spawn(move || {
            let own = |order: Vec<u32>| match &part {
                Some(part) => Among::own(part, &order, &own_config),
                None => Ok(order),
            };
            // Who no longer listens needs no more of them.
            let _ = update::orders(own_config.steps(), &own_config, seeds).try_for_each(|order| give.send(own(order)));
        });
        self.orders = Some((config.clone(), seeds, orders));
    }

    fn roll(
        &mut self,
        environments: &mut dyn Environments,
        running: &mut Running,
        policy: &Policy,
        law: (usize, f64, f64),
        noise: (u64, u64),
    ) -> Result<Taken, PpoError> {
        let on_device = environments.on_device()?;
        self.among.as_ref().map_or(Ok(()), |among| among.alike(on_device.is_some())).map_err(failed)?;
        let taken = match on_device {
            Some(world) => self.stay(world, running, policy, law, noise)?,
            None => rollout(environments, running, self, policy, law, noise)?,
        };
        self.among.as_ref().map_or(Ok(taken.clone()), |among| among.together(taken)).map_err(failed)
    }

    fn begin(&mut self, policy: &Policy) -> Result<(), PpoError> {
        self.take(policy).map_err(failed)
    }

    fn act(&mut self, rows: &[f64], (seed, step): (u64, u64), actions: &mut Vec<f64>) -> Result<(), PpoError> {
        self.answer(rows, stream(seed, step).get_seed(), step, actions).map_err(failed)
    }

    fn arrive(&mut self, result: &StepResult, reached: &[f64]) -> Result<(), PpoError> {
        self.keep(result, reached).map_err(failed)
    }

    fn finish(&mut self, rows: &[f64], law: (f64, f64)) -> Result<(), PpoError> {
        self.judge(rows, law).map_err(failed)
    }

    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, seeds: (u64, u64)) -> Result<Updated, PpoError> {
        let found = sizes(config);
        if found != self.sizes {
            let text = format!("made for {:?} steps of an iteration and of a minibatch, not for {found:?}", self.sizes);
            return Err(PpoError::Device(text));
        }
        if self.orders.as_ref().is_none_or(|(known, asked, _)| known != config || *asked != seeds) {
            self.ahead(config, seeds);
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
}
