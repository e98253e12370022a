//! What the policies of a round earn, in its model and in the truth, and the rule by which that is enough.

use std::path::Path;

use nerd_sim::truth::Truth;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::experiments::games::{Reward, games, gap, gap_error, policy_of};
use crate::report::write;
use nerd_train::ppo::{Arena, PolicyRun};

/// Seed of the starts of all games: that of all protocols.
const STARTS: u64 = 500;

/// One policy in the model that it was trained in, and in the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Its seed.
    pub seed: u64,
    /// Its hash.
    pub sha256: String,
    /// In the truth.
    pub real: Reward,
    /// In the model.
    pub learned: Reward,
    /// `(learned - real) / |real|` in percent; none where the truth gives nothing.
    pub gap: Option<f64>,
    /// Its standard error.
    pub gap_error: Option<f64>,
}

/// The policies of a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskGaps {
    /// The task.
    pub task: String,
    /// By seed.
    pub policies: Vec<Gap>,
}

/// One round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Its number, from 0.
    pub round: usize,
    /// Hash of its model.
    pub model: String,
    /// By task.
    pub tasks: Vec<TaskGaps>,
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
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        let found = Self {
            seed: run.seed,
            sha256: policy.sha256(),
            gap: finite(gap(Reward::of(&real).mean, Reward::of(&learned).mean)),
            gap_error: finite(gap_error(&real, &learned)),
            real: Reward::of(&real),
            learned: Reward::of(&learned),
        };
        put(&run.out.join("gap.json"), &found)?;
        Ok(found)
    }

    /// What stands in a policy's run.
    pub(super) fn read(run: &Path) -> Result<Option<Self>> {
        get(&run.join("gap.json"))
    }

    /// Size of the gap; infinite where there is none to speak of.
    pub fn size(&self) -> f64 {
        self.gap.map_or(f64::INFINITY, f64::abs)
    }

    /// In words.
    pub(super) fn words(&self) -> String {
        let gap = self.gap.map_or("no gap to speak of".into(), |gap| format!("gap {gap:+.3} %"));
        format!("reward {:.1} in the truth, {:.1} in the model, {gap}", self.real.mean, self.learned.mean)
    }
}

impl TaskGaps {
    /// Mean size of its gaps (percent).
    pub fn mean(&self) -> f64 {
        self.policies.iter().map(Gap::size).sum::<f64>() / self.policies.len() as f64
    }

    /// Size of its largest gap (percent).
    pub fn largest(&self) -> f64 {
        self.policies.iter().map(Gap::size).fold(0.0, f64::max)
    }

    /// Whether its gaps are below `mean` in the mean, and none is above `most` (percent).
    pub fn passes(&self, mean: f64, most: f64) -> bool {
        self.mean() < mean && self.largest() <= most
    }
}

impl Round {
    /// Whether every task passes.
    pub fn passes(&self, mean: f64, most: f64) -> bool {
        self.tasks.iter().all(|task| task.passes(mean, most))
    }

    /// That of a round's folder, once it is done.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>> {
        get(&folder.join("gaps.json"))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        put(&folder.join("gaps.json"), self)
    }
}

/// What a file holds, if it is there.
fn get<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    if !path.exists() {
        return Ok(None);
    }
    let text = nerd_sim::files::read_text(path).map_err(crate::error::file(path))?;
    serde_json::from_str(&text).map(Some).map_err(crate::error::format(path))
}

fn put(path: &Path, what: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(what).map_err(crate::error::format(path))?;
    write(path, (text + "\n").as_bytes())
}
