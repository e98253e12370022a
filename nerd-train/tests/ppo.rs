//! PPO: advantages and moments by hand, problems whose answers are known, runs that go on to the bit.

mod common;

use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, Snapshot, StepResult, named, names};
use nerd_train::ppo::gae::{Steps, advantages};
use nerd_train::ppo::rollout::{Running, rollout};
use nerd_train::ppo::update::Adam;
use nerd_train::ppo::{Activation, Engine, Environments, OnCpu, Policy, PpoConfig, RunningMoments, Shape, Stack, Trainer, folder, play};

fn config(text: &str) -> PpoConfig {
    let usual = "environments = 16\nhorizon = 16\niterations = 10\nminibatch = 128\nepochs = 4\nhidden = [16]\n";
    PpoConfig::from_text(&format!("{usual}{text}")).expect("good settings")
}

#[test]
fn advantages_end_where_episodes_do() {
    // One environment, four steps: the second is cut off by time, the third is terminal.
    let steps = Steps {
        rewards: &[1.0, 2.0, 3.0, 4.0],
        values: &[10.0, 20.0, 30.0, 40.0],
        next: &[20.0, 25.0, 99.0, 50.0],
        terminated: &[false, false, true, false],
        truncated: &[false, true, false, false],
    };
    let found = advantages(&steps, 1, 0.5, 0.5);
    // delta: 1 + 10 - 10, 2 + 12.5 - 20 (the value reached, not that of the next start), 3 - 30, 4 + 25 - 40.
    assert_eq!(found, [1.0 + 0.25 * -5.5, -5.5, -27.0, -11.0]);
}

#[test]
fn moments_in_pieces_are_the_moments_of_the_whole() {
    let rows: Vec<f64> = (0..600).map(|k| ((k * k) as f64).sin() * 3.0 + f64::from(k % 2 == 0) * 100.0).collect();
    let (mut whole, mut pieces) = (RunningMoments::new(2), RunningMoments::new(2));
    whole.update(&rows);
    rows.chunks(34).for_each(|c| pieces.update(c));
    for (k, x) in rows.iter().enumerate().take(2) {
        assert!((whole.mean[k] - pieces.mean[k]).abs() < 1e-9, "{whole:?} {pieces:?}");
        assert!((whole.variance[k] / pieces.variance[k] - 1.0).abs() < 1e-9, "{whole:?} {pieces:?}");
        assert!((whole.restore(k, whole.normalize(k, *x)) - x).abs() < 1e-9);
    }
    assert_eq!(whole.normalize(0, 1e9), 5.0, "outliers are kept in bounds");
}

#[test]
fn a_stack_holds_the_newest_and_the_differences_before_it() {
    let mut stack = Stack::new(3, 1, &[1.0, 10.0]);
    let mut reached = Vec::new();
    stack.push(&[2.0, 20.0], &[0, 1], |_| false, &[2.0, 20.0], &mut reached);
    assert_eq!(stack.rows, [2.0, 1.0, 0.0, 20.0, 10.0, 0.0]);
    stack.push(&[3.0, 30.0], &[1], |env| env == 1, &[3.0, 70.0], &mut reached);
    assert_eq!(reached, [30.0, 10.0, 10.0], "the state reached by who was asked for, before the next episode");
    assert_eq!(stack.rows, [3.0, 1.0, 1.0, 70.0, 0.0, 0.0]);
}

/// A point on a line, moved by at most 0.1 a step; reward `-x^2`, cut off after `length` steps; starts at one of +-1.
struct Point {
    x: Vec<f64>,
    age: Vec<u64>,
    length: u64,
    reward: fn(f64) -> f64,
}

impl Point {
    fn new(n: usize, length: u64, reward: fn(f64) -> f64) -> Self {
        Self { x: (0..n).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect(), age: vec![0; n], length, reward }
    }
}

impl Environments for Point {
    fn count(&self) -> usize {
        self.x.len()
    }

    fn observation_dim(&self) -> usize {
        1
    }

    fn action_dim(&self) -> usize {
        1
    }

    fn observations(&self) -> &[f64] {
        &self.x
    }

    fn step(&mut self, actions: &[f64]) -> Result<StepResult, StepError> {
        let n = self.x.len();
        let mut result = StepResult { terminated: vec![false; n], ..Default::default() };
        for (i, a) in actions.iter().enumerate() {
            self.x[i] += 0.1 * a;
            self.age[i] += 1;
            result.rewards.push((self.reward)(self.x[i]));
            result.truncated.push(self.age[i] >= self.length);
        }
        result.reached.clone_from(&self.x);
        for i in 0..n {
            if result.truncated[i] {
                (self.x[i], self.age[i]) = (if i % 2 == 0 { 1.0 } else { -1.0 }, 0);
            }
        }
        Ok(result)
    }

    fn snapshot(&self) -> Result<Snapshot, StepError> {
        Ok(Snapshot { states: self.x.clone(), frames: self.age.clone(), ..Default::default() })
    }

    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), StepError> {
        (self.x, self.age) = (snapshot.states.clone(), snapshot.frames.clone());
        Ok(())
    }
}

#[test]
fn a_point_learns_to_go_home() {
    let config = PpoConfig { environments: 64, horizon: 32, minibatch: 512, ..config("") };
    let mut trainer = Trainer::new(Point::new(64, 30, |x| -x * x), config, 5).expect("fits");
    for _ in 0..40 {
        trainer.iterate().expect("goes on");
    }
    let games = play(&trainer.state.policy, &mut Point::new(64, 30, |x| -x * x), &mut |_| ()).expect("plays");
    let mean = games.iter().map(|g| g.reward).sum::<f64>() / 64.0;
    // At full speed: -(0.9^2 + 0.8^2 + .. + 0.1^2) = -2.85; standing still loses 30.
    println!("mean return {mean:.3}, best possible -2.85");
    assert!((-3.1..-2.84).contains(&mean), "mean return {mean}, best possible -2.85, standing still -30");
}

/// The policy that learns from a rollout is the one that acted in it, so the first ratio is 1 and nothing parts them yet.
#[test]
fn the_first_ratio_of_an_update_is_one() {
    // One minibatch in one pass, and bounds that nothing but rounding keeps.
    let config = PpoConfig { environments: 32, minibatch: 512, epochs: 1, clip: 1e-4, ..config("") };
    let shape = Shape { observation: 1, stack: 1, action: 1, hidden: vec![16], activation: Activation::Tanh, spread_by_state: false };
    let mut policy = Policy::new(shape, &mut nerd_sim::sampling::stream(1, 0));
    // Far from what a fresh policy has seen, so that moments taken in too early would change every answer.
    let mut environments = Point::new(32, 30, |x| -x * x);
    environments.x.iter_mut().for_each(|x| *x = 3.0 * *x + 1.0);
    let mut adam = Adam::new(policy.flat.len(), 1e-3);
    let (mut running, mut engine) = (Running::new(&environments, 1), OnCpu::default());
    for iteration in 0..3 {
        rollout(&mut environments, &mut running, &mut engine, &policy, (16, 0.99, 0.95), (7, iteration * 16)).expect("steps");
        let before = policy.seen.clone();
        let updated = engine.update(&mut policy, &mut adam, &config, (8, iteration)).expect("learns");
        println!("iteration {iteration}: KL {:.1e}, clipped {}, actor loss {:.1e}", updated.kl, updated.clipped, updated.actor_loss);
        assert!(updated.kl.abs() < 1e-6, "iteration {iteration}: KL {:.1e} before anything was learned", updated.kl);
        assert_eq!(updated.clipped, 0.0, "iteration {iteration}: ratios beyond 1 +- 1e-4");
        // Minus the mean of the normalised advantages, which is 0, if every ratio is 1.
        assert!(updated.actor_loss.abs() < 1e-5, "iteration {iteration}: actor loss {:.1e}", updated.actor_loss);
        assert!(policy.seen != before, "the rollout's observations are in no moments");
    }
}

#[test]
fn what_time_cuts_off_keeps_its_value() {
    // Reward 1 for ever is worth 1 / (1 - gamma) = 10, however soon episodes are cut off; without bootstrapping it would be
    // at most 4.1 in episodes of five steps.
    let config = PpoConfig { gamma: 0.9, ..config("") };
    let mut trainer = Trainer::new(Point::new(16, 5, |_| 1.0), config, 2).expect("fits");
    for _ in 0..120 {
        trainer.iterate().expect("goes on");
    }
    let policy = &trainer.state.policy;
    let value = policy.values(&policy.answer(&[1.0, 0.95, -1.0]));
    println!("values {value:?}, should be 10");
    assert!(value.iter().all(|v| (9.0..11.0).contains(v)), "values {value:?}, should be 10");
}

fn cartpole(n: usize) -> Episodes {
    let task = named("cartpole-swingup").expect("registered");
    let system = System::named(task.robot()).expect("built in");
    let batch = Batch::new(&system, &system.scene("free").expect("known"), n);
    let solver = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    Episodes::new(task, Simulation::new(batch, solver), 11)
}

fn steps(run: &mut Trainer<Episodes>, n: usize) {
    for _ in 0..n {
        run.iterate().expect("goes on");
    }
}

#[test]
fn a_resumed_run_equals_an_unbroken_one_on_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("last.safetensors");
    let config = PpoConfig { environments: 24, minibatch: 100, stack: 2, ..config("") };
    let begin = || Trainer::new(cartpole(24), config.clone(), 9).expect("fits");
    let pool = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    // Solvers stay on one thread, so a run begins and ends inside its pool.
    let whole = pool(1).install(|| {
        let mut run = begin();
        steps(&mut run, 25);
        run.state
    });
    let broken = pool(3).install(|| {
        let mut run = begin();
        steps(&mut run, 12);
        run.save(&file, "this run").expect("written");
        run = begin();
        assert!(run.resume(&file, "another run").is_err(), "another run's file is refused");
        run.resume(&file, "this run").expect("its own file");
        steps(&mut run, 13);
        run.state
    });
    assert!(whole.recent.len() > 24, "episodes ended: {}", whole.recent.len());
    assert!(whole == broken, "the runs differ");
    let mut other = Trainer::new(cartpole(24), config.clone(), 8).expect("fits");
    assert!(other.resume(&file, "this run").is_err(), "another seed's file is refused");
    assert!(Trainer::new(cartpole(3), config, 8).is_err(), "three environments, where 24 are asked for");
}

#[test]
fn a_learned_solver_goes_on_too() {
    // A network of windows to the bit. One that keeps keys and values adds them up in the order of their slots, which depends
    // on when an environment was last cleared: equal to rounding, 6e-6 rad/s where it was measured.
    use nerd_model::{base::Base, neural::Neural, transformer::Positions};
    for (name, base, positions, allowed) in [
        ("cartpole-swingup", Base::State, Positions::Table, 0.0),
        ("ant-run", Base::ExactFlight, Positions::Rotary, 1e-5),
        ("anymal-side", Base::Draft(1), Positions::Rotary, 1e-5),
    ] {
        let task = || named(name).expect("registered");
        let system = System::named(task().robot()).expect("built in");
        let begin = |remembered: bool| {
            let model = common::model(&system, base, positions);
            let network = model.config.network;
            let batch = Batch::new(&system, &system.scene(task().scene()).expect("known"), 3);
            let mut episodes = Episodes::new(task(), Simulation::new(batch, Neural::on_cpu(model, &system)), 4);
            episodes.remember(if remembered { network.history * network.layers } else { 0 });
            episodes
        };
        let actions = |step: usize| (0..3 * task().action_dim()).map(|i| ((i * 5 + step) as f64).sin()).collect::<Vec<_>>();
        let gap = |remembered: bool| {
            let mut whole = begin(remembered);
            for step in 0..70 {
                whole.step(&actions(step)).expect("steps");
            }
            let mut again = begin(remembered);
            again.restore(&whole.snapshot()).expect("its own");
            let (a, b) = (whole.step(&actions(70)).expect("steps"), again.step(&actions(70)).expect("steps"));
            a.reached.iter().zip(&b.reached).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let (with, without) = (gap(true), gap(false));
        println!("{name}: {with:.1e}, without its past {without:.1e}");
        assert!(with <= allowed, "{name}: {with:.1e} between the states reached");
        assert!(without > 10.0 * allowed.max(1e-6), "{name}: its past plays no part ({without:.1e}), so nothing is shown");
    }
}

#[test]
fn every_task_has_settings_and_a_policy_survives_its_folder() {
    let folder_ = tempfile::tempdir().expect("temporary folder");
    for name in names() {
        let (task, ppo) = (named(name).expect("registered"), PpoConfig::of(name).expect("settings"));
        let shape = Shape {
            observation: task.observation_dim(),
            stack: ppo.stack,
            action: task.action_dim(),
            hidden: ppo.hidden.clone(),
            activation: ppo.activation,
            spread_by_state: ppo.spread_by_state,
        };
        let mut policy = Policy::new(shape.clone(), &mut nerd_sim::sampling::stream(0, 0));
        policy.seen.update(&(0..shape.observation * shape.stack * 3).map(|k| k as f64).collect::<Vec<_>>());
        let provenance = Default::default();
        let solver = Truth::default().name();
        let config = folder::PolicyConfig { task: name.into(), solver, shape, ppo, iterations: 1, reward: None, provenance };
        folder::save(folder_.path(), &config, &policy, "# A card\n").expect("written");
        assert_eq!(folder::load(folder_.path()).expect("read"), (config.clone(), policy.clone()), "{name}");
        let refusal = |config: &folder::PolicyConfig, policy: &Policy| {
            folder::save(folder_.path(), config, policy, "# A card\n").expect("written");
            folder::load(folder_.path()).expect_err("cannot be").to_string()
        };
        let mut wide = config.clone();
        wide.shape.hidden = vec![usize::MAX, usize::MAX];
        let said = {
            let json = serde_json::to_string(&wide).expect("JSON");
            std::fs::write(folder_.path().join("config.json"), json).expect("written");
            folder::load(folder_.path()).expect_err("cannot be").to_string()
        };
        assert!(said.contains("`hidden` is 18446744073709551615"), "{name}: {said}");
        let mut none = policy.clone();
        none.flat[1] = f32::NAN;
        assert!(refusal(&config, &none).contains("no finite number"), "{name}");
        let mut none = policy;
        none.seen.variance[0] = -1.0;
        assert!(refusal(&config, &none).contains("below 0"), "{name}");
    }
    assert!(names().into_iter().all(|task| PpoConfig::small(task).is_ok()) && PpoConfig::small("cartpole-juggle").is_err());
    let wrong = |text: &str| PpoConfig::from_text(text).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(wrong("environments = 1\nhurry = true").contains("hurry"));
    let zero = "environments = 0\nhorizon = 1\niterations = 1\nminibatch = 1\nepochs = 1\nhidden = []\n";
    assert!(wrong(zero).contains("environments"), "{}", wrong(zero));
    assert!(PpoConfig::of("juggle").is_err());
}
