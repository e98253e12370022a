//! Limits of a URDF act, with or without a stiffness in a TOML.

use super::common::*;

/// A gripper finger on a vertical slide: range 0 to 0.08 m, effort limit 20 N.
fn grip(mass: f64) -> String {
    let slide = r#"<axis xyz="0 0 -1"/><limit lower="0" upper="0.08" effort="20" velocity="1"/>"#;
    urdf(&[
        base(),
        link("finger", mass, [0.0; 3], [1e-4; 3], ""),
        joint("grip", "prismatic", ["base", "finger"], slide),
    ])
}

/// An arm of links of 0.3 m on hinges about z, x and y in turn, limited to -1.6 to 1.5 rad.
fn arm(links: usize) -> String {
    let mut parts = vec![link("l0", 3.0, [0.0; 3], [0.02; 3], "")];
    for n in 1..=links {
        let (axis, x) = (["0 1 0", "0 0 1", "1 0 0"][n % 3], if n == 1 { 0.0 } else { 0.3 });
        let hinge = format!(
            r#"<origin xyz="{x} 0 0"/><axis xyz="{axis}"/><limit lower="-1.6" upper="1.5" effort="5" velocity="5"/>"#
        );
        let [above, own] = [n - 1, n].map(|k| format!("l{k}"));
        parts.push(link(&own, 1.0 / n as f64, [0.15, 0.0, 0.02], [1e-3, 9e-3, 9e-3], ""));
        parts.push(joint(&format!("j{n}"), "revolute", [&above, &own], &hinge));
    }
    urdf(&parts)
}

/// Largest excess over a limit (rad or m), and as a share of its range, in two seconds under constant torques.
fn excess(system: &Arc<System>, config: ArticulatedConfig, start: &[f64], torque: f64) -> [f64; 2] {
    let states = motion(&mut Articulated::new(config), at(system, "free", start), torque, 120);
    let over = states.iter().flat_map(|state| {
        let limits = system.robot.joints().map(|j| j.limit.expect("limited"));
        state[system.robot.root_coords()..].iter().zip(limits).map(|(q, limit)| {
            let over = (q - limit.upper).max(limit.lower - q);
            [over, over / (limit.upper - limit.lower)]
        })
    });
    over.fold([0.0; 2], |most, x| [most[0].max(x[0]), most[1].max(x[1])])
}

#[test]
fn a_grip_stays_within_its_range() {
    // A heavy finger, and one of 15 g.
    for mass in [0.2, 0.015] {
        let system = Arc::new(System::bare("grip", &grip(mass), false).expect("valid"));
        for (name, config) in presets(&system) {
            // Dropped through its range, or pushed out or in at its ends by the full effort.
            for (what, start, tau) in
                [("dropped", [0.0, 0.0], 0.0), ("pushed out", [0.08, 0.0], 20.0), ("pushed in", [0.0, 0.0], -20.0)]
            {
                let [_, found] = excess(&system, config, &start, tau);
                assert!(found < 0.05, "{name}, {mass} kg, {what}: {:.1} % of the range beyond its end", 100.0 * found);
                assert!(tau == 0.0 || found > 1e-3, "{name}, {mass} kg, {what}: {found}, a limit is a spring");
            }
        }
    }
}

#[test]
fn arms_fall_into_their_limits_and_stay() {
    for (links, floating) in [(1, false), (3, false), (7, false), (5, true)] {
        let mut system = System::bare("arm", &arm(links), floating).expect("valid");
        if floating {
            system.spec.gravity = [0.0; 3];
        }
        let system = Arc::new(system);
        for (name, config) in presets(&system) {
            let mut start = system.default_state();
            let rates = system.robot.nq() + system.robot.root_dofs();
            // Joint velocities of 3 rad/s drive the arm against its limits.
            start[rates..].iter_mut().enumerate().for_each(|(i, v)| *v = if i % 2 == 0 { 3.0 } else { -3.0 });
            let [_, found] = excess(&system, config, &start, 0.0);
            assert!(found < 0.1, "{name}, {links} links: {:.1} % of the range beyond an end", 100.0 * found);
        }
    }
}

/// Without `limit` in the TOML, the URDF's limit acts; zeros switch it off; the built-in robots' TOMLs give every
/// limit.
#[test]
fn what_is_said_counts() {
    let limit = |text: &str| {
        let toml = keys(false, 9.81) + &joint_table("grip", text);
        let system = System::from_text("grip", &grip(0.2), Some(&toml)).expect("valid");
        system.robot.joints().next().and_then(|j| j.limit).map(|l| (l.stiffness, l.damping)).expect("limited")
    };
    // 0.2 kg at 1/960 s: `k = 0.2 (0.2 * 960)^2` N/m and `d = 0.4 * 0.2 * 960` N s/m. k holds 20 N at 3.4 % of the
    // range.
    let (stiffness, damping) = limit("");
    assert!(
        (stiffness / 7372.8 - 1.0).abs() < 1e-9 && (damping / 76.8 - 1.0).abs() < 1e-9,
        "{stiffness} N/m, {damping} N s/m"
    );
    assert_eq!(limit("limit = { stiffness = 0.0, damping = 0.0 }"), (0.0, 0.0));
    assert_eq!(limit("limit = { stiffness = 5.0, damping = 1.0 }"), (5.0, 1.0));
    for name in System::built_in() {
        let system = built_in(name);
        let mut pairs = system.robot.joints().zip(system.joint_specs());
        assert!(
            pairs.all(|(joint, said)| joint.limit.is_some() == said.limit.is_some()),
            "{name}: a limit of which nothing is said"
        );
    }
}

/// A joint with equal lower and upper limits is locked; it has no range to divide by.
#[test]
fn a_joint_without_a_range_is_locked() {
    let locked = changed(&grip(0.2), "upper=\"0.08\"", "upper=\"0\"");
    for urdf in [locked.clone(), locked.replace("effort=", "effort=\"0\" was=")] {
        let system = Arc::new(System::bare("grip", &urdf, false).expect("valid"));
        let limit = system.robot.joints().next().and_then(|j| j.limit).expect("a limit");
        assert!(limit.stiffness.is_finite() && limit.stiffness > 0.0, "stiffness {}", limit.stiffness);
        for (name, config) in presets(&system) {
            let [most, _] = excess(&system, config, &[0.0; 2], 0.0);
            assert!(most < 4e-3, "{name}: a locked joint gives way by {most:.1e} m");
        }
    }
}
