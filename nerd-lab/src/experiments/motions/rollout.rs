//! Rolls solvers out along recorded motions and compares contact points with the recorded ones.

use nerd_train::cost::each;

use crate::prelude::*;

/// A motion is lost if a frame's mean distance exceeds this factor times the largest recorded distance from the origin.
const FAR: f64 = 10.0;

/// Contact points (m, world): `[frame][motion][point]`.
pub type Points = Vec<Vec<Vec<Vector3<f64>>>>;

/// Motions that were recorded with the reference solver.
pub struct Recorded {
    /// Batch with one environment for each motion, at the motion's start and in its scene.
    pub start: Batch,
    /// Torques `[motion][frame][joint]` (N m or N).
    pub torques: Vec<f64>,
    pub points: Points,
    pub frames: usize,
}

pub struct Rollout {
    pub points: Points,
    /// Wall time of a frame of one environment (us).
    pub microseconds: f64,
    /// Whether the solver gave up, by motion.
    pub failed: Vec<bool>,
}

impl Recorded {
    pub fn roll_out(&self, mut solver: Box<dyn Solver>) -> Result<Rollout> {
        let mut batch = self.start.clone();
        let robot = &self.start.system.robot;
        let n = self.start.len();
        // Steps once untimed, so that memory is allocated before timing.
        if let Err(error) = solver.step(&mut batch.clone(), &self.torques_of(0)) {
            error.faults()?;
        }
        (0..n).for_each(|env| solver.reset(env));
        let mut failed = vec![false; n];
        let mut points = Vec::with_capacity(self.frames);
        let mut spent = Duration::ZERO;
        let mut data = Data::new(robot);
        for frame in 0..self.frames {
            let torques = self.torques_of(frame);
            let began = Instant::now();
            let stepped = solver.step(&mut batch, &torques);
            spent += began.elapsed();
            if let Err(error) = stepped {
                for fault in error.faults()? {
                    failed[fault.env] = true;
                    // Resets the failed motion, so that frames cost as much as before; its errors no longer count.
                    batch.reset(fault.env, self.start.state(fault.env));
                    solver.reset(fault.env);
                }
            }
            points.push((0..n).map(|env| contact_points(robot, batch.state(env), &mut data)).collect());
        }
        Ok(Rollout { points, microseconds: each(spent, n * self.frames), failed })
    }

    /// Torques of all motions in a frame, `[motion][joint]`.
    fn torques_of(&self, frame: usize) -> Vec<f64> {
        let joints = self.start.system.robot.joint_count();
        (0..self.start.len())
            .flat_map(|env| &self.torques[(env * self.frames + frame) * joints..][..joints])
            .copied()
            .collect()
    }
}

pub fn contact_points(robot: &Robot, state: &[f64], data: &mut Data) -> Vec<Vector3<f64>> {
    kinematics(robot, state, data);
    robot.contact_points.iter().map(|p| point_position(data, p.link, &p.local)).collect()
}

/// Mean distance (m) of `points` from `recorded`, by frame and by motion, over motions that are not lost. A motion is
/// lost if the solver failed, or with `solves` if the distance exceeded the bound of `FAR`. For predictors without
/// dynamics, which may go anywhere, `solves` is false.
pub fn distances(points: &Points, recorded: &Points, failed: &[bool], solves: bool) -> (Vec<f64>, Vec<f64>) {
    let distance = |frame: usize, env: usize| {
        let pairs = points[frame][env].iter().zip(&recorded[frame][env]);
        mean(&pairs.map(|(a, b)| (a - b).norm()).collect_vec())
    };
    let frames = points.len();
    let size = recorded.iter().flatten().flatten().map(|p| p.norm()).fold(0.0, f64::max);
    let left = |env: usize| solves && (0..frames).any(|frame| distance(frame, env) > FAR * size);
    let kept = (0..failed.len()).filter(|env| !failed[*env] && !left(*env)).collect_vec();
    let over = |all: &mut dyn Iterator<Item = f64>| mean(&all.collect_vec());
    let curve = |frame: usize| over(&mut kept.iter().map(|env| distance(frame, *env)));
    let curve = (0..frames).filter(|_| !kept.is_empty()).map(curve).collect();
    (curve, kept.iter().map(|env| over(&mut (0..frames).map(|frame| distance(frame, *env)))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three motions of one point over two frames: the solver fails on one, another goes too far in one frame.
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
