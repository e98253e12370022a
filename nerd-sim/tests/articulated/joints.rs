//! Forces at a joint against closed forms. Under a damper far too stiff for the substep the velocity decays as `exp(-d
//! t / I)`, or at least without overshoot. A limit far too stiff holds. Limits act beyond a full turn.

use super::common::*;

/// Hinges about z in a row, 1 m apart, on a fixed base without gravity; `inertias` are about each joint. Has a ground.
fn arm(inertias: &[f64], kind: &str, dynamics: &str, spec: &str) -> Arc<System> {
    let (mut parts, mut toml) = (vec![base()], keys(false, 0.0));
    toml += "material = { stiffness = 1e4, damping = 10.0, friction_damping = 10.0, friction = 0.5 }\n";
    for (k, i) in inertias.iter().enumerate() {
        let (name, above) = (format!("l{k}"), if k == 0 { "base".into() } else { format!("l{}", k - 1) });
        parts.push(link(&name, 1e-3, [0.0; 3], [*i; 3], &collision([0.0, 0.0, 0.05], r#"<sphere radius="0.1"/>"#)));
        let inner = format!(r#"<origin xyz="{} 0 0"/><axis xyz="0 0 1"/>{dynamics}"#, k.min(1));
        parts.push(joint(&format!("j{k}"), kind, [&above, &name], &inner));
        toml += &joint_table(&format!("j{k}"), spec);
    }
    Arc::new(System::from_text("arm", &urdf(&parts), Some(&(toml + GROUND))).expect("an arm"))
}

fn after(system: &Arc<System>, scene: &str, config: ArticulatedConfig, state: &[f64], frames: usize) -> Vec<Vec<f64>> {
    motion(&mut Articulated::new(config), at(system, scene, state), 0.0, frames)
}

/// A damper from soft to far too stiff for the substep: the velocity never changes sign and never grows. Presets
/// `implicit` and `converged` follow the exponential within 0.02 rad/s, the others within 0.2. From d = 0.3 N m s/rad
/// on, less than 1e-6 rad/s is left after 0.5 s.
#[test]
fn a_damper_of_any_stiffness_dies_away() {
    for damping in [1e-3, 0.05, 0.3, 1.0, 10.0, 1e4] {
        let system = arm(&[1e-3], "continuous", &format!(r#"<dynamics damping="{damping}" friction="0"/>"#), "");
        for ((name, config), scene) in
            presets(&system).into_iter().flat_map(|preset| ["free", "ground"].map(|scene| (preset, scene)))
        {
            let mut before = 1.0;
            for (k, state) in after(&system, scene, config, &[0.0, 1.0], 30).iter().enumerate() {
                let (v, exact) = (state[1], (-damping / 1e-3 * (k + 1) as f64 / 60.0).exp());
                let place = format!("{name}, {scene}, d = {damping}, frame {k}: {v:e} rad/s, textbook {exact:e}");
                assert!((0.0..=before).contains(&v), "overshoot: {place}");
                // The ball touches the plane where the axis meets it, so contact has no lever arm.
                let allowed = if name == "implicit" || name == "converged" { 0.02 } else { 0.2 };
                assert!((v - exact).abs() < allowed, "{place}");
                before = v;
            }
            assert!(
                damping < 0.3 || before < 1e-6,
                "{name}, {scene}, d = {damping}: {before:e} rad/s are left after 0.5 s"
            );
        }
    }
}

/// In a row of light links the effective inertia at a joint is far below the link's own. Dampers are stiffer there, and
/// the kinetic energy must still fall with every preset.
#[test]
fn coupled_dampers_take_energy_only() {
    for damping in [1e-4, 1e-3, 1e-2, 0.1, 1.0, 100.0] {
        let system = arm(&[1e-4; 6], "continuous", &format!(r#"<dynamics damping="{damping}" friction="0"/>"#), "");
        for (name, config) in presets(&system) {
            let start: Vec<f64> = (0..12).map(|k| if k < 6 { 0.3 } else { [1.0, -1.0][k % 2] }).collect();
            let mut data = Data::new(&system.robot);
            let mut energy = |s: &[f64]| totals(&system.robot, s, &mut data).kinetic;
            let (first, mut before) = (energy(&start), f64::INFINITY);
            for (k, state) in after(&system, "free", config, &start, 60).iter().enumerate() {
                let e = energy(state);
                assert!(
                    e <= before.min(1.05 * first) * 1.001,
                    "{name}, d = {damping}, frame {k}: {e:e} J, before {before:e} of {first:e}"
                );
                before = e;
            }
        }
    }
}

/// A joint thrown at a limit far too stiff for the substep. Penetration is at most `v sqrt(I / k)` plus the distance of
/// a substep of 1/240 s. The joint returns no faster than it came.
#[test]
fn a_limit_of_any_stiffness_holds() {
    let limit = r#"<limit lower="-1" upper="1" effort="1" velocity="1"/>"#;
    for (stiffness, damping) in [(1e3, 1.0), (1e5, 0.0), (1e7, 100.0), (1e9, 0.0)] {
        let system =
            arm(&[1e-3], "revolute", limit, &format!("limit = {{ stiffness = {stiffness:?}, damping = {damping:?} }}"));
        for ((name, config), scene) in
            presets(&system).into_iter().flat_map(|preset| ["free", "ground"].map(|scene| (preset, scene)))
        {
            let states = after(&system, scene, config, &[0.0, 3.0], 60);
            let deepest = states.iter().map(|s| s[0].abs() - 1.0).fold(f64::MIN, f64::max);
            let fastest = states.iter().map(|s| s[1].abs()).fold(0.0, f64::max);
            let allowed = 3.0 * (1e-3f64 / stiffness).sqrt() + 3.0 / 60.0 / 4.0;
            assert!(deepest < allowed, "{name}, {scene}, k = {stiffness:e}: {deepest} rad beyond, allowed {allowed}");
            assert!(fastest < 3.0 * 1.05, "{name}, {scene}, k = {stiffness:e}: {fastest} rad/s, came at 3");
        }
    }
}

/// Limits of -1 and 6 rad, in our solver and in rapier: none acts at 4 rad, the upper limit acts at 6.5 rad.
#[test]
fn limits_wider_than_a_turn_act_where_they_are() {
    let limit = r#"<limit lower="-1" upper="6" effort="1" velocity="1"/>"#;
    let system = arm(&[0.1], "revolute", limit, "limit = { stiffness = 10.0, damping = 0.0 }");
    let mut solvers: Vec<(&str, Box<dyn Solver>)> =
        presets(&system).into_iter().map(|(n, c)| (n, Box::new(Articulated::new(c)) as Box<dyn Solver>)).collect();
    #[cfg(feature = "rapier")]
    solvers.push(("rapier", Box::new(Rapier::new(RapierConfig::default()))));
    for (name, solver) in &mut solvers {
        let [inside, beyond] = [4.0, 6.5].map(|q| end(solver, at(&system, "free", &[q, 0.0]), 0.0, 6));
        // The spring's first tenth of a second: `q = 6 + 0.5 cos(10 t)` for I = 0.1 kg m^2 and k = 10 N m/rad.
        let exact = 6.0 + 0.5 * 1.0f64.cos();
        assert!((inside[0] - 4.0).abs() < 1e-6 && inside[1].abs() < 1e-6, "{name}: at 4 rad it moves to {inside:?}");
        assert!((beyond[0] - exact).abs() < 0.03, "{name}: from 6.5 rad to {}, the spring's {exact}", beyond[0]);
    }
}
