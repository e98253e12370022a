//! Limits of a URDF act, whether or not a TOML says how stiff they are.

use std::sync::Arc;

use nerd_sim::prelude::*;

/// A grip hanging down, 0 to 0.08 m, 20 N.
fn grip(mass: f64) -> String {
    format!(
        r#"<robot name="grip"><link name="hand"/><link name="finger"><inertial><mass value="{mass}"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 0 -1"/><limit lower="0" upper="0.08" effort="20" velocity="1"/></joint></robot>"#
    )
}

/// An arm of links of 0.3 m, each on a hinge of half a turn about another axis.
fn arm(links: usize, floating: bool) -> String {
    let mut urdf = String::from(
        r#"<robot name="arm"><link name="l0"><inertial><mass value="3"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>"#,
    );
    for n in 1..=links {
        let axis = ["0 1 0", "0 0 1", "1 0 0"][n % 3];
        urdf += &format!(
            r#"<link name="l{n}"><inertial><origin xyz="0.15 0 0.02"/><mass value="{m}"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="9e-3" iyz="0" izz="9e-3"/></inertial></link><joint name="j{n}" type="revolute"><parent link="l{}"/><child link="l{n}"/><origin xyz="{x} 0 0"/><axis xyz="{axis}"/><limit lower="-1.6" upper="1.5" effort="5" velocity="5"/></joint>"#,
            n - 1,
            m = 1.0 / n as f64,
            x = if n == 1 { 0.0 } else { 0.3 },
        );
    }
    assert!(!floating || links > 0);
    urdf + "</robot>"
}

fn solvers(system: &System) -> [(&'static str, Articulated); 3] {
    let coulomb = Friction::Coulomb;
    [
        ("paper", ArticulatedConfig::paper(system, coulomb)),
        ("implicit", ArticulatedConfig::implicit(4, coulomb)),
        ("converged", ArticulatedConfig::converged(coulomb)),
    ]
    .map(|(name, config)| (name, Articulated::new(config)))
}

/// Largest excess over a limit's ends, as a share of its range, over two seconds under constant torques.
fn excess(system: &Arc<System>, solver: &mut Articulated, start: &[f64], tau: &[f64]) -> f64 {
    let mut batch = Batch::new(system, &system.scene("free").expect("empty"), 1);
    batch.reset(0, start);
    let mut worst = 0.0f64;
    for _ in 0..120 {
        solver.step(&mut batch, tau).expect("finite");
        let q = &batch.state(0)[system.robot.root_coords()..];
        for (q, limit) in q.iter().zip(system.robot.joints().map(|j| j.limit.expect("limited"))) {
            worst = worst.max((q - limit.upper).max(limit.lower - q) / (limit.upper - limit.lower));
        }
    }
    worst
}

#[test]
fn a_grip_stays_within_its_range() {
    // A heavy one, and a finger of 15 g.
    for mass in [0.2, 0.015] {
        let system = Arc::new(System::bare("grip", &grip(mass), false).expect("valid"));
        for (name, mut solver) in solvers(&system) {
            // Dropped through its range; pushed at its end by all its effort, and back.
            for (what, start, tau) in [("dropped", [0.0, 0.0], 0.0), ("pushed out", [0.08, 0.0], 20.0), ("pushed in", [0.0, 0.0], -20.0)] {
                let found = excess(&system, &mut solver, &start, &[tau]);
                assert!(found < 0.05, "{name}, {mass} kg, {what}: {:.1} % of the range beyond its end", 100.0 * found);
                assert!(tau == 0.0 || found > 1e-3, "{name}, {mass} kg, {what}: {found}, a limit is a spring");
            }
        }
    }
}

#[test]
fn arms_fall_into_their_limits_and_stay() {
    for (links, floating) in [(1, false), (3, false), (7, false), (5, true)] {
        let mut system = System::bare("arm", &arm(links, floating), floating).expect("valid");
        if floating {
            system.spec.gravity = [0.0; 3];
        }
        let system = Arc::new(system);
        for (name, mut solver) in solvers(&system) {
            let mut start = system.default_state();
            let rates = system.robot.nq() + system.robot.root_dofs();
            // Thrown against the stops.
            start[rates..].iter_mut().enumerate().for_each(|(i, v)| *v = if i % 2 == 0 { 3.0 } else { -3.0 });
            let found = excess(&system, &mut solver, &start, &vec![0.0; links]);
            assert!(found < 0.1, "{name}, {links} links: {:.1} % of the range beyond an end", 100.0 * found);
        }
    }
}

/// A TOML that says nothing of a limit leaves it acting; zeros switch it off; the built-in robots say all of theirs.
#[test]
fn what_is_said_counts() {
    let toml = |limit: &str| {
        format!(
            "floating = false\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, -9.81]\nsubsteps = 16\n[[joint]]\nname = \"grip\"\n{limit}sample = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\nreset = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\n"
        )
    };
    let limit = |text: &str| {
        let system = System::from_text("grip", &grip(0.2), Some(&toml(text))).expect("valid");
        system.robot.joints().next().and_then(|j| j.limit).map(|l| (l.stiffness, l.damping)).expect("limited")
    };
    // 0.2 kg at 1/960 s: 0.2 (0.2 960)^2 N/m would hold 20 N at 3.4 % of the range, 0.4 0.2 960 N s/m.
    let (stiffness, damping) = limit("");
    assert!((stiffness / 7372.8 - 1.0).abs() < 1e-9 && (damping / 76.8 - 1.0).abs() < 1e-9, "{stiffness} N/m, {damping} N s/m");
    assert_eq!(limit("limit = { stiffness = 0.0, damping = 0.0 }\n"), (0.0, 0.0));
    assert_eq!(limit("limit = { stiffness = 5.0, damping = 1.0 }\n"), (5.0, 1.0));
    for name in System::built_in() {
        let system = System::named(name).expect("built in");
        let silent: Vec<_> =
            system.robot.joints().zip(system.joint_specs()).filter(|(j, s)| j.limit.is_some() != s.limit.is_some()).collect();
        assert!(silent.is_empty(), "{name}: {silent:?}");
    }
}

/// A joint whose ends are one place has no range to divide by.
#[test]
fn a_joint_without_a_range_is_locked() {
    let urdf = grip(0.2).replace("upper=\"0.08\"", "upper=\"0\"");
    assert_ne!(urdf, grip(0.2), "the range is there to be changed");
    for urdf in [urdf.clone(), urdf.replace("effort=", "effort=\"0\" was=")] {
        let system = Arc::new(System::bare("grip", &urdf, false).expect("valid"));
        let limit = system.robot.joints().next().and_then(|j| j.limit).expect("a limit");
        assert!(limit.stiffness.is_finite() && limit.stiffness > 0.0, "stiffness {}", limit.stiffness);
        for (name, mut solver) in solvers(&system) {
            let mut batch = Batch::new(&system, &system.scene("free").expect("scene"), 1);
            let most = (0..120).map(|_| {
                solver.step(&mut batch, &[0.0]).expect("finite");
                batch.state(0)[0].abs()
            });
            let most = most.fold(0.0, f64::max);
            assert!(most < 4e-3, "{name}: a locked joint gives way by {most:.1e} m");
        }
    }
}
