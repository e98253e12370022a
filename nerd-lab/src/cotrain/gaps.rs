//! What the policies of a round earn, in its model and in the truth.

use nerd_train::ppo::PolicyRun;

use crate::experiments::games::{Compared, games, policy_of};
use crate::prelude::*;
use crate::report::{read_json, write_json};

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

    pub(super) fn read(run: &Path) -> Result<Option<Self>> {
        get(&run.join("gap.json"))
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

    pub(super) fn read(folder: &Path) -> Result<Option<Self>> {
        get(&folder.join("gaps.json"))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join("gaps.json"), self)
    }
}

fn get<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    path.exists().then(|| read_json(path)).transpose()
}
