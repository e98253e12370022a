//! Somebody's own solver held against the stability suite:
//! `cargo run --release --manifest-path examples/Cargo.toml -p sim-only`, or with words of rows behind `--`.
//!
//! It is semi-implicit Euler over nerd-core's articulated-body algorithm, without contact, joint limits or damping. What flies
//! or swings comes out right to first order; whatever touches something falls through it. The suite says which is which.

use std::sync::Arc;

use nerd_sim::instruments::glide;
use nerd_sim::nerd_core::dynamics::{Data, aba, kinematics, to_local, to_world};
use nerd_sim::nerd_core::state::vector;
use nerd_sim::prelude::*;
use nerd_sim::solver::{check, commit};
use nerd_sim::suite::{Error, Method, Suite};

/// So many equal substeps a frame.
struct Euler(usize);

impl Solver for Euler {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let (mut next, mut faults) = (batch.states.clone(), Vec::new());
        check(batch, torques, &mut faults)?;
        let (system, h) = (batch.system.clone(), batch.system.frame_time / self.0 as f64);
        let (robot, mut data) = (&system.robot, Data::new(&system.robot));
        for (env, state) in next.chunks_exact_mut(robot.state_dim()).enumerate() {
            let mut tau = vec![0.0; robot.root_dofs()];
            tau.extend(&torques[env * robot.joint_count()..][..robot.joint_count()]);
            for _ in 0..self.0 {
                let (q, qd) = state.split_at_mut(robot.nq());
                to_local(robot, q, qd); // a floating root's velocity is then (w, p_dot)
                kinematics(robot, q, &mut data);
                if !aba(robot, qd, &tau, &batch.scenes[env].gravity, &mut data) {
                    return Err(StepError::Solver("a link has no inertia".into()));
                }
                if robot.floating() {
                    let turning = vector(qd).cross(&vector(&qd[3..6])); // p_ddot of a spatial acceleration
                    (0..3).for_each(|k| data.qdd[3 + k] += turning[k]);
                }
                qd.iter_mut().zip(data.qdd.iter()).for_each(|(v, a)| *v += a * h);
                to_world(robot, q, qd);
                glide(&system, state, h); // positions follow the new velocities
            }
        }
        commit(batch, &mut next, &mut faults)
    }
}

fn main() -> Result<(), Error> {
    let own = |substeps: usize| move |_: &Arc<System>| Box::new(Euler(substeps)) as Box<dyn Solver>;
    let methods = [Method::new("Euler x4", own(4)).finer(own(16)), Method::new("Euler x64", own(64)).finer(own(256)), Method::converged()];
    let words: Vec<String> = std::env::args().skip(1).collect();
    let lines = Suite::new().only(&words)?.run(&methods, |_done| ());
    println!("{:<26} {:>9}   {}", "row", "limit", methods.each_ref().map(|m| format!("{:<20}", m.name())).concat());
    for line in &lines {
        let cells = line.cells.iter().map(|cell| format!("{cell:<20}"));
        println!("{:<26} {:>9.1e}   {}", line.row, line.limit, cells.collect::<String>());
    }
    Ok(())
}
