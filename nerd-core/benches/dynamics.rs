//! Benchmarks of RNEA, CRBA and ABA on random trees of 2 to 18 DoF (14: an ant, 18: a quadruped, both with floating
//! base). `cargo bench -p nerd-core --bench dynamics`.
#![allow(missing_docs)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::*;
use criterion::{Criterion, criterion_group, criterion_main};
use nerd_core::dynamics::{Data, Factor, aba, bias, crba, kinematics};
use nerd_core::velocity::LocalVelocity;

fn dynamics(c: &mut Criterion) {
    for (dofs, floating) in [(2, false), (7, false), (14, true), (18, true)] {
        let mut rng = Rng::seed_from_u64(dofs as u64);
        let robot = robot(&mut rng, if floating { dofs - 6 } else { dofs }, floating);
        let ((q, LocalVelocity(qd)), tau) = (state(&mut rng, &robot), values(&mut rng, dofs, 20.0));
        let (mut data, mut factor, mut x) = (Data::new(&robot), Factor::new(&robot), tau.clone());
        c.bench_function(&format!("kinematics, bias, crba, factor, solve: {dofs} dof"), |b| {
            b.iter(|| {
                kinematics(&robot, black_box(&q), &mut data);
                bias(&robot, black_box(&qd), &GRAVITY, &mut data);
                crba(&robot, &mut data);
                assert!(factor.refill(&data.mass));
                x.iter_mut().zip(&tau).zip(data.tau.iter()).for_each(|((x, t), c)| *x = t - c);
                factor.solve(&mut x);
            });
        });
        c.bench_function(&format!("kinematics, aba: {dofs} dof"), |b| {
            b.iter(|| {
                kinematics(&robot, black_box(&q), &mut data);
                assert!(aba(&robot, black_box(&qd), black_box(&tau), &GRAVITY, &mut data));
            });
        });
        // The timed calls must agree: both give the same accelerations.
        let difference = gap(&x, data.qdd.as_slice());
        assert!(difference < 1e-10, "{dofs} dof: the two differ by {difference:.1e}");
        // The public method, which includes kinematics.
        let velocity = LocalVelocity(qd);
        c.bench_function(&format!("forward_dynamics: {dofs} dof"), |b| {
            b.iter(|| {
                data.forward_dynamics(&robot, black_box(&q), &velocity, black_box(&tau), &GRAVITY).map(|qdd| qdd[0])
            });
        });
    }
}

criterion_group!(benches, dynamics);
criterion_main!(benches);
