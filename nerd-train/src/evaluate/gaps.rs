//! Distances between states, and speeds of a state.

use nerd_core::dynamics::to_local;

use crate::prelude::*;
use crate::stats::mean;

/// Names of the compared quantities: position (m, Euclidean) and orientation (rad, angle) of a floating root, then the
/// joints.
pub fn quantities(system: &System) -> Vec<String> {
    root(system, ["position", "orientation"]).chain(system.robot.joints().map(|j| j.name.clone())).collect()
}

fn root(system: &System, names: [&str; 2]) -> impl Iterator<Item = String> {
    let known = system.robot.floating();
    names.map(String::from).into_iter().filter(move |_| known)
}

/// Shortens figures in the order of [`quantities`] for a table. With more than two joints, one mean replaces the
/// joints' figures.
pub fn summary(system: &System, figures: &[f64]) -> Vec<f64> {
    let joints = system.robot.joint_count();
    if joints <= 2 {
        return figures.to_vec();
    }
    let (root, angles) = figures.split_at(figures.len() - joints);
    [root, &[mean(angles)]].concat()
}

/// Names of the entries of [`summary`], with units.
pub fn summary_names(system: &System) -> Vec<String> {
    let root = root(system, ["position (m)", "orientation (rad)"]);
    let unit = |j: &Joint| if j.kind == JointKind::Prismatic { "m" } else { "rad" };
    let joints = system.robot.joints().map(|j| format!("{} ({})", j.name, unit(j))).collect_vec();
    if joints.len() <= 2 { root.chain(joints).collect() } else { root.chain(["joints, mean (rad)".into()]).collect() }
}

/// Distances between two states, by quantity.
pub struct Gaps {
    system: Arc<System>,
    wraps: Vec<bool>,
}

impl Gaps {
    /// Prepares distances between states of `system`.
    pub fn new(system: &Arc<System>) -> Self {
        Self { system: system.clone(), wraps: system.robot.joints().map(|j| j.wraps()).collect() }
    }

    /// Absolute differences (m, rad) of two states, in the order of [`quantities`].
    ///
    /// # Panics
    /// If `out` has fewer entries than there are quantities.
    pub fn between(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        let coords = self.system.robot.root_coords();
        let mut at = 0;
        if self.system.robot.floating() {
            out[0] = (vector(a) - vector(b)).norm();
            out[1] = angle(&quaternion(&a[3..7]), &quaternion(&b[3..7]));
            at = 2;
        }
        for (k, wraps) in self.wraps.iter().enumerate() {
            let gap = a[coords + k] - b[coords + k];
            out[at + k] = if *wraps { wrap(gap) } else { gap }.abs();
        }
    }

    /// Largest joint speed (rad/s or m/s), then the root's angular (rad/s) and linear (m/s) speed, 0 for a fixed root.
    pub(super) fn speeds(&self, state: &[f64]) -> [f64; 3] {
        let robot = &self.system.robot;
        let mut state = state.to_vec();
        let (q, qd) = state.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        let joints = qd[robot.root_dofs()..].iter().fold(0.0f64, |a, v| a.max(v.abs()));
        if robot.floating() { [joints, vector(qd).norm(), vector(&qd[3..6]).norm()] } else { [joints, 0.0, 0.0] }
    }
}

/// Angle (rad) between two orientations, from the distance between their quaternions. It is exactly 0 for equal
/// orientations.
fn angle(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    let (near, far) = ((a.coords - b.coords).norm(), (a.coords + b.coords).norm());
    4.0 * near.min(far).atan2(near.max(far))
}
