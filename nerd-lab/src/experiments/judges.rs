//! Judges in which nothing was trained: every policy in its truth, at twice the substeps, in rapier, at the reference simulator's preset
//! and in MuJoCo. A policy that exploits one simulator's fault earns only there.

use nerd_train::{Error, ppo::folder, shipped::from_root};

use super::games::{Reward, depend, games};
use super::policies::{Policies, short};
use crate::prelude::*;

settings! {
    /// Every policy before judges in which nothing was trained.
    pub struct Judges {
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// Games of each policy before each judge
        games: usize = 64, Whole(STARTS);
        /// Python that has MuJoCo, for the last judge [default: none]
        mujoco: Option<PathBuf> = None, Text;
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub policy: String,
    pub trained_in: String,
    pub judged: Vec<(String, Reward)>,
}

impl Judges {
    fn folders(&self) -> Result<Vec<PathBuf>> {
        Policies { policy: self.policy.clone(), ..Policies::default() }.folders()
    }

    /// The judges of a robot, by name: first the truth itself.
    fn arenas(&self, system: &System) -> Vec<(String, Arena)> {
        let bare = system.robot.contact_points.is_empty();
        let finer = if bare { Setting::Rk4(8) } else { Setting::Implicit(2 * system.spec.substeps) };
        let mut arenas = vec![("truth".to_string(), Arena::Truth(Truth::Articulated)), ("twice the substeps".into(), Arena::Judge(finer))];
        arenas.push(("reference preset".into(), Arena::Judge(Setting::Paper)));
        arenas.push(("rapier".into(), Arena::Judge(Setting::RapierSteps(16))));
        arenas.extend(self.mujoco.clone().map(|python| ("MuJoCo".into(), mujoco(python))));
        arenas
    }

    fn row(&self, path: &Path) -> Result<Row> {
        let (config, policy) = folder::load(path)?;
        let system = nerd_tasks::named(&config.task)?.system()?;
        let judged = self.arenas(&system).into_iter().map(|(name, arena)| {
            let played = games(&config.task, &arena, &policy, self.games, self.seed)?;
            Ok((name, Reward::of(&played)))
        });
        Ok(Row { policy: from_root(path), trained_in: config.solver, judged: judged.collect::<Result<_>>()?, task: config.task })
    }
}

impl Experiment for Judges {
    fn about(&self) -> Result<About> {
        let (folders, mut inputs) = (self.folders()?, Inputs::default());
        for path in &folders {
            depend(&mut inputs, &folder::load(path)?.0.task, Truth::Articulated)?;
            inputs.add(Input::policy(path)?);
        }
        Ok(About { name: "judges".into(), seed: self.seed, effort: (self.games * folders.len()) as f64, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let rows: Vec<Row> = self.folders()?.iter().map(|path| self.row(path)).collect::<Result<_>>()?;
        let judges: Vec<&str> = rows.first().map_or_else(Vec::new, |r| r.judged.iter().map(|(name, _)| name.as_str()).collect());
        let header: Vec<&str> = ["policy", "trained in"].into_iter().chain(judges).collect();
        let line = |r: &Row| {
            let own = r.judged.first().map_or(f64::NAN, |(_, reward)| reward.mean);
            let word = |(i, (_, reward)): (usize, &(String, Reward))| match i {
                0 => format!("{:.1} +- {:.1}", reward.mean, reward.standard_error),
                _ => format!("{:.1} ({:+.1} %)", reward.mean, 100.0 * (reward.mean - own) / own.abs()),
            };
            [short(&r.policy), r.trained_in.clone()].into_iter().chain(r.judged.iter().enumerate().map(word)).collect()
        };
        let note = "Mean reward of a game under mean actions (in brackets: beside that in the truth). +-: standard error over games.";
        let table = Table::new("judges", &header).with(rows.iter().map(line)).noted(note);
        Measured::new(&serde_json::json!({ "rows": rows }), vec![table])
    }
}

pub fn mujoco(python: PathBuf) -> Arena {
    let make = move |system: &Arc<System>, scene: &Arc<Scene>| -> Result<Box<dyn Solver>, Error> {
        let solver = crate::mujoco::Mujoco::new(&python, system, scene).map_err(|e| Error::Refused(format!("--mujoco: {e}")))?;
        Ok(Box::new(solver))
    };
    Arena::Guest("MuJoCo".into(), Arc::new(make))
}
