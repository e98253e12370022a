//! Torsional and rolling friction against textbook values; a contact with a margin rests at the margin.

use nerd_suite::bodies::Body;

use super::common::*;

const G: f64 = 9.81;

/// A ball of radius 0.1 m and mass 1 kg with the given torsional and rolling friction (m).
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

/// Position (m) and velocity (m/s) along x of a ball, `seconds` after it starts rolling at 1 m/s.
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

/// A rolling ball decelerates by `mu_r g / (1.4 r)`. From 1 m/s at mu_r = 0.02 m the ball stops after 0.357 m.
#[test]
fn rolling_friction_stops_a_ball() {
    let (rate, way) = (0.02 * G / 0.1 / 1.4, 0.7 / (0.02 * G / 0.1));
    for substeps in [1, 4, 16] {
        let [_, half] = rolled(&ball(0.0, 0.02), substeps, 0.25);
        let [x, v] = rolled(&ball(0.0, 0.02), substeps, 2.0);
        assert!(
            (half - (1.0 - 0.25 * rate)).abs() < 0.01,
            "{substeps}: {half} m/s after 1/4 s, not {}",
            1.0 - 0.25 * rate
        );
        assert!((x / way - 1.0).abs() < 0.02 && v.abs() < 1e-3, "{substeps}: stops at {x} m, not {way}, with {v} m/s");
    }
    let [x, v] = rolled(&ball(0.5, 0.0), 4, 1.0);
    assert!((x - 1.0).abs() < 1e-3 && (v - 1.0).abs() < 1e-3, "torsion alone: {x} m, {v} m/s");
}

/// The same for a ball that carries a chain of light sprung links, which is solved along the kinematic tree.
#[test]
fn a_chain_on_a_ball_changes_nothing() {
    let (mut parts, mut tables) = (
        vec![link("body", 1.0, [0.0; 3], [0.004; 3], &collision([0.0; 3], r#"<sphere radius="0.1"/>"#))],
        String::new(),
    );
    for k in 0..3 {
        let (above, own) = (if k == 0 { "body".into() } else { format!("l{}", k - 1) }, format!("l{k}"));
        parts.push(link(&own, 1e-6, [0.0; 3], [1e-8; 3], ""));
        parts.push(joint(&format!("j{k}"), "continuous", [&above, &own], r#"<axis xyz="0 0 1"/>"#));
        tables += &joint_table(&format!("j{k}"), "stiffness = 1e-3");
    }
    let material =
        "material = { stiffness = 1e5, damping = 100.0, friction_damping = 1e3, friction = 0.5, rolling = 0.02 }\n";
    let toml = keys(true, G) + material + GROUND + &tables;
    let system = Arc::new(System::from_text("ball", &urdf(&parts), Some(&toml)).expect("valid"));
    assert!(nerd_sim::articulated::along(&system.robot), "it is solved by its matrix");
    let [x, v] = rolled(&system, 4, 2.0);
    assert!((x / 0.3568 - 1.0).abs() < 0.02 && v.abs() < 1e-3, "stops at {x} m with {v} m/s");
}

/// A ball spinning about the normal decelerates by `mu_t m g / I` and stays in place.
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
    // Friction far above the ball's weight does not make the ball chatter.
    let held = end(&mut implicit(1), at(&ball(10.0, 10.0), "ground", &start), 0.0, 60);
    assert!(held[7..10].iter().all(|w| w.abs() < 1e-3), "{:?} rad/s", &held[7..10]);
}

/// A ball on a slope of angle a below `atan(mu_r / r)` stands still. On a steeper slope it accelerates by `(sin a -
/// mu_r / r cos a) g / 1.4`.
#[test]
fn rolling_friction_holds_a_ball_and_lets_it_go() {
    let system = ball(0.0, 0.02);
    for (substeps, share) in [1, 4].into_iter().flat_map(|n| [(n, 0.6), (n, 1.1), (n, 2.0)]) {
        let angle = (share * 0.2f64).atan();
        let mut batch =
            at(&system, "ground", &Body::state([0.0, 0.0, 0.1 - G / 1e5], [0.0, 0.0, 0.0, 1.0], [0.0; 3], [0.0; 3]));
        let mut scene = (*batch.scenes[0]).clone();
        scene.gravity = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), -angle) * scene.gravity;
        batch.scenes[0] = Arc::new(scene);
        let mut solver = implicit(substeps);
        run(&mut solver, &mut batch, 0.0, 120);
        let begun = batch.state(0).to_vec();
        if share < 1.0 {
            run(&mut solver, &mut batch, 0.0, 3600);
            let way = (vector(batch.state(0)) - vector(&begun)).norm();
            assert!(way < 1e-4, "x{substeps}: {way:.1e} m in a minute");
        } else {
            let way = (vector(&begun) - Vector3::new(0.0, 0.0, 0.1)).norm();
            let right = 0.5 * G * (angle.sin() - 0.2 * angle.cos()) / 1.4 * 4.0;
            let most = if share < 1.5 { 0.02 } else { 0.01 };
            assert!((way / right - 1.0).abs() < most, "x{substeps}, {share} times the angle: {way} m for {right} m");
        }
    }
}

/// A rotor on a ball applies a torque about the normal. Up to `mu_t N` the ball stands still; above, it turns.
#[test]
fn torsional_friction_holds_a_ball_and_lets_it_go() {
    let (weight, torsion) = (1.5 * G, 0.01);
    let shape = collision([0.0; 3], r#"<sphere radius="0.1"/>"#);
    let parts = [
        link("body", 1.0, [0.0; 3], [0.004; 3], &shape),
        link("rotor", 0.5, [0.0; 3], [0.01; 3], ""),
        joint(
            "j",
            "continuous",
            ["body", "rotor"],
            r#"<axis xyz="0 0 1"/><limit effort="10" velocity="1000"/><dynamics damping="0.001"/>"#,
        ),
    ];
    let material = format!(
        "material = {{ stiffness = 1e5, damping = 100.0, friction_damping = 1e3, friction = 0.5, torsion = {torsion} }}\n"
    );
    let system = Arc::new(
        System::from_text("ball", &urdf(&parts), Some(&(keys(true, G) + &material + GROUND + &joint_table("j", ""))))
            .expect("valid"),
    );
    for substeps in [1, 4] {
        let mut start = system.robot.zero_state();
        start[2] = 0.1 - weight / 1e5;
        let mut batch = at(&system, "ground", &start);
        let mut solver = implicit(substeps);
        run(&mut solver, &mut batch, 0.6 * torsion * weight, 120);
        let begun = batch.state(0)[..7].to_vec();
        run(&mut solver, &mut batch, 0.6 * torsion * weight, 3600);
        let turned = 2.0 * (batch.state(0)[5] - begun[5]).abs();
        assert!(turned < 1e-4, "x{substeps}: {turned:.1e} rad in a minute");
        // The excess torque accelerates the ball alone, less the damper's torque at the relative rate of ball and
        // rotor.
        batch.reset(0, &start);
        run(&mut solver, &mut batch, 2.0 * torsion * weight, 12);
        let spin = batch.state(0)[system.robot.nq() + 2].abs();
        let [ball, rotor] = [torsion * weight / 0.004, 2.0 * torsion * weight / 0.01];
        let right = 0.2 * ball - 0.001 * (ball + rotor) * 0.02 / 0.004;
        assert!((spin / right - 1.0).abs() < 0.01, "x{substeps}: {spin} rad/s for {right} rad/s");
    }
}

/// A crate rests at its material's margin above the ground, where the contact springs carry its weight.
#[test]
fn a_margin_lifts() {
    let system = with(&Body::default(), 0.0, 0.0, 0.03);
    for start in [0.13, 0.2] {
        let mut batch = at(&system, "ground", &Body::at([0.0, 0.0, start]));
        batch.forces = vec![Vector3::zeros(); 8];
        run(&mut implicit(4), &mut batch, 0.0, 120);
        // A box's corners have a contact radius of 1e-5 m.
        let (z, expected) = (batch.states[2], 0.13 + 1e-5 - G / 4e5);
        assert!((z - expected).abs() < 1e-9, "from {start} m it rests at {z} m, not {expected}");
        let pressed = system.stored(&batch.scenes[0], &batch.states, &mut system.data());
        assert!((pressed / (0.5 * G * G / 4e5) - 1.0).abs() < 1e-2, "{pressed} J in its springs");
    }
}
