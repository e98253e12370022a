//! Planners: what they reach, that each environment is planned for alone, and what the solver that looks ahead remembers.

use std::sync::Mutex;

use nerd_sim::prelude::*;
use nerd_sim::solver::{Fault, Slopes, commit};
use nerd_tasks::formula::{Formulas, Number, Sight};
use nerd_tasks::plan::{Ilqr, IlqrConfig, Mppi, MppiConfig, Planner};
use nerd_tasks::{About, Episodes, Task, named};

use crate::episodes;

const CONFIG: MppiConfig = MppiConfig { samples: 16, steps: 48, noise: 0.15, hold: 4, temperature: 3.0, rounds: 1, seed: 1 };

/// Environments `first ..` of a task of Cartpole.
fn of(task: Box<dyn Task>, solver: impl Solver + 'static, seed: u64, first: usize, n: usize) -> Episodes {
    let system = System::named("cartpole").expect("built in");
    let batch = Batch::new(&system, &system.scene("free").expect("known"), n);
    Episodes::part(task, Simulation::new(batch, solver), seed, first)
}

fn cartpole(solver: impl Solver + 'static, first: usize, n: usize) -> Episodes {
    of(named("cartpole-swingup").expect("registered"), solver, 3, first, n)
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

/// A cart without friction, of 1 kg, whose pole does not move; it notes how many frames it went back through.
#[derive(Default)]
struct Rail {
    back: Arc<Mutex<Vec<usize>>>,
    /// Between 2 and 5 m/s backwards its slopes are no numbers, or a fault.
    bad: Option<Bad>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Bad {
    NotANumber,
    Fault,
}

/// Time of a frame of Cartpole (s).
const FRAME: f64 = 1.0 / 60.0;

impl Solver for Rail {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        next.chunks_exact_mut(4).zip(torques.chunks_exact(2)).for_each(|(state, tau)| state[2] += FRAME * tau[0]);
        commit(batch, &mut next, &mut Vec::new())
    }

    fn back(&mut self, batch: &Batch, _torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        self.back.lock().expect("one thread").push(batch.len());
        let bad = |env: usize, how: Bad| self.bad == Some(how) && (-5.0..-2.0).contains(&batch.state(env)[2]);
        let faults = (0..batch.len()).filter(|env| bad(*env, Bad::Fault)).map(|env| Fault { env, frame: 0, reason: "none".into() });
        let faults: Vec<Fault> = faults.collect();
        if !faults.is_empty() {
            return Err(StepError::Environments(faults));
        }
        let torques = by_next.chunks_exact(4).flat_map(|row| [FRAME * row[2], 0.0]).collect();
        let number = |k: usize| if bad(k / (4 * rows), Bad::NotANumber) { f64::NAN } else { 1.0 };
        let states = by_next.iter().enumerate().map(|(k, by)| number(k) * by).collect();
        Ok(Slopes { states, torques, ..Slopes::default() })
    }
}

/// Stop the cart, on which a brake of 6 N s/m acts.
struct Stop;

const BRAKE: f64 = 6.0;

impl Formulas for Stop {
    fn about(&self) -> About {
        About { name: "stop", robot: "cartpole", scene: "free", observation: 1, action: 1, steps: 500, frames: 2 }
    }
    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        out[0] = sight.qd(0);
    }
    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        torques.copy_from_slice(&[action[0] - N::from(BRAKE) * sight.qd(0), N::from(0.0)]);
    }
    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _: &[N]) -> N {
        -sight.qd(0).squared()
    }
    fn residuals<N: Number>(&self, sight: &mut impl Sight<N>) -> Vec<N> {
        vec![sight.qd(0)]
    }
}

/// Environments `first ..` in which a cart is to be stopped.
fn stops(rail: Rail, first: usize, n: usize) -> Episodes {
    of(Box::new(Stop), rail, 5, first, n)
}

#[test]
fn ilqr_of_a_linear_system_is_its_regulator() {
    let episodes = |n: usize| stops(Rail::default(), 0, n);
    let effort = 0.1;
    let config = IlqrConfig { steps: 300, effort, rounds: [1, 24], search: 3 };
    let (truth, mut planner) = (episodes(2), Ilqr::new(episodes(6), config).expect("it has residuals"));
    let found = planner.act(&truth).expect("linear");
    // v' = a v + b u costs v'^2 + effort u^2: with the square w of what comes, b^2 w^2 + (effort (1 - a^2) - b^2) w - effort = 0.
    let alpha = 1.0 - FRAME * BRAKE;
    let (a, b) = (alpha * alpha, (1.0 + alpha) * FRAME);
    let half = effort * (1.0 - a * a) - b * b;
    let w = (-half + (half * half + 4.0 * b * b * effort).sqrt()) / (2.0 * b * b);
    for (env, action) in found.iter().enumerate() {
        let wanted = -a * b * w / (effort + b * b * w) * truth.view(env).state[2];
        println!("environment {env}: action {action:.9}, the regulator's {wanted:.9}");
        assert!(wanted.abs() > 0.01 && wanted.abs() < 1.0 && (action - wanted).abs() < 1e-9, "{action} {wanted}");
    }
}

/// Environment 1 begins anew while environment 0 is under way, and its plan leads through where there are no slopes: neither changes what
/// environment 0 does, or how often its frames are gone back through; and environment 1 plans with the slopes before those.
#[test]
fn ilqr_plans_for_each_environment_as_if_it_were_alone() {
    let config = IlqrConfig { steps: 20, effort: 0.1, rounds: [1, 6], search: 3 };
    for bad in [None, Some(Bad::NotANumber), Some(Bad::Fault)] {
        let back = Arc::new(Mutex::default());
        let rail = || Rail { back: Arc::clone(&back), bad };
        let [mut planner, mut other] = [2, 1].map(|n| Ilqr::new(stops(rail(), 0, 3 * n), config).expect("it has residuals"));
        let (mut all, mut alone, mut again) = (stops(rail(), 0, 2), stops(rail(), 0, 1), 0);
        for step in 0..12 {
            if step == 4 {
                all.simulation.reset(1, &[0.0, 0.0, -20.0, 0.0]);
            }
            back.lock().expect("one thread").clear();
            let actions = planner.act(&all).unwrap_or_else(|error| panic!("{bad:?}, step {step}: {error}"));
            let sizes = back.lock().expect("one thread").clone();
            assert_eq!(other.act(&alone).expect("it is slow")[0], actions[0], "{bad:?}, step {step}: a neighbour is heard");
            match (step, bad) {
                (0, _) => assert_eq!(sizes, [80; 6], "{bad:?}: six rounds for both"),
                (4, None) => assert_eq!(sizes, [80, 40, 40, 40, 40, 40], "one round for both, five for who begins"),
                (_, None) => assert_eq!(sizes, [80], "step {step}"),
                _ => {}
            }
            again += sizes.iter().filter(|n| **n % 40 != 0).count();
            assert!(step != 4 || actions[1] > 0.5, "{bad:?}: it does not brake, {}", actions[1]);
            assert!(actions[1].is_finite(), "{bad:?}, step {step}: {}", actions[1]);
            alone.step(&actions[..1]).expect("finite");
            all.step(&actions).expect("finite");
        }
        assert_eq!(again > 0, bad == Some(Bad::Fault), "{bad:?}: {again} times without the frames that have none");
    }
}

/// None of its frames can be stepped.
struct Broken;

impl Solver for Broken {
    fn step(&mut self, batch: &mut Batch, _: &[f64]) -> Result<(), StepError> {
        Err(StepError::Environments((0..batch.len()).map(|env| Fault { env, frame: 0, reason: "broken".into() }).collect()))
    }

    fn back(&mut self, batch: &Batch, _: &[f64], _: usize, _: &[f64]) -> Result<Slopes, StepError> {
        self.step(&mut batch.clone(), &[]).map(|()| Slopes::default())
    }
}

#[test]
fn who_cannot_look_ahead_at_all_acts_all_the_same() {
    let config = IlqrConfig { steps: 2, search: 2, ..IlqrConfig::default() };
    let ilqr = Ilqr::new(cartpole(Broken, 0, 2), config).expect("it has residuals");
    let planners: [(&str, Box<dyn Planner>); 2] =
        [("mppi", Box::new(Mppi::new(cartpole(Broken, 0, 16), CONFIG))), ("ilqr", Box::new(ilqr))];
    for (name, mut planner) in planners {
        let mut truth = cartpole(quick(), 0, 1);
        for step in 0..4 {
            let action = planner.act(&truth).unwrap_or_else(|error| panic!("{name}, step {step}: {error}"));
            assert!(action.len() == 1 && action[0].abs() <= 1.0, "{name}, step {step}: {action:?}");
            truth.step(&action).expect("finite");
        }
    }
}

#[test]
fn ilqr_reaches_by_slopes_through_the_solver() {
    // Two frames a step under a position law, torques, a pole to swing up, feet on the ground.
    for (name, method, steps, last) in
        [("franka-reach", 0, 20, 60), ("franka-reach-torque", 0, 24, 60), ("cartpole-swingup", 0, 60, 160), ("ant-point", 1, 24, 220)]
    {
        let system = System::named(named(name).expect("registered").robot()).expect("built in");
        let episodes = |n: usize, method| {
            let task = named(name).expect("registered");
            let batch = Batch::new(&system, &system.scene(task.scene()).expect("known"), n);
            Episodes::new(task, Simulation::new(batch, Articulated::new(method)), 3)
        };
        let rough = if method == 1 {
            ArticulatedConfig::implicit(1, Friction::Coulomb)
        } else {
            ArticulatedConfig { substeps: 1, ..ArticulatedConfig::converged(Friction::Coulomb) }
        };
        let config = IlqrConfig { steps, ..IlqrConfig::default() };
        let mut truth = episodes(1, ArticulatedConfig::accurate(&system));
        let mut planner = Ilqr::new(episodes(config.search, rough), config).expect("it has residuals");
        let mut largest = 0.0_f64;
        for step in 0..last {
            let result = truth.step(&planner.act(&truth).expect("slopes")).expect("finite");
            assert!(!result.terminated[0], "{name}: over at step {step}");
            if step >= last - 20 {
                largest = largest.max(result.misses[0].expect("it speaks of success"));
            }
        }
        println!("{name}: largest miss of the last 20 of {last} steps {largest:.3}");
        assert!(largest < 1.0, "{name}: {largest:.3}");
    }
    let run = episodes("ant-run", "articulated", 6);
    let error = Ilqr::new(run, IlqrConfig::default()).err().expect("no residuals").to_string();
    assert!(error.contains("MPPI"), "{error}");
}
