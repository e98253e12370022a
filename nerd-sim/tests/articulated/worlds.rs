//! Built-in worlds: distance and normal of the nearest collider, inside and outside, against closed forms.

use nerd_sim::scene::{WORLDS, hill};

use super::common::*;

fn world(name: &str) -> std::sync::Arc<Scene> {
    built_in("cube").scene(name).expect("a world")
}

#[test]
fn distances_are_those_of_geometry() {
    // World, point, signed distance, normal.
    let cases = [
        ("plane", [0.3, -2.0, 0.5], 0.5, [0.0, 0.0, 1.0]),
        ("slope", [0.0, 5.0, 1.0], 0.984_807_753, [-0.173_648_178, 0.0, 0.984_807_753]),
        ("box", [0.75, 0.1, 0.25], 0.05, [0.0, 0.0, 1.0]), // above the box
        ("box", [0.75, 0.1, 0.19], -0.01, [0.0, 0.0, 1.0]), // in it, near its top
        ("box", [0.43, 0.0, 0.1], 0.02, [-1.0, 0.0, 0.0]), // beside it: nearer than the ground
        ("steps", [1.0, 0.0, 0.2], 0.04, [0.0, 0.0, 1.0]), // above the second step, 0.16 m high
        ("steps", [0.79, 0.0, 0.12], 0.01, [-1.0, 0.0, 0.0]), // before the second step, above the first
    ];
    for (world, point, distance, normal) in cases {
        let event = self::world(world).contact(&Vector3::from(point));
        assert!(
            (event.distance - distance).abs() < 1e-9,
            "{world} at {point:?}: {} m, geometry says {distance}",
            event.distance
        );
        let gap = (event.normal - Vector3::from(normal)).norm();
        assert!(gap < 1e-8, "{world} at {point:?}: normal {:?}, geometry says {normal:?}", event.normal);
    }
}

/// The hills' mesh has an inside: a point below the surface has its true depth.
#[test]
fn under_the_hills_is_inside() {
    let scene = world("hills");
    for k in 0..200 {
        let (x, y) = (10.0 * (0.7 * k as f64).sin(), 10.0 * (1.3 * k as f64).cos());
        for depth in [-0.1, -0.01, 0.01, 0.1] {
            let event = scene.contact(&Vector3::new(x, y, hill(x, y) + depth));
            // The distance is at most the vertical one and has the right sign. Facets lie up to 1 cm off the waves.
            let (signed, least) = (event.distance * depth.signum(), 0.5 * depth.abs() - 0.01);
            assert!(
                signed > least && signed < depth.abs() + 0.01,
                "({x:.2}, {y:.2}), {depth} m: distance {} m",
                event.distance
            );
            assert!(event.normal.z > 0.5, "({x:.2}, {y:.2}), {depth} m: normal {:?}", event.normal);
        }
    }
}

/// A cube dropped into each world comes to rest on its surface.
#[test]
fn a_cube_comes_to_rest_in_every_world() {
    let system = built_in("cube");
    for world in WORLDS.into_iter().filter(|w| *w != "slope") {
        let mut batch = batch(&system, world, 2);
        for (env, x) in [0.75, 1.0].into_iter().enumerate() {
            let state = batch.state_mut(env);
            (state[0], state[2]) = (x, 0.8);
        }
        run(&mut implicit(8), &mut batch, 0.0, 240);
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        for env in 0..2 {
            let state = batch.state(env);
            contacts(&system, &batch.scenes[env], state, &mut data, &mut events);
            let nearest = events.iter().map(|e| e.distance).fold(f64::INFINITY, f64::min);
            let speed = state[7..].iter().fold(0.0f64, |a, b| a.max(b.abs()));
            assert!(
                nearest.abs() < 2e-3 && speed < 0.1,
                "{world} {env}: {nearest} m from the surface at {speed} m/s or rad/s"
            );
        }
    }
}

/// Boxes and pegs of a TOML are at their given positions, whichever axis is up.
#[test]
fn boxes_and_pegs_stand_on_the_plane() {
    let ball = urdf(&[link("ball", 1.0, [0.0; 3], [1e-3; 3], &collision([0.0; 3], r#"<sphere radius="0.05"/>"#))]);
    for (gravity, order) in [("[0.0, 0.0, -9.81]", [0, 1, 2]), ("[0.0, -9.81, 0.0]", [1, 2, 0])] {
        // Permutes coordinates given with z up to the axes of this world.
        let turned = |x: [f64; 3]| order.map(|k: usize| x[k]);
        let text = format!(
            "{}{GROUND}box = [{{ size = [0.4, 0.4, 0.2], position = {:?} }}]\npeg = [{{ radius = 0.1, height = 0.5, position = {:?} }}]\n",
            changed(&keys(true, 9.81), "[0.0, 0.0, -9.81]", gravity),
            turned([1.0, 0.0, 0.1]),
            turned([0.0, 1.0, 0.0])
        );
        let scene =
            System::from_text("ball", &ball, Some(&text)).expect("a table").scene("ground").expect("it is there");
        for (place, gap) in [
            ([1.0, 0.0, 0.5], 0.3),
            ([1.0, 0.5, 0.1], 0.1),
            ([0.0, 1.0, 0.7], 0.2),
            ([0.3, 1.0, 0.25], 0.2),
            ([0.0, 1.3, 0.4], 0.2),
            ([-3.0, 0.0, 0.5], 0.5),
        ] {
            let distance = scene.contact(&Vector3::from(turned(place))).distance;
            assert!((distance - gap).abs() < 1e-9, "up against {gravity}, {place:?}: {distance} m, not {gap}");
        }
        for (old, new) in [
            ("radius = 0.1", "radius = 0.0"),
            ("height = 0.5", "height = nan"),
            ("size = [0.4,", "size = [-0.4,"),
            ("peg =", "post ="),
        ] {
            line(System::from_text("ball", &ball, Some(&changed(&text, old, new))));
        }
    }
}
