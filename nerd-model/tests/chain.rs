//! Chains: conversion to rods and back, the adjoint of a frame, the solver.

use nerd_model::chain::{Chain, ChainSolver, INPUTS, Look, OUTPUTS, Outputs, Rods};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{Architecture, TransformerConfig, Weights};
use nerd_sim::dataset::{GenerateConfig, begin};
use nerd_sim::prelude::*;

fn lead() -> (Arc<System>, Chain) {
    let system = System::named("lead-pegs").expect("built in");
    let chain = Chain::of(&system).expect("a chain");
    (system, chain)
}

/// Deterministic numbers of about this size.
fn numbers(n: usize, seed: f64, size: f64) -> Vec<f64> {
    (0..n).map(|i| size * (12.9898 * (i as f64 + 1.7 * seed) + (i as f64 * 0.37 + seed).cos() * 4.0).sin()).collect()
}

/// A state with the bends and rates of a moving cable, and torques of the gripper.
fn state(chain: &Chain, seed: f64) -> (Vec<f64>, Vec<f64>) {
    let n = 2 * chain.rods;
    let q = [numbers(6, seed, 0.3), numbers(n, seed + 1.0, 0.3)].concat();
    let qd = [numbers(6, seed + 2.0, 2.0), numbers(n, seed + 3.0, 5.0)].concat();
    ([q, qd].concat(), numbers(6, seed + 4.0, 20.0))
}

fn network(chain: &Chain) -> TransformerConfig {
    let paper = TransformerConfig::paper(INPUTS, OUTPUTS, 48);
    TransformerConfig {
        layers: 8,
        heads: 1,
        block: chain.rods,
        history: 1,
        head: 1,
        architecture: Architecture::Chain,
        ..paper
    }
}

fn normalizer() -> Normalizer {
    let variance = [vec![0.25; 3], vec![1e-4; 3], vec![1e-6; OUTPUTS - 6]].concat();
    let outputs = Moments { mean: vec![0.0; OUTPUTS], variance, epsilon: 1e-24 };
    Normalizer { inputs: Moments::identity(INPUTS), outputs }
}

#[test]
fn rods_and_joints_are_the_same_state() {
    let (system, chain) = lead();
    let (mut worst, mut way) = (0.0f64, 0.0f64);
    for seed in 0..8 {
        let (state, _) = state(&chain, f64::from(seed));
        let rods = chain.rods(&state);
        let mut back = vec![0.0; state.len()];
        chain.state(&rods, &mut back);
        // Rates are about 5 rad/s and add up over forty rods.
        worst = state.iter().zip(&back).fold(worst, |worst, (a, b)| worst.max((a - b).abs()));
        let mut data = nerd_core::dynamics::Data::new(&system.robot);
        nerd_core::dynamics::kinematics(&system.robot, &state, &mut data);
        let places =
            system.robot.contact_points.iter().map(|p| nerd_core::dynamics::point_position(&data, p.link, &p.local));
        way = places.zip(&chain.nodes(&rods)[0]).fold(way, |way, (a, b)| way.max((a - b).norm()));
    }
    assert!(worst < 1e-12, "joints to rods and back: off by {worst:.1e} rad or rad/s");
    assert!(way < 1e-12, "ends of rods are {way:.1e} m from where kinematics has them");
}

#[test]
fn rates_are_how_directions_change() {
    let (_, chain) = lead();
    let (before, _) = state(&chain, 3.0);
    let (n, h) = (before.len() / 2, 1e-6);
    let moved = |h: f64| {
        chain.rods(
            &(0..2 * n).map(|i| if i < n { before[i] + h * before[n + i] } else { before[i] }).collect::<Vec<_>>(),
        )
    };
    let (back, ahead, rods) = (moved(-h), moved(h), chain.rods(&before));
    let worst = (0..chain.rods)
        .map(|k| ((ahead.along[k] - back.along[k]) / (2.0 * h) - rods.rates[k]).norm())
        .fold(0.0, f64::max);
    assert!(worst < 1e-6, "off by {worst:.1e} 1/s");
}

/// A frame of a chain above the floor as a scalar function: tokens and next state times fixed weights.
fn weighed(chain: &Chain, rods: &Rods, torques: &[f64], outputs: Outputs, scene: &Scene) -> f64 {
    let look = Look::at(chain, rods, torques, |place| scene.contact(place));
    let mut tokens = Vec::new();
    look.tokens(chain, rods, &mut tokens);
    let after = chain.advance(rods, &look.glided, outputs);
    let tokens: Vec<f64> = tokens.into_iter().map(f64::from).collect();
    dot(&tokens, &numbers(tokens.len(), 9.0, 1.0)) + dot(&flat(&after), &weights(chain))
}

fn weights(chain: &Chain) -> Vec<f64> {
    [numbers(12, 5.0, 1.0), numbers(3 * chain.rods, 1.0, 1.0), numbers(3 * chain.rods, 2.0, 1.0)].concat()
}

fn flat(rods: &Rods) -> Vec<f64> {
    rods.gripper.numbers().chain(rods.along.iter().chain(&rods.rates).flat_map(|v| v.iter().copied())).collect()
}

fn rods_of(numbers: &[f64]) -> Rods {
    let (gripper, rest) = numbers.split_at(12);
    let [along, rates] = [0, 1].map(|i| {
        rest[i * rest.len() / 2..][..rest.len() / 2]
            .as_chunks()
            .0
            .iter()
            .map(|v: &[f64; 3]| Vector3::from(*v))
            .collect()
    });
    let mut rods = Rods { along, rates, ..Rods::default() };
    rods.gripper.numbers_mut().zip(gripper).for_each(|(x, g)| *x = *g);
    rods
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[test]
fn gradients_of_a_frame_are_those_of_differences() {
    let (system, chain) = lead();
    // Low, so that some rods touch, some are near and some far.
    let scene = system.scene("plane").expect("a floor");
    let scale = ChainSolver::scale(&normalizer()).expect("a chain's");
    let mut worst = 0.0f64;
    for seed in 0..4 {
        let (mut state, torques) = state(&chain, f64::from(seed));
        state[2] = -0.45;
        let rods = chain.rods(&state);
        let raw: Vec<f32> = numbers(chain.rods * OUTPUTS, 7.0, 1.0).iter().map(|x| *x as f32).collect();
        let outputs = Outputs { numbers: &raw, scale: &scale };
        let look = Look::at(&chain, &rods, &torques, |place| scene.contact(place));
        let by_tokens: Vec<f32> = numbers(chain.rods * INPUTS, 9.0, 1.0).iter().map(|x| *x as f32).collect();
        let (mut gradient, upstream) = (Rods::zeros(chain.rods), rods_of(&weights(&chain)));
        let by_outputs = chain.advance_back(&rods, outputs, &upstream, &mut gradient);
        let mut glided = look.tokens_back(&chain, &rods, &by_tokens, &mut gradient);
        glided.numbers_mut().zip(upstream.gripper.numbers()).for_each(|(x, b)| *x += b);
        let gripper = chain.glide_back(&glided);
        gradient.gripper.numbers_mut().zip(gripper.numbers()).for_each(|(x, g)| *x += g);

        // Directions within one part at a time. Tokens are rounded to f32, so the step is large.
        let (third, start) = (12 + 3 * chain.rods, flat(&rods));
        for (part, h) in [(0..12, 1e-5), (12..third, 1e-5), (third..start.len(), 1e-3)] {
            let way: Vec<f64> =
                weights(&chain).iter().enumerate().map(|(k, w)| if part.contains(&k) { *w } else { 0.0 }).collect();
            let value = |h: f64| {
                let moved: Vec<f64> = start.iter().zip(&way).map(|(x, w)| x + h * w).collect();
                weighed(&chain, &rods_of(&moved), &torques, outputs, &scene)
            };
            let (found, wanted) = (dot(&flat(&gradient), &way), (value(h) - value(-h)) / (2.0 * h));
            worst = worst.max((found - wanted).abs() / wanted.abs().max(100.0));
        }
        let way = numbers(chain.rods * OUTPUTS, 8.0, 1.0);
        let value = |h: f64| {
            let numbers: Vec<f32> = raw.iter().zip(&way).map(|(x, w)| (f64::from(*x) + h * w) as f32).collect();
            weighed(&chain, &rods, &torques, Outputs { numbers: &numbers, scale: &scale }, &scene)
        };
        let found: f64 = by_outputs.iter().zip(&way).map(|(a, b)| f64::from(*a) * b).sum();
        let wanted = (value(1e-3) - value(-1e-3)) / 2e-3;
        worst = worst.max((found - wanted).abs() / wanted.abs().max(1.0));
    }
    assert!(worst < 2e-3, "gradients are {worst:.1e} from those of differences");
}

#[test]
fn a_chain_moves_the_same_alone_and_among_others() {
    let (system, chain) = lead();
    let weights = Weights::init(network(&chain), 3);
    let start =
        begin(&system, &GenerateConfig { transitions: 5, frames: 1, seed: 4, ..GenerateConfig::default() }, 0, 5)
            .expect("starts");
    let joints = system.robot.joint_count();
    let torques: Vec<f64> = numbers(5, 1.0, 1.0)
        .iter()
        .flat_map(|x| (0..joints).map(move |k| if k < 6 { 20.0 * x } else { 0.0 }))
        .collect();
    let roll = |envs: &[usize]| {
        let mut batch = Batch::new(&system, &start.scenes[0], envs.len());
        for (i, env) in envs.iter().enumerate() {
            batch.scenes[i] = start.scenes[*env].clone();
            batch.reset(i, start.state(*env));
        }
        let own: Vec<f64> = envs.iter().flat_map(|env| torques[env * joints..][..joints].to_vec()).collect();
        let mut solver = ChainSolver::new(&weights, &normalizer(), &system).expect("its chain");
        (0..5).for_each(|_| solver.step(&mut batch, &own).expect("finite"));
        batch.states
    };
    let all = roll(&[0, 1, 2, 3, 4]);
    assert_eq!(all, roll(&[0, 1, 2, 3, 4]), "twice the same");
    assert_eq!(
        all[3 * system.robot.state_dim()..4 * system.robot.state_dim()],
        roll(&[3])[..],
        "alone and among others"
    );
}

#[test]
fn what_is_no_chain_or_no_number_is_refused() {
    let pendulum = Chain::of(&System::named("pendulum").expect("a robot")).expect_err("no chain").to_string();
    assert!(pendulum.starts_with("robot `pendulum` is not a chain") && !pendulum.contains('\n'), "{pendulum}");
    let twisting = "[cable]\nlength = 0.5\ndiameter = 0.006\nmass = 0.03\nbending = 1e-3\ntwisting = 1e-3\nlinks = 10";
    let twisting =
        Chain::of(&System::from_toml("rope", twisting).expect("a cable")).expect_err("it twists").to_string();
    assert!(twisting.contains("hinge"), "{twisting}");

    let (system, chain) = lead();
    let mut weights = Weights::init(network(&chain), 3);
    let short = TransformerConfig { block: 39, ..weights.config };
    let error = ChainSolver::new(&Weights::init(short, 0), &normalizer(), &system).err().expect("39 rods").to_string();
    assert!(error.contains("40 rods") && error.contains("39"), "{error}");
    *weights.flat.last_mut().expect("weights") = f32::NAN;
    let mut batch = Batch::new(&system, &system.scene("plane").expect("a floor"), 2);
    let torques = vec![0.0; 2 * system.robot.joint_count()];
    let error = ChainSolver::new(&weights, &normalizer(), &system)
        .expect("its chain")
        .step(&mut batch, &torques)
        .expect_err("no number");
    assert!(error.to_string().starts_with("environment 0, frame 0: "), "{error}");
}
