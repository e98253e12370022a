//! MuJoCo as a referee: another engine on the same robot, for those who have one. Nothing needs it, to build or to run:
//! a Python with MuJoCo is started when asked for, given a model and starts, and asked for states.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;

use anyhow::{Context, anyhow};
use nerd_core::robot::Robot;
use nerd_sim::mjcf::driven;
use nerd_sim::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::state::{from_mujoco, to_mujoco};
use crate::error::{Result, refuse};

const REFEREE: &str = include_str!("referee.py");
const WARP: &str = include_str!("warp.py");
/// Every coordinate of a state that MuJoCo has given up: past what counts as diverged.
pub const GONE: f64 = 2e5;

/// MuJoCo's integrators that are of use here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Scheme {
    /// Semi-implicit, joint damping implicit.
    #[serde(rename = "EULER")]
    Euler,
    /// The same, all smooth forces of velocity but the Coriolis ones implicit.
    #[serde(rename = "IMPLICITFAST")]
    ImplicitFast,
    /// Classical Runge-Kutta.
    #[serde(rename = "RK4")]
    Rk4,
}

/// What came of one setting.
pub struct Played {
    /// States of all starts by frame, `[frame][start * state]` as a batch holds them; [`GONE`] once MuJoCo gives one up.
    pub frames: Vec<Vec<f64>>,
    /// Seconds of stepping all starts over all frames on one core: of a few runs the fastest; 0 if not timed.
    pub seconds: f64,
    /// Starts that were given up in the timed run, of MuJoCo Warp.
    pub lost: usize,
}

/// The referee's input: once, and for each run.
#[derive(Serialize)]
struct Request {
    mjcf: String,
    frame_time: f64,
    frames: usize,
    starts: Vec<Vec<f64>>,
    /// Of the robot of each start, where they differ.
    numbers: Vec<Numbers>,
}

#[derive(Serialize)]
struct Numbers {
    masses: Vec<f64>,
    friction: f64,
}

#[derive(Serialize)]
struct Setting {
    integrator: Scheme,
    substeps: usize,
    timed: bool,
    told: bool,
    plain: bool,
    worlds: usize,
}

/// What it says.
#[derive(Deserialize)]
#[serde(untagged)]
enum Said<A> {
    Error { error: String },
    Answer(A),
}

#[derive(Deserialize)]
struct Version {
    version: String,
}

#[derive(Deserialize)]
struct Rolled {
    states: Vec<Vec<Option<Vec<f64>>>>,
    seconds: f64,
    #[serde(default)]
    lost: usize,
}

/// MuJoCo at work on one model from the same starts, at one setting after another.
pub struct Referee {
    /// MuJoCo's version.
    pub version: String,
    /// Whether friction is what MuJoCo's defaults make it, pyramids that creep, in place of cones (that hold, where there are drives).
    pub plain: bool,
    /// Environments of a timed run on a GPU; 0: the starts.
    pub worlds: usize,
    pub(super) robot: Robot,
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Referee {
    /// Starts `python` on `system` in `scene`, to roll out `frames` frames from each of `starts`, states of ours.
    ///
    /// # Errors
    /// Of [`nerd_sim::mjcf::mjcf`], if `python` cannot be started or has no MuJoCo, or what MuJoCo says of the model.
    pub fn new(python: &Path, system: &Arc<System>, scene: &Arc<Scene>, starts: &[Vec<f64>], frames: usize) -> Result<Self> {
        let mut batch = Batch::new(system, scene, starts.len());
        batch.states = starts.concat();
        Self::of(python, &batch, frames)
    }

    /// The same from a batch, with its drives, which must be those of its first environment everywhere, and the masses and frictions of
    /// its robots. All else of them and of their scenes is taken from the first; largest velocities of joints are not kept.
    ///
    /// # Errors
    /// As [`Self::new`]; a batch whose drives differ.
    pub fn of(python: &Path, batch: &Batch, frames: usize) -> Result<Self> {
        Self::by(REFEREE, python, batch, frames)
    }

    /// MuJoCo Warp, the same engine in 32 bits on a GPU: every start is a world, and all of them run side by side. It makes no frames one
    /// by one, and takes no robots that differ.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn warp(python: &Path, batch: &Batch, frames: usize) -> Result<Self> {
        Self::by(WARP, python, batch, frames)
    }

    fn by(script: &str, python: &Path, batch: &Batch, frames: usize) -> Result<Self> {
        let (system, first) = (&batch.system, batch.driven(0));
        if (1..batch.len()).any(|env| batch.driven(env) != first) {
            refuse!("drives differ between environments, which the referee of MuJoCo does not take");
        }
        let robot = system.robot.clone();
        let free = Arc::new(Scene::free(system.gravity()));
        let starts = (0..batch.len()).map(|env| to_mujoco(&robot, batch.state(env))).collect();
        let numbers = |own: &Arc<System>, scene: &Arc<Scene>| Numbers {
            masses: own.robot.links.iter().map(|l| l.inertia.mass).collect(),
            friction: scene.colliders.first().map_or(0.0, |c| c.material.mean(&own.spec.material).friction),
        };
        let numbers = batch.systems.iter().zip(&batch.scenes).map(|(own, scene)| numbers(own, scene)).collect();
        let mjcf = driven(system, batch.scenes.first().unwrap_or(&free), first)?;
        let request = Request { mjcf, frame_time: system.frame_time, frames, starts, numbers };
        let cannot = || format!("cannot start `{}` as a Python with MuJoCo", python.display());
        let mut command = Command::new(python);
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().with_context(cannot)?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            refuse!("{}: it has no pipes", cannot());
        };
        let mut referee = Self { version: String::new(), plain: false, worlds: 0, robot, child, input, output: BufReader::new(output) };
        let Version { version } = referee.ask(&request)?;
        referee.version = version;
        Ok(referee)
    }

    /// Rolls out at one setting: `substeps` steps of `integrator` a frame.
    ///
    /// # Errors
    /// What MuJoCo says, or that it has ended.
    pub fn play(&mut self, integrator: Scheme, substeps: usize, timed: bool) -> Result<Played> {
        self.set(Setting { integrator, substeps, timed, told: true, plain: self.plain, worlds: self.worlds })
    }

    /// The seconds alone that it takes, for more states than one would read.
    ///
    /// # Errors
    /// As [`Self::play`].
    pub fn time(&mut self, integrator: Scheme, substeps: usize) -> Result<f64> {
        Ok(self.set(Setting { integrator, substeps, timed: true, told: false, plain: self.plain, worlds: self.worlds })?.seconds)
    }

    fn set(&mut self, setting: Setting) -> Result<Played> {
        let Rolled { states, seconds, lost } = self.ask(&setting)?;
        let robot = &self.robot;
        let state = |s: Option<Vec<f64>>| s.map_or_else(|| vec![GONE; robot.state_dim()], |s| from_mujoco(robot, &s));
        Ok(Played { frames: states.into_iter().map(|frame| frame.into_iter().flat_map(state).collect()).collect(), seconds, lost })
    }

    pub(super) fn ask<A: DeserializeOwned>(&mut self, question: &impl Serialize) -> Result<A> {
        // One that has ended says why on its output.
        let question = serde_json::to_string(question).context("cannot ask MuJoCo")?;
        let _ = writeln!(self.input, "{question}");
        let mut line = String::new();
        self.output.read_line(&mut line).context("cannot hear MuJoCo")?;
        match serde_json::from_str(&line) {
            Ok(Said::Error { error }) => Err(anyhow!(error)),
            Ok(Said::Answer(answer)) => Ok(answer),
            Err(_) => Err(anyhow!("the Python of MuJoCo ended without an answer")),
        }
    }
}

impl Drop for Referee {
    /// Nobody listens any more.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
