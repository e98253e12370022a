//! How the error of a rollout changes with what the network said in each of its frames.
//!
//! The chain rule through time: with `x[t+1] = f(x[t])` and the error `e[t]` of frame t, `l[t] = de[t]/dx + (df/dx)^T l[t+1]` from the
//! last frame back. `df/dx` is taken by differences of the whole solver, contact queries, base and network alike, so nothing has to be
//! differentiable by itself and any robot and base will do. The network must have no memory (`history` 1).

use nerd_core::dynamics::Data;
use nerd_core::robot::Robot;
use nerd_model::features::Features;
use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_sim::calibrate::{Distance, Subject, Trial};
use nerd_sim::dataset::Recording;
use nerd_sim::prelude::*;
use rayon::prelude::*;

use super::tangent::{apart, dim, shift};
use crate::error::{Result, refuse};
use crate::prepare::{normalize, tokens};
use crate::windows::Windows;

/// Step of the differences through a frame, in the numbers' units: contact has kinks, and what counts is the slope across them.
const PROBE: f64 = 0.02;
/// Step of those through a prediction, which has none.
const STEP: f64 = 1e-5;
/// How far (s) a change of a rate carries, for its unit.
const AHEAD: f64 = 0.1;
/// An adjoint longer than this, in the error's units, is shortened to it: contact makes some of them explode.
const LONGEST: f64 = 1.0;
/// A distance within this share of its unit counts by its square, which has a slope at zero.
const ROUND: f64 = 0.02;

/// Mean error of a model's rollouts, and how it changes with what the network says.
pub struct Slope {
    /// Mean over trials, frames and what is measured (position, rotation, joints), each in its unit.
    pub error: f64,
    /// Tokens of the rollouts and what the network said, a trajectory each, normalised.
    pub windows: Windows,
    /// Change of a trial's error with each number that was said, in the order of the windows' targets.
    pub slopes: Vec<f64>,
    /// Frames in which the network was asked; in all others nothing it could say moves anything.
    pub asked: usize,
}

impl Slope {
    /// The windows with targets down the slope from what was said: by 1 in the mean square of a frame in which the network was asked,
    /// since where contact makes slopes large only their direction is worth anything. In all other frames the target is no change.
    pub fn targets(mut self) -> Windows {
        let square: f64 = self.slopes.iter().map(|s| s * s).sum();
        let scale = (self.asked as f64 / square.max(1e-300)).sqrt();
        self.windows.y.iter_mut().zip(&self.slopes).for_each(|(y, s)| *y -= (s * scale) as f32);
        self.windows
    }
}

/// The slope at a model's present weights. All trials have as many frames. A rollout that the solver cannot finish teaches nothing:
/// another one stands in its place.
///
/// # Errors
/// What the solver says; trials of no or different lengths; no rollout that could be finished.
pub fn slope(model: &Model, subject: &Subject, trials: &[Trial], unit: &Distance) -> Result<Slope> {
    let (system, robot) = (&subject.system, &subject.system.robot);
    let frames = trials.first().map_or(0, |t| t.torques.len());
    if frames == 0 || trials.iter().any(|t| t.torques.len() != frames || t.measured.len() != frames + 1) {
        refuse!("rollouts of no frames, or of different numbers of them");
    }
    let (m, d) = (dim(robot), robot.state_dim());
    let units = units(robot, unit);
    let Course { states, moves, asked, sound } = course(model, subject, trials, &units)?;
    let taken: Vec<usize> = sound.iter().copied().cycle().take(trials.len()).collect();
    if taken.is_empty() {
        refuse!("none of {} rollouts of {frames} frames could be finished; take a smaller rate, or a calibrated robot", trials.len());
    }
    let (mut data, mut recording) = (Data::new(robot), Recording::empty(frames));
    for &i in &taken {
        let own: Vec<Vec<f64>> = states.iter().map(|s| s[i * d..(i + 1) * d].to_vec()).collect();
        recording.push(system, &subject.scene, &own, &trials[i].torques, &mut data);
    }
    let form = model.config.form();
    let mut windows = tokens(system, &recording, model.config.network.sequence(), form)?;
    normalize(&mut windows, &model.normalizer);
    let outputs = windows.outputs;
    let scale: Vec<f64> = model.normalizer.outputs.scale().collect();
    // Said changes are small: what one more does to the outcome is told by adding it to the outcome itself.
    let mut nothing = vec![0.0; outputs];
    if robot.floating() {
        nothing[6] = 1.0;
    }
    let back = |features: &mut Features, &i: &usize| {
        let of = |t: usize| &states[t][i * d..(i + 1) * d];
        let (mut slopes, mut error, mut next) = (vec![0.0; frames * outputs], 0.0, vec![0.0; d]);
        let (mut adjoint, mut way) = (vec![0.0; m], vec![0.0; m]);
        for t in (0..frames).rev() {
            error += add(robot, of(t + 1), &trials[i].measured[t + 1], &units, frames, &mut adjoint);
            shorten(&mut adjoint, &units);
            for k in (0..outputs).filter(|_| asked[t][i]) {
                let mut change = nothing.clone();
                change[k] += STEP;
                features.apply(of(t), of(t + 1), &change, &mut next);
                apart(robot, of(t + 1), &next, &mut way);
                slopes[t * outputs + k] = dot(&way, &adjoint) / STEP * scale[k];
            }
            let rows = &moves[t][i * m * m..(i + 1) * m * m];
            adjoint = rows.chunks_exact(m).map(|row| dot(row, &adjoint)).collect();
        }
        (slopes, error)
    };
    let (slopes, errors): (Vec<Vec<f64>>, Vec<f64>) = taken.par_iter().map_init(|| Features::new(system, form), back).unzip();
    let slopes = slopes.concat();
    if slopes.iter().any(|s| !s.is_finite()) {
        refuse!("a rollout of {frames} frames ends in no number; take a smaller rate");
    }
    let asked = taken.iter().map(|&i| asked.iter().filter(|frame| frame[i]).count()).sum();
    Ok(Slope { error: errors.iter().sum::<f64>() / taken.len() as f64, windows, slopes, asked })
}

/// Rollouts, and by how much the outcome of each frame moves with each number of its start.
struct Course {
    /// By frame, of all trials.
    states: Vec<Vec<f64>>,
    /// By frame: `[trial][number of the start][number of the outcome]`.
    moves: Vec<Vec<f64>>,
    /// By frame and trial, whether the network was asked.
    asked: Vec<Vec<bool>>,
    /// Trials whose rollouts could be finished.
    sound: Vec<usize>,
}

fn course(model: &Model, subject: &Subject, trials: &[Trial], units: &[f64]) -> Result<Course> {
    let (system, scene, robot) = (&subject.system, &subject.scene, &subject.system.robot);
    let (n, m) = (trials.len(), dim(robot));
    let mut data = Data::new(robot);
    let (mut neural, mut probes) = (Neural::on_cpu(model.clone(), system), Neural::on_cpu(model.clone(), system));
    let (mut batch, mut near) = (Batch::new(system, scene, n), Batch::new(system, scene, n * m));
    trials.iter().enumerate().for_each(|(i, trial)| batch.reset(i, &subject.start(trial, &mut data)));
    let (mut states, mut moves, mut asked) = (vec![batch.states.clone()], Vec::new(), Vec::new());
    let mut lost = vec![false; n];
    for t in 0..trials[0].torques.len() {
        let torques: Vec<f64> = trials.iter().flat_map(|trial| trial.torques[t].iter().copied()).collect();
        let probing: Vec<f64> = trials.iter().flat_map(|trial| trial.torques[t].repeat(m)).collect();
        for env in 0..n * m {
            let mut state = batch.state(env / m).to_vec();
            shift(robot, &mut state, env % m, PROBE * units[env % m]);
            near.reset(env, &state);
        }
        let astray = unable(probes.step(&mut near, &probing))?;
        unable(neural.step(&mut batch, &torques))?.into_iter().for_each(|env| lost[env] = true);
        let mut moved = vec![0.0; n * m * m];
        moved.par_chunks_mut(m).enumerate().for_each(|(env, row)| {
            // Where a probe leads nowhere, so does its slope.
            if astray.contains(&env) {
                return;
            }
            apart(robot, batch.state(env / m), near.state(env), row);
            row.iter_mut().for_each(|x| *x /= PROBE * units[env % m]);
        });
        let mut told = vec![false; n];
        neural.asked().iter().for_each(|&env| told[env] = true);
        asked.push(told);
        moves.push(moved);
        states.push(batch.states.clone());
    }
    Ok(Course { states, moves, asked, sound: (0..n).filter(|&i| !lost[i]).collect() })
}

/// Environments that a step could not move.
fn unable(step: std::result::Result<(), StepError>) -> Result<Vec<usize>> {
    Ok(step.err().map_or(Ok(Vec::new()), StepError::faults)?.into_iter().map(|fault| fault.env).collect())
}

/// Units of a change's numbers: what of each is worth an error of 1.
fn units(robot: &Robot, unit: &Distance) -> Vec<f64> {
    let (nv, root) = (robot.nv(), robot.root_dofs());
    let of = |k: usize| match k {
        0..3 if root > 0 => unit.position,
        3..6 if root > 0 => unit.rotation,
        _ => unit.joints,
    };
    // Rates stand angular first.
    let rate = |k: usize| of(if root > 0 && k < 6 { (k + 3) % 6 } else { k }) / AHEAD;
    (0..nv).map(of).chain((0..nv).map(rate)).map(|u| if u > 0.0 { u } else { 1.0 }).collect()
}

/// The error of a frame's pose, in its units; its slope goes into `adjoint`.
fn add(robot: &Robot, state: &[f64], measured: &[f64], units: &[f64], frames: usize, adjoint: &mut [f64]) -> f64 {
    let (nq, root) = (robot.nq(), robot.root_dofs());
    let pose = |q: &[f64]| [&q[..nq], &vec![0.0; robot.nv()]].concat();
    let mut way = vec![0.0; 2 * robot.nv()];
    apart(robot, &pose(measured), &pose(&state[..nq]), &mut way);
    let joints = robot.joint_count();
    let blocks = [0..root.min(3), root.min(3)..root].into_iter().chain((0..joints).map(|k| root + k..root + k + 1));
    let blocks: Vec<_> = blocks.filter(|b| !b.is_empty()).collect();
    // A joint counts with the others as one.
    let parts = f64::from(u8::from(root > 0)) * 2.0 + f64::from(u8::from(joints > 0));
    let mut error = 0.0;
    for block in blocks {
        let share = if block.start >= root { 1.0 / joints as f64 } else { 1.0 } / (parts * frames as f64);
        let size = block.clone().map(|k| (way[k] / units[k]).powi(2)).sum::<f64>();
        let length = (size + ROUND * ROUND).sqrt();
        error += share * (length - ROUND);
        block.for_each(|k| adjoint[k] += share * way[k] / (units[k] * units[k] * length));
    }
    error
}

fn shorten(adjoint: &mut [f64], units: &[f64]) {
    let length = adjoint.iter().zip(units).map(|(a, u)| (a * u).powi(2)).sum::<f64>().sqrt();
    if length > LONGEST {
        adjoint.iter_mut().for_each(|a| *a *= LONGEST / length);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
