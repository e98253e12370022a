//! Task-agnostic sampling of starts and scenes.

use rand::{Rng, RngExt};

pub use crate::random::{normal, stream};
use crate::scene::{PegSpec, peg, place};
pub use crate::system::Start;
use crate::system::start::{clear_start, draw, write_twist};
use crate::system::{RandomPegs, RandomPlane, RootStart};
use crate::{internal::*, random::direction};

/// Rounds of draws after which a start is accepted even where it is not clear of the scene. A specification changed
/// after its system was made may have no clear start.
const MAX_START_ROUNDS: usize = 100;

/// Draws a start `[q, qd]`. A floating root is drawn in body axes about its default pose. If the specification requires
/// clearance, draws are repeated until the robot is clear of the scene.
pub fn start(system: &System, which: Start, rng: &mut impl Rng) -> Vec<f64> {
    (0..MAX_START_ROUNDS).find_map(|_| clear_start(system, which, rng)).unwrap_or_else(|| draw(system, which, rng))
}

/// Ratio of the largest velocities of [`hurry`] to the largest velocities in the specification's `reset` ranges. For
/// the Ant this gives up to 6 m/s and 16 rad/s, near the speeds of its policies.
pub const FASTEST: f64 = 64.0;

/// Replaces the velocities of a start; the pose is kept. One share, drawn from U(0, 1), is common to all velocities.
/// Each velocity is uniform between plus and minus this share of its maximum. The maximum is [`FASTEST`] times the
/// largest velocity of the `reset` range, but at least the largest of the `sample` range.
pub fn hurry(system: &System, state: &mut [f64], rng: &mut impl Rng) {
    let robot = &system.robot;
    let spec = &system.spec;
    let nq = robot.nq();
    let rates = robot.nq() + robot.root_dofs();
    let largest = |range: &Range| range.low.abs().max(range.high.abs());
    let share: f64 = rng.random();
    let mut even =
        |reset: f64, sample: &Range| share * (FASTEST * reset).max(largest(sample)) * (2.0 * rng.random::<f64>() - 1.0);
    if let Some(root) = &spec.root {
        // A root without `reset` ranges starts from its `sample` ranges, which are already wide.
        let of = |ranges: fn(&RootStart) -> &[Range; 3], i: usize| {
            root.reset.as_ref().map_or(0.0, |r| largest(&ranges(r)[i]))
        };
        let mut vector = |ranges: fn(&RootStart) -> &[Range; 3]| {
            Vector3::from_fn(|i, _| even(of(ranges, i), &ranges(&root.sample)[i]))
        };
        let (ang_vel, velocity) = (vector(|r| &r.ang_vel), vector(|r| &r.velocity));
        let p = Vector3::from_column_slice(&state[..3]);
        let pose = quaternion(&state[3..7]);
        write_twist(&mut state[nq..rates], (&p, &pose), (&ang_vel, &velocity));
    }
    for (rate, joint) in state[rates..].iter_mut().zip(&spec.joints) {
        *rate = even(largest(&joint.reset.qd), &joint.sample.qd);
    }
}

/// The scene of a random trajectory that starts at `state`. It is the system's data scene, else a random plane if the
/// specification has one, else empty. Random pegs are added if the specification has them.
///
/// The normal n of a random plane is drawn uniformly in a cube, then normalised. The offset (m) is
/// `U(n . root - reach, min_i n . p_i - clearance)` over the contact points p_i of the start. The robot thus starts
/// clear of the plane. Pegs, too, are drawn clear of the robot.
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

/// Number of draws of a peg; if none is clear of the robot's start, the peg is left out.
const MAX_PEG_DRAWS: usize = 20;

fn random_pegs(system: &System, law: &RandomPegs, state: &[f64], rng: &mut impl Rng) -> Vec<Collider> {
    let mut data = Data::new(&system.robot);
    let mut events = Vec::new();
    let mut clear = |collider: &Collider| {
        let alone = Scene { name: String::new(), gravity: system.gravity(), colliders: vec![collider.clone()] };
        contacts(system, &alone, state, &mut data, &mut events);
        events.iter().zip(&system.robot.contact_points).all(|(event, point)| event.distance >= point.radius)
    };
    let mut one = || {
        let spec = PegSpec {
            radius: law.radius.draw(rng),
            height: law.height,
            position: law.position.map(|range| range.draw(rng)),
        };
        peg(&spec, &system.gravity(), system.spec.material)
    };
    (0..law.count).filter_map(|_| (0..MAX_PEG_DRAWS).map(|_| one()).find(&mut clear)).collect()
}

fn random_plane(system: &System, law: &RandomPlane, state: &[f64], rng: &mut impl Rng) -> Plane {
    let normal = direction(rng);
    let robot = &system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|c| normal.dot(&place(c, &data, &normal)));
    let tangent = heights.fold(f64::INFINITY, f64::min);
    // The reach is measured from the first moving link, where the arm is mounted.
    let pivot = point_position(&data, 0, &Vector3::zeros());
    let high = tangent - law.clearance;
    // If the start leaves no room within reach, the clearance has precedence.
    let low = (normal.dot(&pivot) - law.reach).min(high);
    Plane { normal, offset: Range { low, high }.draw(rng) }
}
