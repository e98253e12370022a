//! Task-agnostic sampling: starts and scenes. Each trajectory draws from a ChaCha8 stream of its
//! own, keyed by (seed, trajectory), so what it draws depends on neither threads nor neighbours.

use std::sync::Arc;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_core::state::{quaternion, wrap_state, write_quaternion};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::batch::contacts;
use crate::range::Range;
use crate::scene::{Collider, Plane, Scene};
use crate::spec::{PegSpec, RandomPegs, RandomPlane, RootSpec, RootStart};
use crate::system::System;
use crate::worlds::peg;

/// Which of a system's two boxes a start is drawn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Training data.
    Sample,
    /// Evaluation (and tasks).
    Reset,
}

impl Start {
    /// Its name in a specification.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Reset => "reset",
        }
    }
}

/// The random stream of a trajectory.
pub fn stream(seed: u64, trajectory: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(trajectory);
    rng
}

/// One N(0, 1) number (Box and Muller), from two draws.
pub fn normal(rng: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A start `[q, qd]`. A floating root's is drawn in body axes about its default pose, until it stands clear if it must.
pub fn start(system: &System, which: Start, rng: &mut impl Rng) -> Vec<f64> {
    loop {
        if let Some(state) = clear_start(system, which, rng, DRAWS) {
            return state;
        }
    }
}

/// Draws after which a specification is said to ask for too much.
pub(crate) const DRAWS: usize = 10_000;

/// The first of so many starts that stands as clear of the data's scene as the specification asks; of a robot on a fixed base, that is not
/// inside of it.
pub(crate) fn clear_start(system: &System, which: Start, rng: &mut impl Rng, draws: usize) -> Option<Vec<f64>> {
    let Some(least) = least_clearance(system, which) else { return Some(draw(system, which, rng)) };
    let scene = system.scene(system.spec.data_scene.as_ref()?).ok()?;
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    (0..draws).map(|_| draw(system, which, rng)).find(|state| {
        contacts(system, &scene, state, &mut data, &mut events);
        events.iter().all(|e| e.distance >= least)
    })
}

/// How far (m) from the data's scene a start stands at least, where that is asked for.
pub(crate) fn least_clearance(system: &System, which: Start) -> Option<f64> {
    let outside = || system.robot.contact_points.iter().map(|p| p.radius).fold(0.0, f64::max);
    match &system.spec.root {
        Some(root) => of(root, which).clearance,
        None => system.spec.data_scene.as_ref().filter(|_| !system.robot.floating()).map(|_| outside()),
    }
}

fn of(root: &RootSpec, which: Start) -> &RootStart {
    match which {
        Start::Reset => root.reset.as_ref().unwrap_or(&root.sample),
        Start::Sample => &root.sample,
    }
}

fn draw(system: &System, which: Start, rng: &mut impl Rng) -> Vec<f64> {
    let robot = &system.robot;
    let mut state = robot.zero_state();
    let (coords, nq, rates) = (robot.root_coords(), robot.nq(), robot.nq() + robot.root_dofs());
    if let Some(root) = &system.spec.root {
        let laws = of(root, which);
        let mut vector = |laws: &[Range; 3]| Vector3::from(laws.each_ref().map(|l| l.draw(rng)));
        let (p, w, v) = (vector(&laws.position), vector(&laws.angular), vector(&laws.linear));
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_unchecked(direction(rng)), laws.tilt.draw(rng));
        let pose = quaternion(&root.quaternion) * turn;
        state[..3].copy_from_slice(p.as_slice());
        write_quaternion(&mut state[3..7], &pose);
        write_twist(&mut state[nq..rates], (&p, &pose), (&w, &v));
    }
    let specs = &system.spec.joints;
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

/// A root's twist about the world's origin, of its place and its velocities (angular, linear) in body axes.
fn write_twist(out: &mut [f64], (p, pose): (&Vector3<f64>, &UnitQuaternion<f64>), (w, v): (&Vector3<f64>, &Vector3<f64>)) {
    let w = pose * w;
    out[..3].copy_from_slice(w.as_slice());
    out[3..].copy_from_slice((pose * v + p.cross(&w)).as_slice());
}

/// How far the velocities of [`hurry`] reach beyond the largest that resets draw: for the Ant to 6 m/s and 16 rad/s, near what
/// its policies run and spin with.
pub const FASTEST: f64 = 64.0;

/// Gives a start other velocities, each even within a share, itself from U(0, 1), of the most that is looked for:
/// [`FASTEST`] times the largest of the reset law or, where that is less, the largest of the data's. Where it stands is left.
pub fn hurry(system: &System, state: &mut [f64], rng: &mut impl Rng) {
    let (robot, spec) = (&system.robot, &system.spec);
    let (nq, rates) = (robot.nq(), robot.nq() + robot.root_dofs());
    let largest = |range: &Range| range.low.abs().max(range.high.abs());
    let share: f64 = rng.random();
    let mut even = |reset: f64, sample: &Range| share * (FASTEST * reset).max(largest(sample)) * (2.0 * rng.random::<f64>() - 1.0);
    if let Some(root) = &spec.root {
        // A root without a reset law of its own starts as the data does, which is wide already.
        let of = |ranges: fn(&RootStart) -> &[Range; 3], i: usize| root.reset.as_ref().map_or(0.0, |r| largest(&ranges(r)[i]));
        let mut vector = |ranges: fn(&RootStart) -> &[Range; 3]| Vector3::from_fn(|i, _| even(of(ranges, i), &ranges(&root.sample)[i]));
        let (angular, linear) = (vector(|r| &r.angular), vector(|r| &r.linear));
        let (p, pose) = (Vector3::from_column_slice(&state[..3]), quaternion(&state[3..7]));
        write_twist(&mut state[nq..rates], (&p, &pose), (&angular, &linear));
    }
    for (rate, joint) in state[rates..].iter_mut().zip(&spec.joints) {
        *rate = even(largest(&joint.reset.qd), &joint.sample.qd);
    }
}

/// A cube-uniform direction.
fn direction(rng: &mut impl Rng) -> Vector3<f64> {
    let mut side = || 2.0 * rng.random::<f64>() - 1.0;
    loop {
        let n = Vector3::new(side(), side(), side());
        if n.norm() > 1e-6 {
            return n.normalize();
        }
    }
}

/// The scene of a random trajectory from `state`: the system's own, a random plane where it asks for one, else empty; with random pegs in
/// it where it asks for those.
///
/// Range: normal n a cube-uniform direction; offset `U(n . root - reach, min_i n . p_i - clearance)` over the contact
/// points p_i of the start, so the robot starts clear of it. It starts clear of pegs, too.
pub fn scene(system: &System, state: &[f64], rng: &mut impl Rng) -> Arc<Scene> {
    let own = system.spec.data_scene.as_ref().and_then(|name| system.scene(name).ok());
    if let (Some(scene), None) = (&own, &system.spec.random_pegs) {
        return scene.clone();
    }
    let mut scene = own.map_or_else(|| Scene::free(system.gravity()), |scene| (*scene).clone());
    if let Some(law) = system.spec.random_plane.as_ref().filter(|_| system.spec.data_scene.is_none()) {
        scene.name = "random".into();
        scene.colliders.push(Collider::plane(random_plane(system, law, state, rng), system.spec.material));
    }
    if let Some(law) = &system.spec.random_pegs {
        scene.name = "random".into();
        scene.colliders.extend(random_pegs(system, law, state, rng));
    }
    Arc::new(scene)
}

/// Draws after which a peg is left out.
const PLACES: usize = 20;

fn random_pegs(system: &System, law: &RandomPegs, state: &[f64], rng: &mut impl Rng) -> Vec<Collider> {
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    let mut clear = |collider: &Collider| {
        let alone = Scene { name: String::new(), gravity: system.gravity(), colliders: vec![collider.clone()] };
        contacts(system, &alone, state, &mut data, &mut events);
        events.iter().zip(&system.robot.contact_points).all(|(event, point)| event.distance >= point.radius)
    };
    let mut one = || {
        let spec = PegSpec { radius: law.radius.draw(rng), height: law.height, at: law.at.map(|range| range.draw(rng)) };
        peg(&spec, &system.gravity(), system.spec.material)
    };
    (0..law.count).filter_map(|_| (0..PLACES).map(|_| one()).find(&mut clear)).collect()
}

fn random_plane(system: &System, law: &RandomPlane, state: &[f64], rng: &mut impl Rng) -> Plane {
    let normal = direction(rng);
    let robot = &system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|c| normal.dot(&point_position(&data, c.link, &c.local)));
    let tangent = heights.fold(f64::INFINITY, f64::min);
    // The plane's reach is measured from the first joint, where the arm hangs.
    let pivot = point_position(&data, 0, &Vector3::zeros());
    let high = tangent - law.clearance;
    // Where the start leaves no room within reach, the clearance is kept.
    let low = (normal.dot(&pivot) - law.reach).min(high);
    Plane { normal, offset: Range { low, high }.draw(rng) }
}
