//! Gravity compensation, and armature and damping of a free root: kernels against the solver.

use super::*;

/// Trunks with two legs under torques, in the air or on the ground.
fn lifted(vary: &str) -> Case {
    let system =
        Arc::new(System::from_text("lifted", LIFTED, Some(&format!("like = \"urdf\"\n{vary}"))).expect("a robot"));
    let mut batch = vary::batch(&system, "ground", 20, 3).expect("a batch");
    (0..20).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(5, env as u64))));
    run(&mut Articulated::new(ArticulatedConfig::accurate(&system)), &mut batch, 0.0, 20);
    let torques = (0..20 * system.robot.joint_count()).map(|k| (k as f64 * 0.7).sin()).collect();
    Case { batch, torques, config: ArticulatedConfig::accurate(&system) }
}

#[test]
fn lifted_links_and_a_damped_root_move_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    for vary in ["", "[vary]\nmass = \"U(0.8, 1.2)\"\ncom = \"U(-0.02, 0.02)\""] {
        let case = lifted(vary);
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 3));
        assert!(double.states(0) < 1e-9 && single.states(1) < 1e-2, "{vary}: {double:?}, f32 {single:?}");
    }
}

#[test]
fn gradients_of_lifted_links_and_a_damped_root_are_those_of_the_solver() {
    let Some(compiler) = Compiler::find() else { return };
    for fly in [false, true] {
        let mut case = lifted("");
        if fly {
            let free = case.batch.system.scene("free").expect("a scene");
            case.batch.scenes.iter_mut().for_each(|scene| scene.clone_from(&free));
        }
        let apart = back_apart(&case, &compiler, Real::F64);
        assert!(apart[19] < 1e-9, "flying {fly}: {apart:?}");
    }
}
