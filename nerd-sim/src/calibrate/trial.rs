//! Open-loop rollouts from measured states: pieces of equal length that start at regular intervals of a trajectory.

use rayon::prelude::*;

use super::{parameter::CalibrateError, subject::Subject};
use crate::internal::*;
use crate::log::{Log, Trajectory, turned};

/// A start state, and the measured poses from there on.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Number of the trajectory.
    pub id: u64,
    /// First frame of the trial in its trajectory.
    pub first: usize,
    /// State `[q, qd]` at the start of a rollout.
    pub start: Vec<f64>,
    /// Coordinates q of every frame, including the start.
    pub measured: Vec<Vec<f64>>,
    /// Joint torques (N m or N) held constant over each frame.
    pub torques: Vec<Vec<f64>>,
    /// Torques of the two frames before the start, newest first. At the start of a trajectory they equal its first
    /// torques.
    pub earlier: [Vec<f64>; 2],
}

/// Distance between a rollout and its measurement: means over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// Distance of the root positions (m).
    pub position: f64,
    /// Angle between the root orientations (rad).
    pub rotation: f64,
    /// Mean absolute difference of the joint positions (rad or m).
    pub joints: f64,
    /// 1 if the root ends with a different side up, else 0.
    pub other_side: f64,
}

impl Distance {
    pub(super) fn parts(&self) -> [f64; 3] {
        [self.position, self.rotation, self.joints]
    }
}

impl Trial {
    /// Commanded torques of a frame and of the two frames before, newest first.
    pub(super) fn asked(&self, frame: usize) -> [&[f64]; 3] {
        std::array::from_fn(|back| {
            frame.checked_sub(back).map_or_else(|| &self.earlier[back - frame - 1], |frame| &self.torques[frame])
        })
        .map(Vec::as_slice)
    }

    /// The trial cut to its first frames, as a share of all frames.
    pub(super) fn begun(&self, share: f64) -> Self {
        let n = ((share * self.measured.len() as f64).ceil() as usize)
            .clamp(2.min(self.measured.len()), self.measured.len());
        Self { measured: self.measured[..n].to_vec(), torques: self.torques[..n - 1].to_vec(), ..self.clone() }
    }
}

impl Log {
    /// Pieces of `length` frames, with a start every `every` frames; with `length` 0, one piece per trajectory.
    pub fn trials(&self, length: usize, every: usize) -> Vec<Trial> {
        let nq = self.system.robot.nq();
        let cut = |t: &Trajectory, first: usize, length: usize| Trial {
            id: t.id,
            first,
            start: t.states[first].clone(),
            measured: t.states[first..first + length].iter().map(|s| s[..nq].to_vec()).collect(),
            torques: t.torques[first..first + length - 1].to_vec(),
            earlier: [1, 2].map(|back| t.torques[first.saturating_sub(back)].clone()),
        };
        let pieces = |t: &Trajectory| match length {
            0 => vec![cut(t, 0, t.states.len())],
            _ => t.starts(length - 1, every).map(|k| cut(t, k, length)).collect(),
        };
        self.trajectories.iter().flat_map(pieces).collect()
    }
}

impl Subject {
    /// Rolls out every trial, on all threads. Returns the coordinates of every frame as sensor readings. If the solver
    /// fails, the rollout keeps its last pose from there on.
    ///
    /// # Errors
    /// If no trial can be stepped even once.
    pub fn roll(&self, trials: &[Trial]) -> Result<Vec<Vec<Vec<f64>>>, CalibrateError> {
        let nq = self.system.robot.nq();
        let begin = || (self.engine.solver(), Batch::new(&self.system, &self.scene, 1), Data::new(&self.system.robot));
        let rolled = trials.par_iter().map_init(begin, |(solver, batch, data), trial| {
            batch.reset(0, &self.start(trial, data));
            solver.reset(0);
            let mut lost = false;
            let mut first = None;
            let shown = |batch: &Batch| {
                let mut pose = batch.state(0)[..nq].to_vec();
                self.shift(&mut pose, -1.0);
                pose
            };
            let mut motion = vec![shown(batch)];
            for frame in 0..trial.torques.len() {
                if let Some(error) = if lost { None } else { solver.step(batch, &self.late(&trial.asked(frame))).err() }
                {
                    lost = true;
                    first = first.or(Some(error).filter(|_| motion.len() == 1));
                }
                motion.push(shown(batch));
            }
            (motion, first)
        });
        let (motions, errors): (Vec<_>, Vec<_>) = rolled.unzip();
        match errors.into_iter().collect::<Option<Vec<_>>>().and_then(|all| all.into_iter().next()) {
            Some(error) => Err(error.into()),
            None => Ok(motions),
        }
    }

    /// Start state of a rollout. A penetrating body is moved out of the ground, since contact forces would throw the
    /// body out. In free fall the velocity is corrected for the lag.
    pub(super) fn start(&self, trial: &Trial, data: &mut Data) -> Vec<f64> {
        let robot = &self.system.robot;
        let mut state = trial.start.clone();
        let mut events = Vec::new();
        self.shift(&mut state[..robot.nq()], 1.0);
        if !robot.floating() {
            return state;
        }
        contacts(&self.system, &self.scene, &state, data, &mut events);
        let nearness = |(e, p): (&ContactEvent, &ContactPoint)| (e.distance - p.radius, e.normal);
        let Some((depth, normal)) =
            events.iter().zip(&robot.contact_points).map(nearness).min_by(|a, b| a.0.total_cmp(&b.0))
        else {
            return state;
        };
        let (q, qd) = state.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        if depth < 0.0 {
            (0..3).for_each(|k| q[k] -= depth * normal[k]);
        } else if depth > FREE_DISTANCE {
            (0..3).for_each(|k| qd[3 + k] += self.lag * self.system.frame_time * self.scene.gravity[k]);
        }
        to_world(robot, q, qd);
        state
    }

    /// Distance of every trial from its rollout.
    pub fn distances(&self, trials: &[Trial]) -> Result<Vec<Distance>, CalibrateError> {
        let motions = self.roll(trials)?;
        Ok(motions.iter().zip(trials).map(|(motion, trial)| distance(&self.system, motion, &trial.measured)).collect())
    }
}

/// Distance (m) from every surface beyond which a body is in free fall.
const FREE_DISTANCE: f64 = 0.002;

/// Distance between two motions, each given as the coordinates q of every frame.
pub fn distance(system: &System, a: &[Vec<f64>], b: &[Vec<f64>]) -> Distance {
    let floating = system.robot.floating();
    let first = system.robot.root_coords();
    let n = a.len().min(b.len()) as f64;
    let mut sum = Distance::default();
    for (a, b) in a.iter().zip(b) {
        if floating {
            sum.position += (vector(a) - vector(b)).norm() / n;
            sum.rotation += quaternion(&a[3..7]).angle_to(&quaternion(&b[3..7])) / n;
        }
        let joints = turned(&system.robot, a, b).iter().map(|d| d.abs()).sum::<f64>();
        sum.joints += joints / ((a.len() - first).max(1) as f64 * n);
    }
    if let (true, Some(a), Some(b)) = (floating, a.last(), b.last()) {
        sum.other_side = f64::from(up(a) != up(b));
    }
    sum
}

/// The root axis nearest to up, and its sign.
fn up(q: &[f64]) -> (usize, bool) {
    let up = quaternion(&q[3..7]).inverse() * nalgebra::Vector3::z();
    (up.iamax(), up[up.iamax()] > 0.0)
}

/// Means over trials.
pub fn mean(distances: &[Distance]) -> Distance {
    let n = distances.len().max(1) as f64;
    distances.iter().fold(Distance::default(), |a, b| Distance {
        position: a.position + b.position / n,
        rotation: a.rotation + b.rotation / n,
        joints: a.joints + b.joints / n,
        other_side: a.other_side + b.other_side / n,
    })
}
