//! Runs the stability suite on a hand-written solver:
//! `cargo run --release --manifest-path examples/Cargo.toml -p sim-only`.
//! Words after `--` select the rows with such a word in their names.
//!
//! The solver is semi-implicit Euler over nerd-core's articulated-body algorithm, without contact, joint limits or
//! damping. Flight and swinging have errors of first order in the substep; bodies fall through whatever they touch. The
//! suite shows both.

use std::sync::Arc;

use nerd_sim::prelude::*;
use nerd_sim::solver::{check, commit};
use nerd_suite::{Method, Suite};

/// Semi-implicit Euler with this number of equal substeps in a frame.
struct Euler(usize);

impl Solver for Euler {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let mut faults = Vec::new();
        check(batch, torques, &mut faults)?;
        let mut next = batch.states.clone();
        let system = batch.system.clone();
        let robot = &system.robot;
        let mut data = Data::new(robot);
        let h = system.frame_time / self.0 as f64; // a substep (s)
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
    let euler = |substeps: usize| move |_: &Arc<System>| Box::new(Euler(substeps)) as Box<dyn Solver>;
    let articulated = |_: &Arc<System>| {
        Box::new(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb))) as Box<dyn Solver>
    };
    let mut methods = Vec::new();
    for substeps in [4, 64] {
        methods.push(Method::new(format!("Euler x{substeps}"), euler(substeps)).finer(euler(4 * substeps)));
    }
    methods.push(Method::new("articulated", articulated));
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
