//! Robots of a family in the kernels, against their own solvers.

use super::*;

/// Sampled states of robots drawn from `spec`, with torques.
fn family(name: &str, scene: &str, spec: VarySpec) -> Case {
    let Case { batch: nominal, torques, config } = sampled(name, scene, ArticulatedConfig::accurate(&built_in(name)));
    let mut system = (*nominal.system).clone();
    system.spec.vary = Some(spec);
    let mut batch = vary::batch(&system.into(), scene, nominal.len(), 3).expect("a family");
    batch.states = nominal.states;
    Case { batch, torques, config }
}

/// Each robot of a family moves as in its own solver, whichever parameters vary, also behind an actuator and sensor
/// model.
#[test]
fn robots_of_a_family_move_as_their_solvers_have_them() {
    let Some(compiler) = Compiler::find() else { return };
    let range = |low, high| Some(Range { low, high });
    let (none, half) = (VarySpec::default(), range(0.5, 1.5));
    let all =
        VarySpec { mass: half, inertia: half, com: range(-0.02, 0.02), armature: range(0.0, 0.05), ..none.clone() };
    let rubbed =
        VarySpec { joint_damping: half, damping: range(0.0, 2.0), dry_friction: range(0.1, 4.0), ..all.clone() };
    let ground = VarySpec {
        friction: range(0.4, 1.2),
        stiffness: half,
        contact_damping: half,
        gravity: range(8.0, 11.0),
        ..none.clone()
    };
    let late = VarySpec { delay: range(0.0, 2.0), ..none.clone() };
    let rig = VarySpec {
        delay: late.delay,
        strength: half,
        zero: range(-0.1, 0.1),
        top_speed: range(1.0, 9.0),
        ripple: range(0.0, 20.0),
        ..rubbed
    };
    for (name, scene, spec) in [
        ("pendulum", "free", all.clone()),
        ("pendulum", "free", late),
        ("cartpole", "free", VarySpec { com: range(-0.1, 0.1), damping: range(0.0, 30.0), ..none.clone() }),
        ("ant", "ground", VarySpec { armature: range(0.0, 0.1), ..ground.clone() }),
        ("anymal", "ground", VarySpec { mass: half, ..ground }),
        ("franka", "free", all),
        ("ant", "ground", rig),
    ] {
        let told = format!("{name} on {scene}, {spec:?}");
        let rigged = spec.delay.is_some();
        let Case { mut batch, torques, config } = family(name, scene, spec);
        let (frames, n, joints) = (4, batch.len(), batch.system.robot.joint_count());
        let all: Vec<f64> =
            (0..frames).flat_map(|f| torques.iter().map(move |tau| tau * (1.0 - 0.6 * f as f64))).collect();
        let case = Case { batch: batch.clone(), torques: all.clone(), config };
        let motors = if rigged { ", b[8], b[9]" } else { "" };
        let kernel = format!("advance(b[0], b[1], b[2], b[3], b[4], 0, b[6], b[7], {n}, {frames}, 0{motors});");
        let buffers =
            [case.buffers(), [0, 4 * n, 4 * n, 16 * n * joints, 4 * n].map(|size| vec![0; size]).into()].concat();
        let reached = |real| {
            let found = compiler.launch(
                &case.text(real),
                &format!("for (; blockIdx.x < {n}; blockIdx.x++) {kernel}"),
                &buffers,
            );
            assert!(found[6].iter().all(|byte| *byte == 0), "{told}: faults {:?}", found[6]);
            doubles(&found[0])
        };
        let found = reached(Real::F64);
        let mut solver: Box<dyn Solver> = Box::new(Articulated::new(config));
        if rigged {
            solver = Box::new(Rig::new(solver));
        }
        let mut nominal = Batch { systems: Vec::new(), ..batch.clone() };
        for torques in all.chunks_exact(n * joints) {
            solver.step(&mut batch, torques).expect("it can be stepped");
            Articulated::new(config).step(&mut nominal, torques).expect("it can be stepped");
        }
        let apart = |found: &[f64], of: &Batch| {
            found.iter().zip(&of.states).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max)
        };
        let (double, other) = (apart(&found, &batch), apart(&found, &nominal));
        assert!(double < 1e-9 && other > 1e-3, "{told}: {double:e}, {other:e}");
        if name == "pendulum" {
            let single = apart(&reached(Real::F32), &batch);
            assert!(single < 1e-4, "{told}: in f32 {single:e}");
        }
    }
}

/// A motion without a GPU that steps a different robot in each environment.
#[cfg(feature = "cuda")]
struct Nowhere;

#[cfg(feature = "cuda")]
impl nerd_sim::articulated::device::Motion for Nowhere {
    fn capabilities(&self) -> Capabilities {
        Capabilities { systems: true, ..Capabilities::default() }
    }

    fn open(&mut self, _: &Batch, _: Reach) -> Result<(), StepError> {
        Ok(())
    }

    fn device(&self) -> Option<&nerd_cuda::Device> {
        None
    }

    fn advance(
        &mut self,
        _: &nerd_sim::articulated::device::Held,
        _: &[u64],
        _: usize,
        _: bool,
    ) -> Result<(), nerd_cuda::DeviceError> {
        Ok(())
    }

    fn frame(&self, _: &nerd_sim::articulated::device::Held) -> Result<(), nerd_cuda::DeviceError> {
        Ok(())
    }
}

/// On a GPU a family steps with its actuators and sensors; for a single robot that has them the solver refuses.
#[cfg(feature = "cuda")]
#[test]
fn motors_of_a_family_are_no_reason_to_refuse_it() {
    let late = VarySpec { delay: Some(Range { low: 1.0, high: 2.0 }), ..VarySpec::default() };
    let Case { mut batch, torques, .. } = family("pendulum", "free", late);
    let mut solver = nerd_sim::articulated::device::OnDevice::by(Nowhere);
    solver.step(&mut batch, &torques).expect("a family");
    batch.system = batch.systems.swap_remove(0);
    batch.systems.clear();
    let said = solver.step(&mut batch, &torques).expect_err("one late robot").to_string();
    assert!(said.contains("motors of its own"), "{said}");
}

/// Settings without kernels are refused before a GPU is looked for.
#[cfg(feature = "cuda")]
#[test]
fn settings_of_the_reference_are_refused() {
    let Case { mut batch, torques, config } = sampled("cube", "ground", ArticulatedConfig::accurate(&built_in("cube")));
    let (huber, explicit) =
        (ArticulatedConfig { friction: Friction::Huber, ..config }, ArticulatedConfig::explicit(4, Friction::Coulomb));
    for config in [huber, explicit, ArticulatedConfig { integrator: Integrator::SymplecticEuler, ..config }] {
        let said = nerd_sim::articulated::device::CudaArticulated::new(config, Real::F64).step(&mut batch, &torques);
        assert!(said.as_ref().is_err_and(|e| e.to_string().contains("have no kernels")), "{config:?}: {said:?}");
    }
}
