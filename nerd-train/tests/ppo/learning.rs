//! Moments and stacks by hand, problems with known answers, resumed runs that equal unbroken ones.

use nerd_tasks::formula::{Sight, Traced};
use nerd_tasks::{About, ChaCha8Rng, Plain, Task};
use rand::RngExt;

use crate::*;

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

/// A point on a line, moved by at most 0.1 a step: the cart of a Cartpole under `Slide`. Episodes are truncated after
/// `length` steps and begin at one of two places.
struct Point {
    length: u64,
    starts: [f64; 2],
    reward: for<'a> fn(Traced<'a>) -> Traced<'a>,
}

impl Task for Point {
    fn about(&self) -> About {
        About {
            name: "point",
            robot: "cartpole",
            scene: "free",
            observation: 1,
            action: 1,
            steps: self.length,
            frames: 1,
        }
    }

    fn plain(&self) -> Option<&dyn Plain> {
        Some(self)
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out[0] = sight.q(0);
    }

    fn act<'a>(&self, _: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        torques[0] = action[0];
    }

    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        (self.reward)(sight.q(0))
    }
}

impl Plain for Point {
    fn reset(&self, _: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        vec![self.starts[usize::from(rng.random::<bool>())], 0.0, 0.0, 0.0]
    }
}

struct Slide;

impl Solver for Slide {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        for env in 0..batch.len() {
            batch.state_mut(env)[0] += 0.1 * torques[2 * env];
            batch.frames[env] += 1;
        }
        Ok(())
    }
}

fn points(n: usize, length: u64, starts: [f64; 2], reward: for<'a> fn(Traced<'a>) -> Traced<'a>) -> Episodes {
    let system = System::named("cartpole").expect("built in");
    let batch = Batch::new(&system, &system.scene("free").expect("known"), n);
    Episodes::new(Box::new(Point { length, starts, reward }), Simulation { batch, solver: Box::new(Slide) }, 1)
}

#[test]
fn a_point_learns_to_go_home() {
    let config = PpoConfig { environments: 64, horizon: 32, minibatch: 512, ..config("") };
    let mut trainer = Trainer::new(points(64, 30, [1.0, -1.0], |x| -x * x), config, 5).expect("fits");
    for _ in 0..40 {
        trainer.iterate().expect("goes on");
    }
    let games = play(&trainer.state.policy, &mut points(64, 30, [1.0, -1.0], |x| -x * x), &mut |_| ()).expect("plays");
    let mean = games.iter().map(|g| g.reward).sum::<f64>() / 64.0;
    // At full speed: -(0.9^2 + 0.8^2 + .. + 0.1^2) = -2.85; standing still loses 30.
    assert!((-3.1..-2.84).contains(&mean), "mean return {mean}, best possible -2.85, standing still -30");
}

#[test]
fn a_task_without_numbers_or_steps_is_refused_by_name() {
    for (length, reward, expected) in [
        (5, (|_| f64::NAN.into()) as for<'a> fn(Traced<'a>) -> Traced<'a>, "its `reward` gives NaN"),
        (0, |x| x, "steps is 0"),
    ] {
        let said = points(2, length, [1.0, 1.0], reward).step(&[0.0; 2]).expect_err("refused").to_string();
        assert!(said.contains("task `point`") && said.contains(expected), "{said}");
    }
}

/// The policy that learns from a rollout is the policy that acted in it, so the first probability ratio is 1.
#[test]
fn the_first_ratio_of_an_update_is_one() {
    // One minibatch in one epoch, and a clip range that allows rounding alone.
    let config = PpoConfig { environments: 32, minibatch: 512, epochs: 1, clip_coef: 1e-4, ..config("") };
    let mut policy = policy(1, 1, 1, &[16], Activation::Tanh);
    // Far from observations that a fresh policy has seen: moments updated too early would change every answer.
    let mut episodes = points(32, 30, [4.0, -2.0], |x| -x * x);
    let mut adam = Adam::new(policy.flat.len(), 1e-3);
    let (mut running, mut engine) = (Running::new(&episodes, 1), OnCpu::default());
    for iteration in 0..3 {
        let noise = StreamKey { seed: 7, number: iteration * 16 };
        let on = RolloutInput {
            episodes: &mut episodes,
            running: &mut running,
            policy: &policy,
            config: &config,
            noise,
            stop: Default::default(),
        };
        engine.roll(on).expect("steps");
        let before = policy.seen.clone();
        let updated = engine
            .update(&mut policy, &mut adam, &config, StreamKey { seed: 8, number: iteration })
            .expect("learns")
            .terms;
        assert!(updated.kl.abs() < 1e-6, "iteration {iteration}: KL {:.1e} before anything was learned", updated.kl);
        assert_eq!(updated.clipped, 0.0, "iteration {iteration}: ratios beyond 1 +- 1e-4");
        // The actor loss is minus the mean of the normalised advantages, which is 0, if every ratio is 1.
        assert!(updated.actor.abs() < 1e-5, "iteration {iteration}: actor loss {:.1e}", updated.actor);
        assert!(policy.seen != before, "the rollout's observations are in no moments");
    }
}

#[test]
fn what_time_cuts_off_keeps_its_value() {
    // Reward 1 for ever is worth 1 / (1 - gamma) = 10, however soon episodes are truncated. Without bootstrapping it
    // would be at most 4.1 in episodes of five steps.
    let config = PpoConfig { gamma: 0.9, ..config("") };
    let mut trainer = Trainer::new(points(16, 5, [1.0, -1.0], |_| 1.0.into()), config, 2).expect("fits");
    for _ in 0..120 {
        trainer.iterate().expect("goes on");
    }
    let policy = &trainer.state.policy;
    let value = policy.values(&policy.answer(&[1.0, 0.95, -1.0]));
    assert!(value.iter().all(|v| (9.0..11.0).contains(v)), "values {value:?}, should be 10");
}

#[test]
fn a_resumed_run_equals_an_unbroken_one_on_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("last.safetensors");
    let config = PpoConfig { environments: 24, minibatch: 100, stack: 2, ..config("") };
    let cartpole = |n: usize| episodes("cartpole-swingup", n, 11);
    let begin = || Trainer::new(cartpole(24), config.clone(), 9).expect("fits");
    let steps = |run: &mut Trainer, n: usize| (0..n).for_each(|_| _ = run.iterate().expect("goes on"));
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
    // A network of windows continues to the bit. A network with a cache of keys and values adds in the order of its
    // slots. The order depends on the last reset, so the states are equal to rounding, measured as 6e-6 rad/s.
    use nerd_model::{base::Base, neural::Neural, transformer::Positions};
    for (name, base, positions, allowed) in [
        ("cartpole-swingup", Base::State, Positions::Table, 0.0),
        ("ant-run", Base::Trapezoid, Positions::Rotary, 1e-5),
    ] {
        let task = || named(name).expect("registered");
        let system = System::named(task().robot()).expect("built in");
        let begin = |remembered: bool| {
            let model = common::model(&system, base, positions);
            let network = model.config.network;
            let batch = Batch::new(&system, &system.scene(task().scene()).expect("known"), 3);
            let mut episodes = Episodes::new(task(), Simulation::new(batch, Neural::on_cpu(model)), 4);
            episodes.remember(if remembered { network.history * network.layers } else { 0 });
            episodes
        };
        let actions =
            |step: usize| (0..3 * task().action_dim()).map(|i| ((i * 5 + step) as f64).sin()).collect::<Vec<_>>();
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
        assert!(
            without > 10.0 * allowed.max(1e-6),
            "{name}: its past plays no part ({without:.1e}), so nothing is shown"
        );
    }
}

/// Each environment of a family has a different robot, the same for a seed. A snapshot includes delayed torques.
#[test]
fn each_environment_has_a_robot_of_a_family() {
    let arena = |name: &str| Arena::family("ant-run", name, SolverSpec::default());
    let family = arena("ant-family").expect("a family of the Ant");
    let mut all = family.episodes("ant-run", 6, 3).expect("episodes");
    let masses = |e: &Episodes| e.simulation.batch.systems.iter().map(|own| own.robot.mass()).collect::<Vec<f64>>();
    let drawn = masses(&all);
    assert!((1..6).all(|k| drawn[k] != drawn[k - 1]) && drawn.len() == 6);
    assert!(masses(&family.episodes("ant-run", 6, 4).expect("episodes")) != drawn);
    let go = |all: &mut Episodes, step: usize| {
        drop(all.step(&(0..48).map(|k| (1.3 * k as f64 + step as f64).sin()).collect::<Vec<_>>()).expect("a step"))
    };
    (0..6).for_each(|step| go(&mut all, step));
    let mut again = family.episodes("ant-run", 6, 3).expect("episodes");
    assert_eq!(masses(&again), drawn);
    again.restore(&all.snapshot()).expect("of these episodes");
    for step in 6..9 {
        [&mut all, &mut again].into_iter().for_each(|e| go(e, step));
    }
    assert_eq!(all.simulation.batch.states, again.simulation.batch.states);
    for (name, why) in [("pendulum-family", "its links or joints are others"), ("ant", "give its TOML a [vary]")] {
        let said = arena(name).map(|_| ()).expect_err(name).to_string();
        assert!(said.contains(why), "{name}: {said}");
    }
    // A family runs at its task's frame time and on its task's ground.
    let rough = Arena::family("rough@anymal", "anymal-family", SolverSpec::default()).expect("a family of ANYmal");
    let batch = rough.episodes("rough@anymal", 1, 0).expect("episodes").simulation.batch;
    let own = &batch.systems[0];
    assert_eq!((own.frame_time, own.spec.substeps, &*batch.scenes[0].name), (0.005, 1, "terrain"));
}

#[test]
fn a_policy_that_diverges_stops_with_a_line_and_its_record_can_be_read() {
    let wild = "learning_rate = 1\ntarget_kl = 0\nepochs = 50\nclip_coef = 1e6\nstate_dependent_std = true\nactivation = \"relu\"\n";
    let usual = "environments = 16\nhorizon = 16\nminibatch = 128\nhidden = [64, 64]\n";
    let config = PpoConfig::from_text(&format!("{usual}{wild}")).expect("good settings");
    let mut trainer = Trainer::new(points(16, 30, [1.0, -1.0], |x| -x * x), config, 5).expect("fits");
    let (mut said, mut lines) = (String::new(), 0);
    for _ in 0..100 {
        match trainer.iterate() {
            Ok(line) => {
                let text = serde_json::to_string(&line).expect("JSON");
                assert!(!text.contains("\"kl\":null"), "{text}");
                lines += 1;
            }
            Err(error) => {
                said = error.to_string();
                break;
            }
        }
    }
    assert!(
        said.contains("the policy has diverged: take a smaller `learning_rate`"),
        "after {lines} iterations: `{said}`"
    );
    // A record of an earlier build has null where figures were not finite.
    let text = serde_json::to_string(&Iteration::default()).expect("JSON").replace("\"kl\":0.0", "\"kl\":null");
    let line: Iteration = serde_json::from_str(&text).expect("read");
    assert!(text.contains("null") && line.updated.terms.kl.is_nan(), "{text}");
}
