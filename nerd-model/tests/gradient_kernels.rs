//! GPU kernels of a frame's adjoint against the CPU solver. No GPU is needed: the kernels are compiled as C++ and run
//! on the CPU, with the CPU's network between them.

mod common;
#[path = "../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;

use common::{fallen, pure, some, worst};
use cpp::{Compiler, bytes, doubles, floats};
use nerd_model::device::{gradient_program, padded};
use nerd_model::prelude::*;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_sim::articulated::device::{Reach, record};

const N: usize = 10;
const ROWS: usize = 2;

/// Launches of every kernel. Arguments: states, torques, scene, scene index of each environment, outputs, gradients
/// with respect to next states and to tokens, results.
const LAUNCHES: &str = "for (; blockIdx.x < N + 3; blockIdx.x++) {
    gradients_look(b[0], b[1], b[2], b[3], b[7], N, N);
    for (int row = 0; row < ROWS; row++) {
        gradients_said(b[0], b[4], b[5], b[9], (float*)b[8] + row * N * STATE, ROWS, row, N);
        gradients_back(b[0], b[2], b[3], b[4], (float*)b[6] + row * N * INPUTS, b[5], b[10], b[11], ROWS, row, N);
    }
}";

#[test]
fn kernels_go_back_through_a_frame_as_the_cpu_does() {
    let Some(compiler) = Compiler::find() else { return };
    for (robot, scene) in [("cartpole", "free"), ("franka", "free"), ("ant", "ground")] {
        let system = System::named(robot).expect("built in");
        let model = pure(&system, 0.1, 0.5);
        let network = model.config.network;
        let (inputs, d, joints) = (network.inputs, network.outputs, system.robot.joint_count());
        let loaded = Loaded::new(network.program(), &model.weights.flat);
        let batch = fallen(&system, scene, N, (Start::Reset, 7), 20);
        let (torques, grad_next) = (some(N * joints, 1.0), some(N * ROWS * 2 * system.robot.nv(), 1.0));
        let text = gradient_program(model.config.form(), &model.normalizer, &system, Reach::of(&batch));
        let launches = format!("const int N = {N}, ROWS = {ROWS};\n{LAUNCHES}");
        let numbers = record(&batch.scenes[0], &system, Reach::of(&batch)).expect("a scene with kernels");
        let mut buffers = [&batch.states, &torques, &numbers].map(|numbers| bytes(numbers, f64::to_le_bytes)).to_vec();
        buffers.extend([
            vec![0; 4 * N],
            vec![0; 4 * N * d],
            bytes(&grad_next, f64::to_le_bytes),
            vec![0; 4 * ROWS * N * inputs],
        ]);
        let found = [4 * N * padded(inputs), 4 * ROWS * N * d, 8 * N * d, 8 * grad_next.len(), 8 * N * ROWS * joints];
        buffers.extend(found.map(|size| vec![0; size]));
        // Three launches: for tokens, for gradients with respect to outputs, and for the full adjoint.
        let mut memory = Memory::default();
        let tokens = floats(&compiler.launch(&text, &launches, &buffers)[7]);
        let tokens: Vec<f32> = tokens.chunks(padded(inputs)).flat_map(|token| token[..inputs].to_vec()).collect();
        buffers[4] = bytes(loaded.forward(&tokens, &mut memory, Pass::Kept(1)), f32::to_le_bytes);
        let by_said = floats(&compiler.launch(&text, &launches, &buffers)[8]);
        let by_tokens = by_said.chunks(N * d).flat_map(|by| loaded.backward_to_tokens(1, by, &mut memory));
        buffers[6] = bytes(&by_tokens.collect::<Vec<f32>>(), f32::to_le_bytes);
        let found = compiler.launch(&text, &launches, &buffers);
        let [next, states, by_torques] = [9, 10, 11].map(|k| doubles(&found[k]));
        let expected = Neural::on_cpu(model).vjp(&batch, &torques, ROWS, &grad_next).expect("gradients");
        let off =
            [worst(&next, &expected.next), worst(&states, &expected.states), worst(&by_torques, &expected.torques)];
        assert!(
            off.iter().all(|off| *off < 1e-5),
            "{robot}: next states, gradients by states and by torques {off:?} off"
        );
    }
}
