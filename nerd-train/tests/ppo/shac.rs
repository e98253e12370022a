//! SHAC: its gradient against central differences, what it learns in a pure model, runs that go on to the bit.

use std::path::Path;

use nerd_model::pick::Setting;
use nerd_tasks::About;
use nerd_tasks::formula::{Formulas, Number, Sight};
use nerd_train::device::Device;
use nerd_train::ppo::{Algorithm, Arena, Engine, PpoConfig, Running, Shac, StreamKey, Trainer, play};

fn model(robot: &str) -> Arena {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../models")).join(robot);
    Arena::Model { folder, device: Device::Cpu }
}

/// J and the gradient of `-J` after some steps, of a policy that is moved by so much along a direction.
fn rolled(arena: &Arena, task: &str, config: &PpoConfig, by: f64, along: &[f64]) -> (f64, Vec<f32>) {
    let named = nerd_tasks::named(task).expect("registered");
    let Trainer { mut episodes, mut state, .. } = arena.trainer(named, config.clone(), 3, &Default::default()).expect("a run");
    let mut running = Running::new(&episodes, 1);
    let mut engine = Shac::new(&episodes, &mut state.policy, config, 4, &Default::default()).expect("slopes");
    // No action comes to its bounds, where slopes that lead inside are more than J has.
    let spread = state.policy.flat.len() - state.policy.shape.action;
    state.policy.flat[spread..].fill(-3.0);
    // Some columns are far beyond others, so that moments count.
    state.policy.seen.update(episodes.observations());
    state.policy.flat.iter_mut().zip(along).for_each(|(w, x)| *w += (by * x) as f32);
    engine.roll(&mut episodes, &mut running, &state.policy, config, StreamKey { seed: 5, number: 0 }).expect("a rollout");
    (engine.earned, engine.gradient)
}

#[test]
fn the_gradient_of_what_a_policy_earns_is_that_of_differences() {
    // Contact of an Ant bends what it earns within less than that.
    for (robot, task, h, most) in
        [("cartpole", "cartpole-swingup", 1e-2, 2e-3), ("ant", "ant-run", 3e-4, 3e-2), ("franka", "franka-reach", 3e-3, 5e-3)]
    {
        let text = "algorithm = \"shac\"\nenvironments = 8\nhorizon = 3\nhidden = [16]\nactivation = \"elu\"\n";
        let (arena, config) = (model(robot), PpoConfig::from_text(text).expect("settings"));
        let (_, gradient) = rolled(&arena, task, &config, 0.0, &[]);
        let size = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        let along: Vec<f64> = gradient.iter().map(|g| f64::from(*g) / size).collect();
        let [ahead, behind] = [h, -h].map(|h| rolled(&arena, task, &config, h, &along).0);
        let found = (behind - ahead) / (2.0 * h);
        println!("{task}: a slope of {size:.5}, by differences {found:.5}");
        assert!((size / found - 1.0).abs() < most, "{task}: {size} by the way back, {found} by differences");
    }
}

/// The cart comes to the middle of its rail and stays there; 60 steps.
struct Centre;

impl Formulas for Centre {
    fn about(&self) -> About {
        About { name: "centre", robot: "cartpole", scene: "free", observation: 4, action: 1, steps: 60, frames: 1 }
    }

    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        out.copy_from_slice(&[sight.q(0), sight.q(1).wrap(), sight.qd(0), sight.qd(1)]);
    }

    fn act<N: Number>(&self, _: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        torques.copy_from_slice(&[N::from(300.0) * action[0], N::from(0.0)]);
    }

    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _: &[N]) -> N {
        -sight.q(0).squared() - N::from(0.1) * sight.qd(0).squared()
    }
}

/// A run of so many steps in the shipped model.
fn centre(algorithm: Algorithm, steps: usize) -> Trainer {
    let text = "environments = 16\nhorizon = 16\nminibatch = 128\nepochs = 4\nhidden = [32]\nactivation = \"elu\"\n";
    let mut config = PpoConfig { algorithm, ..PpoConfig::from_text(text).expect("settings") };
    (config.iterations, config.rate) = ((steps / config.steps()) as u64, if algorithm == Algorithm::Shac { 1e-2 } else { config.rate });
    model("cartpole").trainer(Box::new(Centre), config, 1, &Default::default()).expect("a run")
}

#[test]
fn in_as_many_steps_slopes_teach_more_than_samples() {
    let learned = [Algorithm::Shac, Algorithm::Ppo].map(|algorithm| {
        let mut run = centre(algorithm, 16 * 16 * 60);
        let started = std::time::Instant::now();
        (0..60).for_each(|_| _ = run.iterate().expect("goes on"));
        let mut other = model("cartpole").part(Box::new(Centre), 0..64, 9).expect("episodes");
        let games = play(&run.state.policy, &mut other, &mut |_| ()).expect("plays");
        let mean = games.iter().map(|game| game.reward).sum::<f64>() / 64.0;
        println!("{algorithm:?}: an episode earns {mean:.2}, learned in {:.1?}", started.elapsed());
        mean
    });
    let [slopes, samples] = learned;
    assert!(slopes > -15.0 && samples < 2.0 * slopes, "by slopes {slopes:.2}, by samples {samples:.2}");
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
    broken = begin();
    broken.resume(&file, "this run").expect("its own file");
    steps(&mut broken, 3);
    assert!(whole.state == broken.state, "the runs differ");
    assert!(whole.engine.learned() == broken.engine.learned(), "their critics differ");
}

#[test]
fn what_has_no_slopes_is_refused() {
    let config = PpoConfig { stack: 2, ..PpoConfig::shac("cartpole-swingup").expect("settings") };
    let begun = |task: &str, arena: &Arena, config: &PpoConfig| {
        let task = nerd_tasks::named(task).expect("registered");
        arena.trainer(task, config.clone(), 1, &Default::default()).and_then(|mut run| run.iterate())
    };
    let truth = Arena::Judge(Setting::Implicit(1));
    let lead = PpoConfig { environments: 1, ..PpoConfig::shac("lead-tip").expect("settings") };
    for (said, words) in [
        (begun("cartpole-swingup", &model("cartpole"), &config), "one observation"),
        (begun("lead-tip", &truth, &lead), "has no slopes: train it by PPO"),
    ] {
        let said = said.expect_err("refused").to_string();
        assert!(said.contains(words) && !said.contains('\n'), "{said}");
    }
}
