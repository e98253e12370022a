//! Every collider that a point touches acts on it, surfaces inside others do not, and cylinders are cylinders.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use nerd_core::state::vector;
use nerd_sim::prelude::*;
use parry3d_f64::shape::SharedShape;

const MATERIAL: Material = Material { stiffness: 1e4, damping: 100.0, friction_damping: 1e3, friction: 0.5 };

/// A free body of 1 kg.
fn body(shape: &str) -> Arc<System> {
    let urdf = format!(
        r#"<robot name="body"><link name="body"><inertial><mass value="1"/>
        <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
        <collision><geometry>{shape}</geometry></collision></link></robot>"#
    );
    let mut system = System::bare("body", &urdf, true).expect("a body");
    system.spec.material = MATERIAL;
    Arc::new(system)
}

fn floor() -> Collider {
    Collider::plane(Plane { normal: Vector3::z(), offset: 0.0 }, MATERIAL)
}

fn block(low: [f64; 3], high: [f64; 3]) -> Collider {
    let (low, high) = (Vector3::from(low), Vector3::from(high));
    let (half, centre) = ((high - low) * 0.5, (high + low) * 0.5);
    Collider::new(SharedShape::cuboid(half.x, half.y, half.z), Isometry3::translation(centre.x, centre.y, centre.z), MATERIAL)
}

fn scene(gravity: f64, colliders: Vec<Collider>) -> Arc<Scene> {
    Arc::new(Scene { name: "test".into(), gravity: Vector3::new(0.0, 0.0, -gravity), colliders })
}

fn solvers(system: &System) -> [(&'static str, ArticulatedConfig); 3] {
    let law = Friction::Coulomb;
    let (paper, explicit) = (ArticulatedConfig::paper(system, law), ArticulatedConfig::explicit(64, law));
    [("paper", paper), ("explicit", explicit), ("implicit", ArticulatedConfig::implicit(8, law))]
}

/// The state after `frames` frames.
fn run(system: &Arc<System>, scene: &Arc<Scene>, mut solver: impl Solver, at: Isometry3<f64>, frames: usize) -> Vec<f64> {
    let mut batch = Batch::new(system, scene, 1);
    let mut state = system.default_state();
    state[..3].copy_from_slice(at.translation.vector.as_slice());
    nerd_core::state::write_quaternion(&mut state[3..7], &at.rotation);
    batch.reset(0, &state);
    (0..frames).for_each(|_| solver.step(&mut batch, &vec![0.0; system.robot.joint_count()]).expect("finite"));
    batch.states
}

/// A ball in a corner, deeper in the riser than in the floor, is pushed out of both, and by as much as by either alone.
#[test]
fn a_ball_in_a_corner_feels_floor_and_riser() {
    let system = body(r#"<sphere radius="0.05"/>"#);
    // The riser alone, the floor alone, both; without friction, so that neither rubs the push of the other.
    let smooth = |colliders: Vec<Collider>| {
        let material = Material { friction: 0.0, ..MATERIAL };
        colliders.into_iter().map(|c| Collider { material, ..c }).collect::<Vec<_>>()
    };
    let mut system = (*system).clone();
    system.spec.material.friction = 0.0;
    let system = Arc::new(system);
    for riser in [block([0.0, -1.0, 0.0], [1.0, 1.0, 0.3]), block([0.0, -1.0, -0.5], [1.0, 1.0, 0.3])] {
        for (name, config) in solvers(&system) {
            let at = Isometry3::translation(-0.04, 0.0, 0.045);
            let after = |colliders| vector(&run(&system, &scene(0.0, smooth(colliders)), Articulated::new(config), at, 1));
            let way = |p: Vector3<f64>| p - at.translation.vector;
            let (both, one, two) = (way(after(vec![floor(), riser.clone()])), way(after(vec![riser.clone()])), way(after(vec![floor()])));
            assert!(one.x < -1e-4 && two.z > 1e-4, "{name}: neither pushes: {one:?}, {two:?}");
            assert!(
                (both.x / one.x - 1.0).abs() < 1e-6 && (both.z / two.z - 1.0).abs() < 1e-6,
                "{name}: {both:?}, alone {one:?} and {two:?}"
            );
        }
    }
}

/// Corners of a box pressed into a corner, with points inside both solids: gravity holds it on the floor, a push at the wall.
#[test]
fn a_box_leans_on_floor_and_wall() {
    let system = body(r#"<box size="0.2 0.2 0.2"/>"#);
    let wall = block([0.1, -1.0, -0.5], [1.0, 1.0, 1.0]);
    let room = Arc::new(Scene { gravity: Vector3::new(5.0, 0.0, -9.81), ..(*scene(9.81, vec![floor(), wall])).clone() });
    for (name, config) in solvers(&system) {
        let last = run(&system, &room, Articulated::new(config), Isometry3::translation(0.0, 0.0, 0.1), 120);
        let p = vector(&last);
        assert!(p.x.abs() < 2e-3 && (p.z - 0.1).abs() < 2e-3, "{name}: {p:?}, it leans at x 0, z 0.1");
    }
}

/// Tiles side by side are one floor: a ball rolls over their seam as over a plane, and rests there as deep.
#[test]
fn a_seam_between_tiles_is_no_bump() {
    let system = body(r#"<sphere radius="0.05"/>"#);
    let tiles = vec![block([-1.0, -1.0, -0.1], [0.0, 1.0, 0.0]), block([0.0, -1.0, -0.1], [1.0, 1.0, 0.0])];
    for (name, config) in solvers(&system) {
        let roll = |colliders| {
            let (room, mut solver) = (scene(9.81, colliders), Articulated::new(config));
            let mut batch = Batch::new(&system, &room, 1);
            // Rolling at 0.5 m/s, 10 rad/s about y.
            let mut state = system.default_state();
            (state[0], state[2], state[8]) = (-0.25, 0.0499, 10.0);
            let v = Vector3::new(0.5, 0.0, 0.0) - Vector3::new(0.0, 10.0, 0.0).cross(&vector(&state));
            state[10..13].copy_from_slice(v.as_slice());
            batch.reset(0, &state);
            let mut path = Vec::new();
            for _ in 0..60 {
                solver.step(&mut batch, &[]).expect("finite");
                path.push(vector(batch.state(0)));
            }
            path
        };
        let (seam, plane) = (roll(tiles.clone()), roll(vec![floor()]));
        let gap = seam.iter().zip(&plane).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(plane[59].x > 0.2 && gap < 1e-6, "{name}: {gap:.1e} m apart from rolling on a plane, which ends at {} m", plane[59].x);
    }
}

/// A face that lies buried under the floor does not push down what is under the floor.
#[test]
fn a_buried_face_does_not_act() {
    let mut events = Vec::new();
    let room = scene(0.0, vec![floor(), block([-1.0, -1.0, 0.0], [1.0, 1.0, 0.2])]);
    room.contacts(&Vector3::new(0.1, 0.0, -0.01), f64::INFINITY, &mut events);
    let found: Vec<_> = events.iter().map(|e| (e.collider, e.distance)).collect();
    assert_eq!(found, [(0, -0.01)], "the block's underside at z 0 is no surface");
    events.clear();
    // In the inner corner of two steps both risers and treads are surfaces.
    let steps = scene(0.0, vec![floor(), block([0.0, -1.0, 0.0], [1.0, 1.0, 0.1])]);
    steps.contacts(&Vector3::new(-0.02, 0.0, 0.03), 0.1, &mut events);
    assert_eq!(events.len(), 2, "{events:?}");
}

fn rods() -> [(&'static str, f64, f64); 3] {
    [("rod", 0.05, 0.2), ("wheel", 0.1, 0.02), ("short rod", 0.1, 0.11)]
}

/// Upright a cylinder rests at its half length, on its side at its radius, in our solvers (but for `m g / k` of the law) and
/// in rapier.
#[test]
fn a_cylinder_rests_on_its_end_and_on_its_side() {
    for (name, radius, half) in rods() {
        let system = body(&format!(r#"<cylinder radius="{radius}" length="{}"/>"#, 2.0 * half));
        let room = scene(9.81, vec![floor()]);
        let side = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        // Flat, it stands on 16 points of a rim, so a wheel lies down on a side of that polygon.
        let flat = if half < radius { radius * (1.0 - (std::f64::consts::PI / 16.0).cos()) } else { 0.0 };
        for (turn, height, sunk) in [(UnitQuaternion::identity(), half, 0.0), (side, radius, flat)] {
            let at = Isometry3::from_parts(Vector3::new(0.0, 0.0, height + 0.002).into(), turn);
            let mut last: Vec<(&str, Vec<f64>)> =
                solvers(&system).into_iter().map(|(n, c)| (n, run(&system, &room, Articulated::new(c), at, 180))).collect();
            #[cfg(feature = "rapier")]
            last.push(("rapier", run(&system, &room, Rapier::new(RapierConfig::default()), at, 180)));
            for (solver, state) in last {
                assert!(
                    (-1e-3 - sunk..1e-3).contains(&(state[2] - height)),
                    "{name}, {solver}: rests at {} m, its shape says {height}",
                    state[2]
                );
                let turned = nerd_core::state::quaternion(&state[3..7]) * Vector3::z();
                assert!(turned.dot(&(turn * Vector3::z())) > 0.999, "{name}, {solver}: axis fell to {turned:?}");
            }
        }
    }
}

/// Down a slope of 10 degrees from rest, on its side: g sin a t^2 / 2 / (1 + I / m r^2).
#[test]
fn a_cylinder_rolls() {
    for (name, radius, half, allowed) in [("rod", 0.1, 0.3, 0.02), ("wheel", 0.1, 0.05, 0.15)] {
        let system = body(&format!(r#"<cylinder radius="{radius}" length="{}"/>"#, 2.0 * half));
        let a = 10f64.to_radians();
        let room = Arc::new(Scene { gravity: Vector3::new(9.81 * a.sin(), 0.0, -9.81 * a.cos()), ..(*scene(0.0, vec![floor()])).clone() });
        let at =
            Isometry3::from_parts(Vector3::new(0.0, 0.0, radius).into(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2));
        let expected = 0.5 * 9.81 * a.sin() / (1.0 + 0.01 / (radius * radius));
        for (solver, config) in solvers(&system) {
            let x = run(&system, &room, Articulated::new(config), at, 60)[0];
            assert!((x / expected - 1.0).abs() < allowed, "{name}, {solver}: rolled {x} m in 1 s, textbook {expected}");
        }
    }
}

/// What is not finite, or out of its range, is refused by name before a step, not ignored.
#[test]
fn a_scene_that_is_no_scene_is_refused() {
    let system = body(r#"<sphere radius="0.05"/>"#);
    let with = |plane: Plane, material: Material| scene(9.81, vec![floor(), Collider::plane(plane, material)]);
    let plane = Plane { normal: Vector3::z(), offset: 0.0 };
    let bent = Isometry3::translation(f64::NAN, 0.0, 0.0);
    let cases = [
        (with(Plane { offset: f64::NAN, ..plane }, MATERIAL), "plane"),
        (with(Plane { normal: Vector3::new(f64::NAN, 0.0, 1.0), ..plane }, MATERIAL), "normal"),
        (with(Plane { normal: Vector3::zeros(), ..plane }, MATERIAL), "unit vector"),
        (with(plane, Material { friction: -0.5, ..MATERIAL }), "`friction` is -0.5"),
        (with(plane, Material { damping: -1.0, ..MATERIAL }), "`damping` is -1 N s/m"),
        (with(plane, Material { stiffness: f64::NAN, ..MATERIAL }), "`stiffness` is NaN N/m"),
        (with(plane, Material { friction_damping: f64::INFINITY, ..MATERIAL }), "`friction_damping`"),
        (scene(9.81, vec![floor(), Collider::new(SharedShape::cuboid(1.0, 1.0, 1.0), bent, MATERIAL)]), "pose"),
        (scene(9.81, vec![floor(), Collider::new(SharedShape::ball(f64::NAN), Isometry3::identity(), MATERIAL)]), "size"),
    ];
    for (room, word) in cases {
        let mut solvers: Vec<Box<dyn Solver>> =
            solvers(&system).into_iter().map(|(_, c)| Box::new(Articulated::new(c)) as Box<dyn Solver>).collect();
        #[cfg(feature = "rapier")]
        solvers.push(Box::new(Rapier::new(RapierConfig::default())));
        for solver in &mut solvers {
            let error = solver.step(&mut Batch::new(&system, &room, 1), &[]).expect_err("refused").to_string();
            assert!(error.contains("collider 1") && error.contains(word) && !error.contains('\n'), "`{word}`: {error}");
        }
    }
    let weightless = scene(f64::NAN, vec![floor()]);
    let mut solver = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    let error = solver.step(&mut Batch::new(&system, &weightless, 1), &[]).expect_err("refused").to_string();
    assert!(error.contains("gravity"), "{error}");
}

/// Colliders that are passed over since a ball around them is too far away are those that would not have been the nearest.
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
    let colliders: Vec<Collider> = (0..22).map(placed).chain([floor()]).collect();
    let alone: Vec<_> = colliders.iter().map(|c| scene(0.0, vec![c.clone()])).collect();
    let all = scene(0.0, colliders);
    let (mut others, mut found) = (0, Vec::new());
    for i in 0..2000 {
        let part = |m: usize| (i * m % 211) as f64 / 211.0;
        let place = Vector3::new(1.4 * part(31) - 0.2, 1.4 * part(57) - 0.2, 0.6 * part(101) - 0.05);
        let events: Vec<_> = alone.iter().map(|s| s.contact(&place)).collect();
        let nearest = events.iter().map(|e| e.distance).fold(f64::INFINITY, f64::min);
        let event = all.contact(&place);
        assert_eq!(event.distance, nearest, "at {:?}", place.as_slice());
        assert_eq!(event.distance, events[event.collider].distance, "the collider named");
        found.clear();
        all.contacts(&place, 0.05, &mut found);
        assert!(events.iter().filter(|e| e.distance <= 0.0).count() == found.iter().filter(|e| e.distance <= 0.0).count(), "at {place:?}");
        others += usize::from(event.collider + 1 != all.colliders.len());
    }
    assert!(others > 1000, "{others} of 2000 places are nearest to something else than the floor");
}
