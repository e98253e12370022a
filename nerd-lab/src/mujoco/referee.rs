//! MuJoCo as a reference engine on the same robot. It is optional: a Python with MuJoCo is started on demand, receives
//! a model and start states, and returns rollouts.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use nerd_core::dynamics::{to_local, to_world};
use nerd_core::state::wrap_state;
use nerd_sim::mjcf::mjcf;
use nerd_train::evaluate::Held;
use serde_json::{Value, json};

use crate::prelude::*;

pub(super) const REFEREE: &str = include_str!("referee.py");
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
    pub(super) python: Python,
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
        self.python.child.id()
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

// Our states differ from MuJoCo's only for a floating root. Ours is `q = [p, quaternion x y z w]`, `qd = [w, p_dot + p
// x w]` in world axes. MuJoCo's is `qpos = [p, quaternion w x y z]`, `qvel = [p_dot, w in body axes]`.

/// Converts a state `[q, qd]` to MuJoCo's `[qpos, qvel]`.
pub fn to_mujoco(robot: &Robot, state: &[f64]) -> Vec<f64> {
    let mut out = state.to_vec();
    if robot.floating() {
        let (q, qd) = out.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        let w = quaternion(&q[3..7]).inverse() * vector(&qd[..3]);
        let velocity = vector(&qd[3..6]);
        q[3..7].rotate_right(1);
        qd[..3].copy_from_slice(velocity.as_slice());
        qd[3..6].copy_from_slice(w.as_slice());
    }
    out
}

/// Converts the states `[q, qd]` of all environments to MuJoCo's `[qpos, qvel]`.
pub fn all_to_mujoco(batch: &Batch) -> Vec<Vec<f64>> {
    (0..batch.len()).map(|env| to_mujoco(&batch.system.robot, batch.state(env))).collect()
}

/// Converts MuJoCo's `[qpos, qvel]` to a state `[q, qd]`, with angles of unlimited joints wrapped.
pub fn from_mujoco(robot: &Robot, state: &[f64]) -> Vec<f64> {
    let mut out = state.to_vec();
    if robot.floating() {
        let (q, qd) = out.split_at_mut(robot.nq());
        q[3..7].rotate_left(1);
        let velocity = vector(&qd[..3]);
        let w = quaternion(&q[3..7]) * vector(&qd[3..6]);
        qd[..3].copy_from_slice(w.as_slice());
        qd[3..6].copy_from_slice(velocity.as_slice());
        to_world(robot, q, qd);
    }
    wrap_state(robot, &mut out);
    out
}

pub struct Python {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Said<A> {
    Error { error: String },
    Answer { answer: A },
}

impl Python {
    pub fn start(python: &Path, script: &str) -> Result<Self> {
        let cannot = || format!("cannot start `{}` as a Python with MuJoCo", python.display());
        let mut command = Command::new(python);
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().with_context(cannot)?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            bail!("{}: it has no pipes", cannot())
        };
        Ok(Self { child, input, output: BufReader::new(output) })
    }

    /// Starts MuJoCo with a `model` (`mjcf` or `path`, and `frame_time`), without start states.
    pub fn of_model(python: &Path, mut model: Value) -> Result<Self> {
        model["frames"] = json!(0);
        model["starts"] = json!([]);
        let mut python = Self::start(python, REFEREE)?;
        python.ask::<String>(&model)?;
        Ok(python)
    }

    pub fn ask<A: DeserializeOwned>(&mut self, question: &Value) -> Result<A> {
        // Ignores a failed write: a process that has ended left its error on standard output, which is read next.
        let _ = writeln!(self.input, "{question}");
        let mut line = String::new();
        self.output.read_line(&mut line).context("cannot hear MuJoCo")?;
        match serde_json::from_str(&line) {
            Ok(Said::Error { error }) => bail!(error.split_whitespace().join(" ")),
            Ok(Said::Answer { answer }) => Ok(answer),
            Err(_) => bail!("the Python of MuJoCo ended without an answer"),
        }
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
