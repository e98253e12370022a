//! Task-agnostic sampling: starts, random planes, random torques. Each trajectory draws from a ChaCha8 stream of its
//! own, keyed by (seed, trajectory), so what it draws depends on neither threads nor neighbours.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_core::state::wrap_state;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::law::Law;
use crate::scene::{Collider, Plane, Scene};
use crate::spec::RandomPlane;
use crate::system::System;

/// Which of a system's two boxes a start is drawn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Training data.
    Sample,
    /// Evaluation (and tasks).
    Reset,
}

/// The random stream of a trajectory.
pub fn stream(seed: u64, trajectory: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(trajectory);
    rng
}

/// A start `[q, qd]` of a fixed-base system; a floating root starts at rest at the world's origin.
pub fn start(system: &System, which: Start, rng: &mut impl Rng) -> Vec<f64> {
    let robot = &system.robot;
    let mut state = vec![0.0; robot.state_dim()];
    let (coords, rates) = (robot.root_coords(), robot.nq() + robot.root_dofs());
    if robot.floating() {
        state[6] = 1.0;
    }
    let specs: Vec<_> = system.joint_specs().collect();
    let laws = |i: usize| if which == Start::Sample { &specs[i].sample } else { &specs[i].reset };
    for i in 0..specs.len() {
        state[coords + i] = laws(i).q.draw(rng);
        if let Some(other) = laws(i).minus.as_ref().and_then(|name| specs[..i].iter().position(|s| &s.name == name)) {
            state[coords + i] -= state[coords + other];
        }
    }
    for i in 0..specs.len() {
        state[rates + i] = laws(i).qd.draw(rng);
    }
    wrap_state(robot, &mut state);
    state
}

/// The scene of a random trajectory from `state`: a random plane where the system asks for one, else empty.
///
/// Law: normal n a cube-uniform direction; offset `U(n . root - reach, min_i n . p_i - clearance)` over the contact
/// points p_i of the start, so the robot starts clear of it.
pub fn scene(system: &System, state: &[f64], rng: &mut impl Rng) -> Arc<Scene> {
    let mut scene = Scene::free(system.gravity());
    if let Some(law) = &system.spec.random_plane {
        scene.name = "random".into();
        scene.colliders.push(Collider::plane(random_plane(system, law, state, rng), system.spec.material));
    }
    Arc::new(scene)
}

fn random_plane(system: &System, law: &RandomPlane, state: &[f64], rng: &mut impl Rng) -> Plane {
    let mut side = || 2.0 * rng.random::<f64>() - 1.0;
    let normal = loop {
        let n = Vector3::new(side(), side(), side());
        if n.norm() > 1e-6 {
            break n.normalize();
        }
    };
    let robot = &system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|c| normal.dot(&point_position(robot, state, &data, c.link, &c.local)));
    let tangent = heights.fold(f64::INFINITY, f64::min);
    // The plane's reach is measured from the first joint, where the arm hangs.
    let pivot = point_position(robot, state, &data, 0, &Vector3::zeros());
    let (low, high) = (normal.dot(&pivot) - law.reach, tangent - law.clearance);
    Plane { normal, offset: Law { low, high }.draw(rng) }
}

/// Fresh torques of one frame, each `U(-a, a)` times `scale`.
pub fn torques(amplitudes: &[f64], scale: f64, rng: &mut impl Rng, out: &mut [f64]) {
    for (tau, a) in out.iter_mut().zip(amplitudes) {
        *tau = if *a == 0.0 { 0.0 } else { scale * a * (2.0 * rng.random::<f64>() - 1.0) };
    }
}
