//! Planners: what they reach, that each environment is planned for alone, and what the solver that looks ahead remembers.

use std::sync::{Arc, Mutex};

use nerd_sim::prelude::*;
use nerd_tasks::plan::{Mppi, MppiConfig, Planner};
use nerd_tasks::{Episodes, named};

const CONFIG: MppiConfig = MppiConfig { samples: 16, steps: 48, noise: 0.15, hold: 4, temperature: 3.0, rounds: 1, seed: 1 };

/// Environments `first ..` of Cartpole.
fn cartpole(solver: impl Solver + 'static, first: usize, n: usize) -> Episodes {
    let system = System::named("cartpole").expect("built in");
    let batch = Batch::new(&system, &system.scene("free").expect("known"), n);
    Episodes::part(named("cartpole-swingup").expect("registered"), Simulation::new(batch, solver), 3, first)
}

fn quick() -> Articulated {
    Articulated::new(ArticulatedConfig::explicit(1, Friction::Coulomb))
}

#[test]
fn mppi_swings_poles_up_each_as_if_it_were_alone() {
    let truth = |first, n| cartpole(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb)), first, n);
    let (mut all, mut alone) = (truth(0, 3), truth(2, 1));
    let [mut planner, mut other] = [3, 1].map(|n| Mppi::new(cartpole(quick(), 0, 16 * n), CONFIG));
    let mut largest = [0.0_f64; 3];
    for step in 0..220 {
        let actions = planner.act(&all).expect("of the same task");
        if step < 20 {
            assert_eq!(other.act(&alone).expect("of the same task"), actions[2..], "step {step}: a neighbour is heard");
            alone.step(&actions[2..]).expect("finite");
        }
        let result = all.step(&actions).expect("finite");
        assert!(result.terminated.iter().all(|over| !over), "step {step}: an episode is over");
        if step >= 180 {
            largest.iter_mut().zip(result.misses).for_each(|(most, miss)| *most = most.max(0.2 * miss.expect("of Cartpole")));
        }
    }
    println!("largest angles from upright in steps 180 to 220: {largest:.3?} rad");
    assert!(largest.iter().all(|angle| *angle < 0.2), "{largest:.3?}");
    let error = planner.act(&alone).expect_err("48 environments do not look ahead of one").to_string();
    assert!(error.contains("48 environments"), "{error}");
}

/// A solver whose cart gets the force of the frame before; it notes what it is told to remember.
struct Late {
    inner: Articulated,
    last: Vec<f64>,
    told: Arc<Mutex<Vec<f64>>>,
}

impl Solver for Late {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.last.resize(torques.len(), 0.0);
        let before = std::mem::replace(&mut self.last, torques.to_vec());
        self.inner.step(batch, &before)
    }

    fn reset(&mut self, env: usize) {
        self.last.iter_mut().skip(2 * env).take(2).for_each(|x| *x = 0.0);
    }

    fn remembered(&self, env: usize) -> Result<Vec<f64>, StepError> {
        Ok(self.last.get(2 * env..2 * env + 2).unwrap_or_default().to_vec())
    }

    fn recall(&mut self, env: usize, memory: &[f64]) -> Result<(), StepError> {
        self.reset(env);
        *self.told.lock().expect("one thread") = memory.to_vec();
        self.last.iter_mut().skip(2 * env).zip(memory).for_each(|(x, m)| *x = *m);
        Ok(())
    }
}

#[test]
fn who_looks_ahead_remembers_what_was_done() {
    let told = Arc::new(Mutex::default());
    let late = || Late { inner: quick(), last: Vec::new(), told: Arc::clone(&told) };
    let (mut truth, mut planner) = (cartpole(late(), 0, 1), Mppi::new(cartpole(late(), 0, 16), CONFIG));
    let mut before: Option<f64> = None;
    for step in 0..5 {
        let action = planner.act(&truth).expect("of the same task");
        truth.step(&action).expect("finite");
        if let Some(force) = before {
            assert_eq!(*told.lock().expect("one thread"), [force, 0.0], "step {step}");
        }
        before = Some(1500.0 * action[0]);
    }
    assert!(before.is_some_and(|force| force != 0.0), "nothing was done: {before:?}");
}
