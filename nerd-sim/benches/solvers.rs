//! Frames per second of the analytic solvers on one thread, and the cost of a frame's vector-Jacobian product:
//! `cargo bench -p nerd-sim --bench solvers`.
//!
//! Each sample steps a batch of 64 environments, so times are for 64 frames and "thrpt" is frames per second. The state
//! is checked to be finite in the same run. A vector-Jacobian product is with respect to state and torque, on states
//! visited under random torques.

#[path = "../tests/common/mod.rs"]
mod common;

use common::*;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::RngExt;

/// Frames after which a batch starts anew, so that every sample sees the same mix of flight and contact.
const EPISODE: usize = 100;

fn bench(c: &mut Criterion, name: &str, robot: &str, scene: &str, mut solver: impl Solver) {
    let system = built_in(robot);
    let mut begun = batch(&system, scene, 64);
    (0..64).for_each(|env| begun.reset(env, &start(&system, Start::Reset, &mut stream(0, env as u64))));
    let torques = vec![0.0; 64 * system.robot.joint_count()];
    let (mut batch, mut frame) = (begun.clone(), 0);
    let mut group = c.benchmark_group(format!("{robot} {scene}"));
    group.throughput(Throughput::Elements(64)).sample_size(20).measurement_time(std::time::Duration::from_secs(3));
    group.bench_function(name, |b| {
        b.iter(|| {
            if frame % EPISODE == 0 {
                batch.states.copy_from_slice(&begun.states);
            }
            frame += 1;
            solver.step(&mut batch, &torques).expect("finite");
        });
    });
    assert!(batch.states.iter().all(|x| x.is_finite()), "{name}: the state is not finite");
}

fn solvers(c: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("first pool");
    for (robot, scene) in
        [("cartpole", "free"), ("pendulum", "ground1"), ("cube", "ground"), ("ant", "ground"), ("anymal", "ground")]
    {
        let system = built_in(robot);
        for (name, config) in [
            ("accurate", ArticulatedConfig::accurate(&system)),
            ("paper", ArticulatedConfig::paper(&built_in(&format!("{robot}-paper")), Friction::Coulomb)),
        ] {
            bench(c, name, robot, scene, Articulated::new(config));
        }
        #[cfg(feature = "rapier")]
        bench(c, "rapier", robot, scene, Rapier::new(RapierConfig::default()));
    }
}

fn gradients(c: &mut Criterion) {
    for (robot, scene) in [("ant", "ground"), ("anymal", "ground"), ("cartpole", "free")] {
        let (system, mut solver, mut random) = (built_in(robot), implicit(4), stream(0, 1));
        let mut batch = batch(&system, scene, 64);
        (0..64).for_each(|env| batch.reset(env, &start(&system, Start::Reset, &mut stream(0, env as u64))));
        let amplitudes = system.torque_amplitudes();
        let mut pushed =
            || (0..64).flat_map(|_| &amplitudes).map(|a| a * random.random_range(-1.0..=1.0)).collect::<Vec<f64>>();
        // 60 frames are enough for robots that fall from `reset` to reach the ground.
        (0..60).for_each(|_| solver.step(&mut batch, &pushed()).expect("steps"));
        let (torques, grad_next) = (pushed(), vec![1.0; 64 * 2 * system.robot.nv()]);
        let mut group = c.benchmark_group(format!("{robot} {scene}"));
        group.throughput(Throughput::Elements(64)).sample_size(20).measurement_time(std::time::Duration::from_secs(3));
        group.bench_function("frame", |b| {
            b.iter(|| {
                let mut next = batch.clone();
                solver.step(&mut next, &torques).expect("finite");
                next
            });
        });
        group.bench_function("frame with back", |b| {
            b.iter(|| solver.vjp(&batch, &torques, 1, &grad_next).expect("finite"))
        });
    }
}

criterion_group!(benches, solvers, gradients);
criterion_main!(benches);
