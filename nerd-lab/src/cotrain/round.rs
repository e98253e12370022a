//! One round: its model, its policies, and what these earn in it and in the truth.

use nerd_train::ppo::PolicyRun;
use nerd_train::run::{Run, RunConfig};

use super::plan::Plan;
use crate::experiments::games::{Compared, games, policy_of};
use crate::prelude::*;
use crate::report::{read_json_of, write_json};

/// Between the seeds of the data of two rounds: further than runs move theirs to validate.
const DATA: u64 = 10_000;

impl Plan {
    fn folder(&self, k: usize) -> PathBuf {
        self.out.join(format!("round-{k}"))
    }

    /// All gaps of a round that is done.
    pub(super) fn done(&self, k: usize) -> PathBuf {
        self.folder(k).join("gaps.json")
    }

    pub(super) fn model_of(&self, k: usize) -> PathBuf {
        if k == 0 { self.model.clone() } else { self.folder(k).join("model") }
    }

    /// The run of policy `j` of task `t` in round `k`, by a seed that no other policy of the loop has.
    fn policy(&self, k: usize, t: usize, j: usize) -> PolicyRun {
        let task = self.tasks[t].clone();
        let seed = self.config.seed + ((k * self.tasks.len() + t) * self.config.seeds + j) as u64;
        let arena = Arena::Model { folder: self.model_of(k), device: self.config.device };
        let out = self.folder(k).join("policies").join(format!("{task}-{seed}"));
        PolicyRun { task, arena, config: self.ppo[t].clone(), seed, until: None, minutes: self.left(), out }
    }

    fn policies(&self, k: usize) -> impl Iterator<Item = PolicyRun> {
        (0..self.tasks.len()).flat_map(move |t| (0..self.config.seeds).map(move |j| self.policy(k, t, j)))
    }

    /// A round that is not done yet; none if time was over before.
    pub(super) fn round(&self, k: usize) -> Result<Option<Round>> {
        if self.left() == Some(0.0) || !self.model(k)? {
            return Ok(None);
        }
        let mut gaps = Vec::new();
        for run in self.policies(k) {
            tell!("round {k}: {}, seed {}", run.task, run.seed);
            if !trained(&run)? {
                return Ok(None);
            }
            gaps.push(Gap::of(&run, self.truth, self.config.games)?);
        }
        let round = Round { round: k, model: ModelConfig::read(&self.model_of(k))?.model_sha256, gaps };
        write_json(&self.done(k), &round)?;
        Ok(Some(round))
    }

    /// Makes the round's model, unless it is there; whether it is now.
    fn model(&self, k: usize) -> Result<bool> {
        let run = self.onward(k);
        if k == 0 || run.made()?.is_some() {
            return Ok(true);
        }
        tell!("round {k}: the model of round {} learns from {} policies", k - 1, run.record.policy.len());
        Ok(Run::new(&run)?.train()?.is_some())
    }

    /// The training that leads to round `k`, on data in which the policies of all rounds before act.
    fn onward(&self, k: usize) -> RunConfig {
        let mut run = self.onward.clone();
        (run.out, run.minutes) = (self.folder(k), self.left());
        run.from = k.checked_sub(1).map(|before| self.model_of(before));
        run.record.seed += DATA * k as u64;
        run.record.policy_share = self.config.policy_share;
        run.record.policy.extend((0..k).flat_map(|k| self.policies(k)).map(|policy| policy.out.join("policy")));
        run
    }
}

/// Trains a policy, unless it is done; whether it is now.
fn trained(run: &PolicyRun) -> Result<bool> {
    if Gap::read(&run.out)?.is_some() {
        return Ok(true);
    }
    if run.minutes == Some(0.0) {
        return Ok(false);
    }
    Ok(run.train()?.iterations >= run.config.iterations)
}

/// Seed of the starts of all games: that of all protocols.
const STARTS: u64 = 500;

/// One policy in the model that it was trained in, and in the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    pub task: String,
    pub seed: u64,
    pub sha256: String,
    #[serde(flatten)]
    pub rewards: Compared,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    pub round: usize,
    pub model: String,
    pub gaps: Vec<Gap>,
}

impl Gap {
    /// Plays a trained policy, or reads what it has played.
    pub(super) fn of(run: &PolicyRun, truth: Truth, n: usize) -> Result<Self> {
        if let Some(done) = Self::read(&run.out)? {
            return Ok(done);
        }
        let policy = policy_of(&run.out.join("policy"), &run.task)?;
        let play = |arena: &Arena| games(&run.task, arena, &policy, n, STARTS);
        let (real, learned) = (play(&Arena::Truth(truth))?, play(&run.arena)?);
        let rewards = Compared::of(&real, Some(&learned));
        let found = Self { task: run.task.clone(), seed: run.seed, sha256: policy.sha256(), rewards };
        write_json(&run.out.join("gap.json"), &found)?;
        Ok(found)
    }

    fn read(run: &Path) -> Result<Option<Self>> {
        read_json_of(&run.join("gap.json"))
    }

    /// Size of the gap; infinite where there is none to speak of.
    fn size(&self) -> f64 {
        self.rewards.gap.map_or(f64::INFINITY, f64::abs)
    }
}

impl Round {
    /// Mean and largest size of a task's gaps (percent).
    pub fn sizes(&self, task: &str) -> [f64; 2] {
        let sizes: Vec<f64> = self.gaps.iter().filter(|gap| gap.task == task).map(Gap::size).collect();
        [sizes.iter().sum::<f64>() / sizes.len() as f64, sizes.iter().copied().fold(0.0, f64::max)]
    }
}
