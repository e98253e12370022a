//! Free roots that rotate fast about a centre of mass away from the root's origin.

use super::*;

/// A body with an arm, low above the plane or in a free scene. Angular velocities are up to `spin` rad/s an axis.
fn spinning(scene: &str, spin: f64, config: ArticulatedConfig) -> Case {
    let trunk = link(
        "trunk",
        1.0,
        [0.05, 0.02, 0.03],
        [3e-3, 5e-3, 7e-3],
        &collision([0.0; 3], r#"<box size="0.3 0.2 0.05"/>"#),
    );
    let arm = link(
        "arm",
        0.1,
        [0.0, 0.0, 0.1],
        [1e-4, 1e-4, 2e-5],
        &collision([0.0, 0.0, 0.2], r#"<sphere radius="0.02"/>"#),
    );
    let hinge = joint(
        "hinge",
        "continuous",
        ["trunk", "arm"],
        r#"<origin xyz="0.1 0 0"/><axis xyz="0 1 0"/><dynamics damping="0.01"/>"#,
    );
    let system = Arc::new(System::bare("spinner", &urdf(&[trunk, arm, hinge]), true).expect("a robot"));
    let mut batch = batch(&system, scene, 24);
    for env in 0..batch.len() {
        let (k, state) = (env as f64, batch.state_mut(env));
        (state[2], state[7]) = (0.25 + 0.05 * k.sin(), k.cos());
        let w = [1.0 + k, 2.3 * k, 0.7 * k].map(|x| spin * f64::sin(x));
        state[8..11].copy_from_slice(&w);
        (state[11], state[12], state[14]) = (-w[1] * state[2], w[0] * state[2], k.sin());
    }
    Case { torques: vec![0.05; batch.len()], batch, config }
}

#[test]
fn spins_are_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    for (scene, spin, substeps) in [("plane", 5.0, 4), ("plane", 60.0, 1), ("plane", 60.0, 8), ("free", 60.0, 4)] {
        let case = spinning(scene, spin, ArticulatedConfig::implicit(substeps, Friction::Coulomb));
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 2));
        assert!(
            double.states(0) < 1e-8 && single.states(2) < 0.05,
            "{scene} at {spin} rad/s, x{substeps}: {double:?}, {single:?}"
        );
    }
}

#[test]
fn kernels_go_back_over_spins() {
    let Some(compiler) = Compiler::find() else { return };
    for (scene, spin, substeps) in [("plane", 30.0, 4), ("plane", 30.0, 8), ("free", 10.0, 4)] {
        let case = spinning(scene, spin, ArticulatedConfig::implicit(substeps, Friction::Coulomb));
        let apart = back_apart(&case, &compiler, Real::F64);
        let median = apart[apart.len() / 2];
        // The angular velocity is found to a relative 1e-7. If the energy check asks for more than eight times the
        // substeps, gradients use eight times the substeps.
        assert!(median < 1e-6 && apart[apart.len() - 5] < 1e-5, "{scene} at {spin} rad/s, x{substeps}: {apart:?}");
    }
}
