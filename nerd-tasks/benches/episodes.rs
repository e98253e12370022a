//! Benchmarks of a step of 64 Ant episodes: the task alone (without motion), and with the articulated solver.
//! `cargo bench -p nerd-tasks`.

use criterion::{Criterion, criterion_group, criterion_main};
use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, named};

const N: usize = 64;

/// A solver without motion.
struct Still;

impl Solver for Still {
    fn step(&mut self, batch: &mut Batch, _: &[f64]) -> Result<(), StepError> {
        batch.frames.iter_mut().for_each(|frames| *frames += 1);
        Ok(())
    }
}

fn step(c: &mut Criterion) {
    let system = System::named("ant").expect("built in");
    let solvers: [(&str, Box<dyn Solver>); 2] = [
        ("task alone", Box::new(Still)),
        ("articulated", Box::new(Articulated::new(ArticulatedConfig::accurate(&system)))),
    ];
    for (name, solver) in solvers {
        let batch = Batch::new(&system, &system.scene("ground").expect("built in"), N);
        let mut episodes = Episodes::new(named("ant-run").expect("built in"), Simulation { batch, solver }, 0);
        let actions = vec![0.1; N * episodes.task.action_dim()];
        c.bench_function(&format!("ant-run x {N}, {name}"), |b| {
            b.iter(|| episodes.step(&actions).expect("finite physics"))
        });
    }
}

criterion_group!(benches, step);
criterion_main!(benches);
