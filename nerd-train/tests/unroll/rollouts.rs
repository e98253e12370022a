//! Chains: views of a motion, scenes drawn again, the gradient of a rollout's loss, and that a model learns.

use nerd_model::chain::Look;
use nerd_sim::dataset::{Manifest, generate};
use nerd_train::unroll::chain::{View, distance};
use nerd_train::unroll::{Rollout, Unroll};

use crate::*;

const CABLE: &str = "[cable]\nlength = 0.4\ndiameter = 0.008\nmass = 0.03\nbending = 1e-3\nlinks = 6\nat = [0.1, 0.05, 0.1]\n\
    [random_pegs]\ncount = 3\nradius = \"U(0.02, 0.04)\"\nheight = 0.15\nat = [\"U(0.0, 0.6)\", \"U(-0.3, 0.3)\", \"U(0, 0)\"]";

struct Case {
    system: Arc<System>,
    chain: Chain,
    motions: Arc<Trajectories>,
}

fn case() -> Case {
    let system = Arc::new(System::from_toml("cable", CABLE).expect("a cable"));
    let config = GenerateConfig { transitions: 40 * 30, frames: 30, seed: 3, ..GenerateConfig::default() };
    let solver = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::accurate(&system))) };
    let motions = motions(&system, &solver, &config, &|_| ()).expect("motions");
    Case { chain: Chain::of(&system).expect("a chain"), motions: Arc::new(motions), system }
}

const CONFIG: LearnerConfig =
    LearnerConfig { batch: 20, clip: 1.0, average: 0.9, seed: 0, huber: None, optimizer: Optimizer::Adam };

/// The training course of rollouts of `frames` frames.
fn course(case: &Case, frames: usize) -> Course<Cable> {
    let (normalizer, velocity) = scales(&case.chain, &case.motions);
    let scale = ChainSolver::scale(&normalizer).expect("a chain's");
    let body = Cable { chain: case.chain.clone(), loss: Loss::new(&scale, velocity, frames), scale };
    Course { body, train: case.motions.clone(), validation: case.motions.clone(), frames }
}

/// A learner of a chain that continues `state`.
fn learner(case: &Case, config: LearnerConfig, state: LearnerState, frames: usize) -> UnrollLearner<Cable> {
    UnrollLearner::new(config, state, course(case, frames)).expect("a learner")
}

fn weights(chain: &Chain) -> Weights {
    let paper = TransformerConfig::paper(INPUTS, OUTPUTS, 16);
    let small = TransformerConfig {
        layers: 3,
        heads: 1,
        block: chain.rods,
        history: 1,
        head: 1,
        architecture: Architecture::Chain,
        ..paper
    };
    Weights::init(small, 5)
}

fn apart(a: &Rods, b: &Rods) -> f64 {
    let led = a.gripper.numbers().zip(b.gripper.numbers()).map(|(a, b)| (a - b).abs());
    let rods = a.along.iter().chain(&a.rates).zip(b.along.iter().chain(&b.rates)).map(|(a, b)| (a - b).norm());
    led.chain(rods).fold(0.0, f64::max)
}

#[test]
fn a_motion_turned_and_mirrored_is_one_as_well() {
    let Case { chain, motions, .. } = case();
    let view = View::new(0.7, true);
    let mut worst = 0.0f64;
    for frame in [0, 7, 20] {
        let (rods, torques, scene) =
            (chain.rods(motions.state(2, frame)), motions.torques(2, frame), &motions.scenes[2]);
        let seen = view.rods(&chain, &rods);
        let look = Look::at(&chain, &rods, torques, |place| scene.contact(place));
        let other = Look::at(&chain, &seen, &view.torques(&chain, torques), |place| view.contact(&chain, scene, place));
        let glided = view.rods(&chain, &Rods { gripper: look.glided, ..rods.clone() });
        worst = worst.max(apart(&glided, &Rods { gripper: other.glided, ..seen.clone() }));
        let (mut tokens, mut others) = (Vec::new(), Vec::new());
        look.tokens(&chain, &rods, &mut tokens);
        other.tokens(&chain, &seen, &mut others);
        for (own, other) in tokens.as_chunks::<INPUTS>().0.iter().zip(others.as_chunks::<INPUTS>().0) {
            for first in [0, 3, 6, 9, 18, 21, 24, 27] {
                let v = |x: &[f32]| nalgebra::Vector3::new(x[first], x[first + 1], x[first + 2]).map(f64::from);
                worst = worst.max((view.vector(&v(own)) - v(other)).norm() * 1e-6);
            }
            (12..18).for_each(|k| worst = worst.max(f64::from((own[k] - other[k]).abs()) * 1e-6));
        }
        // Through the chain's form of a state and back.
        let mut state = vec![0.0; motions.state(2, 0).len()];
        chain.state(&seen, &mut state);
        worst = worst.max(apart(&chain.rods(&state), &seen));
    }
    assert!(worst < 1e-11, "a view is off by {worst:.1e}");
}

#[test]
fn scenes_are_drawn_again_from_the_seed() {
    let Case { system, motions, .. } = case();
    let folder = tempfile::tempdir().expect("a folder");
    let config = GenerateConfig {
        transitions: 40 * 30,
        frames: 30,
        seed: 3,
        shard_trajectories: 16,
        ..GenerateConfig::default()
    };
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
    generate(&system, &mut solver, "articulated accurate", &config, folder.path(), &mut |_, _| ()).expect("data");
    let read = read(&system, "articulated accurate", folder.path()).expect("what was written");
    assert_eq!((read.count, read.frames), (40, 30));
    let colliders = |scene: &Scene| scene.colliders.iter().map(|c| c.pose.translation.vector).collect::<Vec<_>>();
    for motion in 0..40 {
        assert_eq!(colliders(&read.scenes[motion]), colliders(&motions.scenes[motion]), "scene {motion}");
        assert_eq!(read.state(motion, 30), motions.state(motion, 30), "motion {motion}");
    }
    assert!(read.scenes.iter().any(|scene| colliders(scene) != colliders(&read.scenes[0])), "each has its own");

    // Under another seed the recorded contacts do not fit the scenes.
    let mut manifest = Manifest::read(folder.path()).expect("written");
    manifest.seed = 4;
    let error =
        manifest.shard_in_scenes(folder.path(), &manifest.shards[0], &system).expect_err("other scenes").to_string();
    assert!(error.contains("trajectory 0: its scenes cannot be drawn again"), "{error}");
}

/// Error of the loss gradient of a few rollouts, some in contact, against finite differences along it with step `h`.
pub fn gradient_off<B: Body>(course: &Course<B>, weights: &Weights, view: impl Fn(usize) -> B::View, h: f64) -> f64 {
    let passed = |flat: &[f32]| {
        let network = Loaded::new(weights.config.program(), flat);
        let unroll = Unroll { course, network: &network };
        let begin = |k: usize| unroll.begin(Place { motion: k, frame: k, view: view(k) });
        let mut rollouts: Vec<Rollout<B>> = (0..12).map(begin).collect();
        unroll.pass(&mut rollouts, 1.0 / 12.0, &mut Vec::<Memory>::new())
    };
    let (_, gradient) = passed(&weights.flat);
    let size = gradient.iter().map(|g| f64::from(g * g)).sum::<f64>().sqrt();
    let moved = |h: f64| {
        let flat = weights.flat.iter().zip(&gradient).map(|(w, g)| (f64::from(*w) + h * f64::from(*g) / size) as f32);
        passed(&flat.collect::<Vec<f32>>()).0
    };
    let wanted = (moved(h) - moved(-h)) / (2.0 * h);
    println!("{} frames: a gradient of {size:.4}, by differences {wanted:.4}", course.frames);
    (size / wanted - 1.0).abs()
}

#[test]
fn the_gradient_of_a_rollout_is_that_of_differences() {
    let case = case();
    // Contact normals count as constant. Along the loss gradient this matters least.
    for (frames, most) in [(1, 5e-3), (4, 2e-2)] {
        let off = gradient_off(
            &course(&case, frames),
            &weights(&case.chain),
            |k| View::new(k as f64, k.is_multiple_of(2)),
            1e-2,
        );
        assert!(off < most, "{frames} frames: off by {off:.1e}");
    }
}

#[test]
fn rollouts_come_nearer_to_the_truth() {
    let case = case();
    let (normalizer, _) = scales(&case.chain, &case.motions);
    let mut state = LearnerState::new(weights(&case.chain));
    let judged = |state: &LearnerState| {
        distance(&case.system, &case.motions, &state.averaged(), &normalizer).expect("a chain's")
    };
    let first = judged(&state);
    let mut missed = [0.0; 2];
    for (frames, updates) in [(1, 150), (4, 50)] {
        let mut learner = learner(&case, LearnerConfig { batch: 32, ..CONFIG }, state, frames);
        if frames == 1 {
            missed[0] = learner.validate(200).expect("finite");
        }
        for _ in 0..updates {
            learner.update(3e-3).expect("finite");
        }
        missed[1] = learner.validate(200).expect("finite");
        state = learner.state().expect("a state");
    }
    let last = judged(&state);
    assert!(missed[1] < 0.9 * missed[0], "single frames: {missed:?} of the change of rates are missed");
    assert!(last < 0.5 * first, "rollouts were {first:.4} m from the truth, and are {last:.4} m from it");
}

#[test]
fn the_same_updates_on_any_number_of_threads() {
    let case = case();
    let trained = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let mut learner = learner(&case, CONFIG, LearnerState::new(weights(&case.chain)), 3);
            (0..10).for_each(|_| learner.update(1e-3).expect("finite"));
            learner.state().expect("a state").weights.flat
        })
    };
    assert!(trained(1) == trained(3), "weights differ");
}

#[test]
fn a_run_makes_a_model_that_is_picked_like_all_others() {
    let folder = tempfile::tempdir().expect("a folder");
    let robot = folder.path().join("cable.toml");
    std::fs::write(&robot, CABLE).expect("written");
    let mut config = RunConfig::new(&robot.to_string_lossy(), folder.path().join("out"));
    (config.variant, config.embedding, config.layers) = (Variant::Chain, 16, 3);
    (config.transitions, config.updates, config.batch, config.rollouts) = (600, 6, 8, 2);
    (config.record.frames, config.sequence, config.validation_windows) = (30, Some(2), 50);
    let model = Run::new(&config).expect("a run").train().expect("trained").expect("a model");
    let system = System::named(&robot.to_string_lossy()).expect("the cable");
    let mut solver = SolverSpec::neural(&model).solver(&system, 1).expect("its solver");
    let mut batch = Batch::new(&system, &system.scene("plane").expect("a floor"), 2);
    solver.step(&mut batch, &vec![0.0; 2 * system.robot.joint_count()]).expect("a frame");

    let but = |change: &dyn Fn(&mut RunConfig)| {
        let mut config = config.clone();
        change(&mut config);
        Run::new(&config)
    };
    // A run from the model starts with its weights and uses its scales.
    let onward = but(&|c| (c.from, c.out, c.sequence) = (Some(model.clone()), folder.path().join("next"), Some(3)));
    onward.expect("a run").train().expect("trained").expect("a model");
    // Rollouts of another length are another run.
    let error = but(&|c| c.sequence = Some(4)).expect("a run").train().expect_err("another").to_string();
    assert!(error.contains("other settings") && error.contains("unrolled"), "{error}");
    let streamed = but(&|c| c.stream = true).err().expect("refused").to_string();
    assert!(streamed.contains("--stream means nothing with --variant chain"), "{streamed}");
    let pendulum = but(&|c| c.robot = "pendulum".into()).err().expect("refused").to_string();
    assert!(pendulum.starts_with("robot `pendulum` is not a chain") && !pendulum.contains('\n'), "{pendulum}");

    // One rod fewer: another robot of the same name.
    let shorter = Arc::new(System::from_toml("cable", &CABLE.replace("links = 6", "links = 5")).expect("a cable"));
    let error = SolverSpec::neural(&model).solver(&shorter, 1).err().expect("six rods were learned").to_string();
    assert!(error.contains("6") && error.contains("5 rods"), "{error}");
}
