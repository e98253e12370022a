//! An exported policy at play in MuJoCo, sim-to-sim: the child has its ONNX, its contract and the robot as MJCF, and makes observations, actions
//! and torques of its own. What comes back goes through the task here, so that rewards and falls are the task's own, and observations and
//! torques are compared with what the task says of the same states.

use std::sync::{Arc, Mutex, PoisonError};

use nerd_sim::solver::{Fault, check, commit};
use nerd_tasks::Episodes;
use nerd_train::onnx::Contract;
use nerd_train::ppo::{Game, Policy};
use serde_json::json;

use super::referee::{Python, from_mujoco, to_mujoco};
use super::settings::Settings;
use crate::prelude::*;

/// Length of a step of MuJoCo (s): our contact is stiff on light links, which at half a millisecond already fly off.
const STEP: f64 = 1e-4;

const PLAYER: &str = concat!(include_str!("model.py"), include_str!("player.py"));

/// The model that MuJoCo plays with.
#[derive(Clone, Copy, Debug)]
pub enum Model<'a> {
    /// Written by us, with our contact translated.
    Ours,
    /// The robot's MJCF as it is, with its own contact and solver settings, actuators and ground.
    File(&'a Path),
}

#[derive(Clone, Debug, Default)]
pub struct Played {
    pub versions: String,
    pub games: Vec<Game>,
    /// Games that ended in a terminal state.
    pub fallen: usize,
    pub settings: Settings,
    /// Largest differences of MuJoCo's observations from the task's, of actions from the policy's own at the task's observations,
    /// and of torques from the task's, in units of the largest of its kind.
    pub apart: Gaps,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gaps {
    pub observation: f64,
    pub action: f64,
    pub torque: f64,
}

/// Torques and the state that they led to, by environment; `None` where the episode has ended or was given up.
type Frame = Vec<Option<(Vec<f64>, Option<Vec<f64>>)>>;

/// What of the child's frames has not been stepped through yet, and how far torques were apart.
#[derive(Default)]
struct Heard {
    frames: std::collections::VecDeque<Frame>,
    torque: f64,
}

/// Steps as it was heard; who is not played any more stands still.
struct Hearsay(Arc<Mutex<Heard>>, Vec<f64>);

impl Solver for Hearsay {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> std::result::Result<(), StepError> {
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
        let (robot, d) = (&batch.system.robot, batch.system.robot.state_dim());
        for (env, heard_of) in frame.into_iter().enumerate() {
            let Some((theirs, state)) = heard_of else { continue };
            heard.torque = heard.torque.max(gap(&torques[env * theirs.len()..][..theirs.len()], &theirs));
            match state {
                Some(state) => self.1[env * d..][..d].copy_from_slice(&from_mujoco(robot, &state)),
                None => faults.push(Fault { env, frame: batch.frames[env], reason: "MuJoCo gave it up".into() }),
            }
        }
        commit(batch, &mut self.1, &mut faults)
    }

    /// Servos are MuJoCo's.
    fn capabilities(&self) -> Capabilities {
        Capabilities { drives: true, ..Capabilities::default() }
    }
}

/// A plane as a geom, and as it is compared with one.
fn ground(plane: &Plane) -> serde_json::Value {
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &plane.normal)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let place = plane.normal * plane.offset;
    json!({ "pos": place.as_slice(), "quat": [turn.w, turn.i, turn.j, turn.k], "normal": plane.normal.as_slice(), "offset": plane.offset })
}

/// Largest difference, of the largest number of the first, at least 1.
fn gap(ours: &[f64], theirs: &[f64]) -> f64 {
    let most = ours.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
    ours.iter().zip(theirs).map(|(a, b)| (a - b).abs() / most).fold(0.0, f64::max)
}

/// Plays one episode of each of `episodes`, of an analytic solver or none yet stepped, by the policy in the file `onnx`; they begin as they do.
pub fn play(python: &Path, model: Model, onnx: &Path, contract: &Contract, policy: &Policy, mut episodes: Episodes) -> Result<Played> {
    if let Some(unknown) = contract.unknown().first() {
        bail!("a policy of `{}` cannot be played by its contract alone: {unknown}; `policy evaluate` plays it here", contract.task);
    }
    let (batch, n) = (&episodes.simulation.batch, episodes.len());
    let (robot, joints) = (batch.system.robot.clone(), batch.system.robot.joint_count());
    let starts: Vec<_> = (0..n).map(|env| to_mujoco(&robot, batch.state(env))).collect();
    let mut first = json!({ "onnx": onnx, "contract": contract, "starts": starts });
    match model {
        Model::Ours => {
            first["mjcf"] = json!(nerd_sim::mjcf::mjcf_of_our_contact(&batch.system, &batch.scenes[0])?);
            first["substeps"] = json!((batch.system.frame_time / STEP).ceil());
        }
        Model::File(path) => {
            let planes = batch.scenes[0].colliders.iter().filter_map(|collider| collider.plane.as_ref()).map(ground);
            (first["path"], first["scene"]) = (json!(path), json!(batch.scenes[0].name));
            first["planes"] = planes.collect();
        }
    }
    let mut python = Python::start(python, PLAYER)?;
    let mut played = Played { versions: python.ask(&first)?, ..Played::default() };
    let heard = Arc::new(Mutex::new(Heard::default()));
    episodes.simulation.solver = Box::new(Hearsay(heard.clone(), Vec::new()));
    let actor = nerd_train::ppo::Actor::new(policy.clone());
    let mut running = nerd_train::ppo::Running::new(&episodes, policy.shape.stack);
    let (frames, width, seen) = (contract.frames_per_action as usize, contract.action.len(), contract.observation.len());
    let mut games: Vec<Option<Game>> = vec![None; n];
    let bar = bar(&format!("steps of {n} games of {} in MuJoCo", contract.task), episodes.task.episode_length());
    for step in 1.. {
        let live: Vec<usize> = (0..n).filter(|env| games[*env].is_none()).collect();
        if live.is_empty() {
            break;
        }
        let goals: Vec<&[f64]> = live.iter().map(|env| episodes.view(*env).goal).collect();
        type Answer = (Vec<f64>, Vec<f64>, Vec<(Vec<f64>, Option<Vec<f64>>)>);
        let answers: Vec<Answer> = python.ask(&json!({ "live": live, "goals": goals }))?;
        if answers.iter().any(|(o, a, f)| o.len() != seen || a.len() != width || f.len() != frames || f.iter().any(|f| f.0.len() != joints))
        {
            bail!("the Python of MuJoCo answered with other numbers than the contract has");
        }
        let own = actor.mean(&running.stack.rows);
        let (mut actions, mut all) = (vec![0.0; n * width], vec![vec![None; n]; frames]);
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
