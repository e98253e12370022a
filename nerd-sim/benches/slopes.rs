//! What a frame's vector-Jacobian product costs beside the frame, on one thread: one gradient by state and torque for each of 64
//! environments, on states that random torques visit. `cargo bench -p nerd-sim --bench slopes`; "thrpt" is frames per second.

#[path = "../tests/common/mod.rs"]
mod common;

use common::*;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::RngExt;

const ENVS: usize = 64;
/// Frames after which robots that fell from `reset` are on the ground.
const FRAMES: usize = 60;

fn slopes(c: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("first pool");
    for (robot, scene) in [("ant", "ground"), ("anymal", "ground"), ("cartpole", "free")] {
        let (system, mut solver, mut random) = (built_in(robot), implicit(4), stream(0, 1));
        let mut batch = batch(&system, scene, ENVS);
        (0..ENVS).for_each(|env| batch.reset(env, &start(&system, Start::Reset, &mut stream(0, env as u64))));
        let amplitudes = system.torque_amplitudes();
        let mut pushed = || (0..ENVS).flat_map(|_| &amplitudes).map(|a| a * random.random_range(-1.0..=1.0)).collect::<Vec<f64>>();
        (0..FRAMES).for_each(|_| solver.step(&mut batch, &pushed()).expect("steps"));
        let (torques, by_next) = (pushed(), vec![1.0; ENVS * 2 * system.robot.nv()]);
        let mut group = c.benchmark_group(format!("{robot} {scene}"));
        group.throughput(Throughput::Elements(ENVS as u64)).sample_size(20).measurement_time(std::time::Duration::from_secs(3));
        group.bench_function("frame", |b| {
            b.iter(|| {
                let mut next = batch.clone();
                solver.step(&mut next, &torques).expect("finite");
                next
            });
        });
        group.bench_function("frame with back", |b| b.iter(|| solver.back(&batch, &torques, 1, &by_next).expect("finite")));
    }
}

criterion_group!(benches, slopes);
criterion_main!(benches);
