//! Sim-to-sim transfer of policies to MuJoCo. Policies are exported as ONNX with a contract, and another runtime plays
//! them from these files alone. The same episodes run in the truth.

use nerd_tasks::named;
use nerd_train::ppo::{Game, Policy, folder};
use nerd_train::{onnx, shipped::from_root};

use super::games::{Reward, depend, fallen, games, still};
use super::policies::{Policies, short};
use crate::mujoco::player::{self, Model, Played};
use crate::{mujoco::Settings, prelude::*};

settings! {
    /// Settings: policies played in MuJoCo by their ONNX and contract alone.
    pub struct Carried {
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// Contact and solver of MuJoCo: file (the robot's MJCF), ours (our contact, translated) or both (one after the
        /// other)
        settings: String = "both".into(), Words(&["both", "file", "ours"]);
        /// Python that has mujoco, numpy and onnxruntime
        mujoco: PathBuf = "python3".into(), Text;
        /// Episodes of each policy
        episodes: usize = 32, Whole(STARTS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}

const FILE: &str = "MuJoCo, file";
const OURS: &str = "MuJoCo, ours";

/// Rewards of a policy and of the zero-action policy in one simulator.
#[derive(Clone, Serialize)]
pub struct Row {
    pub task: String,
    pub policy: String,
    pub simulator: String,
    pub reward: Reward,
    pub still: Reward,
    /// (reward - still) / (reward in the truth - still in the truth); `None` where the policy earns no more in the
    /// truth than `still`.
    pub share: Option<f64>,
    /// Number of the policy's episodes that ended in a terminal state.
    pub fallen: usize,
    /// MuJoCo's versions, differences and settings; `None` for the truth.
    pub there: Option<There>,
}

#[derive(Clone, Serialize)]
pub struct There {
    pub versions: String,
    pub apart: player::Gaps,
    pub settings: Settings,
}

/// A policy, or the zero-action policy, exported as ONNX with its contract.
struct Exported {
    policy: Policy,
    onnx: PathBuf,
    contract: onnx::Contract,
}

impl Carried {
    fn folders(&self) -> Result<Vec<PathBuf>> {
        Policies { policy: self.policy.clone(), ..Policies::default() }.folders()
    }

    /// Plays a policy in the truth and in MuJoCo, with a row for each simulator. Empty, with a note, if the contract
    /// does not suffice to play the policy in MuJoCo.
    fn rows(&self, path: &Path) -> Result<Vec<Row>> {
        let (folder::PolicyConfig { task, .. }, policy) = folder::load(path)?;
        let name = from_root(path);
        let own = named(&task)?;
        let temporary = tempfile::tempdir()?;
        let still = still(&policy);
        let export = |policy: Policy, name: &str| -> Result<Exported> {
            let onnx = temporary.path().join(name);
            Ok(Exported { contract: onnx::export(&policy, &*own, &onnx)?, onnx, policy })
        };
        let both = [export(policy, "policy.onnx")?, export(still, "still.onnx")?];
        if let (Some(unknown), true) = (both[0].contract.unknown().first(), self.policy.is_empty()) {
            tell!("{name} is left out: {unknown}");
            return Ok(Vec::new());
        }
        let file = mjcf_of(own.robot());
        if file.is_none() && self.settings != "ours" {
            let robot = own.robot();
            let said = format!("{name}: `{robot}` is no MJCF, which would have contact and solver settings of its own");
            if self.settings == "file" {
                bail!("{said}; leave --settings file out");
            }
            tell!("{said}: it is played with ours alone");
        }
        let arena = Arena::Solver(SolverSpec::default());
        let mut rows = Vec::new();
        let mut add = |simulator: &str, games: &[Game], still: &[Game], fallen: usize, there: Option<There>| {
            let beyond = |row: &Row| row.reward.mean - row.still.mean;
            let row = Row {
                task: task.clone(),
                policy: name.clone(),
                simulator: simulator.into(),
                reward: Reward::of(games),
                still: Reward::of(still),
                share: None,
                fallen,
                there,
            };
            let most = beyond(rows.first().unwrap_or(&row));
            rows.push(Row { share: (most > 0.0).then(|| beyond(&row) / most), ..row });
        };
        let play = |own: &Exported| games(&task, &arena, &own.policy, self.episodes, self.seed);
        let here = play(&both[0])?;
        add("truth", &here, &play(&both[1])?, fallen(&here, &*own), None);
        let models = [("file", FILE, file.as_deref().map(Model::File)), ("ours", OURS, Some(Model::Ours))];
        for (word, simulator, model) in models {
            let Some(model) = model.filter(|_| self.settings == word || self.settings == "both") else { continue };
            let play = |own: &Exported| {
                let episodes = arena.episodes(&task, self.episodes, self.seed)?;
                player::play(&self.mujoco, model, &own.onnx, &own.contract, &own.policy, episodes)
            };
            match play(&both[0]).and_then(|played| Ok((played, play(&both[1])?))) {
                Ok((Played { versions, games, fallen, apart, settings }, still)) => {
                    add(simulator, &games, &still.games, fallen, Some(There { versions, apart, settings }));
                }
                // Goes on, since the other contact setting may still succeed.
                Err(error) if self.settings == "both" && file.is_some() => {
                    tell!("{name}: not played with --settings {word}: {error}")
                }
                Err(error) => return Err(error),
            }
        }
        if rows.len() < 2 {
            bail!("{name}: it was not played in MuJoCo");
        }
        Ok(rows)
    }
}

/// Returns the path of the robot's file, if it is an MJCF.
fn mjcf_of(robot: &str) -> Option<PathBuf> {
    let text = nerd_sim::files::read_text(Path::new(robot)).ok()?;
    nerd_sim::mjcf::is_mjcf(&text).then(|| robot.into())
}

/// Describes for each policy the MuJoCo settings that differ between `file` and `ours`. If only `file` was played, all
/// its settings are listed.
fn differences(rows: &[Row]) -> String {
    let line = |k: usize| {
        let settings = |row: &Row| row.there.as_ref().map(|there| there.settings.clone());
        let own = rows.get(k).filter(|row| row.simulator == FILE)?;
        let file = settings(own)?;
        let name = short(&own.policy);
        let ours = rows.get(k + 1).filter(|row| row.policy == own.policy).and_then(settings);
        let (what, mut list) = match &ours {
            Some(ours) => ("of the file and ours", file.differences(ours)),
            None => ("of the file", file.list()),
        };
        let guessed = ours.is_some_and(|ours| ours.armature != file.armature);
        list.extend(guessed.then(|| "armature that the file does not have is the .toml's".into()));
        list.extend((file.ground != "its own").then(|| format!("ground {}", file.ground)));
        Some(format!(" Settings of {name}, {what}: {}.", list.join("; ")))
    };
    (0..rows.len()).filter_map(line).collect()
}

impl Experiment for Carried {
    fn about(&self) -> Result<About> {
        let folders = self.folders()?;
        let mut inputs = Inputs::default();
        for path in &folders {
            depend(&mut inputs, &folder::load(path)?.0.task, Truth::Articulated)?;
            inputs.add(Input::policy(path)?);
        }
        Ok(About { name: "carried".into(), seed: self.seed, effort: (self.episodes * folders.len()) as f64, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let rows = self.folders()?.iter().map(|path| self.rows(path)).collect::<Result<Vec<_>>>()?.concat();
        let header =
            ["policy", "simulator", "reward", "keeps still", "share", "falls", "observation", "action", "torque"];
        let line = |r: &Row| {
            let word = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.standard_error);
            let share = or_dash(r.share.map(|share| format!("{:.1} %", 100.0 * share)));
            let falls = format!("{} of {}", r.fallen, self.episodes);
            let gaps = r.there.as_ref().map_or([None; 3], |there| {
                let player::Gaps { observation, action, torque } = there.apart;
                [Some(observation), Some(action), (there.settings.control == "torques").then_some(torque)]
            });
            let gaps = gaps.map(|gap| or_dash(gap.map(|x| format!("{x:.0e}"))));
            [short(&r.policy), r.simulator.clone(), word(&r.reward), word(&r.still), share, falls]
                .into_iter()
                .chain(gaps)
        };
        let note = "Mean reward of a game under mean actions, and of a robot that keeps still (all actions 0). Share: (reward - keeps still) / \
                    (the truth's - keeps still). MuJoCo, file: the robot's MJCF with its own contact, solver and actuators; MuJoCo, ours: our \
                    contact translated. Observation, action, torque: largest difference between what the contract's player made of MuJoCo's \
                    states and what task and policy make of them, of the largest number.";
        let table =
            Table::new("carried", header).with(rows.iter().map(line)).noted(note.to_string() + &differences(&rows));
        Measured::new(&serde_json::json!({ "rows": rows }), vec![table])
    }
}
