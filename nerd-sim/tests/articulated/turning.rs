//! Torsional and rolling friction against textbook values, and margins: contacts with a margin rest at that distance.

use nerd_sim::suite::bodies::Body;

use super::common::*;

const G: f64 = 9.81;

/// A ball of 0.1 m and 1 kg with this torsional and rolling friction (m).
fn ball(torsion: f64, rolling: f64) -> Arc<System> {
    let body = Body { shape: r#"<sphere radius="0.1"/>"#.into(), inertia: [0.004; 3], ..Body::default() };
    with(&body, torsion, rolling, 0.0)
}

fn with(body: &Body, torsion: f64, rolling: f64, margin: f64) -> Arc<System> {
    let mut system = (*body.system().expect("valid")).clone();
    let material = &mut system.spec.material;
    (material.stiffness, material.torsion, material.rolling, material.margin) = (1e5, torsion, rolling, margin);
    Arc::new(system)
}

/// Position and velocity of a ball that starts rolling at 1 m/s along x, after `seconds`.
fn rolled(system: &Arc<System>, substeps: usize, seconds: f64) -> [f64; 2] {
    let mut start = Body::state([0.0, 0.0, 0.1 - G / 1e5], [0.0, 0.0, 0.0, 1.0], [0.0, 10.0, 0.0], [1.0, 0.0, 0.0]);
    start.extend(vec![0.0; system.robot.state_dim() - start.len()]);
    if system.robot.joint_count() > 0 {
        start = system.robot.zero_state();
        let nq = system.robot.nq();
        (start[2], start[nq + 1]) = (0.1 - G / 1e5, 10.0);
        start[nq + 3] = 1.0 - 10.0 * start[2];
    }
    let state = end(&mut implicit(substeps), at(system, "ground", &start), 0.0, (60.0 * seconds) as usize);
    let nq = system.robot.nq();
    [state[0], state[nq + 3] + state[nq + 1] * state[2]]
}

/// A ball that rolls slows down by `mu_r g / (1.4 r)` and stops: 1 m/s at 0.02 m after 0.357 m.
#[test]
fn rolling_friction_stops_a_ball() {
    let (rate, way) = (0.02 * G / 0.1 / 1.4, 0.7 / (0.02 * G / 0.1));
    for substeps in [1, 4, 16] {
        let [_, half] = rolled(&ball(0.0, 0.02), substeps, 0.25);
        let [x, v] = rolled(&ball(0.0, 0.02), substeps, 2.0);
        assert!((half - (1.0 - 0.25 * rate)).abs() < 0.01, "{substeps}: {half} m/s after 1/4 s, not {}", 1.0 - 0.25 * rate);
        assert!((x / way - 1.0).abs() < 0.02 && v.abs() < 1e-3, "{substeps}: stops at {x} m, not {way}, with {v} m/s");
    }
    let [x, v] = rolled(&ball(0.5, 0.0), 4, 1.0);
    assert!((x - 1.0).abs() < 1e-3 && (v - 1.0).abs() < 1e-3, "torsion alone: {x} m, {v} m/s");
}

/// The same along the tree, of a ball that carries a chain of light sprung links.
#[test]
fn a_chain_on_a_ball_changes_nothing() {
    let (mut parts, mut tables) =
        (vec![link("body", 1.0, [0.0; 3], [0.004; 3], &collision([0.0; 3], r#"<sphere radius="0.1"/>"#))], String::new());
    for k in 0..3 {
        let (above, own) = (if k == 0 { "body".into() } else { format!("l{}", k - 1) }, format!("l{k}"));
        parts.push(link(&own, 1e-6, [0.0; 3], [1e-8; 3], ""));
        parts.push(joint(&format!("j{k}"), "continuous", [&above, &own], r#"<axis xyz="0 0 1"/>"#));
        tables += &joint_table(&format!("j{k}"), "stiffness = 1e-3");
    }
    let material = "material = { stiffness = 1e5, damping = 100.0, friction_damping = 1e3, friction = 0.5, rolling = 0.02 }\n";
    let toml = keys(true, G) + material + GROUND + &tables;
    let system = Arc::new(System::from_text("ball", &urdf(&parts), Some(&toml)).expect("valid"));
    assert!(nerd_sim::articulated::along(&system.robot), "it is solved by its matrix");
    let [x, v] = rolled(&system, 4, 2.0);
    assert!((x / 0.3568 - 1.0).abs() < 0.02 && v.abs() < 1e-3, "stops at {x} m with {v} m/s");
}

/// A ball that spins about the normal slows down by `mu_t m g / I` and stays where it is.
#[test]
fn torsional_friction_stops_a_spin() {
    let (torsion, w) = (0.01, 50.0);
    let rate = torsion * G / 0.004;
    let start = Body::state([0.0, 0.0, 0.1 - G / 1e5], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, w], [0.0; 3]);
    for substeps in [1, 4, 16] {
        let spin = |frames: usize| end(&mut implicit(substeps), at(&ball(torsion, 0.0), "ground", &start), 0.0, frames);
        let (early, late) = (spin(60)[9], spin(180)[9]);
        assert!((early / (w - rate) - 1.0).abs() < 1e-2, "{substeps}: {early} rad/s after 1 s, not {}", w - rate);
        assert!(late.abs() < 1e-3, "{substeps}: {late} rad/s when it should rest");
    }
    // Far more than the ball's weight could balance: nothing shakes.
    let held = end(&mut implicit(1), at(&ball(10.0, 10.0), "ground", &start), 0.0, 60);
    assert!(held[7..10].iter().all(|w| w.abs() < 1e-3), "{:?} rad/s", &held[7..10]);
}

/// A crate rests at the margin of its material above the ground, and presses there with its weight.
#[test]
fn a_margin_lifts() {
    let system = with(&Body::default(), 0.0, 0.0, 0.03);
    for start in [0.13, 0.2] {
        let mut batch = at(&system, "ground", &Body::at([0.0, 0.0, start]));
        batch.forces = vec![Vector3::zeros(); 8];
        run(&mut implicit(4), &mut batch, 0.0, 120);
        let (z, expected) = (batch.states[2], 0.13 - G / 4e5);
        assert!((z - expected).abs() < 1e-5, "from {start} m it rests at {z} m, not {expected}");
        let pressed = system.stored(&batch.scenes[0], &batch.states, &mut system.data());
        assert!((pressed / (0.5 * G * G / 4e5) - 1.0).abs() < 1e-2, "{pressed} J in its springs");
    }
}
