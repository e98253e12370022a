//! GPU kernels around the network against the CPU solver, and small networks as one kernel against the CPU engine. No
//! GPU is needed: the kernels are compiled as C++ and run on the CPU.

mod common;
#[path = "../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;

use std::sync::Mutex;

use common::{fallen, placed};
use cpp::{Compiler, bytes, doubles, floats};
use nerd_model::base::Base;
use nerd_model::chain::{Chain, ChainSolver, INPUTS, Look, OUTPUTS, chain_program};
use nerd_model::device::{Products, held_in_f16, padded, program, whole_program};
use nerd_model::form::{Form, View};
use nerd_model::prelude::*;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::transformer::{Architecture, ForwardError, Positions, Stream, TransformerConfig, Weights};
use nerd_sim::articulated::device::{Reach, Real, records};
use nerd_sim::dataset::{GenerateConfig, begin};
use nerd_sim::scene::{TerrainKind, TerrainSpec};

/// A network with given predictions that records its tokens.
struct Given {
    predictions: Vec<f32>,
    tokens: Arc<Mutex<Vec<f32>>>,
}

impl Stream for Given {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        *self.tokens.lock().expect("its own thread") = tokens.to_vec();
        out.clone_from(&self.predictions);
        Ok(())
    }

    fn clear(&mut self, _: usize) {}
}

/// Runs the two launches of a kernel text on a batch; returns tokens and next states.
fn frame(
    compiler: &Compiler,
    (text, launches): (&str, [&str; 2]),
    batch: &Batch,
    torques: &[f64],
    predictions: &[f32],
    (rows, inputs): (usize, usize),
) -> (Vec<f32>, Vec<f64>) {
    let (n, reach) = (batch.len(), Reach::of(batch));
    let (scenes, of) = records(batch, reach).expect("they have kernels");
    let [states, torques, scenes] = [&*batch.states, torques, &scenes].map(|numbers| bytes(numbers, f64::to_le_bytes));
    let [scene_of, held] = [of, vec![1]].map(|numbers| bytes(&numbers, i32::to_le_bytes));
    let [tokens, faults, done, taken, memo] =
        [4 * rows * padded(inputs), 4 * n, 4 * n, 4 * n, 2 * states.len()].map(|size| vec![0; size]);
    let predictions = bytes(predictions, f32::to_le_bytes);
    let buffers = [states, torques, scenes, scene_of, tokens, faults, done, held, predictions, taken, memo];
    // Threads beyond the last environment must do nothing.
    let lines = launches.map(|kernel| format!("for (blockIdx.x = 0; blockIdx.x < 8 * n; blockIdx.x++) {kernel};\n"));
    let found = compiler.launch(text, &format!("const int n = {n};\n{}", lines.concat()), &buffers);
    assert!(found[5].iter().all(|b| *b == 0), "{:?}", found[5]);
    let tokens = floats(&found[4]).chunks(padded(inputs)).flat_map(|token| token[..inputs].to_vec()).collect();
    (tokens, doubles(&found[0]))
}

fn apart<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| ((*a).into() - (*b).into()).abs() / (1.0 + (*b).into().abs())).fold(0.0, f64::max)
}

#[test]
fn kernels_tell_and_apply_as_the_solver_does() {
    let Some(compiler) = Compiler::find() else { return };
    let launches = [
        "neural_tell(b[0], b[1], b[2], b[3], b[4], b[5], b[6], n, b[7])",
        "neural_apply(b[0], b[8], b[9], b[5], b[6], n)",
    ];
    let table = [
        ("cartpole", "free", Base::State),
        ("franka", "free", Base::Trapezoid),
        ("pendulum", "ground1", Base::Trapezoid),
        ("pendulum", "ground5", Base::State),
        ("cube", "box", Base::State),
        ("cube", "ground", Base::Trapezoid),
        ("ant", "ground", Base::State),
        ("ant", "free", Base::Trapezoid),
        ("ant", "terrain", Base::Trapezoid),
        ("anymal", "ground", Base::Trapezoid),
    ];
    let each =
        |(robot, scene, base)| [View::Own, View::Moving].map(|view| (robot, scene, Form { base, view, told: false }));
    for (robot, scene, form) in table.into_iter().flat_map(each) {
        let (mut system, n) = (System::named(robot).expect("built in"), 40);
        if scene == "terrain" {
            let rubble = TerrainSpec { kind: TerrainKind::Rubble, height: 0.1, cell: 0.2, length: None, seed: Some(4) };
            system = Arc::new((*system).clone().with_terrain(rubble).expect("in range"));
        }
        // After these frames most robots are in contact.
        let batch = fallen(&system, scene, n, (Start::Sample, 5), 25);
        let torques: Vec<f64> = (0..n * system.robot.joint_count()).map(|k| 3.0 * (k as f64 * 0.7).sin()).collect();
        let mut model = placed(&system, form, Positions::Rotary);
        // Every token entry depends on the normaliser, and predicted rotations are near the identity.
        model.normalizer.inputs.mean.iter_mut().enumerate().for_each(|(k, m)| *m = 0.1 * (k as f64).sin());
        if system.robot.floating() {
            model.normalizer.outputs.mean[6] = 1.0;
        }
        let predictions: Vec<f32> = (0..batch.states.len()).map(|k| (k as f32 * 0.37).sin()).collect();
        let (mut own, noted) = (batch.clone(), Arc::new(Mutex::new(Vec::new())));
        let given = Given { predictions: predictions.clone(), tokens: noted.clone() };
        Neural::new(model.clone(), Box::new(given)).step(&mut own, &torques).expect("finite");
        for (real, most) in [(Real::F64, [1e-6, 1e-9]), (Real::F32, [1e-4, 2e-4])] {
            let name = format!("{robot}-{scene}-{real:?}");
            let text = program(model.config.form(), &model.normalizer, &system, real, Reach::of(&batch));
            let shape = (n, model.config.network.inputs);
            let (tokens, states) = frame(&compiler, (&text, launches), &batch, &torques, &predictions, shape);
            let (tokens, states) = (apart(&tokens, &noted.lock().expect("done")), apart(&states, &own.states));
            assert!(
                tokens < most[0] && states < most[1],
                "{name}, {form:?}: tokens {tokens:e}, states {states:e} apart"
            );
        }
    }
}

#[test]
fn kernels_of_a_chain_tell_and_apply_as_its_solver_does() {
    let Some(compiler) = Compiler::find() else { return };
    const LEADS: usize = 8;
    let system = System::named("lead-pegs").expect("built in");
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/lead-pegs");
    let model = Model::load(folder.as_ref(), &system, None).expect("the shipped model");
    let (chain, joints) = (Chain::of(&system).expect("a chain"), system.robot.joint_count());
    let config = GenerateConfig { transitions: LEADS * 60, frames: 60, ..GenerateConfig::default() };
    let mut batch = begin(&system, &config, 0, LEADS).expect("leads");
    let torques: Vec<f64> =
        (0..LEADS * joints).map(|k| if k % joints < 6 { 3.0 * (k as f64).sin() } else { 0.0 }).collect();
    let mut solver = ChainSolver::new(&model.weights, &model.normalizer, &system).expect("a solver");
    // Until the cables lie on floor and pegs.
    (0..40).for_each(|_| solver.step(&mut batch, &torques).expect("it can be stepped"));

    let (mut tokens, mut outputs, mut memory) = (Vec::new(), Vec::new(), Memory::default());
    let (network, rows) =
        (Loaded::new(model.weights.config.program(), &model.weights.flat), Vec::from_iter(0..chain.rods));
    for env in 0..LEADS {
        let (rods, first) = (chain.rods(batch.state(env)), tokens.len());
        let look =
            Look::at(&chain, &rods, &torques[env * joints..][..joints], |place| batch.scenes[env].contact(place));
        look.tokens(&chain, &rods, &mut tokens);
        outputs.extend_from_slice(network.forward(&tokens[first..], &mut memory, Pass::Windows(chain.rods, &rows)));
    }
    let near = tokens.chunks(INPUTS).filter(|token| token[17] > 0.0).count();
    let scale: [f64; OUTPUTS] = ChainSolver::scale(&model.normalizer).expect("a chain's normaliser");
    let text = chain_program(&chain, &scale, &system, Reach::of(&batch).colliders);
    let tell = "chain_tell(b[0], b[1], b[2], b[3], b[10], b[4], b[5], b[6], n, b[7])";
    let launches = [tell, "chain_apply(b[0], b[10], b[8], b[5], b[6], n)"];
    let (own, states) = frame(&compiler, (&text, launches), &batch, &torques, &outputs, (LEADS * chain.rods, INPUTS));
    solver.step(&mut batch, &torques).expect("it can be stepped");
    let (tokens, states) = (apart(&own, &tokens), apart(&states, &batch.states));
    assert!(near > 100 && tokens < 1e-6 && states < 1e-9, "{near} near, tokens {tokens:e}, states {states:e} apart");
}

fn network(architecture: Architecture, [inputs, outputs, embedding, layers]: [usize; 4], tokens: usize) -> Weights {
    let paper = TransformerConfig::paper(inputs, outputs, embedding);
    let shape = TransformerConfig { layers, heads: 1, block: tokens, history: 1, head: 8, architecture, ..paper };
    let mut weights = Weights::init(shape, 5);
    // No zeros, so that every tensor has an effect.
    weights.flat.iter_mut().enumerate().for_each(|(k, w)| *w += 0.05 * (k as f32 * 0.37).sin());
    weights
}

#[test]
fn a_pass_in_one_kernel_is_that_of_the_engine() {
    let Some(compiler) = Compiler::find() else { return };
    let (chain, residual) = (Architecture::Chain, Architecture::Residual);
    let chains = [([30, 18, 48, 8], 40), ([30, 18, 12, 3], 7)];
    let along = chains.iter().map(|(shape, tokens)| (network(chain, *shape, *tokens), *tokens, 3, Products::F32, 1e-5));
    // A block has 64 rows; the second one here has fewer.
    let alone = [[30, 18, 64, 3], [65, 64, 128, 2], [110, 29, 192, 2], [340, 29, 256, 2]]
        .map(|shape| (network(residual, shape, 1), 1, 70, Products::F16, 1e-3));
    // Without blocks the remaining products are nearly f32.
    let mut idle = network(residual, [340, 29, 256, 1], 1);
    let (tensors, starts) = (idle.config.tensors(), idle.config.program().starts());
    assert!(!held_in_f16(&idle.config.program(), &idle.flat), "numbers longer than f16's");
    for (tensor, at) in tensors.iter().zip(starts).filter(|(tensor, _)| tensor.name.contains("mlp")) {
        idle.flat[at..at + tensor.len()].fill(0.0);
    }
    assert!(held_in_f16(&idle.config.program(), &idle.flat), "zeros");
    for (weights, tokens, windows, products, most) in along.chain(alone).chain([(idle, 1, 70, Products::F16, 1e-5)]) {
        let (program, c) = (weights.config.program(), weights.config);
        let whole = whole_program(&program, tokens, products).expect("it fits");
        let inputs: Vec<f32> = (0..windows * tokens * c.inputs).map(|k| (k as f32 * 0.71).sin()).collect();
        let packed = whole.packed(&program, &weights.flat);
        let row = |row: &[f32]| [row, &vec![0.0; padded(row.len()) - row.len()]].concat();
        let full: Vec<f32> = inputs.chunks(c.inputs).flat_map(row).collect();
        let [weights_there, tokens_there] = [&*packed, &full].map(|numbers| bytes(numbers, f32::to_le_bytes));
        let buffers = [weights_there, tokens_there, vec![0; 4 * windows * tokens * c.outputs]];
        // Unwritten shared memory is NaN.
        let text = whole.text.clone() + "extern \"C\" { float s[FLOATS]; }\n";
        let kernel = format!("for (float& x : s) x = NAN;\nwhole_pass(b[0], b[1], b[2], {windows});");
        let launches = format!("for (; blockIdx.x * WINDOWS < {windows}; blockIdx.x++) {{\n{kernel}\n}}");
        let found = floats(&compiler.launch(&text, &launches, &buffers)[2]);
        let (network, rows) = (Loaded::new(program, &weights.flat), Vec::from_iter(0..windows * tokens));
        let wanted = network.forward(&inputs, &mut Memory::default(), Pass::Windows(tokens, &rows)).clone();
        let size = wanted.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let off =
            found.iter().zip(&wanted).map(|(a, b)| (a - b).abs() / size).max_by(f32::total_cmp).unwrap_or(f32::NAN);
        let name = format!("{:?}, E {}, {products:?}", c.architecture, c.embedding);
        assert!(
            found.len() == wanted.len() && off < most,
            "{name}: {off:e} off, {} of {} numbers",
            found.len(),
            wanted.len()
        );
    }
}

#[test]
fn what_has_no_such_form_has_none() {
    let of = |architecture, tokens| network(architecture, [30, 18, 48, 2], tokens).config.program();
    assert!(whole_program(&of(Architecture::Transformer, 10), 10, Products::F32).is_none(), "attention");
    assert!(
        whole_program(&of(Architecture::Chain, 400), 400, Products::F32).is_none(),
        "too long for a block's memory"
    );
    assert!(
        whole_program(&of(Architecture::Residual, 1), 1, Products::F16).is_none(),
        "48 columns, not a multiple of 64"
    );
}
