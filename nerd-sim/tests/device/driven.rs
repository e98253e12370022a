//! Drives of every kind, on a robot with more of them than a word has bits.

use super::*;

/// Legs of three joints, some with friction, some with limits so near that a substep meets both. The last foot mimics
/// its hip.
fn legged(legs: usize) -> String {
    let ball = collision([0.1, 0.0, 0.0], r#"<sphere radius="0.02"/>"#);
    let mut parts = vec![link("trunk", 3.0, [0.0; 3], [0.05; 3], "")];
    for (leg, k) in (0..legs).flat_map(|leg| (0..3).map(move |k| (leg, k))) {
        let above = if k == 0 { "trunk".into() } else { format!("l{leg}{}", k - 1) };
        let (range, top) = (if (leg + k) % 4 == 0 { 0.002 } else { 0.4 }, if leg % 3 == 0 { 1.0 } else { 20.0 });
        let (x, turn, rubs) =
            (if k == 0 { 0.0 } else { 0.1 }, if k == 0 { leg as f64 } else { 0.0 }, 0.05 * (leg % 2) as f64);
        let follows = if (leg + 1, k) == (legs, 2) {
            format!(r#"<mimic joint="j{leg}0" multiplier="-1.5"/>"#)
        } else {
            String::new()
        };
        let inner = format!(
            r#"<origin xyz="{x} 0 0" rpy="0 0 {turn}"/><axis xyz="0 {k} 1"/><limit lower="-{range}" upper="{range}" effort="50" velocity="{top}"/>
            <dynamics damping="0.01" friction="{rubs}"/>{follows}"#
        );
        parts.push(joint(&format!("j{leg}{k}"), "revolute", [&above, &format!("l{leg}{k}")], &inner));
        parts.push(link(&format!("l{leg}{k}"), 0.2, [0.05, 0.0, 0.0], [1e-4, 5e-4, 5e-4], &ball));
    }
    urdf(&parts)
}

#[test]
fn drives_of_every_kind_move_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    let toml = format!(
        "like = \"urdf\"\nfloating = true\nself_collision = false\n{GROUND}[[scene]]\nname = \"peg\"\n\
         plane = {{ height = 0.0, angles = [0.2, 0.1, 0.0] }}\npeg = [{{ radius = 0.1, height = 0.5, position = [0.1, 0.2, 0.0] }}]"
    );
    let (legged, chain) = (legged(12), chain(10));
    // A chain of this length whips, and is short enough for the mass matrix.
    for (text, floating, soft) in [(legged, true, 1.0), (chain, false, 1e-3)] {
        let toml = toml.replace("floating = true", &format!("floating = {floating}"));
        let system = Arc::new(System::from_text("driven", &text, Some(&toml)).expect("a robot"));
        let (robot, mut batch) = (&system.robot, batch(&system, "peg", 20));
        let (d, nq, coords, joints) = (robot.state_dim(), robot.nq(), robot.root_coords(), robot.joint_count());
        for (n, x) in batch.states.iter_mut().enumerate().filter(|(n, _)| n % d >= coords) {
            *x = if n % d < nq { 0.3 } else { 4.0 } * (1.3 * n as f64).sin();
        }
        let drive = |k: usize| {
            let (kp, kd) = [(0.0, 0.5), (80.0, 0.0), (0.0, 0.0), (50.0, 3.0), (1e5, 1e4)][k % 5];
            let effort = if k.is_multiple_of(4) { f64::INFINITY } else { 0.3 * soft * (k % 7) as f64 };
            Drive { kp: soft * kp, kd: 0.1 * soft * kd, target: 0.3 * (k as f64).sin(), speed: (k % 2) as f64, effort }
        };
        batch.drives = (0..20 * joints).map(drive).collect();
        for substeps in [1, 4] {
            let torques = vec![0.0; 20 * joints];
            let case = Case {
                batch: batch.clone(),
                torques,
                config: ArticulatedConfig::implicit(substeps, Friction::Coulomb),
            };
            let text = case.text(Real::F64).replace("#define UNROLLED 1\n", "#define UNROLLED 0\n");
            let by = |name: &str| {
                text.lines().find_map(|line| line.strip_prefix("#define ")?.strip_prefix(name)).map(str::trim)
            };
            assert_eq!([by("ALONG"), by("WHIPS")], [Some("0"), Some(if floating { "0" } else { "1" })]);
            let apart = case.apart_by(&compiler, &text, 1);
            assert!(apart.states(0) < 1e-8 && apart.forces < 1e-7, "floating {floating}, x{substeps}: {apart:?}");
        }
    }
}

#[test]
fn servos_move_as_the_solver_has_them_and_go_back() {
    let Some(compiler) = Compiler::find() else { return };
    let mut case = sampled("anymal", "ground", ArticulatedConfig::accurate(&built_in("anymal")));
    let mut system = (*case.batch.system).clone();
    system.spec.control.as_mut().expect("a position law").servo = true;
    // A velocity law, and a joint without a law.
    (system.spec.joints[1].kp, system.spec.joints[2].kp, system.spec.joints[2].kd) = (0.0, 0.0, 0.0);
    (case.batch.system, case.batch.servo) = (Arc::new(system), true);
    let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 1));
    assert!(double.states(0) < 1e-9 && double.forces < 1e-7 && single.states(0) < 1e-3, "{double:?}, f32 {single:?}");
    let [double, single] = [Real::F64, Real::F32].map(|real| back_apart(&case, &compiler, real));
    assert!(double[39] < 1e-9 && single[38] < 1e-3 && single[39] < 0.1, "{double:?}, f32 {single:?}");
}
