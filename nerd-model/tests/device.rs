//! The kernels around the network against the solver's own way, and small programs as one kernel against the CPU's engine, without a
//! device: their text is compiled as C++ and run on the CPU.

mod common;
#[path = "../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;

use std::sync::Arc;

use common::placed;
use nerd_core::dynamics::Data;
use nerd_core::state::wrap_state;
use nerd_model::base::Base;
use nerd_model::device::{Products, padded, program, settings, whole_program};
use nerd_model::features::Features;
use nerd_model::folder::Model;
use nerd_model::form::View;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::transformer::{Architecture, Positions, TransformerConfig, Weights};
use nerd_sim::articulated::device::{Reach, Real, record};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use nerd_sim::scene::contacts;

/// Environments that mostly touch something.
fn fallen(system: &Arc<System>, scene: &str, n: usize) -> (Batch, Vec<f64>) {
    let mut batch = Batch::new(system, &system.scene(scene).expect("a scene"), n);
    (0..n).for_each(|env| batch.reset(env, &start(system, Start::Sample, &mut stream(5, env as u64))));
    let mut solver = Articulated::new(ArticulatedConfig::accurate(system));
    let idle = vec![0.0; n * system.robot.joint_count()];
    (0..25).for_each(|_| solver.step(&mut batch, &idle).expect("it can be stepped"));
    // A rod of a cable weighs two grams.
    let push = if system.robot.sprung() { 1e-3 } else { 3.0 };
    let torques = (0..idle.len()).map(|k| push * (k as f64 * 0.7).sin()).collect();
    (batch, torques)
}

/// Tokens, bases and next states.
struct Told {
    tokens: Vec<f32>,
    bases: Vec<f64>,
    states: Vec<f64>,
}

/// By the library.
fn expected(model: &Model, batch: &Batch, torques: &[f64], predictions: &[f32]) -> Told {
    let (system, d) = (&batch.system, batch.system.robot.state_dim());
    let (joints, width) = (system.robot.joint_count(), padded(model.config.network.inputs));
    let mut features = Features::new(system, model.config.form());
    let mut draft = model.config.base.draft(system).map(|made| made.expect("a draft"));
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    let mut told = Told { tokens: vec![0.0; batch.len() * width], bases: batch.states.clone(), states: batch.states.clone() };
    for env in 0..batch.len() {
        let (state, scene, tau) = (batch.state(env), &batch.scenes[env], &torques[env * joints..][..joints]);
        contacts(&system.robot, scene, state, &mut data, &mut events);
        let base = &mut told.bases[env * d..][..d];
        if let Some(draft) = &mut draft {
            draft.step(system, &scene.gravity, &events, tau, base).expect("drafted");
        }
        let token = &mut told.tokens[env * width..][..model.config.network.inputs];
        features.token(state, base, &events, tau, &scene.gravity, token);
        model.normalizer.inputs.normalize(token);
        let outputs = &model.normalizer.outputs;
        let raw = predictions[env * d..][..d].iter().zip(outputs.scale().zip(&outputs.mean));
        let change: Vec<f64> = raw.map(|(x, (scale, mean))| f64::from(*x) * scale + mean).collect();
        let next = &mut told.states[env * d..][..d];
        features.apply(state, base, &change, next);
        wrap_state(&system.robot, next);
    }
    told
}

/// By the kernels.
fn kernels(compiler: &cpp::Compiler, name: &str, model: &Model, batch: &Batch, torques: &[f64], predictions: &[f32], real: Real) -> Told {
    let (system, n, reach) = (&batch.system, batch.len(), Reach::of(batch));
    let text = program(model, system, real, reach.colliders).expect("it has kernels");
    let config = settings(model, system).expect("it has kernels").0;
    let mut input: Vec<u8> = [n, n].iter().flat_map(|x| (*x as i32).to_le_bytes()).collect();
    let scenes: Vec<f64> = batch.scenes.iter().flat_map(|s| record(s, system, &config, reach).expect("a scene with kernels")).collect();
    input.extend(batch.states.iter().chain(torques).chain(&scenes).flat_map(|x| x.to_le_bytes()));
    input.extend((0..n as i32).flat_map(i32::to_le_bytes));
    input.extend(predictions.iter().flat_map(|x| x.to_le_bytes()));
    let output = compiler.run(&text, input);
    let (faults, rest) = output.split_at(4 * n);
    assert!(faults.iter().all(|b| *b == 0), "{name}: {faults:?}");
    let (tokens, rest) = rest.split_at(4 * n * padded(model.config.network.inputs));
    let doubles = |bytes: &[u8]| -> Vec<f64> { bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect() };
    let (bases, states) = rest.split_at(rest.len() / 2);
    let tokens = tokens.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    Told { tokens, bases: doubles(bases), states: doubles(states) }
}

fn apart(a: impl IntoIterator<Item = f64>, b: impl IntoIterator<Item = f64>) -> f64 {
    a.into_iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max)
}

#[test]
fn kernels_tell_and_apply_as_the_solver_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let table = [
        ("cartpole", "free", Base::State),
        ("cartpole", "free", Base::Draft(1)),
        ("franka", "free", Base::Draft(1)),
        ("pendulum", "ground1", Base::Draft(4)),
        ("cube", "box", Base::Draft(4)),
        ("cube", "ground", Base::State),
        ("ant", "ground", Base::Draft(4)),
        ("ant", "free", Base::Draft(2)),
        ("anymal", "ground", Base::Draft(4)),
        // Springs, and whips that are cut.
        ("lead", "plane", Base::Draft(2)),
    ];
    for (robot, scene, base) in table {
        let (system, n) = (System::named(robot).expect("built in"), 40);
        let (batch, torques) = fallen(&system, scene, n);
        let mut model = placed(&system, base, Positions::Rotary);
        // Nothing of a token is where it would be without its normaliser, and turns are near those that are none.
        model.normalizer.inputs.mean.iter_mut().enumerate().for_each(|(k, m)| *m = 0.1 * (k as f64).sin());
        if system.robot.floating() {
            model.normalizer.outputs.mean[6] = 1.0;
        }
        let d = system.robot.state_dim();
        let predictions: Vec<f32> = (0..n * d).map(|k| (k as f32 * 0.37).sin()).collect();
        let own = expected(&model, &batch, &torques, &predictions);
        // A cable's end is so light that 32 bits tell its rates to a hundredth.
        let single = if system.robot.sprung() { [0.1, 0.1] } else { [1e-4, 2e-4] };
        for (real, most) in [(Real::F64, [1e-6, 1e-9]), (Real::F32, single)] {
            let name = format!("{robot}-{scene}-{real:?}");
            let told = kernels(&compiler, &name, &model, &batch, &torques, &predictions, real);
            let wide = |x: &[f32]| x.iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
            let tokens = apart(wide(&told.tokens), wide(&own.tokens));
            let (bases, states) = (apart(told.bases.clone(), own.bases.clone()), apart(told.states.clone(), own.states.clone()));
            println!("{name} {base:?}: tokens {tokens:.1e}, bases {bases:.1e}, states {states:.1e} apart");
            assert!(tokens < most[0] && bases < most[1] && states < most[1], "{name}: {tokens:e}, {bases:e}, {states:e}");
        }
    }
}

#[test]
fn what_has_no_kernel_is_named() {
    let system = System::named("ant").expect("built in");
    type Change<'a> = &'a dyn Fn(&mut Model);
    let refused = |change: Change| {
        let mut model = placed(&system, Base::Draft(1), Positions::Rotary);
        change(&mut model);
        program(&model, &system, Real::F32, 1).expect_err("it has no kernel")
    };
    let table: [(&str, Change); 2] = [("Flight", &|m| m.config.base = Base::Flight), ("view is World", &|m| m.config.view = View::World)];
    for (word, change) in table {
        let said = refused(change);
        assert!(said.contains(word) && said.contains("CPU"), "{said}");
    }
}

const WINDOWS: usize = 3;

fn network(architecture: Architecture, [inputs, outputs, embedding, layers]: [usize; 4], tokens: usize) -> Weights {
    let paper = TransformerConfig::paper(inputs, outputs, embedding);
    let shape = TransformerConfig { layers, heads: 1, block: tokens, history: 1, head: 8, architecture, ..paper };
    let mut weights = Weights::init(shape, 5);
    // Nothing at zero, so that every tensor is seen.
    weights.flat.iter_mut().enumerate().for_each(|(k, w)| *w += 0.05 * (k as f32 * 0.37).sin());
    weights
}

#[test]
fn a_pass_in_one_kernel_is_that_of_the_engine() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let cases = [
        ("chain", network(Architecture::Chain, [30, 18, 48, 8], 40), 40),
        ("short", network(Architecture::Chain, [30, 18, 12, 3], 7), 7),
        ("mlp", network(Architecture::Mlp, [10, 3, 8, 3], 1), 1),
    ];
    let cases = cases.iter().flat_map(|case| [Products::F32, Products::Tf32].map(|products| (case, products)));
    for ((name, weights, tokens), products) in cases {
        let (tokens, most) = (*tokens, if products == Products::F32 { 1e-5 } else { 5e-3 });
        let (program, c) = (weights.config.program(), weights.config);
        let whole = whole_program(&program, tokens, products).expect("it fits");
        let inputs: Vec<f32> = (0..WINDOWS * tokens * c.inputs).map(|k| (k as f32 * 0.71).sin()).collect();
        let mut input: Vec<u8> = [WINDOWS as i32, weights.flat.len() as i32].iter().flat_map(|x| x.to_le_bytes()).collect();
        input.extend(weights.flat.iter().flat_map(|x| x.to_le_bytes()));
        for row in inputs.chunks(c.inputs) {
            let full = row.iter().copied().chain(std::iter::repeat(0.0)).take(padded(c.inputs));
            input.extend(full.flat_map(f32::to_le_bytes));
        }
        let said = compiler.run(&whole.text, input);
        let said: Vec<f32> = said.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let (network, rows) = (Loaded::new(program, &weights.flat), Vec::from_iter(0..WINDOWS * tokens));
        let wanted = network.forward(&inputs, &mut Memory::default(), Pass::Windows(tokens, &rows)).clone();
        let size = wanted.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let off = said
            .iter()
            .zip(&wanted)
            .map(|(a, b)| (a - b).abs() / size)
            .fold(0.0f32, |most, off| if most.is_nan() || off <= most { most } else { off });
        println!("{name}, {products:?}: {off:.1e} off, {} threads, {} windows", whole.threads, whole.windows);
        assert!(said.len() == wanted.len() && off < most, "{name}, {products:?}: {off:e} off, {} of {} numbers", said.len(), wanted.len());
    }
}

#[test]
fn what_has_no_such_form_has_none() {
    let of = |architecture, tokens| network(architecture, [30, 18, 48, 2], tokens).config.program();
    assert!(whole_program(&of(Architecture::Transformer, 10), 10, Products::F32).is_none(), "attention");
    assert!(whole_program(&of(Architecture::Gru, 10), 10, Products::F32).is_none(), "cells");
    assert!(whole_program(&of(Architecture::Chain, 400), 400, Products::F32).is_none(), "too long for a block's memory");
}
