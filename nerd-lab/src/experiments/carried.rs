//! Policies carried elsewhere: exported as ONNX with a contract, and played in MuJoCo by somebody else's runtime from these alone, beside the
//! same games in the truth.

use nerd_tasks::named;
use nerd_train::{onnx, ppo::folder, shipped::from_root};

use super::games::{Reward, depend, games};
use super::policies::{Policies, short};
use crate::{mujoco::player, prelude::*};

settings! {
    /// Policies by their ONNX and contract alone, in MuJoCo.
    pub struct Carried {
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// Python that has mujoco, numpy and onnxruntime
        mujoco: PathBuf = "python3".into(), Text;
        /// Games of each policy
        games: usize = 32, Whole(STARTS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub policy: String,
    pub versions: String,
    pub truth: Reward,
    pub mujoco: Reward,
    /// Games that ended in a terminal state, there and in the truth.
    pub fallen: [usize; 2],
    pub apart: player::Gaps,
}

impl Carried {
    fn folders(&self) -> Result<Vec<PathBuf>> {
        Policies { policy: self.policy.clone(), ..Policies::default() }.folders()
    }

    /// None of a policy that its contract alone cannot carry, which is said.
    fn row(&self, path: &Path) -> Result<Option<Row>> {
        let (folder::PolicyConfig { task, .. }, policy) = folder::load(path)?;
        let (own, temporary) = (named(&task)?, tempfile::tempdir()?);
        let model = temporary.path().join("policy.onnx");
        let contract = onnx::export(&policy, &*own, &model)?;
        if let (Some(unknown), true) = (contract.unknown().first(), self.policy.is_empty()) {
            tell!("{} is left out: {unknown}", from_root(path));
            return Ok(None);
        }
        let arena = Arena::Truth(Truth::Articulated);
        let there = player::play(&self.mujoco, &model, &contract, &policy, arena.episodes(&task, self.games, self.seed)?)?;
        let here = games(&task, &arena, &policy, self.games, self.seed)?;
        let ended = here.iter().filter(|game| game.length < own.episode_length() as f64).count();
        let player::Played { versions, games, fallen, apart } = there;
        let (truth, mujoco, policy) = (Reward::of(&here), Reward::of(&games), from_root(path));
        Ok(Some(Row { policy, versions, truth, mujoco, fallen: [fallen, ended], apart, task }))
    }
}

impl Experiment for Carried {
    fn about(&self) -> Result<About> {
        let (folders, mut inputs) = (self.folders()?, Inputs::default());
        for path in &folders {
            depend(&mut inputs, &folder::load(path)?.0.task, Truth::Articulated)?;
            inputs.add(Input::policy(path)?);
        }
        Ok(About { name: "carried".into(), seed: self.seed, effort: (self.games * folders.len()) as f64, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let rows = self.folders()?.iter().filter_map(|path| self.row(path).transpose()).collect::<Result<Vec<Row>>>()?;
        let header = ["policy", "truth", "MuJoCo by ONNX", "share", "falls (MuJoCo, truth)", "observation", "action", "torque"];
        let line = |r: &Row| {
            let word = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.standard_error);
            let apart = [r.apart.observation, r.apart.action, r.apart.torque].map(|x| format!("{x:.0e}"));
            let share = format!("{:.1} %", 100.0 * r.mujoco.mean / r.truth.mean);
            let falls = format!("{}, {} of {}", r.fallen[0], r.fallen[1], self.games);
            [short(&r.policy), word(&r.truth), word(&r.mujoco), share, falls].into_iter().chain(apart).collect()
        };
        let note = "Mean reward of a game under mean actions. Share: MuJoCo's of the truth's. Observation, action, torque: largest difference \
                    between what the contract's player made of MuJoCo's states and what task and policy make of them, of the largest number.";
        let table = Table::new("carried", &header).with(rows.iter().map(line)).noted(note);
        Measured::new(&serde_json::json!({ "rows": rows }), vec![table])
    }
}
