//! What acts at a joint, against closed forms: a damper far too stiff for the substep dies away as `exp(-d t / I)`, or at
//! least without overshoot; a limit far too stiff holds; limits and position laws are right beyond a turn.

use std::sync::Arc;

use nerd_sim::prelude::*;

/// Hinges about z in a row, the rods of a fixed base 1 m long, with inertia `inertia` about their own joint, without gravity.
fn arm(inertias: &[f64], kind: &str, dynamics: &str, spec: &str, ground: bool) -> Arc<System> {
    let (mut links, mut joints, mut specs) = (String::new(), String::new(), String::new());
    for (k, i) in inertias.iter().enumerate() {
        let (parent, at) = if k == 0 { ("base".into(), 0) } else { (format!("l{}", k - 1), 1) };
        links += &format!(
            r#"<link name="l{k}"><inertial><mass value="1e-3"/><inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>
            <collision><origin xyz="0 0 0.05"/><geometry><sphere radius="0.1"/></geometry></collision></link>"#
        );
        joints += &format!(
            r#"<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{at} 0 0"/><axis xyz="0 0 1"/>{dynamics}</joint>"#
        );
        specs += &format!(
            "[[joint]]\nname = \"j{k}\"\n{spec}\nsample = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\nreset = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\n"
        );
    }
    let urdf = format!(r#"<robot name="arm"><link name="base"/>{links}{joints}</robot>"#);
    let ground = if ground { "[[scene]]\nname = \"ground\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n" } else { "" };
    let toml = format!(
        "urdf = \"\"\nfloating = false\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, 0.0]\nsubsteps = 16\nmaterial = {{ stiffness = 1e4, damping = 10.0, friction_damping = 10.0, friction = 0.5 }}\n{specs}{ground}"
    );
    Arc::new(System::from_text("arm", &urdf, Some(&toml)).expect("an arm"))
}

fn presets(system: &System) -> [(&'static str, ArticulatedConfig); 4] {
    let law = Friction::Coulomb;
    [
        ("paper", ArticulatedConfig::paper(system, law)),
        ("explicit", ArticulatedConfig::explicit(8, law)),
        ("implicit", ArticulatedConfig::implicit(4, law)),
        ("converged", ArticulatedConfig::converged(law)),
    ]
}

/// States by frame from `state`.
fn run(system: &Arc<System>, scene: &str, config: ArticulatedConfig, state: &[f64], tau: f64, frames: usize) -> Vec<Vec<f64>> {
    let mut batch = Batch::new(system, &system.scene(scene).expect("scene"), 1);
    batch.reset(0, state);
    let mut solver = Articulated::new(config);
    let torques = vec![tau; system.robot.joint_count()];
    let mut step = |_| {
        solver.step(&mut batch, &torques).expect("finite");
        batch.states.clone()
    };
    (0..frames).map(&mut step).collect()
}

/// From soft to 1e5 times too stiff: never past zero, never faster, never slower than a hundredth of what it was after 40 time
/// constants and two frames; the accurate presets follow the exponential.
#[test]
fn a_damper_of_any_stiffness_dies_away() {
    for damping in [1e-3, 0.05, 0.3, 1.0, 10.0, 1e4] {
        let system = arm(&[1e-3], "continuous", &format!(r#"<dynamics damping="{damping}" friction="0"/>"#), "", true);
        for (name, config) in presets(&system) {
            for scene in ["free", "ground"] {
                let mut before = 1.0;
                for (k, state) in run(&system, scene, config, &[0.0, 1.0], 0.0, 30).iter().enumerate() {
                    let (v, exact) = (state[1], (-damping / 1e-3 * (k + 1) as f64 / 60.0).exp());
                    let place = format!("{name}, {scene}, d = {damping}, frame {k}: {v:e} rad/s, textbook {exact:e}");
                    assert!((0.0..=before).contains(&v), "overshoot: {place}");
                    // The ball presses on the plane from where the axis meets it, so contact has no arm.
                    let allowed = if name == "implicit" || name == "converged" { 0.02 } else { 0.2 };
                    assert!((v - exact).abs() < allowed, "{place}");
                    before = v;
                }
                assert!(damping < 0.3 || before < 1e-6, "{name}, {scene}, d = {damping}: {before:e} rad/s are left after 0.5 s");
            }
        }
    }
}

/// Light links in a row make a damper stiffer than each joint's own inertia says. Energy falls, whatever the preset.
#[test]
fn coupled_dampers_take_energy_only() {
    for damping in [1e-4, 1e-3, 1e-2, 0.1, 1.0, 100.0] {
        let dynamics = format!(r#"<dynamics damping="{damping}" friction="0"/>"#);
        let system = arm(&[1e-4; 6], "continuous", &dynamics, "", false);
        for (name, config) in presets(&system) {
            let start: Vec<f64> = (0..12).map(|k| if k < 6 { 0.3 } else { [1.0, -1.0][k % 2] }).collect();
            let mut data = nerd_core::dynamics::Data::new(&system.robot);
            let mut energy = |s: &[f64]| nerd_core::dynamics::totals(&system.robot, s, &mut data).kinetic;
            let (first, mut before) = (energy(&start), f64::INFINITY);
            for (k, state) in run(&system, "free", config, &start, 0.0, 60).iter().enumerate() {
                let e = energy(state);
                assert!(e <= before.min(1.05 * first) * 1.001, "{name}, d = {damping}, frame {k}: {e:e} J, before {before:e} of {first:e}");
                before = e;
            }
        }
    }
}

/// A joint thrown at a stop far too stiff for the substep: it is held within the depth `v sqrt(I / k)` of its spring or what
/// a substep travels, and comes back no faster than it went.
#[test]
fn a_limit_of_any_stiffness_holds() {
    for (stiffness, damping) in [(1e3, 1.0), (1e5, 0.0), (1e7, 100.0), (1e9, 0.0)] {
        let spec = format!("limit = {{ stiffness = {stiffness:?}, damping = {damping:?} }}");
        let limit = r#"<limit lower="-1" upper="1" effort="1" velocity="1"/>"#;
        let system = arm(&[1e-3], "revolute", limit, &spec, true);
        for (name, config) in presets(&system) {
            for scene in ["free", "ground"] {
                let states = run(&system, scene, config, &[0.0, 3.0], 0.0, 60);
                let deepest = states.iter().map(|s| s[0].abs() - 1.0).fold(f64::MIN, f64::max);
                let fastest = states.iter().map(|s| s[1].abs()).fold(0.0, f64::max);
                let allowed = 3.0 * (1e-3f64 / stiffness).sqrt() + 3.0 / 60.0 / 4.0;
                assert!(deepest < allowed, "{name}, {scene}, k = {stiffness:e}: {deepest} rad beyond, allowed {allowed}");
                assert!(fastest < 3.0 * 1.05, "{name}, {scene}, k = {stiffness:e}: {fastest} rad/s, came at 3");
            }
        }
    }
}

/// Limits of -1 and 6 rad: at 4 rad nothing acts, at 6.5 rad the upper one does, in our solver and in rapier.
#[test]
fn limits_wider_than_a_turn_act_where_they_are() {
    let limit = r#"<limit lower="-1" upper="6" effort="1" velocity="1"/>"#;
    let system = arm(&[0.1], "revolute", limit, "limit = { stiffness = 10.0, damping = 0.0 }", false);
    let mut solvers: Vec<(&str, Box<dyn Solver>)> =
        presets(&system).into_iter().map(|(n, c)| (n, Box::new(Articulated::new(c)) as Box<dyn Solver>)).collect();
    #[cfg(feature = "rapier")]
    solvers.push(("rapier", Box::new(Rapier::new(RapierConfig::default()))));
    for (name, solver) in &mut solvers {
        let mut last = |q: f64| {
            let mut batch = Batch::new(&system, &system.scene("free").expect("scene"), 1);
            batch.reset(0, &[q, 0.0]);
            (0..6).for_each(|_| solver.step(&mut batch, &[0.0]).expect("finite"));
            batch.states
        };
        let inside = last(4.0);
        assert!((inside[0] - 4.0).abs() < 1e-6 && inside[1].abs() < 1e-6, "{name}: at 4 rad it moves to {inside:?}");
        // A spring's first tenth of a second: 6 + 0.5 cos(10 t), I = 0.1 kg m^2.
        let (beyond, exact) = (last(6.5)[0], 6.0 + 0.5 * 1.0f64.cos());
        assert!((beyond - exact).abs() < 0.03, "{name}: from 6.5 rad to {beyond}, the spring's {exact}");
    }
}
