//! Every collider that a point touches acts on it, buried surfaces do not, and cylinders have flat ends and round
//! sides.

use std::f64::consts::FRAC_PI_2;

use nerd_sim::scene::Surfaces;
use nerd_suite::bodies::{Body, UPRIGHT};
use parry3d_f64::shape::SharedShape;

use super::common::*;

/// The same as the material of [`Body`].
const MATERIAL: Material = Material {
    stiffness: 1e4,
    damping: 100.0,
    friction_damping: 1e3,
    friction: 0.5,
    torsion: 0.0,
    rolling: 0.0,
    margin: 0.0,
    release: 0.0,
};

fn body(shape: &str) -> Arc<System> {
    Body { shape: shape.into(), inertia: [0.01; 3], ..Default::default() }.system().expect("a body")
}

fn ball() -> Arc<System> {
    body(r#"<sphere radius="0.05"/>"#)
}

fn floor() -> Collider {
    Collider::plane(Plane { normal: Vector3::z(), offset: 0.0 }, MATERIAL)
}

fn block(low: [f64; 3], high: [f64; 3]) -> Collider {
    let (low, high) = (Vector3::from(low), Vector3::from(high));
    let (half, centre) = ((high - low) * 0.5, (high + low) * 0.5);
    Collider::new(
        SharedShape::cuboid(half.x, half.y, half.z),
        Isometry3::translation(centre.x, centre.y, centre.z),
        MATERIAL,
    )
}

fn scene(gravity: [f64; 3], colliders: Vec<Collider>) -> Arc<Scene> {
    Arc::new(Scene { name: "test".into(), gravity: Vector3::from(gravity), colliders })
}

const DOWN: [f64; 3] = [0.0, 0.0, -9.81];
const WEIGHTLESS: [f64; 3] = [0.0; 3];

fn solvers(system: &System) -> [(&'static str, Articulated); 3] {
    let law = Friction::Coulomb;
    [
        ("paper", ArticulatedConfig::paper(system, law)),
        ("explicit", ArticulatedConfig::explicit(64, law)),
        ("implicit", ArticulatedConfig::implicit(8, law)),
    ]
    .map(|(name, config)| (name, Articulated::new(config)))
}

/// The solvers of `solvers`, and rapier where it is compiled in.
fn all_solvers(system: &System) -> Vec<(&'static str, Box<dyn Solver>)> {
    let mut all: Vec<(_, Box<dyn Solver>)> = Vec::new();
    all.extend(solvers(system).map(|(name, solver)| (name, Box::new(solver) as Box<dyn Solver>)));
    #[cfg(feature = "rapier")]
    all.push(("rapier", Box::new(Rapier::new(RapierConfig::default()))));
    all
}

/// A body at rest at a pose.
fn resting(system: &Arc<System>, scene: &Arc<Scene>, place: [f64; 3], turn: UnitQuaternion<f64>) -> Batch {
    within(system, scene, &Body::state(place, turn.coords.into(), [0.0; 3], [0.0; 3]))
}

/// A ball in a corner, deeper in the riser than in the floor, is pushed out of both. Each push equals the push of that
/// collider alone.
#[test]
fn a_ball_in_a_corner_feels_floor_and_riser() {
    // Without friction neither contact affects the push of the other.
    let mut system = (*ball()).clone();
    system.spec.material.friction = 0.0;
    let system = Arc::new(system);
    let smooth = |c: Collider| Collider { material: Material { friction: 0.0, ..MATERIAL }, ..c };
    for riser in [block([0.0, -1.0, 0.0], [1.0, 1.0, 0.3]), block([0.0, -1.0, -0.5], [1.0, 1.0, 0.3])] {
        for (name, mut solver) in solvers(&system) {
            let place = [-0.04, 0.0, 0.045];
            let mut way = |colliders: Vec<Collider>| {
                let room = scene(WEIGHTLESS, colliders.into_iter().map(smooth).collect());
                vector(&end(&mut solver, resting(&system, &room, place, UnitQuaternion::identity()), 0.0, 1))
                    - Vector3::from(place)
            };
            let [both, one, two] = [vec![floor(), riser.clone()], vec![riser.clone()], vec![floor()]].map(&mut way);
            let apart = (both.x / one.x - 1.0).abs().max((both.z / two.z - 1.0).abs());
            assert!(one.x < -1e-4 && two.z > 1e-4, "{name}: neither pushes: {one:?}, {two:?}");
            assert!(apart < 1e-6, "{name}: {both:?}, alone {one:?} and {two:?}");
        }
    }
}

/// A box in the corner of floor and wall: gravity presses it against both. Some contact points lie inside both solids.
#[test]
fn a_box_leans_on_floor_and_wall() {
    let system = body(r#"<box size="0.2 0.2 0.2"/>"#);
    let room = scene([5.0, 0.0, -9.81], vec![floor(), block([0.1, -1.0, -0.5], [1.0, 1.0, 1.0])]);
    for (name, mut solver) in solvers(&system) {
        let p = vector(&end(&mut solver, within(&system, &room, &Body::at([0.0, 0.0, 0.1])), 0.0, 120));
        assert!(p.x.abs() < 2e-3 && (p.z - 0.1).abs() < 2e-3, "{name}: {p:?}, it leans at x 0, z 0.1");
    }
}

/// Tiles side by side are one floor: a ball rolls over their seam as over a plane.
#[test]
fn a_seam_between_tiles_is_no_bump() {
    let system = ball();
    let tiles = vec![block([-1.0, -1.0, -0.1], [0.0, 1.0, 0.0]), block([0.0, -1.0, -0.1], [1.0, 1.0, 0.0])];
    let rolling = Body::state([-0.25, 0.0, 0.0499], UPRIGHT, [0.0, 10.0, 0.0], [0.5, 0.0, 0.0]);
    for (name, mut solver) in solvers(&system) {
        let mut path = |colliders| motion(&mut solver, within(&system, &scene(DOWN, colliders), &rolling), 0.0, 60);
        let (seam, plane) = (path(tiles.clone()), path(vec![floor()]));
        let gap = seam.iter().zip(&plane).map(|(a, b)| (vector(a) - vector(b)).norm()).fold(0.0, f64::max);
        assert!(
            plane[59][0] > 0.2 && gap < 1e-6,
            "{name}: {gap:.1e} m apart from rolling on a plane, which ends at {} m",
            plane[59][0]
        );
    }
}

/// Appends the contact events of a point at `place` (m, world) with all colliders nearer than `reach` (m).
fn contacts_at(scene: &Scene, place: &Vector3<f64>, reach: f64, events: &mut Vec<ContactEvent>) {
    let system = ball();
    let mut data = system.data();
    kinematics(&system.robot, &system.robot.zero_state(), &mut data);
    scene.meetings(&ContactPoint::new(0, *place, 0.0), &data, reach, &Surfaces::default(), events);
}

/// A face buried under the floor does not push bodies below the floor further down.
#[test]
fn a_buried_face_does_not_act() {
    let mut events = Vec::new();
    let room = scene(WEIGHTLESS, vec![floor(), block([-1.0, -1.0, 0.0], [1.0, 1.0, 0.2])]);
    contacts_at(&room, &Vector3::new(0.1, 0.0, -0.01), f64::INFINITY, &mut events);
    let found: Vec<_> = events.iter().map(|e| (e.collider, e.distance)).collect();
    assert_eq!(found, [(0, -0.01)], "the block's underside at z 0 is no surface");
    events.clear();
    // In the inner corner of two steps both risers and treads are surfaces.
    let steps = scene(WEIGHTLESS, vec![floor(), block([0.0, -1.0, 0.0], [1.0, 1.0, 0.1])]);
    contacts_at(&steps, &Vector3::new(-0.02, 0.0, 0.03), 0.1, &mut events);
    assert_eq!(events.len(), 2, "{events:?}");
}

fn side() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
}

/// An upright cylinder rests at its half length, a lying one at its radius. Our solvers rest lower by `m g / k`; rapier
/// agrees.
#[test]
fn a_cylinder_rests_on_its_end_and_on_its_side() {
    for (name, radius, half) in [("rod", 0.05, 0.2), ("wheel", 0.1, 0.02), ("short rod", 0.1, 0.11)] {
        let system = body(&format!(r#"<cylinder radius="{radius}" length="{}"/>"#, 2.0 * half));
        let room = scene(DOWN, vec![floor()]);
        for (turn, height) in [(UnitQuaternion::identity(), half), (side(), radius)] {
            for (solver, mut one) in all_solvers(&system) {
                let state = end(&mut one, resting(&system, &room, [0.0, 0.0, height + 0.002], turn), 0.0, 180);
                let upright = (quaternion(&state[3..7]) * Vector3::z()).dot(&(turn * Vector3::z()));
                assert!(
                    (-1e-3..1e-3).contains(&(state[2] - height)),
                    "{name}, {solver}: rests at {} m, not {height}",
                    state[2]
                );
                assert!(upright > 0.999, "{name}, {solver}: its axis fell to {upright} of where it was");
            }
        }
    }
}

/// Values that are not finite or out of range are refused by name before a step.
#[test]
fn a_scene_that_is_no_scene_is_refused() {
    let system = ball();
    let plane = Plane { normal: Vector3::z(), offset: 0.0 };
    let bent = Isometry3::translation(f64::NAN, 0.0, 0.0);
    let cases = [
        (Collider::plane(Plane { offset: f64::NAN, ..plane }, MATERIAL), "plane"),
        (Collider::plane(Plane { normal: Vector3::new(f64::NAN, 0.0, 1.0), ..plane }, MATERIAL), "normal"),
        (Collider::plane(Plane { normal: Vector3::zeros(), ..plane }, MATERIAL), "unit vector"),
        (Collider::plane(plane, Material { friction: -0.5, ..MATERIAL }), "`friction` is -0.5"),
        (Collider::plane(plane, Material { damping: -1.0, ..MATERIAL }), "`damping` is -1 N s/m"),
        (Collider::plane(plane, Material { stiffness: f64::NAN, ..MATERIAL }), "`stiffness` is NaN N/m"),
        (Collider::plane(plane, Material { friction_damping: f64::INFINITY, ..MATERIAL }), "`friction_damping`"),
        (Collider::new(SharedShape::cuboid(1.0, 1.0, 1.0), bent, MATERIAL), "pose"),
        (Collider::new(SharedShape::ball(f64::NAN), Isometry3::identity(), MATERIAL), "size"),
    ];
    for (collider, word) in cases {
        let room = scene(DOWN, vec![floor(), collider]);
        for (_, mut solver) in all_solvers(&system) {
            let said = line(solver.step(&mut Batch::new(&system, &room, 1), &[]));
            assert!(said.contains("collider 1") && said.contains(word), "`{word}`: {said}");
        }
    }
    let said = line(implicit(1).step(&mut Batch::new(&system, &scene([0.0, 0.0, f64::NAN], vec![floor()]), 1), &[]));
    assert!(said.contains("gravity"), "{said}");
}

/// Skipping colliders by their bounding balls never skips the nearest.
#[test]
fn among_many_colliders_the_nearest_is_found() {
    let placed = |k: usize| {
        let part = |m: usize| (k * m % 23) as f64 / 23.0;
        let turn = UnitQuaternion::from_euler_angles(part(5), part(7), part(11));
        let pose = Isometry3::from_parts(Vector3::new(part(3), part(13), 0.4 * part(17)).into(), turn);
        let shape = match k % 3 {
            0 => SharedShape::cylinder(0.05 + 0.1 * part(19), 0.03),
            1 => SharedShape::cuboid(0.02, 0.05, 0.1 * part(2) + 0.01),
            _ => SharedShape::ball(0.04),
        };
        Collider::new(shape, pose, MATERIAL)
    };
    let rubble = on_rubble("cube").scene("terrain").expect("its own").terrain().expect("terrain").1.clone();
    let rubble = Collider::terrain(rubble, Isometry3::translation(0.0, 0.0, -0.05), MATERIAL);
    let colliders: Vec<Collider> = (0..22).map(placed).chain([rubble, floor()]).collect();
    let alone: Vec<_> = colliders.iter().map(|c| scene(WEIGHTLESS, vec![c.clone()])).collect();
    let all = scene(WEIGHTLESS, colliders);
    let (mut others, mut rough, mut found) = (0, 0, Vec::new());
    for i in 0..2000 {
        let part = |m: usize| (i * m % 211) as f64 / 211.0;
        let place = Vector3::new(1.4 * part(31) - 0.2, 1.4 * part(57) - 0.2, 0.6 * part(101) - 0.05);
        let events: Vec<_> = alone.iter().map(|s| s.contact(&place)).collect();
        let nearest = events.iter().map(|e| e.distance).fold(f64::INFINITY, f64::min);
        let event = all.contact(&place);
        assert_eq!(event.distance, nearest, "at {:?}", place.as_slice());
        assert_eq!(event.distance, events[event.collider].distance, "the collider named");
        found.clear();
        contacts_at(&all, &place, 0.05, &mut found);
        let inside = |events: &[ContactEvent]| events.iter().filter(|e| e.distance <= 0.0).count();
        assert_eq!(inside(&events), inside(&found), "at {place:?}");
        others += usize::from(event.collider < 22);
        rough += usize::from(event.collider == 22);
    }
    assert!(
        others > 1000 && rough > 100,
        "{others} of 2000 places are nearest to bodies, {rough} to rubble, the others to the floor"
    );
}
