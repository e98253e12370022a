//! Plays an exported policy in MuJoCo (sim-to-sim). The Python process has the ONNX, the contract and an MJCF, and
//! computes observations, actions and torques by itself. The task here computes rewards and terminations from MuJoCo's
//! states. Python's observations and torques are compared with the task's at the same states.

use std::sync::{Arc, Mutex, PoisonError};

use nerd_sim::solver::{check, commit};
use nerd_tasks::Episodes;
use nerd_train::onnx::Contract;
use nerd_train::ppo::{Game, Policy};
use serde_json::json;

use super::python::Python;
use super::settings::Settings;
use super::states::{all_to_mujoco, take};
use crate::prelude::*;

/// Time step of MuJoCo (s). At 5e-4 s our contact diverges, since it is stiff for light links.
const STEP: f64 = 1e-4;

const PLAYER: &str = concat!(include_str!("model.py"), include_str!("player.py"));

/// The model that MuJoCo simulates.
#[derive(Clone, Copy)]
pub enum Model<'a> {
    /// The MJCF that we write, with our contact parameters translated to MuJoCo's.
    Ours,
    /// The robot's MJCF with its own contact, solver settings, actuators and ground.
    File(&'a Path),
}

#[derive(Debug, Default)]
pub struct Played {
    pub versions: String,
    pub games: Vec<Game>,
    /// Number of episodes that ended in a terminal state.
    pub fallen: usize,
    pub settings: Settings,
    /// Largest differences of Python's observations, actions and torques from ours at the same states. Each is divided
    /// by the largest value of our vector, or by 1 if that is smaller.
    pub apart: Gaps,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Gaps {
    pub observation: f64,
    pub action: f64,
    pub torque: f64,
}

/// Torques and the state after them, by environment. The outer `None` means that the episode has ended, the inner that
/// MuJoCo gave it up.
type Frame = Vec<Option<(Vec<f64>, Option<Vec<f64>>)>>;

/// MuJoCo's frames that are not replayed yet, and the largest difference of its torques from the task's.
#[derive(Default)]
struct Heard {
    frames: std::collections::VecDeque<Frame>,
    torque: f64,
}

/// A solver that replays MuJoCo's frames; environments whose episode has ended keep their state.
struct Hearsay(Arc<Mutex<Heard>>, Vec<f64>);

impl Solver for Hearsay {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let mut faults = Vec::new();
        let servo = std::mem::replace(&mut batch.servo, false);
        let checked = check(batch, torques, &mut faults);
        batch.servo = servo;
        checked?;
        let mut heard = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(frame) = heard.frames.pop_front() else {
            return Err(StepError::Solver("MuJoCo played fewer frames than a step has".into()));
        };
        self.1.clone_from(&batch.states);
        for (env, heard_of) in frame.into_iter().enumerate() {
            let Some((theirs, state)) = heard_of else { continue };
            heard.torque = heard.torque.max(gap(&torques[env * theirs.len()..][..theirs.len()], &theirs));
            take(batch, env, state, &mut self.1, &mut faults);
        }
        commit(batch, &mut self.1, &mut faults)
    }

    /// Accepts drives: MuJoCo simulates them.
    fn capabilities(&self) -> Capabilities {
        Capabilities { drives: true, ..Capabilities::default() }
    }
}

/// Describes a plane as JSON: the pose of a MuJoCo geom, and its normal and offset (m).
fn ground(plane: &Plane) -> serde_json::Value {
    let turn = rotation_from(&Vector3::z_axis(), &plane.normal);
    let place = plane.normal * plane.offset;
    json!({ "pos": place.as_slice(), "quat": [turn.w, turn.i, turn.j, turn.k], "normal": plane.normal.as_slice(), "offset": plane.offset })
}

/// Returns the largest difference, divided by the largest absolute value of `ours`, or by 1 if that is smaller.
fn gap(ours: &[f64], theirs: &[f64]) -> f64 {
    let most = ours.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
    ours.iter().zip(theirs).map(|(a, b)| (a - b).abs() / most).fold(0.0, f64::max)
}

/// First message to the player: policy, contract, starts, robot and scene.
fn opening(model: Model, onnx: &Path, contract: &Contract, batch: &Batch) -> Result<serde_json::Value> {
    let mut first = json!({ "onnx": onnx, "contract": contract, "starts": all_to_mujoco(batch) });
    match model {
        Model::Ours => {
            first["mjcf"] = json!(nerd_sim::mjcf::mjcf_of_our_contact(&batch.system, &batch.scenes[0])?);
            first["substeps"] = json!((batch.system.frame_time / STEP).ceil());
        }
        Model::File(path) => {
            let planes = batch.scenes[0].colliders.iter().filter_map(|collider| collider.plane.as_ref()).map(ground);
            first["path"] = json!(path);
            first["scene"] = json!(batch.scenes[0].name);
            first["planes"] = planes.collect();
        }
    }
    Ok(first)
}

/// Observation and action of a step, then torques and the state after them for each of its frames, as in [`Frame`].
type Answer = (Vec<f64>, Vec<f64>, Vec<(Vec<f64>, Option<Vec<f64>>)>);

/// Asks MuJoCo for one step of the unfinished episodes; refuses an answer that does not fit the contract.
fn ask(python: &mut Python, message: &serde_json::Value, contract: &Contract, joints: usize) -> Result<Vec<Answer>> {
    let answers: Vec<Answer> = python.ask(message)?;
    let fits = |(observed, action, frames): &Answer| {
        observed.len() == contract.observation.len()
            && action.len() == contract.action.len()
            && frames.len() == contract.frames_per_action as usize
            && frames.iter().all(|frame| frame.0.len() == joints)
    };
    if !answers.iter().all(fits) {
        bail!("the Python of MuJoCo answered with other numbers than the contract has");
    }
    Ok(answers)
}

/// Refuses a policy whose contract does not describe all its observations and its action law.
fn by_contract(contract: &Contract) -> Result<()> {
    if let Some(unknown) = contract.unknown().first() {
        bail!(
            "a policy of `{}` cannot be played by its contract alone: {unknown}; `policy evaluate` plays it here",
            contract.task
        );
    }
    Ok(())
}

/// Plays one episode in each environment of `episodes`, from its start, with the policy in the file `onnx`. The solver
/// of `episodes` must be analytic, or not have been stepped.
pub fn play(
    python: &Path,
    model: Model,
    onnx: &Path,
    contract: &Contract,
    policy: &Policy,
    mut episodes: Episodes,
) -> Result<Played> {
    by_contract(contract)?;
    let batch = &episodes.simulation.batch;
    let n = episodes.len();
    let joints = batch.system.robot.joint_count();
    let first = opening(model, onnx, contract, batch)?;
    let mut python = Python::start(python, PLAYER)?;
    let mut played = Played { versions: python.ask(&first)?, ..Played::default() };
    let heard = Arc::new(Mutex::new(Heard::default()));
    episodes.simulation.solver = Box::new(Hearsay(heard.clone(), Vec::new()));
    let actor = nerd_train::ppo::Actor::new(policy.clone());
    let mut running = nerd_train::ppo::Running::new(&episodes, policy.shape.stack);
    let frames = contract.frames_per_action as usize;
    let width = contract.action.len();
    let seen = contract.observation.len();
    let mut games: Vec<Option<Game>> = vec![None; n];
    let bar = bar(&format!("steps of {n} games of {} in MuJoCo", contract.task), episodes.task.episode_length());
    for step in 1.. {
        let live = (0..n).filter(|env| games[*env].is_none()).collect_vec();
        if live.is_empty() {
            break;
        }
        let goals = live.iter().map(|env| episodes.view(*env).goal).collect_vec();
        let answers = ask(&mut python, &json!({ "live": live, "goals": goals }), contract, joints)?;
        let own = actor.mean(&running.stack.rows);
        let mut actions = vec![0.0; n * width];
        let mut all = vec![vec![None; n]; frames];
        for (env, (observed, action, then)) in live.iter().copied().zip(answers) {
            let apart = &mut played.apart;
            apart.observation = apart.observation.max(gap(&episodes.observations()[env * seen..][..seen], &observed));
            apart.action = apart.action.max(gap(&own[env * width..][..width], &action));
            actions[env * width..][..width].copy_from_slice(&action);
            all.iter_mut().zip(then).for_each(|(frame, then)| frame[env] = Some(then));
        }
        heard.lock().unwrap_or_else(PoisonError::into_inner).frames = all.into();
        let (result, ended) = running.step(&mut episodes, &actions, &mut Vec::new())?;
        for ended in ended {
            if games[ended.env].is_some() {
                continue;
            }
            games[ended.env] = Some(Game { reward: ended.total, length: ended.length, ..Game::default() });
            played.fallen += usize::from(result.terminated[ended.env]);
        }
        bar.set(step);
    }
    bar.finish();
    played.settings = python.ask(&json!({}))?;
    played.apart.torque = heard.lock().unwrap_or_else(PoisonError::into_inner).torque;
    played.games = games.into_iter().flatten().collect();
    Ok(played)
}
