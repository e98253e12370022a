//! MuJoCo as a reference engine on the same robot. It is optional: a Python with MuJoCo is started on demand, receives
//! a model and start states, and returns rollouts.

use nerd_cli::mujoco::{Python, REFEREE, all_to_mujoco, from_mujoco};
use nerd_sim::mjcf::mjcf;
use nerd_train::evaluate::Held;
use serde_json::json;

use crate::prelude::*;

const WARP: &str = include_str!("warp.py");
/// Value of every coordinate of a state that MuJoCo has given up. It lies above the bound for divergence.
const GONE: f64 = 2e5;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Scheme {
    /// Semi-implicit Euler with implicit joint damping.
    Euler,
    /// Euler with all velocity-dependent smooth forces implicit, except Coriolis forces.
    ImplicitFast,
    /// Classical Runge-Kutta.
    Rk4,
}

pub struct Played {
    /// States by frame, `[frame][start * state]` as in a batch. A rollout that MuJoCo gives up is [`GONE`] from then
    /// on.
    pub frames: Vec<Vec<f64>>,
    /// Wall time (s) of the rollouts. On the CPU: all starts on one core, the fastest of a few runs; on a GPU: all
    /// worlds. `None` if not timed, or if MuJoCo gave up a world.
    pub seconds: Option<f64>,
}

/// Rolls out one model in MuJoCo from one set of start states, at the settings given to `play`.
pub struct Referee {
    pub version: String,
    /// Number of worlds stepped together in a timed run on a GPU; 0 on the CPU.
    worlds: usize,
    robot: Robot,
    python: Python,
}

impl Referee {
    /// Starts `python` to roll out `frames` frames from the states of a batch, with the batch's drives. Drives must be
    /// equal in all environments. Robot and scene are the first environment's; joint velocity limits are ignored.
    pub fn new(python: &Path, batch: &Batch, frames: usize) -> Result<Self> {
        Self::held(python, batch, frames, None, None)
    }

    /// Works like `new`, but the drives follow the targets of `held`. With `worlds`, MuJoCo Warp (f32 on a GPU, its own
    /// contact settings) steps this many worlds together in timed runs.
    pub fn held(
        python: &Path,
        batch: &Batch,
        frames: usize,
        held: Option<&Held>,
        worlds: Option<usize>,
    ) -> Result<Self> {
        let system = &batch.system;
        let first = held.map_or(batch.driven(0), |held| &held.rest);
        if held.is_none() && (1..batch.len()).any(|env| batch.driven(env) != first) {
            bail!("drives differ between environments, which the referee of MuJoCo does not take");
        }
        let robot = system.robot.clone();
        let free = Arc::new(Scene::free(system.gravity()));
        let starts = all_to_mujoco(batch);
        let mjcf = mjcf(system, batch.scenes.first().unwrap_or(&free), first)?;
        let mut request = json!({ "mjcf": mjcf, "frame_time": system.frame_time, "frames": frames, "starts": starts });
        request["targets"] = json!(held.map_or(&[][..], |held| &held.targets));
        request["every"] = json!(held.map_or(frames.max(1), |held| held.every));
        let mut python = Python::start(python, if worlds.is_some() { WARP } else { REFEREE })?;
        let version = python.ask(&request)?;
        Ok(Self { version, worlds: worlds.unwrap_or_default(), robot, python })
    }

    pub fn process(&self) -> u32 {
        self.python.process()
    }

    /// Rolls out all starts with `substeps` steps of `integrator` a frame.
    pub fn play(&mut self, integrator: Scheme, substeps: usize, timed: bool) -> Result<Played> {
        type States = Vec<Vec<Option<Vec<f64>>>>;
        let setting = json!({ "integrator": integrator, "substeps": substeps, "timed": timed, "worlds": self.worlds });
        let (states, seconds): (States, Option<f64>) = self.python.ask(&setting)?;
        let robot = &self.robot;
        let state = |s: Option<Vec<f64>>| s.map_or_else(|| vec![GONE; robot.state_dim()], |s| from_mujoco(robot, &s));
        Ok(Played {
            frames: states.into_iter().map(|frame| frame.into_iter().flat_map(state).collect()).collect(),
            seconds,
        })
    }
}
