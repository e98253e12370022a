//! Frames per second of the analytic solvers on one thread: a batch of 64 is stepped as the solvers step it, and the
//! state is checked to be finite in the same run. `cargo bench -p nerd-sim --bench solvers`; the report's time is that of
//! 64 frames, "thrpt" is frames per second.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nerd_sim::articulated::Integrator;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{self, Start};

const ENVIRONMENTS: usize = 64;
/// After so many frames a batch starts anew, so that every sample sees the same mix of flight and contact.
const EPISODE: usize = 100;

fn bench(c: &mut Criterion, name: &str, robot: &str, scene: &str, mut solver: impl Solver) {
    let system = System::named(robot).expect("built in");
    let mut start = Batch::new(&system, &system.scene(scene).expect("scene"), ENVIRONMENTS);
    for env in 0..ENVIRONMENTS {
        start.reset(env, &sampling::start(&system, Start::Reset, &mut sampling::stream(0, env as u64)));
    }
    let torques = vec![0.0; ENVIRONMENTS * system.robot.joint_count()];
    let (mut batch, mut frame) = (start.clone(), 0);
    let mut group = c.benchmark_group(format!("{robot} {scene}"));
    group.throughput(Throughput::Elements(ENVIRONMENTS as u64));
    group.bench_function(name, |b| {
        b.iter(|| {
            if frame % EPISODE == 0 {
                batch.states.copy_from_slice(&start.states);
            }
            frame += 1;
            solver.step(&mut batch, &torques).expect("finite");
        });
    });
    assert!(batch.states.iter().all(|x| x.is_finite()), "{name}: the state is not finite");
    group.finish();
}

fn articulated(robot: &str, integrator: Integrator, substeps: usize) -> Articulated {
    let system = System::named(robot).expect("built in");
    Articulated::new(ArticulatedConfig { integrator, substeps, ..ArticulatedConfig::paper(&system, Friction::Coulomb) })
}

fn solvers(c: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("first pool");
    for robot in ["cartpole", "pendulum"] {
        bench(c, "articulated RK4 x1", robot, "free", articulated(robot, Integrator::Rk4, 1));
        bench(c, "articulated Euler x5", robot, "free", articulated(robot, Integrator::SymplecticEuler, 5));
    }
    // The reference's substeps.
    for (robot, scene, substeps) in [("pendulum", "ground1", 5), ("cube", "ground", 20), ("ant", "ground", 16), ("anymal", "ground", 10)] {
        bench(c, &format!("articulated paper x{substeps}"), robot, scene, articulated(robot, Integrator::SymplecticEuler, substeps));
    }
    #[cfg(feature = "rapier")]
    {
        for n in [1, 4, 16, 64] {
            bench(c, &format!("rapier {n}x1"), "pendulum", "free", Rapier::new(RapierConfig::substeps(n)));
        }
        bench(c, "rapier 4x4", "pendulum", "ground1", Rapier::new(RapierConfig::default()));
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(3));
    targets = solvers
}
criterion_main!(benches);
