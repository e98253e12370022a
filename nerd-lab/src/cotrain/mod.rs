//! Policies and model in turn, until policies of seeds never used before earn in the model what they earn in its truth.
//!
//! ```text
//! model ─▶ policies of new seeds, trained in it ─▶ games in it and in the truth ─▶ gaps ─ small ─▶ done
//!   ▲                                                                               │
//!   └── trained on, on fresh data in which the policies of all rounds act ◀── large ┘
//! ```
//!
//! A model is at its best where its data was, and a policy that is being trained goes where reward is, right or not: what it
//! finds beyond the data is the model's fault more often than the robot's gift. So the policies that found it act in the next
//! data. That a round's seeds are new makes its gaps an honest judgement: its model was frozen before anybody had them.
//!
//! ```text
//! OUT/co-train.json                              what the loop is; the same command goes on, another one is refused
//! OUT/round-K/model                              the model of round K
//! OUT/round-K/policies/TASK-SEED/{policy,...}    what was trained in it
//! OUT/round-K/gaps.json                          what these earn; there once the round is done
//! OUT/rounds.json, .md, .svg, .png               all rounds
//! ```

mod figure;
mod gaps;
mod plan;
mod report;
mod round;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;

pub use gaps::{Gap, Round, TaskGaps};
pub use report::Rounds;

use crate::error::Result;
use crate::report::Table;
use nerd_train::bounds::{SEEDS, STARTS, UPDATES};
use nerd_train::device::Device;
use nerd_train::ppo::PpoConfig;
use nerd_train::records::claimed;
use nerd_train::run::RunConfig;
use nerd_train::settings::settings;

settings! {
    /// Policies and model in turn.
    pub struct CoTrainConfig {
        /// Folder of the first round's model [default: --recipe trains one from nothing]
        model: Option<PathBuf> = None, Text;
        /// Recipe of `train` (its name or a file): makes the first model if there is no --model; models are trained on with the
        /// settings of its last run
        recipe: Option<String> = None, Text;
        /// TOML with all settings of PPO (see nerd-train/assets/ppo) [default: the task's]
        config: Option<PathBuf> = None, Text;
        /// Policies of each task in each round, of seeds never used before
        seeds: usize = 5, Whole(1..=1000);
        /// Short policies beside them (a quarter of the iterations), whose episodes begin from fast states: for the data alone,
        /// they are not judged
        breadth: usize = 0, Whole(0..=1000);
        /// Iterations of a policy [default: those of its settings]
        iterations: Option<u64> = None, Whole(1..=1_000_000_000);
        /// Games of each policy, in the model and from the same starts in the truth (the paper: 2048)
        games: usize = 2048, Whole(STARTS);
        /// Stop once the sizes of the gaps of every task are below this in the mean (percent)
        mean: f64 = 1.0, Positive;
        /// And none is above this (percent)
        most: f64 = 2.0, Positive;
        /// Stop after so many rounds
        rounds: usize = 5, Whole(1..=1000);
        /// Stop, with all that is done kept, after so many minutes; the same command continues
        minutes: Option<f64> = None, Positive;
        /// Updates of each training on [default: those of the recipe's last run; without a recipe 100000]
        updates: Option<u64> = None, Whole(UPDATES);
        /// Share of the trajectories of a training on in which policies act, those of all rounds alike
        policy_share: f64 = 0.5, Number(0.01..=1.0);
        /// Seed of the first policy; each next one has the next seed, in all rounds
        seed: u64 = 1000, Whole(SEEDS);
        /// Where networks are computed (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

/// The loop, ready to run. All that can be refused has been refused.
pub struct CoTrain {
    tasks: Vec<String>,
    config: CoTrainConfig,
    out: PathBuf,
    system: Arc<System>,
    truth: Truth,
    first: plan::First,
    /// A training on, but for what it starts from and who acts in its data.
    onward: RunConfig,
    /// By task.
    ppo: Vec<PpoConfig>,
    started: Instant,
}

/// Why it stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The gaps of this round are small enough.
    Passed(usize),
    /// All rounds were made, and none is good enough.
    Rounds,
    /// Time is over.
    Time,
}

/// What it came to.
pub struct CoTrained {
    /// Why it stopped.
    pub end: End,
    /// All rounds that are done.
    pub rounds: Vec<Round>,
    /// As people read them.
    pub tables: Vec<Table>,
    /// In a sentence.
    pub said: String,
}

impl CoTrain {
    /// Goes on until the rule, the number of rounds or the minutes stop it.
    ///
    /// # Errors
    /// If the folder is another loop's or in use; those of training, of games and of files.
    pub fn run(&self) -> Result<CoTrained> {
        let _claim = claimed(&self.out)?;
        self.hold()?;
        let end = self.rounds()?;
        let (rounds, tables) = self.report()?;
        let said = match end {
            End::Passed(k) => format!("round {k} passes; its model is {}", self.model_of(k).display()),
            End::Rounds => {
                let last = self.config.rounds - 1;
                format!("no round passes; the model of the last one is {}; more --rounds go on from it", self.model_of(last).display())
            }
            End::Time => format!("time is over in round {}; the same command continues", rounds.len()),
        };
        Ok(CoTrained { end, rounds, tables, said })
    }

    fn rounds(&self) -> Result<End> {
        for k in 0..self.config.rounds {
            let round = match Round::read(&self.folder(k))? {
                Some(done) => done,
                None => {
                    let Some(judged) = self.round(k)? else { return Ok(End::Time) };
                    self.report()?;
                    judged
                }
            };
            if round.passes(self.config.mean, self.config.most) {
                return Ok(End::Passed(k));
            }
        }
        Ok(End::Rounds)
    }

    /// Minutes that are left, if they are limited; none below zero.
    fn left(&self) -> Option<f64> {
        self.config.minutes.map(|all| (all - self.started.elapsed().as_secs_f64() / 60.0).max(0.0))
    }

    fn late(&self) -> bool {
        self.left() == Some(0.0)
    }
}
