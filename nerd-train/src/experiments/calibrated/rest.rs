//! What is left of the errors on the judged part of the first split: by frame, by what happens in a rollout, and where a network acts.

use nerd_core::dynamics::{Data, to_local};
use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_sim::batch::contacts;
use nerd_sim::calibrate::{Subject, Trial, distance, mean, objective};
use nerd_sim::log::Log;
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

use super::split::Parts;
use super::ties::{Tie, ties};
use super::{Calibrated, Calibration};
use crate::error::Result;
use crate::unroll::{silence, solver};

/// What is left.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rest {
    /// Errors by frame.
    pub courses: Vec<Course>,
    /// What errors go along with.
    pub ties: Vec<Tie>,
    /// Where networks act.
    pub acts: Vec<Acts>,
    /// Trajectories to look at.
    pub shown: Vec<Shown>,
}

/// Errors of one method by frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Course {
    /// The method.
    pub name: String,
    /// Mean position (m) and rotation (rad) by frame.
    pub by_frame: Vec<[f64; 2]>,
}

/// What a network adds to its base where so many points touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Acts {
    /// Way of learning.
    pub name: String,
    /// Points that touch something.
    pub points: String,
    /// Share of the frames.
    pub share: f64,
    /// Mean change of the root's velocity in a frame (m/s) and of its spin (rad/s): slower than [`SLOW`], then faster.
    pub changes: [[f64; 2]; 2],
}

/// A whole trajectory and its predictions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// Its name in the log.
    pub id: u64,
    /// What it is an example of.
    pub what: String,
    /// Coordinates by frame: measured first, then by method.
    pub tracks: Vec<(String, Vec<Vec<f64>>)>,
}

/// A calibrated solver, or a model of its robot.
struct Method<'a> {
    name: String,
    subject: &'a Subject,
    model: Option<&'a Model>,
}

/// Slower than this (m/s), a body slides or rests.
pub const SLOW: f64 = 0.3;
/// Nearer than this (m), a point touches.
const TOUCHES: f64 = 1e-3;

impl Calibration {
    /// What is left of the first split's errors: of the calibrated solvers, then of what was learned.
    pub(super) fn rest(&self, log: &Log, fitted: &[Calibrated], parts: &[Parts], models: &[Model]) -> Result<Rest> {
        let Some(part) = parts.first() else { return Ok(Rest::default()) };
        let mut subjects = Vec::new();
        for (solver, fitted) in self.solvers.iter().zip(fitted) {
            let ((subject, parameters), Some(split)) = (self.subject(log, solver)?, fitted.splits.first()) else { continue };
            subjects.push((format!("{}, calibrated", fitted.solver), subject.with(&parameters, &split.fit.values)?));
        }
        let mut methods: Vec<Method> = subjects.iter().map(|(name, subject)| Method { name: name.clone(), subject, model: None }).collect();
        let first = subjects.first().map(|s| &s.1);
        let learned = self.learn.iter().zip(models).zip(std::iter::repeat(first));
        methods.extend(
            learned.filter_map(|((way, model), subject)| Some(Method { name: way.clone(), subject: subject?, model: Some(model) })),
        );
        Rest::new(&methods, part)
    }
}

impl Method<'_> {
    fn roll(&self, trials: &[Trial]) -> Result<Vec<Vec<Vec<f64>>>> {
        Ok(match self.model {
            Some(model) => self.subject.roll_in(trials, &solver(model, &self.subject.system))?,
            None => self.subject.roll(trials)?,
        })
    }
}

impl Rest {
    /// Of these methods, the first of which is the unit of errors.
    ///
    /// # Errors
    /// What solvers say.
    fn new(methods: &[Method], parts: &Parts) -> Result<Self> {
        let Some(first) = methods.first() else { return Ok(Self::default()) };
        let (system, trials) = (&first.subject.system, &parts.judged);
        let mut rest = Self::default();
        let mut unit = None;
        let mut errors = Vec::new();
        for method in methods {
            let motions = method.roll(trials)?;
            let apart: Vec<_> = motions.iter().zip(trials).map(|(m, t)| distance(system, m, &t.measured)).collect();
            let unit = *unit.get_or_insert_with(|| mean(&apart));
            errors.push(apart.iter().map(|d| objective(d, &unit)).collect::<Vec<f64>>());
            rest.courses.push(Course { name: method.name.clone(), by_frame: by_frame(system, &motions, trials) });
            if let Some(model) = method.model {
                rest.acts.extend(acts(&method.name, method.subject, model, trials)?);
            }
        }
        let names: Vec<&str> = methods.iter().map(|m| m.name.as_str()).collect();
        rest.ties = ties(first.subject, trials, &names, &errors);
        rest.shown = shown(methods, parts)?;
        Ok(rest)
    }
}

fn by_frame(system: &System, motions: &[Vec<Vec<f64>>], trials: &[Trial]) -> Vec<[f64; 2]> {
    let frames = trials.first().map_or(0, |t| t.measured.len());
    let at = |k: usize| {
        let one = |(m, t): (&Vec<Vec<f64>>, &Trial)| distance(system, &m[k..=k], &t.measured[k..=k]);
        let all = mean(&motions.iter().zip(trials).map(one).collect::<Vec<_>>());
        [all.position, all.rotation].map(|x| (x * 1e7).round() / 1e7)
    };
    (0..frames).map(at).collect()
}

/// What a model adds to its base along its own rollouts.
fn acts(name: &str, subject: &Subject, model: &Model, trials: &[Trial]) -> Result<Vec<Acts>> {
    let (system, scene, robot) = (&subject.system, &subject.scene, &subject.system.robot);
    // Each state is looked at on its own, which says nothing of a network that remembers others.
    if !robot.floating() || model.weights.config.history > 1 {
        return Ok(Vec::new());
    }
    let mut mute = model.clone();
    silence(&mut mute.weights);
    let motions = subject.states_in(trials, &solver(model, system))?;
    let frames = motions.iter().zip(trials).flat_map(|(m, t)| m.iter().zip(&t.torques));
    let (states, torques): (Vec<&Vec<f64>>, Vec<&Vec<f64>>) = frames.unzip();
    let torques: Vec<f64> = torques.into_iter().flatten().copied().collect();
    let after = |model: &Model| -> Result<Batch> {
        let mut batch = Batch::new(system, scene, states.len());
        states.iter().enumerate().for_each(|(env, state)| batch.reset(env, state));
        // What cannot be stepped stands where it stood, and changes nothing.
        match Neural::on_cpu(model.clone(), system).step(&mut batch, &torques) {
            Err(StepError::Environments(_)) | Ok(()) => Ok(batch),
            Err(error) => Err(error.into()),
        }
    };
    let (with, without) = (after(model)?, after(&mute)?);
    let (mut data, mut events) = (Data::new(robot), Vec::new());
    let mut sums = [[[0.0; 3]; 2]; 4];
    for (env, state) in states.iter().enumerate() {
        contacts(system, scene, state, &mut data, &mut events);
        let touching = events.iter().zip(&robot.contact_points).filter(|(e, p)| e.distance - p.radius < TOUCHES).count();
        let [now, a, b] = [state.as_slice(), with.state(env), without.state(env)].map(|state| {
            let mut own = state.to_vec();
            let (q, qd) = own.split_at_mut(robot.nq());
            to_local(robot, q, qd);
            (nalgebra::Vector3::from_column_slice(&qd[..3]), nalgebra::Vector3::from_column_slice(&qd[3..6]))
        });
        let cell = &mut sums[touching.min(3)][usize::from(now.1.norm() > SLOW)];
        let change = [1.0, (a.1 - b.1).norm(), (a.0 - b.0).norm()];
        cell.iter_mut().zip(change).for_each(|(sum, x)| *sum += x);
    }
    let per = |[n, v, w]: [f64; 3]| [v, w].map(|x| if n > 0.0 { x / n } else { 0.0 });
    let all = states.len().max(1) as f64;
    let row = |(points, cells): (&str, &[[f64; 3]; 2])| Acts {
        name: name.into(),
        points: points.into(),
        share: (cells[0][0] + cells[1][0]) / all,
        changes: cells.map(per),
    };
    Ok(["none", "1", "2", "3 or more"].into_iter().zip(&sums).map(row).collect())
}

/// The trajectories that the last method predicts best, middling and worst.
fn shown(methods: &[Method], parts: &Parts) -> Result<Vec<Shown>> {
    let Some(last) = methods.last() else { return Ok(Vec::new()) };
    let (system, whole) = (&last.subject.system, &parts.whole);
    let motions = last.roll(whole)?;
    let apart: Vec<_> = motions.iter().zip(whole).map(|(m, t)| distance(system, m, &t.measured)).collect();
    let unit = mean(&apart);
    let mut order: Vec<usize> = (0..whole.len()).collect();
    order.sort_by(|a, b| objective(&apart[*a], &unit).total_cmp(&objective(&apart[*b], &unit)));
    let mut places = vec![("best", 0), ("worst", order.len().saturating_sub(1)), ("middling", order.len() / 2)];
    // Of two there is no middling one.
    places.truncate(order.len());
    let short = |q: &Vec<f64>| q.iter().map(|x| (x * 1e5).round() / 1e5).collect::<Vec<f64>>();
    let track = |name: &str, motion: &[Vec<f64>]| (name.to_string(), motion.iter().map(short).collect::<Vec<_>>());
    let one = |(what, place): (&str, usize)| -> Result<Shown> {
        let trial = std::slice::from_ref(&whole[order[place]]);
        let mut tracks = vec![track("measured", &trial[0].measured)];
        // More would hide each other.
        let second = methods.iter().position(|m| m.model.is_some());
        for method in methods.iter().take(1).chain(second.map(|k| &methods[k])) {
            tracks.push(track(&method.name, &method.roll(trial)?[0]));
        }
        Ok(Shown { id: trial[0].id, what: what.into(), tracks })
    };
    if whole.is_empty() { Ok(Vec::new()) } else { places.into_iter().map(one).collect() }
}
