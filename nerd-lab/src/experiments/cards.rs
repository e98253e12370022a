//! Several cards against one: how much faster they learn together, and that they learn the same.

use std::sync::Arc;
use std::time::Instant;

use nerd_model::transformer::{TransformerConfig, Weights};
use serde::{Deserialize, Serialize};

use super::Experiment;
use crate::error::{Error, Result};
use crate::report::table::digits;
use crate::report::{Input, Inputs, Table};
use nerd_train::device::Device;
use nerd_train::learner::cuda::{CudaLearner, Precision};
use nerd_train::learner::{Learner, LearnerConfig, LearnerState};
use nerd_train::ppo::{Arena, PpoConfig, Trainer, on_card};
use nerd_train::ranks::Ranks;
use nerd_train::shipped;
use nerd_train::windows::{Windows, draw};

/// Windows an update and card, and environments a card.
const BATCHES: [usize; 2] = [512, 4096];
const ENVIRONMENTS: usize = 8192;
/// Updates, and iterations of PPO, that are timed.
const UPDATES: usize = 400;
const ITERATIONS: usize = 10;
/// Updates, and iterations, after which one card and several are compared, and the environments of all.
const ALIKE: usize = 20;
const FEW: usize = 1024;

/// The experiment, on each of its ranks; the first one tells.
#[derive(Clone)]
pub struct Cards {
    /// The ranks, one a card.
    pub ranks: Arc<Ranks>,
    /// The task that is learned.
    pub task: String,
    /// Seed of weights, noise and starts.
    pub seed: u64,
}

/// What was measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Data {
    /// Cards.
    pub cards: usize,
    /// Weak scaling: as much a card on all of them as on one.
    pub paces: Vec<Pace>,
    /// Equal work on one card and on all.
    pub same: Vec<Same>,
}

/// Windows or steps a second.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Pace {
    /// What.
    pub what: String,
    /// On one card, and on all.
    pub rates: [f64; 2],
}

/// How far all cards are from one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Same {
    /// What.
    pub what: String,
    /// On one card, and on all.
    pub values: [f64; 2],
}

fn refused(error: impl std::fmt::Display) -> Error {
    Error::msg(error.to_string())
}

impl Cards {
    /// On all ranks; then on the first alone, for which the others wait.
    fn both<T>(&self, work: impl Fn(&Arc<Ranks>) -> Result<T>) -> Result<Option<[T; 2]>> {
        let all = work(&self.ranks)?;
        self.ranks.wait().map_err(refused)?;
        let alone = if self.ranks.leads() { Some(work(&Arc::default())?) } else { None };
        self.ranks.wait().map_err(refused)?;
        Ok(alone.map(|one| [one, all]))
    }

    /// A learner of the paper's network, for so many windows an update and card.
    fn learner(&self, ranks: &Arc<Ranks>, batch: usize, precision: Precision, data: &Windows) -> Result<CudaLearner> {
        let configuration = LearnerConfig { batch, clip: 1.0, average: 0.999, seed: self.seed, huber: None, optimizer: Default::default() };
        let state = LearnerState::new(Weights::init(network(), 1));
        CudaLearner::among(ranks, configuration, precision, state, data, data).map_err(refused)
    }

    fn trainer(&self, ranks: &Arc<Ranks>, environments: usize) -> Result<Trainer> {
        let folder = shipped::model_of_task(&self.task, nerd_tasks::named(&self.task)?.robot());
        let arena = Arena::Model { folder, device: Device::Cuda };
        let config = PpoConfig { environments, ..PpoConfig::of(&self.task)? };
        Ok(on_card(&arena, nerd_tasks::named(&self.task)?, &config, self.seed, ranks)?)
    }
}

/// The paper's network.
pub fn network() -> TransformerConfig {
    TransformerConfig::paper(37, 4, 192)
}

/// Windows to learn from: uniform inputs, and targets that mix two of them.
pub fn windows() -> Windows {
    let TransformerConfig { inputs, outputs, .. } = network();
    let (trajectories, frames) = (200, 100);
    let noise = |i: usize| draw(2, 0, i as u64, 1 << 24) as f32 / (1 << 23) as f32 - 1.0;
    let x: Vec<f32> = (0..trajectories * frames * inputs).map(noise).collect();
    let y = (0..trajectories * frames * outputs).map(|k| {
        let token = &x[k / outputs * inputs..][..inputs];
        token[k % outputs] - token[0] * token[inputs - 1]
    });
    Windows { inputs, outputs, frames, history: network().sequence(), y: y.collect(), x }
}

impl Experiment for Cards {
    type Data = Data;

    fn name(&self) -> String {
        "cards".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.ranks.world() * UPDATES) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        inputs.add(Input::model(&shipped::model_of_task(&self.task, nerd_tasks::named(&self.task)?.robot()))?);
        Ok(inputs)
    }

    fn measure(&self) -> Result<Data> {
        let world = self.ranks.world();
        nerd_cuda::take(self.ranks.local()).map_err(refused)?;
        let (mut data, windows) = (Data { cards: world, ..Data::default() }, windows());
        for batch in BATCHES {
            let rate = |ranks: &Arc<Ranks>| {
                let mut learner = self.learner(ranks, batch * ranks.world(), Precision::Tf32, &windows)?;
                let mut go = |updates: usize| {
                    (0..updates).try_for_each(|_| learner.update(1e-4)).and_then(|()| learner.progress()).map_err(refused).map(drop)
                };
                go(20)?;
                let began = Instant::now();
                go(UPDATES)?;
                Ok((UPDATES * batch * ranks.world()) as f64 / began.elapsed().as_secs_f64())
            };
            let what = format!("training, {batch} windows a card");
            data.paces.extend(self.both(rate)?.map(|rates| Pace { what, rates }));
        }
        let rate = |ranks: &Arc<Ranks>| {
            let mut trainer = self.trainer(ranks, ENVIRONMENTS * ranks.world())?;
            (0..2).try_for_each(|_| trainer.iterate().map(drop))?;
            let began = Instant::now();
            (0..ITERATIONS).try_for_each(|_| trainer.iterate().map(drop))?;
            Ok((ITERATIONS * trainer.config.steps()) as f64 / began.elapsed().as_secs_f64())
        };
        let what = format!("PPO of {}, {ENVIRONMENTS} environments a card", self.task);
        data.paces.extend(self.both(rate)?.map(|rates| Pace { what, rates }));
        let loss = |ranks: &Arc<Ranks>| {
            let mut learner = self.learner(ranks, BATCHES[0], Precision::F32, &windows)?;
            (0..ALIKE).try_for_each(|_| learner.update(1e-3)).map_err(refused)?;
            Ok(f64::from(learner.progress().map_err(refused)?.loss))
        };
        let what = format!("loss of {ALIKE} updates of {} windows", BATCHES[0]);
        data.same.extend(self.both(loss)?.map(|values| Same { what, values }));
        for iterations in [1, ALIKE] {
            let critic = |ranks: &Arc<Ranks>| {
                let mut trainer = self.trainer(ranks, FEW)?;
                let lines = (0..iterations).map(|_| trainer.iterate()).collect::<std::result::Result<Vec<_>, _>>()?;
                Ok(lines.last().map_or(f64::NAN, |line| line.updated.critic_loss))
            };
            let what = format!("value's loss in iteration {iterations} of PPO, {FEW} environments");
            data.same.extend(self.both(critic)?.map(|values| Same { what, values }));
        }
        Ok(data)
    }

    fn tables(&self, data: &Data) -> Result<Vec<Table>> {
        let cards = data.cards;
        let paces = data.paces.iter().map(|Pace { what, rates: [one, all] }| {
            vec![what.clone(), digits(*one), digits(*all), format!("{:.1}", 100.0 * all / (one * cards as f64))]
        });
        let header = ["what", "on one card (1/s)", &format!("on {cards} (1/s)"), "of what so many could (%)"];
        let note = "Weak scaling: each card has as much to do as the one alone. Windows of training with TF32 (width 192, six layers), steps of \
                    all environments in the shipped model, updates included.";
        let paces = Table::new("scaling", &header).with(paces).noted(note);
        let same = data.same.iter().map(|Same { what, values: [one, all] }| {
            vec![what.clone(), format!("{one:.7}"), format!("{all:.7}"), format!("{:.1e}", (all / one - 1.0).abs())]
        });
        let header = ["what", "on one card", &format!("on {cards}"), "apart"];
        let note = "The same seed, and the same batch or environments in all. Sums are made in another order; what that rounds grows as training goes on.";
        Ok(vec![paces, Table::new("same", &header).with(same).noted(note)])
    }
}
