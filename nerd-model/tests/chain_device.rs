//! The kernels around a chain's network against its solver, without a device: their text is compiled as C++ and run on the CPU.

#[path = "../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;

use std::path::PathBuf;

use nerd_model::chain::{Chain, ChainSolver, INPUTS, Look, OUTPUTS};
use nerd_model::device::{chain_program, padded};
use nerd_model::folder::Model;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_sim::articulated::device::{Reach, record};
use nerd_sim::dataset::{GenerateConfig, begin};
use nerd_sim::prelude::*;

const LEADS: usize = 8;

#[test]
fn kernels_tell_and_apply_as_the_solver_of_chains_does() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
    let system = System::named("lead-pegs").expect("built in");
    let model = Model::load(&folder.join("models/lead-pegs"), &system, None).expect("the shipped model");
    let chain = Chain::of(&system).expect("a chain");
    let config = GenerateConfig { transitions: LEADS * 60, frames: 60, ..GenerateConfig::default() };
    let mut batch = begin(&system, &config, 0, LEADS).expect("leads");
    let (joints, d) = (system.robot.joint_count(), system.robot.state_dim());
    let torques: Vec<f64> = (0..LEADS * joints).map(|k| if k % joints < 6 { 3.0 * (k as f64).sin() } else { 0.0 }).collect();
    let mut solver = ChainSolver::new(&model.weights, &model.normalizer, &system).expect("a solver");
    // Until they lie on floor and pegs.
    (0..40).for_each(|_| solver.step(&mut batch, &torques).expect("it can be stepped"));

    let (mut tokens, mut said, mut near, mut memory) = (Vec::new(), Vec::new(), 0, Memory::default());
    let (network, rows) = (Loaded::new(model.weights.config.program(), &model.weights.flat), Vec::from_iter(0..chain.rods));
    for env in 0..LEADS {
        let rods = chain.rods(batch.state(env));
        let look = Look::at(&chain, &rods, &torques[env * joints..][..joints], |place| batch.scenes[env].contact(place));
        let first = tokens.len();
        look.tokens(&chain, &rods, &mut tokens);
        said.extend_from_slice(network.forward(&tokens[first..], &mut memory, Pass::Windows(chain.rods, &rows)));
        near += tokens[first..].chunks(INPUTS).filter(|token| token[17] > 0.0).count();
    }

    let (reach, settings) = (Reach::of(&batch), ArticulatedConfig::implicit(1, Friction::Coulomb));
    let scale: [f64; OUTPUTS] = ChainSolver::scale(&model.normalizer).expect("a chain's normaliser");
    let place = tempfile::tempdir().expect("a folder");
    let made = cpp::compile(compiler, &chain_program(&chain, &scale, &system, reach.colliders), place.path(), "chain");
    let mut input: Vec<u8> = [LEADS as i32; 2].iter().flat_map(|x| x.to_le_bytes()).collect();
    let scenes: Vec<f64> = batch.scenes.iter().flat_map(|s| record(s, &system, &settings, reach).expect("a scene with kernels")).collect();
    input.extend(batch.states.iter().chain(&torques).chain(&scenes).flat_map(|x| x.to_le_bytes()));
    input.extend((0..LEADS as i32).flat_map(i32::to_le_bytes));
    input.extend(said.iter().flat_map(|x| x.to_le_bytes()));
    let output = cpp::talk(&made, input);
    let (faults, rest) = output.split_at(4 * LEADS);
    assert!(faults.iter().all(|b| *b == 0), "{faults:?}");
    let (told, states) = rest.split_at(4 * LEADS * chain.rods * padded(INPUTS));
    let told: Vec<f32> = told.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let states: Vec<f64> = states.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();

    solver.step(&mut batch, &torques).expect("it can be stepped");
    let own = told.chunks(padded(INPUTS)).flat_map(|token| &token[..INPUTS]);
    let by_tokens = own.zip(&tokens).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f32::max);
    let by_states = states.iter().zip(&batch.states).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
    println!("{near} ends of rods near a surface: tokens {by_tokens:.1e}, states {by_states:.1e} apart");
    assert!(near > 100 && states.len() == LEADS * d, "{near} near, {} numbers", states.len());
    assert!(by_tokens < 1e-6 && by_states < 1e-9, "tokens {by_tokens:e}, states {by_states:e} apart");
}
