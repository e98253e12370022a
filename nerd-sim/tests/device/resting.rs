//! Robots that creep at rest: their frames take more substeps than asked for.

use super::*;

/// ANYmals that lie limp, at one substep a frame, from slightly different poses.
fn lying() -> Case {
    let system = built_in("anymal");
    let mut batch = batch(&system, "ground", 4);
    let d = system.robot.state_dim();
    for (env, state) in batch.states.chunks_exact_mut(d).enumerate() {
        (0..system.robot.joint_count()).for_each(|joint| state[7 + joint] += 0.02 * (env as f64 + 1.0).sin());
    }
    run(&mut implicit(1), &mut batch, 0.0, 900);
    Case { batch, torques: vec![0.0; 48], config: ArticulatedConfig::implicit(1, Friction::Coulomb) }
}

#[test]
fn frames_at_rest_have_four_substeps_on_both() {
    let case = lying();
    let after = |substeps: usize| {
        let mut batch = case.batch.clone();
        run(&mut implicit(substeps), &mut batch, 0.0, 1);
        batch.states
    };
    assert_eq!(after(1), after(4), "one substep at rest is not four");
    let Some(compiler) = Compiler::find() else { return };
    let one = case.apart(&compiler, Real::F64, 1);
    let gradients = back_apart(&case, &compiler, Real::F64);
    assert!(one.states(0) < 1e-9 && gradients[3] < 1e-6, "{one:?}, gradients {gradients:?}");
}
