//! A hand-written solver in the stability suite:
//! `cargo run --release --manifest-path examples/Cargo.toml -p sim-only`, or with words of rows behind `--`.
//!
//! The solver is semi-implicit Euler over nerd-core's articulated-body algorithm, without contact, joint limits or
//! damping. Flight and swinging come out right to first order; bodies fall through whatever they touch. The suite shows
//! both.

use std::sync::Arc;

use nerd_sim::prelude::*;
use nerd_sim::solver::{check, commit};
use nerd_suite::{Method, Suite};

/// The number of equal substeps a frame.
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
                let (q, twist) = robot.split(state);
                let mut velocity = twist.to_local(robot, q);
                let qdd = data.forward_dynamics(robot, q, &velocity, &tau, &batch.scenes[env].gravity);
                velocity.accelerate(qdd.map_err(|e| StepError::Solver(e.to_string()))?, h);
                velocity.advance(robot, state, h); // positions follow the new velocities
            }
        }
        commit(batch, &mut next, &mut faults)
    }
}

fn main() {
    let own = |substeps: usize| move |_: &Arc<System>| Box::new(Euler(substeps)) as Box<dyn Solver>;
    let ours = |_: &Arc<System>| {
        Box::new(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb))) as Box<dyn Solver>
    };
    let euler =
        [4, 64].map(|substeps| Method::new(format!("Euler x{substeps}"), own(substeps)).finer(own(4 * substeps)));
    let methods = euler.into_iter().chain([Method::new("articulated", ours)]).collect::<Vec<_>>();
    let words: Vec<String> = std::env::args().skip(1).collect();
    let suite = Suite::new().only(&words).unwrap_or_else(|error| {
        eprintln!("{error}");
        std::process::exit(2)
    });
    let lines = suite.run(&methods, |_done| ());
    println!(
        "{:<26} {:>9}   {}figure",
        "row",
        "limit",
        methods.iter().map(|m| format!("{:<20}", m.name)).collect::<String>()
    );
    for line in &lines {
        let cells = line.cells.iter().map(|cell| format!("{cell:<20}"));
        println!("{:<26} {:>9.1e}   {}{}", line.row, line.limit, cells.collect::<String>(), line.asked());
    }
}
