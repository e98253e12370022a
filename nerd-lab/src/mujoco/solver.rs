//! MuJoCo as a solver for the stability suite. It loads the MJCF that we write, with MuJoCo's default contacts and our
//! friction of each pair. Charts use [`super::Referee`] instead, which times whole rollouts without Python's share.

use nerd_cli::mujoco::{Python, all_to_mujoco, take};
use nerd_sim::solver::{check, commit};
use serde_json::json;

use super::referee::Scheme;
use crate::prelude::*;

/// Steps all environments of a batch with one MuJoCo model; they must share a scene and have no drives.
pub struct Mujoco {
    python: PathBuf,
    substeps: usize,
    world: Option<(Arc<System>, Arc<Scene>, Python)>,
}

impl Mujoco {
    /// Makes a solver of `substeps` `implicitfast` steps a frame. `python` is the path of a Python that has MuJoCo.
    pub fn new(python: &Path, substeps: usize) -> Self {
        Self { python: python.into(), substeps, world: None }
    }

    fn start(&mut self, batch: &Batch) -> Result<&mut Python> {
        let system = &batch.system;
        let scene = &batch.scenes[0];
        if batch.scenes.iter().any(|own| !Arc::ptr_eq(own, scene))
            || (0..batch.len()).any(|env| !batch.driven(env).is_empty())
        {
            bail!("MuJoCo steps one scene for all, without drives");
        }
        if !self.world.as_ref().is_some_and(|(own, at, _)| Arc::ptr_eq(own, system) && Arc::ptr_eq(at, scene)) {
            let mjcf = nerd_sim::mjcf::mjcf(system, scene, &[])?;
            let model = json!({ "mjcf": mjcf, "frame_time": system.frame_time });
            let python = Python::of_model(&self.python, model)?;
            self.world = Some((system.clone(), scene.clone(), python));
        }
        Ok(&mut self.world.as_mut().context("it has just been made")?.2)
    }

    fn ask(&mut self, batch: &Batch, torques: &[f64]) -> Result<Vec<Option<Vec<f64>>>> {
        let robot = &batch.system.robot;
        let substeps = self.substeps;
        let force = |own: &[f64]| [vec![0.0; robot.root_dofs()], own.to_vec()].concat();
        let forces = (0..batch.len())
            .map(|env| force(&torques[env * robot.joint_count()..][..robot.joint_count()]))
            .collect_vec();
        let asked = json!({ "move": all_to_mujoco(batch), "forces": forces, "substeps": substeps, "integrator": Scheme::ImplicitFast });
        self.start(batch)?.ask(&asked)
    }
}

impl Solver for Mujoco {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let mut faults = Vec::new();
        check(batch, torques, &mut faults)?;
        let answers = self.ask(batch, torques).map_err(|error| StepError::Refused(format!("{error:#}")))?;
        let mut states = batch.states.clone();
        answers.into_iter().enumerate().for_each(|(env, state)| take(batch, env, state, &mut states, &mut faults));
        commit(batch, &mut states, &mut faults)
    }
}
