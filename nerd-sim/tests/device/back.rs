//! Gradients of frames: kernels against the solver.

use super::*;

#[test]
fn kernels_go_back_as_the_solver_does() {
    let Some(compiler) = Compiler::find() else { return };
    let on_ground =
        [("pendulum", "ground1"), ("cube", "ground"), ("cube", "box"), ("ant", "ground"), ("anymal", "ground")];
    let flying = ["pendulum", "cartpole", "franka", "ant", "cube"].map(|name| (name, "free"));
    let mut cases: Vec<Case> = on_ground
        .into_iter()
        .chain(flying)
        .map(|(name, scene)| sampled(name, scene, ArticulatedConfig::accurate(&built_in(name))))
        .collect();
    // So fast that the energy check of every third frame requires more substeps.
    for fast in [0, 5] {
        cases[fast].batch.states.chunks_exact_mut(4).flat_map(|state| &mut state[2..]).for_each(|v| *v *= 2.0);
    }
    // Drives, some of them at their torque limit, on the ground and in the free scene.
    for scene in ["ground", "free"] {
        let mut case = sampled("ant", scene, ArticulatedConfig::accurate(&built_in("ant")));
        let drive = |k: usize| Drive { kp: 50.0, kd: 3.0, target: 0.5 * (k as f64).sin(), speed: 0.1, effort: 8.0 };
        case.batch.drives = (0..case.torques.len()).map(drive).collect();
        cases.push(case);
    }
    // Joints with friction and springs, one too stiff for its substep, in the free scene.
    let mut system = System::bare("chain", &chain(1), false).expect("a robot");
    for (joint, numbers) in system.robot.joints_mut().zip([(0.02, 0.4, 1e-4), (50.0, -0.3, 2e-4)]) {
        (joint.stiffness, joint.rest, joint.friction) = numbers;
    }
    let mut batch = batch(&Arc::new(system), "free", 40);
    batch.states.iter_mut().enumerate().for_each(|(k, x)| *x = 0.5 * (k as f64).sin());
    cases.push(Case { batch, torques: vec![1e-3; 80], config: ArticulatedConfig::implicit(4, Friction::Coulomb) });
    for case in cases {
        let what = format!("{} on {}", case.batch.system.name, case.batch.scenes[0].name);
        let [double, single] = [Real::F64, Real::F32].map(|real| back_apart(&case, &compiler, real));
        // In one environment f32 may take the other side of a kink, or suffer cancellation of far larger gradients.
        assert!(double[39] < 1e-9 && single[38] < 1e-3 && single[39] < 0.1, "{what}: {double:?}, f32 {single:?}");
    }
}

#[test]
fn frames_finer_than_is_kept_go_back_by_what_is_kept() {
    let Some(compiler) = Compiler::find() else { return };
    let mut case = sampled("pendulum", "ground1", ArticulatedConfig::implicit(1, Friction::Coulomb));
    case.batch.states.chunks_exact_mut(4).flat_map(|state| &mut state[2..]).for_each(|v| *v *= 6.0);
    let apart = back_apart(&case, &compiler, Real::F64);
    let whole = apart.iter().filter(|off| **off < 1e-9).count();
    assert!(
        (1..apart.len()).contains(&whole),
        "{whole} of {} frames as the solver: some should ask for more than is kept, not all",
        apart.len()
    );
}
