//! Contact properties of an MJCF, with torsional and rolling friction: kernels against the solver.

use super::*;

/// Crawlers that come down and lie, turning, under torques.
fn crawling(scene: &str) -> Case {
    let system = crawler();
    let mut batch = batch(&system, scene, 40);
    drop_low(&mut batch);
    let d = system.robot.state_dim();
    for (env, state) in batch.states.chunks_exact_mut(d).enumerate() {
        let k = env as f64;
        (state[0], state[11], state[13], state[12]) =
            (0.3 * (1.3 * k).sin(), 2.0 * k.sin(), (0.7 * k).cos(), 3.0 * (2.1 * k).sin());
    }
    let torques: Vec<f64> = (0..40 * system.robot.joint_count()).map(|k| 0.3 * (k as f64 * 0.7).sin()).collect();
    let config = ArticulatedConfig::accurate(&system);
    let mut solver = Articulated::new(config);
    (0..15).for_each(|_| solver.step(&mut batch, &torques).expect("it can be stepped"));
    Case { batch, torques, config }
}

/// The same batch with one friction for every pair of geoms.
fn rubbed(case: &Case) -> Batch {
    let mut system = (*case.batch.system).clone();
    system.one_friction = Some(0.05);
    Batch { system: system.into(), ..case.batch.clone() }
}

#[test]
fn geoms_of_a_file_move_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    for scene in ["plane", "box"] {
        let case = crawling(scene);
        let reach = Reach::of(&case.batch);
        assert!(reach.paired && reach.turns, "{reach:?}");
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 3));
        assert!(double.states(0) < 1e-9 && double.forces < 1e-7, "on {scene}: {double:?}");
        assert!(single.states(1) < 1e-2, "on {scene} in f32: {single:?}");
        let loops = changed(&case.text(Real::F64), "#define UNROLLED 1\n", "#define UNROLLED 0\n");
        let looped = case.apart_by(&compiler, &loops, 3).states(0);
        assert!(looped < 1e-9, "on {scene} in loops: {looped:e}");
        // The file's friction acts: another friction gives another motion.
        let other = Case { batch: rubbed(&case), torques: case.torques.clone(), config: case.config };
        let apart = other.apart(&compiler, Real::F64, 3).states(0);
        let [mut own, mut rubbed] = [case.batch.clone(), other.batch.clone()];
        [&mut own, &mut rubbed]
            .into_iter()
            .for_each(|batch| Articulated::new(case.config).step(batch, &case.torques).expect("steps"));
        let differs = own.states.iter().zip(&rubbed.states).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
        assert!(apart < 1e-9 && differs > 1e-2, "on {scene}: {apart:e}, friction alone moves by {differs:e}");
    }
}

/// Torsional and rolling friction of a material, with margins: by the mass matrix and along the tree.
#[test]
fn what_resists_turns_does_so_as_in_the_solver() {
    let Some(compiler) = Compiler::find() else { return };
    let turning = |system: &System| {
        let mut system = system.clone();
        (system.spec.material.torsion, system.spec.material.rolling, system.spec.material.margin) = (0.02, 0.01, 0.004);
        Arc::new(system)
    };
    for (name, scene) in [("cube", "ground"), ("ant", "ground"), ("ant", "box")] {
        let mut case = sampled(name, scene, ArticulatedConfig::accurate(&built_in(name)));
        let system = turning(&case.batch.system);
        case.batch.scenes = vec![system.scene(scene).expect("its own"); case.batch.len()];
        case.batch.system = system;
        assert!(!Reach::of(&case.batch).paired && Reach::of(&case.batch).turns, "{name}");
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 2));
        assert!(double.states(0) < 1e-9 && double.forces < 1e-7, "{name} on {scene}: {double:?}");
        assert!(single.states(1) < 1e-2, "{name} on {scene} in f32: {single:?}");
    }
    let mut system = System::bare("chain", &chain(12), false).expect("a robot");
    system.spec.material = Material { stiffness: 300.0, damping: 1.0, friction_damping: 10.0, ..Material::default() };
    let system = turning(&system);
    let mut batch = batch(&system, "plane", 8);
    let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
    batch
        .states
        .iter_mut()
        .enumerate()
        .for_each(|(k, x)| *x = if k % d < joints { 0.2 * (k as f64).sin() } else { 0.0 });
    run(&mut implicit(4), &mut batch, 0.0, 20);
    let torques = vec![0.0; batch.len() * joints];
    let along = Case { batch, torques, config: ArticulatedConfig::implicit(64, Friction::Coulomb) }.apart(
        &compiler,
        Real::F64,
        1,
    );
    assert!(along.states(0) < 1e-9, "along the tree: {along:?}");
}

#[test]
fn kernels_go_back_over_what_resists_turns() {
    let Some(compiler) = Compiler::find() else { return };
    for scene in ["plane", "box"] {
        let case = crawling(scene);
        let [double, single] = [Real::F64, Real::F32].map(|real| back_apart(&case, &compiler, real));
        // Static friction depends on small differences, which f32 resolves less.
        assert!(double[39] < 1e-8 && single[20] < 1e-3, "on {scene}: {double:?}, f32 {single:?}");
    }
}
