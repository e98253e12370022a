//! SHAC: its gradient against central differences, learning in a pure model, resumed runs that equal unbroken ones.

use nerd_sim::solver::{Fault, Gradients};
use nerd_tasks::formula::{Number, Sight, Traced};
use nerd_tasks::{About, Task};

use crate::*;

fn model(robot: &str) -> Arena {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../models")).join(robot);
    Arena::Solver(SolverSpec::neural(folder))
}

/// J and the gradient of `-J` of a rollout, with the policy's weights moved by `by` in the direction `along`.
fn rolled(arena: &Arena, task: &str, config: &PpoConfig, by: f64, along: &[f64]) -> (f64, Vec<f32>) {
    let named = nerd_tasks::named(task).expect("registered");
    let Trainer { mut episodes, mut state, .. } = arena.trainer(named, config.clone(), 3).expect("a run");
    let mut running = Running::new(&episodes, 1);
    let mut engine = Shac::new(&mut episodes, &mut state.policy, config, 4).expect("gradients");
    // Little noise keeps actions off their bounds, where SHAC passes gradients that J does not have.
    let spread = state.policy.flat.len() - state.policy.shape.action;
    state.policy.flat[spread..].fill(-3.0);
    // Columns differ widely in scale, so that normalisation counts.
    state.policy.seen.update(episodes.observations());
    state.policy.flat.iter_mut().zip(along).for_each(|(w, x)| *w += (by * x) as f32);
    let noise = StreamKey { seed: 5, number: 0 };
    let on = RolloutInput {
        episodes: &mut episodes,
        running: &mut running,
        policy: &state.policy,
        config,
        noise,
        stop: Default::default(),
    };
    engine.roll(on).expect("a rollout");
    (engine.earned, engine.gradient)
}

#[test]
fn the_gradient_of_what_a_policy_earns_is_that_of_differences() {
    // Contact makes an Ant's J nonlinear within its small step, hence the wide tolerance.
    for (robot, task, h, most) in [
        ("cartpole", "cartpole-swingup", 1e-2, 2e-3),
        ("ant", "ant-run", 3e-4, 3e-2),
        ("franka", "franka-reach", 3e-3, 5e-3),
    ] {
        let text = "algorithm = \"shac\"\nenvironments = 8\nhorizon = 3\nhidden = [16]\nactivation = \"elu\"\n";
        let (arena, config) = (model(robot), PpoConfig::from_text(text).expect("settings"));
        let (_, gradient) = rolled(&arena, task, &config, 0.0, &[]);
        let size = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        let along: Vec<f64> = gradient.iter().map(|g| f64::from(*g) / size).collect();
        let [ahead, behind] = [h, -h].map(|h| rolled(&arena, task, &config, h, &along).0);
        let found = (behind - ahead) / (2.0 * h);
        println!("{task}: a gradient of {size:.5}, by differences {found:.5}");
        assert!((size / found - 1.0).abs() < most, "{task}: {size} by the way back, {found} by differences");
    }
}

/// The cart comes to the middle of its rail and stays there; 60 steps.
struct Centre;

impl Task for Centre {
    fn about(&self) -> About {
        About { name: "centre", robot: "cartpole", scene: "free", observation: 4, action: 1, steps: 60, frames: 1 }
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out.copy_from_slice(&[sight.q(0), sight.q(1).wrap(), sight.qd(0), sight.qd(1)]);
    }

    fn act<'a>(&self, _: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        torques.copy_from_slice(&[300.0 * action[0], 0.0.into()]);
    }

    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        -sight.q(0).squared() - 0.1 * sight.qd(0).squared()
    }
}

/// A run of `steps` steps in the shipped model.
fn centre(algorithm: Algorithm, steps: usize) -> Trainer {
    let text = "environments = 16\nhorizon = 16\nminibatch = 128\nepochs = 4\nhidden = [32]\nactivation = \"elu\"\n";
    let mut config = PpoConfig { algorithm, ..PpoConfig::from_text(text).expect("settings") };
    (config.iterations, config.learning_rate) =
        ((steps / config.steps()) as u64, if algorithm == Algorithm::Shac { 1e-2 } else { config.learning_rate });
    model("cartpole").trainer(Box::new(Centre), config, 1).expect("a run")
}

#[test]
fn in_as_many_steps_gradients_teach_more_than_samples() {
    let learned = [Algorithm::Shac, Algorithm::Ppo].map(|algorithm| {
        let mut run = centre(algorithm, 16 * 16 * 60);
        let started = std::time::Instant::now();
        (0..60).for_each(|_| _ = run.iterate().expect("goes on"));
        let mut other = model("cartpole").begin(Box::new(Centre), 64, 9).expect("episodes");
        let games = play(&run.state.policy, &mut other, &mut |_| ()).expect("plays");
        let mean = games.iter().map(|game| game.reward).sum::<f64>() / 64.0;
        println!("{algorithm:?}: an episode earns {mean:.2}, learned in {:.1?}", started.elapsed());
        mean
    });
    let [gradients, samples] = learned;
    assert!(gradients > -15.0 && samples < 2.0 * gradients, "by gradients {gradients:.2}, by samples {samples:.2}");
}

#[test]
fn a_resumed_run_equals_an_unbroken_one() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("last.safetensors");
    let begin = || centre(Algorithm::Shac, 16 * 16 * 8);
    let steps = |run: &mut Trainer, n: usize| (0..n).for_each(|_| _ = run.iterate().expect("goes on"));
    let (mut whole, mut broken) = (begin(), begin());
    steps(&mut whole, 8);
    steps(&mut broken, 5);
    broken.save(&file, "this run").expect("written");
    let said =
        centre(Algorithm::Shac, 16 * 16 * 9).resume(&file, "this run").expect_err("another schedule").to_string();
    assert!(said.contains("rate falls over all 8 iterations"), "{said}");
    broken = begin();
    broken.resume(&file, "this run").expect("its own file");
    steps(&mut broken, 3);
    assert!(whole.state == broken.state, "the runs differ");
    assert!(
        whole.engine.learned().expect("a critic") == broken.engine.learned().expect("a critic"),
        "their critics differ"
    );
}

#[test]
fn what_has_no_gradients_is_refused_before_a_step() {
    let begun = |task: &str, arena: &Arena, config: PpoConfig| {
        let task = nerd_tasks::named(task).expect("registered");
        arena.trainer(task, config, 1).map(drop)
    };
    let truth = Arena::Solver(SolverSpec::implicit(1));
    let shac = |task: &str| PpoConfig { environments: 1, minibatch: 16, ..PpoConfig::shac(task).expect("settings") };
    for (said, words) in [
        (begun("lead-tip", &truth, shac("lead-tip")), "has no gradients: train it by PPO"),
        (begun("cartpole-swingup", &Arena::from(Truth::Rapier), shac("cartpole-swingup")), "solver has no gradients"),
        (begun("cartpole-swingup", &truth, PpoConfig { stack: 2, ..shac("cartpole-swingup") }), "no use for `stack`"),
    ] {
        let said = said.expect_err("refused").to_string();
        assert!(said.contains(words) && !said.contains('\n'), "{said}");
    }
}

#[test]
fn settings_without_use_are_refused_even_at_their_defaults() {
    for line in ["clip_coef = 0.2", "target_kl = 0.008", "ent_coef = 0.01", "stack = 1"] {
        let said = PpoConfig::from_text(&format!("algorithm = \"shac\"\n{line}\n")).expect_err("refused").to_string();
        assert!(said.contains("no use for") && said.contains(line.split(' ').next().expect("a key")), "{said}");
        PpoConfig::from_text(line).expect("of use to PPO");
    }
}

/// A solver without gradients where the cart is beyond a place: by faults if `said`, else by NaN.
struct Lost {
    inner: Articulated,
    beyond: f64,
    said: bool,
}

impl Solver for Lost {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.inner.step(batch, torques)
    }

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        let mut found = self.inner.vjp(batch, torques, rows, grad_next)?;
        let lost: Vec<usize> = (0..batch.len()).filter(|env| batch.state(*env)[0] > self.beyond).collect();
        if self.said && !lost.is_empty() {
            let fault = |env| Fault { env, frame: 0, reason: "no gradients here".into() };
            return Err(StepError::Environments(lost.into_iter().map(fault).collect()));
        }
        lost.iter().for_each(|env| found.states[4 * env] = f64::NAN);
        Ok(found)
    }
}

#[test]
fn an_environment_without_finite_gradients_is_left_out_and_begins_anew() {
    let text = "algorithm = \"shac\"\nenvironments = 16\nhorizon = 8\nhidden = [16]\nactivation = \"elu\"\n";
    let config = PpoConfig::from_text(text).expect("settings");
    let rolled = |beyond: f64, said: bool| {
        let inner = |system: &Arc<System>| Articulated::new(ArticulatedConfig::accurate(system));
        let make = move |system: &Arc<System>, _: &Arc<Scene>| {
            Ok(Box::new(Lost { inner: inner(system), beyond, said }) as Box<dyn Solver>)
        };
        let arena = Arena::Guest("lost".into(), Arc::new(make));
        let task = nerd_tasks::named("cartpole-swingup").expect("registered");
        let Trainer { mut episodes, mut state, .. } = arena.trainer(task, config.clone(), 3).expect("a run");
        let mut engine = Shac::new(&mut episodes, &mut state.policy, &config, 4).expect("gradients");
        let noise = StreamKey { seed: 5, number: 0 };
        let on = RolloutInput {
            episodes: &mut episodes,
            running: &mut state.running,
            policy: &state.policy,
            config: &config,
            noise,
            stop: Default::default(),
        };
        let taken = engine.roll(on).expect("a rollout");
        (
            engine.gradients(&state.policy),
            engine.gradient,
            taken.failed,
            episodes.simulation.batch.frames.clone(),
            state.running,
        )
    };
    let (whole, sum, none, ..) = rolled(f64::MAX, true);
    assert_eq!(none, 0, "all have gradients");
    let off = |k: usize| (whole.iter().map(|own| f64::from(own[k])).sum::<f64>() - f64::from(sum[k])).abs();
    assert!((0..sum.len()).all(|k| off(k) < 1e-6), "gradients of environments are not that of all");
    for said in [true, false] {
        let (gradients, sum, failed, frames, running) = rolled(0.8, said);
        let out: Vec<usize> = (0..16).filter(|env| gradients[*env].iter().all(|g| *g == 0.0)).collect();
        println!("{} of 16 environments left out", out.len());
        assert!((1..16).contains(&out.len()) && failed == out.len(), "{failed} were counted, {} left out", out.len());
        assert!(sum.iter().all(|g| g.is_finite()) && sum.iter().any(|g| *g != 0.0), "nothing is learned of the others");
        for env in 0..16 {
            let (lost, own) = (out.contains(&env), &gradients[env]);
            assert!(lost || *own == whole[env], "environment {env} has another gradient than among sound ones");
            assert_eq!(
                (frames[env], running.lengths[env]),
                if lost { (0, 0.0) } else { (8, 8.0) },
                "environment {env}"
            );
        }
    }
}
