//! Rolls solvers out along recorded motions and compares contact points with the recorded ones.

use nerd_sim::instruments::Timed;
use nerd_sim::trajectories::Trajectories;
use nerd_train::cost::each;

use crate::prelude::*;

/// A motion is lost if a frame's mean distance exceeds this factor times the largest recorded distance from the origin.
const FAR: f64 = 10.0;

/// Contact points (m, world): `[frame][motion][point]`.
pub type Points = Vec<Vec<Vec<Vector3<f64>>>>;

pub struct Rollout {
    pub points: Points,
    /// Wall time of a frame of one environment (us).
    pub microseconds: f64,
    /// Whether the solver gave up, by motion.
    pub failed: Vec<bool>,
}

/// Rolls a solver out along recorded motions.
pub fn along(recorded: &Trajectories, system: &Arc<System>, mut solver: Box<dyn Solver>) -> Result<Rollout> {
    let mut batch = recorded.begun(system);
    let n = batch.len();
    // Steps once untimed, so that memory is allocated before timing.
    if let Err(error) = solver.step(&mut batch.clone(), &recorded.torques_at(0)) {
        error.faults()?;
    }
    (0..n).for_each(|env| solver.reset(env));
    let mut solver = Timed::new(solver);
    let mut failed = vec![false; n];
    let mut all = Vec::with_capacity(recorded.frames);
    for frame in 0..recorded.frames {
        if let Err(error) = solver.step(&mut batch, &recorded.torques_at(frame)) {
            for fault in error.faults()? {
                failed[fault.env] = true;
                // Resets the failed motion, so that frames cost as much as before; its errors no longer count.
                batch.reset(fault.env, recorded.state(fault.env, 0));
                solver.reset(fault.env);
            }
        }
        all.push(points(system, &batch.states));
    }
    Ok(Rollout { points: all, microseconds: each(solver.spent, n * recorded.frames), failed })
}

/// Contact points in each of several states.
pub fn points(system: &System, states: &[f64]) -> Vec<Vec<Vector3<f64>>> {
    let (robot, mut data) = (&system.robot, Data::new(&system.robot));
    let places = |state: &[f64]| {
        kinematics(robot, state, &mut data);
        robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local)).collect()
    };
    states.chunks_exact(robot.state_dim()).map(places).collect()
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
