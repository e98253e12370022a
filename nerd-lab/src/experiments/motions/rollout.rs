//! Rolls solvers out along recorded motions, and compares their contact points with the recorded ones.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_core::robot::Robot;
use nerd_sim::prelude::*;
use nerd_train::stats::mean;

use nerd_train::cost::each;

/// A motion is lost if its points are this many times as far from the recorded ones as those ever are from the origin.
const FAR: f64 = 10.0;

/// Contact points (m, world): `[compared frame][motion][point]`.
pub type Points = Vec<Vec<Vec<Vector3<f64>>>>;

/// Motions of the reference, and how solvers follow them.
pub struct Recorded {
    /// An environment for each motion, at its start and in its scene.
    pub start: Batch,
    /// `[motion][frame][joint]`.
    pub torques: Vec<f64>,
    pub points: Points,
    pub frames: usize,
    /// Frames from one comparison to the next.
    pub stride: usize,
    /// Environments that move together. Environment i has motion i modulo their number; the first of each motion is compared.
    pub environments: usize,
}

/// What a solver made of the motions.
pub struct Rollout {
    pub points: Points,
    /// A frame of one environment.
    pub microseconds: f64,
    /// By motion, whether the solver could not continue it.
    pub failed: Vec<bool>,
}

impl Recorded {
    /// Rolls `solver` out by `roll(solver, batch, torques, frames)`, with torques `[frame][env][joint]`.
    pub fn roll_out<S: Solver + ?Sized>(
        &self,
        solver: &mut S,
        roll: impl Fn(&mut S, &mut Batch, &[f64], usize) -> Result<(), StepError>,
    ) -> Result<Rollout> {
        let (mut batch, robot) = (self.batch(), &self.start.system.robot);
        let (motions, n, compared) = (self.start.len(), batch.len(), self.frames / self.stride);
        // The first frames allocate what all others need, so they are rolled once untimed.
        if let Err(error) = roll(solver, &mut batch.clone(), &self.torques_of(0, n), self.stride) {
            error.faults()?;
        }
        (0..n).for_each(|env| solver.reset(env));
        let (mut failed, mut points, mut spent) = (vec![false; motions], Vec::with_capacity(compared), Duration::ZERO);
        let mut data = Data::new(robot);
        for k in 0..compared {
            let torques = self.torques_of(k, n);
            let began = Instant::now();
            let rolled = roll(solver, &mut batch, &torques, self.stride);
            spent += began.elapsed();
            if let Err(error) = rolled {
                for fault in error.faults()? {
                    failed[fault.env % motions] = true;
                    // It starts again, so that a frame costs as much as before, and does not count.
                    batch.reset(fault.env, self.start.state(fault.env % motions));
                    solver.reset(fault.env);
                }
            }
            points.push((0..motions).map(|env| contact_points(robot, batch.state(env), &mut data)).collect());
        }
        Ok(Rollout { points, microseconds: each(spent, n * compared * self.stride), failed })
    }

    /// The same, one [`Solver::step`] a frame.
    pub fn roll_out_by_steps(&self, mut solver: Box<dyn Solver>) -> Result<Rollout> {
        self.roll_out(&mut *solver, |solver, batch, torques, frames| {
            let width = torques.len() / frames;
            (0..frames).try_for_each(|frame| solver.step(batch, &torques[frame * width..][..width]))
        })
    }

    fn batch(&self) -> Batch {
        let (start, motions) = (&self.start, self.start.len());
        let mut batch = Batch::new(&start.system, &start.scenes[0], self.environments);
        for env in 0..self.environments {
            batch.reset(env, start.state(env % motions));
            batch.scenes[env] = Arc::clone(&start.scenes[env % motions]);
        }
        batch
    }

    /// Torques of `n` environments in the frames before comparison `k`.
    fn torques_of(&self, k: usize, n: usize) -> Vec<f64> {
        let (motions, joints) = (self.start.len(), self.start.system.robot.joint_count());
        let of = |frame: usize, env: usize| &self.torques[(env % motions * self.frames + frame) * joints..][..joints];
        (k * self.stride..(k + 1) * self.stride).flat_map(|frame| (0..n).flat_map(move |env| of(frame, env).iter().copied())).collect()
    }
}

pub fn contact_points(robot: &Robot, state: &[f64], data: &mut Data) -> Vec<Vector3<f64>> {
    kinematics(robot, state, data);
    robot.contact_points.iter().map(|p| point_position(data, p.link, &p.local)).collect()
}

/// Mean distance (m) by compared frame, and by motion, of all that are not lost. A motion is lost if the solver failed in it or, where
/// `solves`, if it went too far: a predictor that knows no dynamics may go anywhere.
pub fn distances(points: &Points, recorded: &Points, failed: &[bool], solves: bool) -> (Vec<f64>, Vec<f64>) {
    let distance = |frame: usize, env: usize| {
        let pairs = points[frame][env].iter().zip(&recorded[frame][env]);
        mean(&pairs.map(|(a, b)| (a - b).norm()).collect::<Vec<_>>())
    };
    let (frames, size) = (points.len(), recorded.iter().flatten().flatten().map(|p| p.norm()).fold(0.0, f64::max));
    let left = |env: usize| solves && (0..frames).any(|frame| distance(frame, env) > FAR * size);
    let kept: Vec<usize> = (0..failed.len()).filter(|env| !failed[*env] && !left(*env)).collect();
    let over = |all: &mut dyn Iterator<Item = f64>| mean(&all.collect::<Vec<_>>());
    let curve = |frame: usize| over(&mut kept.iter().map(|env| distance(frame, *env)));
    let curve = (0..frames).filter(|_| !kept.is_empty()).map(curve).collect();
    (curve, kept.iter().map(|env| over(&mut (0..frames).map(|frame| distance(frame, *env)))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three motions of one point over two frames, of which the solver loses one, and one leaves for a moment.
    #[test]
    fn what_is_lost_is_in_no_mean() {
        let at = |x: f64| vec![Vector3::new(x, 0.0, 0.0)];
        let truth = vec![vec![at(1.0), at(1.0), at(1.0)], vec![at(1.0), at(1.0), at(1.0)]];
        let places = vec![vec![at(1.1), at(1.0), at(1.3)], vec![at(1.2), at(5.0), at(50.0)]];
        let (curve, motions) = distances(&places, &truth, &[false, true, false], true);
        assert!(curve.len() == 2 && (curve[0] - 0.1).abs() < 1e-12 && (curve[1] - 0.2).abs() < 1e-12, "{curve:?}");
        assert!(motions.len() == 1 && (motions[0] - 0.15).abs() < 1e-12, "{motions:?}");
        assert_eq!(distances(&places, &truth, &[false; 3], false).1.len(), 3, "what knows no dynamics may go anywhere");
        assert_eq!(distances(&places, &truth, &[true; 3], true), (Vec::new(), Vec::new()));
    }
}
