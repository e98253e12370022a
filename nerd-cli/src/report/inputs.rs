//! A result's inputs, identified by content so that a later check can tell whether the result still holds.
//!
//! Robots, models, policies and datasets are identified by SHA-256, solvers by the final state of a short rollout. A
//! solver counts as changed only if its steps change, not if its files are renamed.

use crate::prelude::*;
use nerd_train::shipped::{from_root, root};

use crate::error;
use crate::roll::{begun, rolled};
use sha2::{Digest, Sha256};

/// Frames of the rollout that identifies a solver. They suffice for falling and contact, and are too few for rounding
/// to grow.
const FRAMES: usize = 40;
/// Largest relative difference at which two final states count as equal, since machines differ by rounding. It is
/// relative to the largest coordinate, or to 1 if that is smaller.
const SAME: f64 = 1e-6;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Input {
    /// A robot with its start ranges, drives and controller ([`System::sha256`]).
    Robot { name: String, sha256: String },
    /// A model: its folder relative to the workspace, and a hash of all that affects its predictions.
    Model { folder: String, sha256: String },
    /// A policy: its folder relative to the workspace, and a hash of its files.
    Policy { folder: String, sha256: String },
    /// A solver, identified by the final `state` of a short rollout of the robot from a fixed start.
    Motion { robot: String, scene: String, solver: SolverSpec, state: Vec<f64> },
    /// Data from outside the repository.
    Data { name: String, sha256: String },
}

impl Input {
    pub fn robot(system: &System) -> Self {
        Self::Robot { name: system.name.clone(), sha256: system.sha256() }
    }

    pub fn model(folder: &Path) -> Result<Self> {
        Ok(Self::Model { folder: from_root(folder), sha256: ModelConfig::read(folder)?.model_sha256 })
    }

    pub fn policy(folder: &Path) -> Result<Self> {
        let files = ["config.json", "policy.safetensors"].map(|file| folder.join(file));
        Ok(Self::Policy { folder: from_root(folder), sha256: of_files(&files)? })
    }

    /// Identifies data files from outside the repository by their content, in this order.
    pub fn files(name: &str, files: &[PathBuf]) -> Result<Self> {
        Ok(Self::Data { name: name.into(), sha256: of_files(files)? })
    }

    pub fn motion(robot: &str, scene: &str, solver: &SolverSpec) -> Result<Self> {
        let system = System::named(robot)?;
        let begun = begun(&system, &system.scene(scene)?, 1, Start::Reset, 1);
        let batch = rolled(begun, &mut *solver.solver(&system, 1)?, FRAMES)?;
        Ok(Self::Motion {
            robot: robot.into(),
            scene: scene.into(),
            solver: solver.clone(),
            state: batch.state(0).to_vec(),
        })
    }

    /// Identifies this input again as it is now; `None` for data from outside the repository.
    pub fn now(&self) -> Result<Option<Self>> {
        Ok(match self {
            Self::Robot { name, .. } => Some(Self::robot(&*System::named(name)?)),
            Self::Model { folder, .. } => Some(Self::model(&root().join(folder))?),
            Self::Policy { folder, .. } => Some(Self::policy(&root().join(folder))?),
            Self::Motion { robot, scene, solver, .. } => Some(Self::motion(robot, scene, solver)?),
            Self::Data { .. } => None,
        })
    }

    /// Whether two inputs are equal; final states of solvers may differ by rounding.
    pub fn same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Motion { state: a, .. }, Self::Motion { state: b, .. }) => {
                let size = a.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
                a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() <= SAME * size)
            }
            _ => self == other,
        }
    }

    pub fn name(&self) -> String {
        match self {
            Self::Robot { name, .. } => format!("robot {name}"),
            Self::Model { folder, .. } | Self::Policy { folder, .. } => folder.clone(),
            Self::Motion { robot, scene, solver, .. } => format!("{solver} on {robot} in {scene}"),
            Self::Data { name, .. } => format!("data {name}"),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Inputs(pub Vec<Input>);

impl Inputs {
    pub fn add(&mut self, input: Input) {
        if !self.0.contains(&input) {
            self.0.push(input);
        }
    }

    /// Adds the models in these folders.
    pub fn models(&mut self, folders: &[PathBuf]) -> Result<()> {
        folders.iter().try_for_each(|folder| Input::model(folder).map(|model| self.add(model)))
    }

    /// Adds what the results of a solver in a scene depend on: its model, or else its motion. `robot` is a name or path
    /// for [`System::named`].
    pub fn solver(&mut self, spec: &SolverSpec, robot: &str, scene: &str) -> Result<()> {
        self.add(match spec.folder() {
            Some(folder) => Input::model(folder)?,
            None => Input::motion(robot, scene, spec)?,
        });
        Ok(())
    }

    pub fn changed(&self) -> Vec<String> {
        let changed = |then: &Input| match then.now() {
            Ok(now) => now.filter(|now| !then.same(now)).map(|_| then.name()),
            Err(e) => Some(format!("{} ({e})", then.name())),
        };
        self.0.iter().filter_map(changed).collect()
    }
}

/// Returns the SHA-256 of the concatenated files, in hex.
fn of_files(files: &[PathBuf]) -> Result<String> {
    let mut all = Sha256::new();
    for path in files {
        all.update(nerd_sim::files::read(path).map_err(error::file(path))?);
    }
    Ok(all.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
