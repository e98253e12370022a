//! A passive robot that falls gains no energy, however light its fingers are relative to its body.

use crate::common::*;

/// Kinetic, potential and spring energy (J).
fn energy(system: &System, scene: &Scene, state: &[f64], data: &mut Data) -> f64 {
    system.stored(scene, state, data) + totals(&system.robot, state, data).energy(&scene.gravity)
}

/// The largest rise of energy from one frame to a later one, relative to the energy released by the fall.
fn rise(urdf: &str, floating: bool, start: impl Fn(&mut [f64])) -> f64 {
    let system = Arc::new(System::bare("limp", urdf, floating).expect("a robot"));
    assert!(system.robot.joints().all(|j| j.armature == 0.0), "no drive inertia that the file does not give");
    let scene = system.scene("plane").expect("a plane");
    let mut state = system.default_state();
    start(&mut state);
    let mut batch = within(&system, &scene, &state);
    let (mut solver, mut data) = (Articulated::new(ArticulatedConfig::accurate(&system)), Data::new(&system.robot));
    let first = energy(&system, &scene, &state, &mut data);
    let (mut least, mut rise) = (first, 0.0f64);
    for _ in 0..180 {
        run(&mut solver, &mut batch, 0.0, 1);
        let now = energy(&system, &scene, batch.state(0), &mut data);
        rise = rise.max(now - least);
        least = least.min(now);
    }
    rise / (first - least)
}

/// A finger of three joints, each link of 5 g and 1e-5 kg m^2. With `mimics` the last two joints follow the first.
fn finger(name: &str, [x, y]: [f64; 2], mimics: bool) -> String {
    let ball = collision([0.04, 0.0, 0.0], r#"<sphere radius="0.006"/>"#);
    let mut parts = String::new();
    for k in 0..3 {
        let (above, place) = if k == 0 {
            ("body".into(), format!("{x} {y} -0.1"))
        } else {
            (format!("{name}{}", k - 1), "0.04 0 0".into())
        };
        let follow = if mimics && k > 0 { format!(r#"<mimic joint="{name}0j"/>"#) } else { String::new() };
        let own = format!("{name}{k}");
        parts += &link(&own, 0.005, [0.02, 0.0, 0.0], [1e-5; 3], &ball);
        let limit = r#"<limit lower="-1.5" upper="1.5" effort="1" velocity="10"/>"#;
        let inner = format!(r#"<origin xyz="{place}"/><axis xyz="0 1 0"/>{limit}{follow}"#);
        parts += &joint(&format!("{own}j"), "revolute", [&above, &own], &inner);
    }
    parts
}

/// A body of 71 kg that falls on four such fingers.
fn hands(mimics: bool) -> String {
    let body = link("body", 71.0, [0.0; 3], [2.0, 2.5, 1.5], &collision([0.0; 3], r#"<box size="0.5 0.4 0.2"/>"#));
    let fingers = [[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]].into_iter().enumerate();
    urdf(&[vec![body], fingers.map(|(k, at)| finger(&format!("f{k}"), at, mimics)).collect()].concat())
}

/// Two links of 1 kg in a row, then two of 1 g, which whip.
fn arm(limits: bool) -> String {
    let mut parts = vec![base()];
    for (k, mass) in [1.0, 1.0, 1e-3, 1e-3].into_iter().enumerate() {
        let (above, place) = if k == 0 { ("base".into(), "0 0 1.2") } else { (format!("l{}", k - 1), "0.25 0 0") };
        let own = format!("l{k}");
        let inertia = mass * 0.25f64.powi(2) / 12.0;
        parts.push(link(
            &own,
            mass,
            [0.125, 0.0, 0.0],
            [inertia; 3],
            &collision([0.25, 0.0, 0.0], r#"<sphere radius="0.02"/>"#),
        ));
        let limit = if limits { r#"<limit lower="-0.6" upper="0.6" effort="500" velocity="10"/>"# } else { "" };
        let kind = if limits { "revolute" } else { "continuous" };
        // Damping brings the heavy links to rest.
        let damped = if k < 2 && !limits { r#"<dynamics damping="0.2"/>"# } else { "" };
        parts.push(joint(
            &format!("{own}j"),
            kind,
            [&above, &own],
            &format!(r#"<origin xyz="{place}"/><axis xyz="0 1 0"/>{limit}{damped}"#),
        ));
    }
    urdf(&parts)
}

#[test]
fn a_limp_fall_gives_no_energy() {
    let tilted = |state: &mut [f64]| {
        state[2] += 0.4;
        state[3..7].copy_from_slice(&[0.2, 0.1, 0.0, (1.0f64 - 0.05).sqrt()]);
    };
    let stretched = |state: &mut [f64]| state[..4].copy_from_slice(&[0.0, 0.3, 0.5, -0.5]);
    let falls = [
        ("light fingers under 71 kg", rise(&hands(false), true, tilted)),
        ("fingers that follow", rise(&hands(true), true, tilted)),
        ("an arm with a light end", rise(&arm(false), false, stretched)),
        ("limits hit hard", rise(&arm(true), false, stretched)),
    ];
    assert!(falls.iter().all(|(_, rise)| *rise < 1e-4), "{falls:?}");
}
