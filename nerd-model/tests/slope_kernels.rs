//! The kernels of a frame's way back against the CPU's solver, without a device: their text is compiled as C++ and run on the CPU, with the
//! network of the CPU between them.

mod common;
#[path = "../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;

use nerd_model::device::{padded, settings, slope_program};
use nerd_model::form::{Form, View};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::transformer::{Architecture, TransformerConfig};
use nerd_model::{base::Base, features::Features, neural::Neural};
use nerd_sim::articulated::device::{Reach, record};
use nerd_sim::prelude::*;

const N: usize = 10;
const ROWS: usize = 2;

/// Names of CUDA, and a program that launches every kernel, an environment a block: states, torques, scene, outputs, gradients by tokens and by
/// next states in; tokens, next states, gradients by outputs of the last row, by states and by torques out.
const BEFORE: &str = "#define __global__\nstruct Place { int x; };\nstatic Place blockIdx, blockDim = {1}, threadIdx;\n";
const MAIN: &str = r"
#include <cstdio>
#include <vector>
template <class T> std::vector<T> take_in(size_t n) { std::vector<T> x(n); if (fread(x.data(), sizeof(T), n, stdin) != n) throw 1; return x; }
template <class T> void put_out(const std::vector<T>& x) { fwrite(x.data(), sizeof(T), x.size(), stdout); }
int main() {
    const int n = take_in<int>(1)[0], rows = take_in<int>(1)[0];
    auto states = take_in<double>(n * STATE), torques = take_in<double>(n * NJ), scene = take_in<double>(SCENE);
    auto by_next = take_in<double>(n * rows * 2 * NV);
    auto said = take_in<float>(n * STATE), by_tokens = take_in<float>(rows * n * INPUTS);
    std::vector<int> of(n);
    std::vector<float> tokens(n * LDX), by_said(rows * n * STATE);
    std::vector<double> next(n * STATE), slopes(n * rows * 2 * NV), by_torques(n * rows * NJ);
    for (blockIdx.x = 0; blockIdx.x < n + 3; blockIdx.x++) {
        slopes_look(states.data(), torques.data(), scene.data(), of.data(), tokens.data(), n, n);
        for (int row = 0; row < rows; row++) {
            slopes_said(states.data(), said.data(), by_next.data(), next.data(), by_said.data() + row * n * STATE, rows, row, n);
            slopes_back(states.data(), scene.data(), of.data(), said.data(), by_tokens.data() + row * n * INPUTS, by_next.data(), slopes.data(),
                        by_torques.data(), rows, row, n);
        }
    }
    put_out(tokens), put_out(by_said), put_out(next), put_out(slopes), put_out(by_torques);
    return 0;
}
";

fn some(n: usize, size: f64) -> Vec<f64> {
    (0..n).map(|k| size * (1.7 * k as f64 + 0.3).sin()).collect()
}

fn apart(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(1e-9, |most: f64, x| most.max(x.abs()));
    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / largest);
    off.fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

#[test]
fn kernels_go_back_through_a_frame_as_the_cpu_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    for (robot, scene) in [("cartpole", "free"), ("franka", "free"), ("ant", "ground")] {
        let (system, form) = (System::named(robot).expect("built in"), Form { base: Base::Trapezoid, view: View::Moving });
        let scene = system.scene(scene).expect("known");
        let (inputs, d, joints) = (Features::inputs(&system, form), system.robot.state_dim(), system.robot.joint_count());
        let paper = TransformerConfig::paper(inputs, d, 24);
        let network = TransformerConfig { layers: 2, heads: 1, block: 1, history: 1, architecture: Architecture::Residual, ..paper };
        let unit = |n: usize, variance: f64| Moments { mean: vec![0.1; n], variance: vec![variance; n], epsilon: 1e-5 };
        let model = common::unlearned(&system, form, network, Normalizer { inputs: unit(inputs, 1.0), outputs: unit(d, 0.5) });
        let loaded = Loaded::new(network.program(), &model.weights.flat);
        let mut batch = Batch::new(&system, &scene, N);
        (0..N).for_each(|env| batch.reset(env, &start(&system, Start::Reset, &mut stream(7, env as u64))));
        let truth = &mut Articulated::new(ArticulatedConfig::accurate(&system));
        (0..20).for_each(|_| truth.step(&mut batch, &vec![0.0; N * joints]).expect("a frame"));
        let (torques, by_next) = (some(N * joints, 1.0), some(N * ROWS * 2 * system.robot.nv(), 1.0));
        let text = BEFORE.to_string() + &slope_program(form, &model.normalizer, &system, scene.colliders.len()) + MAIN;
        let numbers = record(&scene, &system, &settings(), Reach::of(&batch)).expect("a scene with kernels");
        let head = [N as i32, ROWS as i32].into_iter().flat_map(i32::to_le_bytes);
        let numbers = [&batch.states[..], &torques, &numbers, &by_next].concat().into_iter().flat_map(f64::to_le_bytes);
        let head: Vec<u8> = head.chain(numbers).collect();
        // Three times: for tokens, for gradients by outputs, and for all.
        let (mut said, mut by_tokens) = (vec![0.0f32; N * d], vec![0.0f32; ROWS * N * inputs]);
        let mut memory = Memory::default();
        let run = |said: &[f32], by_tokens: &[f32]| {
            compiler.run(&text, head.iter().copied().chain(said.iter().chain(by_tokens).flat_map(|x| x.to_le_bytes())).collect())
        };
        let floats = |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<f32>>();
        let tokens = floats(&run(&said, &by_tokens)[..4 * N * padded(inputs)]);
        let tokens: Vec<f32> = tokens.chunks(padded(inputs)).flat_map(|token| token[..inputs].to_vec()).collect();
        said.copy_from_slice(loaded.forward(&tokens, &mut memory, Pass::Kept(1)));
        let by_said = floats(&run(&said, &by_tokens)[4 * N * padded(inputs)..][..4 * ROWS * N * d]);
        for (by, row) in by_said.chunks(N * d).zip(by_tokens.chunks_mut(N * inputs)) {
            row.copy_from_slice(&loaded.backward_to_tokens(1, by, &mut memory));
        }
        let output = run(&said, &by_tokens);
        let rest = &output[4 * N * padded(inputs) + 4 * ROWS * N * d..];
        let found: Vec<f64> = rest.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let expected = Neural::on_cpu(model).back(&batch, &torques, ROWS, &by_next).expect("slopes");
        let (next, rest) = found.split_at(expected.next.len());
        let (states, by_torques) = rest.split_at(expected.states.len());
        let off = [apart(next, &expected.next), apart(states, &expected.states), apart(by_torques, &expected.torques)];
        println!("{robot}: next states, slopes by states and by torques {off:?} off");
        assert!(off.iter().all(|off| *off < 1e-5), "{robot}: {off:?}");
    }
}
