//! Robots seen by one token: slopes through frames, their kernels against the CPU, and that rollouts come nearer to the truth.

use std::sync::Arc;

use nerd_model::base::Base;
use nerd_model::device::padded;
use nerd_model::features::Features;
use nerd_model::form::{Form, View};
use nerd_model::normalizer::Normalizer;
use nerd_model::program::cpu::{Loaded, Memory};
use nerd_model::transformer::{Architecture, TransformerConfig, Weights};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::prelude::*;
use nerd_train::learner::{Learner, LearnerConfig, LearnerState, Optimizer};
use nerd_train::prepare::{generate, moments};
use nerd_train::ranks::Ranks;
use nerd_train::unroll::robot::Robot;
use nerd_train::unroll::{Body, Course, Motions, OnCard, Place, Rollout, Unroll, UnrollLearner};

use crate::cpp;
use crate::kernels::{Output, apart, some, worse};

/// As the paper has it, with positions that go with their velocities, and with velocities of contact points.
const ROBOTS: [(&str, Base, View); 11] = [
    ("cartpole", Base::Trapezoid, View::Moving),
    ("pendulum", Base::State, View::Own),
    ("pendulum", Base::State, View::Moving),
    ("cube", Base::State, View::Own),
    ("cube", Base::Trapezoid, View::Moving),
    ("franka", Base::State, View::Own),
    ("franka", Base::State, View::Moving),
    ("ant", Base::State, View::Own),
    ("ant", Base::State, View::Moving),
    ("ant", Base::Trapezoid, View::Moving),
    ("anymal", Base::Trapezoid, View::Moving),
];

fn forms() -> impl Iterator<Item = (&'static str, Form)> {
    ROBOTS.into_iter().map(|(robot, base, view)| (robot, Form { base, view }))
}

fn case(robot: &str, form: Form) -> (Arc<System>, Arc<Motions>, Normalizer) {
    let system = System::named(robot).expect("built in");
    let config = GenerateConfig { transitions: 24 * 40, frames: 40, seed: 3, resets: 0.5, ..GenerateConfig::default() };
    let solver = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::accurate(&system))) };
    let motions = Motions::record(&system, &solver, &config, &|_| ()).expect("motions");
    let windows = generate(&Ranks::default(), &system, &solver, &config, (1, form), &|_| ()).expect("tokens").windows;
    (system, Arc::new(motions), moments(&windows))
}

fn weights(system: &System, form: Form) -> Weights {
    let paper = TransformerConfig::paper(Features::inputs(system, form), Features::outputs(system), 24);
    Weights::init(TransformerConfig { layers: 2, heads: 1, block: 1, history: 1, architecture: Architecture::Residual, ..paper }, 5)
}

#[test]
fn the_slope_of_a_rollout_is_that_of_differences() {
    // Others' upstream gradients are so large that they are limited.
    for (robot, form) in forms().filter(|(robot, form)| form.base == Base::State && *robot != "franka") {
        let (system, motions, normalizer) = case(robot, form);
        let (weights, body) = (weights(&system, form), Robot::new(&system, form, &normalizer, &motions));
        let frames = 4;
        {
            let course = Course { body: body.clone(), train: motions.clone(), validation: motions.clone(), frames };
            let passed = |flat: &[f32]| {
                let network = Loaded::new(weights.config.program(), flat);
                let unroll = Unroll { course: &course, network: &network };
                let begin = |k: usize| unroll.begin(Place { motion: k, frame: k, view: () });
                let mut rollouts: Vec<Rollout<Robot>> = (0..12).map(begin).collect();
                unroll.pass(&mut rollouts, 1.0 / 12.0, &mut Vec::<Memory>::new())
            };
            let (_, gradient) = passed(&weights.flat);
            let size = gradient.iter().map(|g| f64::from(g * g)).sum::<f64>().sqrt();
            let moved = |h: f64| {
                let flat: Vec<f32> =
                    weights.flat.iter().zip(&gradient).map(|(w, g)| (f64::from(*w) + h * f64::from(*g) / size) as f32).collect();
                passed(&flat).0
            };
            let h = 3e-4;
            let wanted = (moved(h) - moved(-h)) / (2.0 * h);
            let off = (size / wanted - 1.0).abs();
            println!("{robot}, {form:?}, {frames} frames: a slope of {size:.4}, by differences {wanted:.4}, off by {off:.1e}");
            assert!(off < 2e-3, "{robot}, {form:?}, {frames} frames: a slope of {size:.4}, by differences {wanted:.4}, off by {off:.1e}");
        }
    }
}

#[test]
fn a_gradient_by_outputs_is_that_of_differences() {
    for (robot, form) in forms() {
        let (system, motions, normalizer) = case(robot, form);
        let (body, d, h) = (Robot::new(&system, form, &normalizer, &motions), system.robot.state_dim(), 2e-4f32);
        let (mut scratch, outputs) = (body.memory(), some(d, 0.3).into_iter().map(|x| x as f32).collect::<Vec<_>>());
        let mut off = 0.0f64;
        for i in 0..12 {
            let place = Place { motion: i, frame: i, view: () };
            let (own, truth) = (body.truth(&motions, &place), body.truth(&motions, &Place { frame: i + 1, ..place }));
            let look = body.look(&own, &motions, &place, &mut scratch, &mut Vec::new());
            let mut cost = |outputs: &[f32]| {
                let (moved, mut slope) = (body.advance(&own, &look, outputs, &mut scratch), body.level());
                (body.loss([&moved, &truth], 1, 1.0, &mut slope), slope)
            };
            let upstream = cost(&outputs).1;
            let expected = (0..d).map(|k| {
                let mut at = |by: f32| {
                    let mut moved = outputs.clone();
                    moved[k] += by;
                    (f64::from(moved[k]), cost(&moved).0)
                };
                let (ahead, behind) = (at(h), at(-h));
                (ahead.1 - behind.1) / (ahead.0 - behind.0)
            });
            let expected: Vec<f64> = expected.collect();
            let found = body.advance_back(&own, &look, &outputs, &upstream, &mut body.level());
            off = worse(off, apart(&found.into_iter().map(f64::from).collect::<Vec<_>>(), &expected));
        }
        println!("{robot}, {form:?}: {off:.1e} of the largest slope off");
        assert!(off < 2e-3, "{robot}, {form:?}: {off:.1e} of the largest slope off");
    }
}

#[test]
fn rollouts_come_nearer_to_the_truth() {
    let form = Base::Trapezoid.into();
    let (system, motions, normalizer) = case("pendulum", form);
    let config = LearnerConfig { batch: 64, clip: 1.0, average: 0.9, seed: 0, huber: None, optimizer: Optimizer::Muon };
    let course = |frames| Course {
        body: Robot::new(&system, form, &normalizer, &motions),
        train: motions.clone(),
        validation: motions.clone(),
        frames,
    };
    let (mut state, mut missed) = (LearnerState::new(weights(&system, form)), Vec::new());
    for (frames, updates) in [(1, 300), (4, 100)] {
        let mut learner = UnrollLearner::new(config, state, course(frames)).expect("a learner");
        missed.push(learner.validate(200).expect("finite"));
        (0..updates).for_each(|_| learner.update(3e-3).expect("finite"));
        missed.push(learner.validate(200).expect("finite"));
        state = learner.state().expect("a state");
    }
    println!("share of a change that is missed: {missed:?}");
    assert!(missed[1] < 0.8 * missed[0] && missed[3] < 0.9 * missed[1], "shares of a change that are missed: {missed:?}");
}

#[test]
fn kernels_roll_out_and_back_as_the_cpu_does() {
    const ROLLOUTS: usize = 24;
    const FRAME: usize = 3;
    let Some(compiler) = cpp::Compiler::find() else { return };
    for (robot, form) in forms() {
        let (system, motions, normalizer) = case(robot, form);
        let body = Robot::new(&system, form, &normalizer, &motions);
        let (d, n, inputs) = (system.robot.state_dim(), 2 * system.robot.nv(), Features::inputs(&system, form));
        let colliders = motions.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);
        let place = |i: usize, k: usize| Place { motion: i, frame: i % 30 + k, view: () };
        let outputs: Vec<f32> = some(ROLLOUTS * d, 0.3).into_iter().map(|x| x as f32).collect();
        let by_tokens: Vec<f32> = some(ROLLOUTS * inputs, 0.01).into_iter().map(|x| x as f32).collect();
        let upstreams = some(ROLLOUTS * n, 5.0);
        let head = [ROLLOUTS, motions.len(), motions.frames, FRAME];
        let mut input: Vec<u8> = head.iter().flat_map(|x| (*x as i32).to_le_bytes()).collect();
        let rows = (0..ROLLOUTS).flat_map(|i| Robot::row(&place(i, 0), true));
        let torques = (0..motions.len()).flat_map(|i| (0..motions.frames).flat_map(|k| motions.torques(i, k).to_vec()).collect::<Vec<_>>());
        let scenes = motions.scenes.iter().flat_map(|scene| body.record(&system, scene, colliders).expect("a scene with kernels"));
        input.extend(rows.chain(motions.states().iter().copied()).chain(torques).chain(scenes).flat_map(f64::to_le_bytes));
        input.extend(outputs.iter().chain(&by_tokens).flat_map(|x| x.to_le_bytes()));
        input.extend(upstreams.iter().flat_map(|x| x.to_le_bytes()));
        let output = compiler.run(&body.program(&system, ROLLOUTS, colliders).expect("it has kernels"), input);
        let mut output = Output { bytes: &output };
        let after = output.doubles(ROLLOUTS * d);
        let (tokens, judged) = (output.floats(ROLLOUTS * padded(inputs)), output.doubles(ROLLOUTS));
        let (slopes, by_outputs, fronts) = (output.doubles(ROLLOUTS * n), output.floats(ROLLOUTS * d), output.doubles(ROLLOUTS * n));

        let (mut worst, mut scratch) = ([0.0f64; 6], body.memory());
        for i in 0..ROLLOUTS {
            let (own, mut expected) = (body.truth(&motions, &place(i, FRAME)), Vec::new());
            let look = body.look(&own, &motions, &place(i, FRAME), &mut scratch, &mut expected);
            let predicted = &outputs[i * d..][..d];
            let moved = body.advance(&own, &look, predicted, &mut scratch);
            let truth = body.truth(&motions, &place(i, FRAME + 1));
            let mut all = body.level();
            let cost = body.loss([&moved, &truth], FRAME + 1, 0.7, &mut all);
            body.join(&mut all, &upstreams[i * n..][..n].to_vec(), 1 + i);
            let mut front = body.level();
            let wanted: Vec<f64> = body.advance_back(&own, &look, predicted, &all, &mut front).into_iter().map(f64::from).collect();
            body.look_back(&own, &look, &by_tokens[i * inputs..][..inputs], &all, &mut front, &mut scratch);
            let expected: Vec<f64> = expected.into_iter().map(f64::from).collect();
            let found = [
                apart(&after[i * d..][..d], &moved),
                apart(&tokens[i * padded(inputs)..][..inputs], &expected),
                apart(&judged[i..][..1], &[cost]),
                apart(&slopes[i * n..][..n], &all),
                apart(&by_outputs[i * d..][..d], &wanted),
                apart(&fronts[i * n..][..n], &front),
            ];
            worst.iter_mut().zip(found).for_each(|(worst, found)| *worst = worse(*worst, found));
        }
        println!("{robot}, {form:?}: after, tokens, loss, its slopes, by outputs, by the state: {worst:?} off");
        let exact = [worst[0], worst[2], worst[3], worst[5]].into_iter().fold(0.0, f64::max);
        assert!(exact < 1e-8 && worst[1].max(worst[4]) < 1e-6, "{robot}, {form:?}: {worst:?}");
        assert!(output.bytes.is_empty());
    }
}
