//! Frames per second of the analytic solvers on one thread: a batch of 64 is stepped as the solvers step it, and the
//! state is checked to be finite in the same run. `cargo bench -p nerd-sim --bench solvers`; the report's time is that of
//! 64 frames, "thrpt" is frames per second.

#[path = "../tests/common/mod.rs"]
mod common;

use common::*;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

/// After so many frames a batch starts anew, so that every sample sees the same mix of flight and contact.
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
    for (robot, scene) in [("cartpole", "free"), ("pendulum", "ground1"), ("cube", "ground"), ("ant", "ground"), ("anymal", "ground")] {
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

criterion_group!(benches, solvers);
criterion_main!(benches);
