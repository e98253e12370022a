//! Ground that is not flat, against hand values, planes and the law of rolling.

use nerd_sim::scene::{foot, place};
use nerd_suite::bodies::Body;

use super::common::*;

#[test]
fn heights_and_normals_are_bilinear() {
    let field = Field::new(0.5, [2, 2], vec![0.0, 1.0, 2.0, 4.0]).expect("four heights");
    // Bilinear between the heights 0 and 2 along x, and 1 and 4 along x at the next y. The point lies half a cell along
    // x and a quarter along y; the second point lies one period away.
    for (x, y) in [(0.25, 0.125), (-0.75, 1.125)] {
        let (height, slope) = field.at(x, y);
        assert!((height - 1.375).abs() < 1e-12, "{height} m");
        assert!((slope[0] - 4.5).abs() + (slope[1] - 3.0).abs() < 1e-12, "{slope:?}");
    }
    // The grid repeats: the first node follows the last, from 2 back to 0.
    assert_eq!(field.scaled(0.5).at(0.75, 0.0), (0.5, [-2.0, 1.5]));
    let terrain = Collider::terrain(field, Isometry3::identity(), Material::default());
    let event =
        Scene { colliders: vec![terrain], ..Scene::free(Vector3::z()) }.contact(&Vector3::new(0.25, 0.125, 2.375));
    let steep = (1.0f64 + 4.5 * 4.5 + 9.0).sqrt();
    assert!((event.distance - 1.0 / steep).abs() < 1e-12, "{} m away", event.distance);
    assert!((event.normal - Vector3::new(-4.5, -3.0, 1.0) / steep).norm() < 1e-12, "{:?}", event.normal);
    for wrong in [
        Field::new(0.1, [2, 2], vec![0.0; 3]),
        Field::new(0.0, [1, 1], vec![0.0]),
        Field::new(0.1, [1, 1], vec![f64::NAN]),
    ] {
        line(wrong);
    }
}

/// On terrain with all heights 0 the motion equals the motion on the plane.
#[test]
fn flat_terrain_is_the_plane() {
    let none = TerrainSpec { kind: TerrainKind::Rubble, height: 0.0, cell: 0.1, length: None, seed: None };
    // Sticking friction amplifies rounding, most on the Ant's many feet.
    for (name, frames) in [("cube", 90), ("ant", 50)] {
        let system = Arc::new((*built_in(name)).clone().with_terrain(none).expect("in range"));
        let state = start(&system, Start::Reset, &mut stream(2, 0));
        let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
        let moved: Vec<f64> = state.iter().enumerate().map(|(k, x)| x + if k == 2 { 1e-15 } else { 0.0 }).collect();
        let [flat, plane, other] = [("terrain", &state), ("plane", &state), ("plane", &moved)]
            .map(|(scene, state)| end(&mut solver, at(&system, scene, state), 0.0, frames));
        let off = |other: &[f64]| other.iter().zip(&plane).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Tumbling amplifies rounding as much as a start about 1e-15 m higher.
        let (off, most) = (off(&flat), 4.0 * off(&other));
        let touches = system.scene("plane").expect("a world").contact(&vector(&plane[..3])).distance < 1.0;
        assert!(off <= most && most < 1e-11 && touches, "{name}: {off:e} apart of {most:e} at {plane:?}");
    }
}

/// A solid ball rolls down a slope at `5/7 g sin(a)`, and exactly as down a plane.
#[test]
fn a_ball_rolls_down_a_slope() {
    let (radius, mass, rise) = (0.1, 1.0, 0.2f64);
    let body = Body {
        mass,
        inertia: [0.4 * mass * radius * radius; 3],
        shape: format!(r#"<sphere radius="{radius}"/>"#),
        ..Body::default()
    };
    let slopes = TerrainSpec { kind: TerrainKind::Slopes, height: rise, cell: 0.1, length: Some(1.0), seed: None };
    let system = Arc::new((*body.system().expect("a ball")).clone().with_terrain(slopes).expect("in range"));
    let angle = rise.atan();
    let normal = Vector3::new(-angle.sin(), 0.0, angle.cos());
    let plane = Collider::plane(Plane { normal, offset: 0.0 }, system.spec.material);
    let plane = Arc::new(Scene { colliders: vec![plane], ..Scene::free(system.gravity()) });
    let start = Body::at([3.0, 6.4, 0.6 + radius / angle.cos()]);
    let frames = (1.0 / system.frame_time).round() as usize;
    let mut ends = Vec::new();
    for scene in [system.scene("terrain").expect("its own"), plane] {
        ends.push(end(&mut implicit(8), within(&system, &scene, &start), 0.0, frames));
    }
    let [slope, plane] = [0, 1].map(|k| vector(&ends[k][..3]));
    let (way, expected) = ((slope - vector(&start[..3])).norm(), 0.5 * 5.0 / 7.0 * 9.81 * angle.sin());
    assert!((way / expected - 1.0).abs() < 2e-3, "{way} m down in a second, the law of rolling has {expected}");
    assert!((slope - plane).norm() < 1e-9, "{:e} m from where the plane has it", (slope - plane).norm());
}

/// Robots start at random places of the terrain, with the same clearance and velocity as on the plane.
#[test]
fn starts_stand_on_the_ground() {
    let system = on_rubble("ant");
    let (robot, scene, mut data) = (&system.robot, system.scene("terrain").expect("its own"), system.data());
    let (up, mut places) = (Vector3::y(), Vec::new());
    for k in 0..100 {
        let drawn = start(&system, Start::Reset, &mut stream(2, k));
        let mut state = drawn.clone();
        scene.strew(robot, &mut data, &mut state, &mut stream(3, k));
        let above = |point: &ContactPoint| {
            let event = scene.contact(&place(point, &data, &up));
            (event.distance - point.radius) / event.normal.dot(&up)
        };
        let found = robot.contact_points.iter().map(above).fold(f64::INFINITY, f64::min);
        let speeds = [&drawn, &state].map(|state| root_velocity(robot, state));
        kinematics(robot, &drawn, &mut data);
        let low = robot.contact_points.iter().map(|point| foot(point, &data, &up)).fold(f64::INFINITY, f64::min);
        assert!((found - low).abs() < 1e-12, "start {k}: {found} m above the ground, {low} m were drawn");
        assert!(
            (speeds[0] - speeds[1]).norm() < 1e-12,
            "start {k}: its velocity was {:?}, is {:?}",
            speeds[0],
            speeds[1]
        );
        places.push([state[0], state[2]]);
    }
    for k in 0..2 {
        let [low, high] = places.iter().fold([f64::MAX, f64::MIN], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        assert!(high - low > 20.0, "they are within {} m", high - low);
    }
}

fn root_velocity(robot: &Robot, state: &[f64]) -> Vector3<f64> {
    let (p, w, v) = (vector(&state[..3]), vector(&state[robot.nq()..][..3]), vector(&state[robot.nq() + 3..][..3]));
    v + w.cross(&p)
}

/// Cubes dropped onto rubble come to rest on it, also across borders of cells.
#[test]
fn cubes_rest_on_rubble() {
    let mut system = (*on_rubble("cube")).clone();
    // High friction, so that nothing slides for long, however steep a cell.
    system.spec.material.friction = 1.0;
    let system = Arc::new(system);
    let (robot, scene, mut data) = (&system.robot, system.scene("terrain").expect("its own"), system.data());
    let mut batch = batch(&system, "terrain", 16);
    for env in 0..16 {
        let mut state = start(&system, Start::Reset, &mut stream(2, env as u64));
        scene.strew(robot, &mut data, &mut state, &mut stream(3, env as u64));
        batch.reset(env, &state);
    }
    run(&mut Articulated::new(ArticulatedConfig::accurate(&system)), &mut batch, 0.0, 1500);
    let mut events = Vec::new();
    for env in 0..16 {
        let state = batch.state(env);
        contacts(&system, &scene, state, &mut data, &mut events);
        let gap =
            events.iter().zip(&robot.contact_points).map(|(e, p)| e.distance - p.radius).fold(f64::INFINITY, f64::min);
        let (speed, spin) = (root_velocity(robot, state).norm(), vector(&state[robot.nq()..][..3]).norm());
        assert!(gap < 0.0 && gap > -2e-3, "cube {env}: {gap:e} m above the ground");
        assert!(speed < 0.02 && spin < 0.02, "cube {env}: {speed:e} m/s, {spin:e} rad/s");
    }
}

#[cfg(feature = "rapier")]
#[test]
fn rapier_refuses_terrain() {
    let system = on_rubble("cube");
    let mut batch = batch(&system, "terrain", 1);
    let said = line(Rapier::new(RapierConfig::default()).step(&mut batch, &[]));
    assert!(said.contains("scene `terrain`: rapier does not know terrain; take `articulated`"), "{said}");
}
