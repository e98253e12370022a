//! Benchmarks of predictions on the CPU (widths of the double pendulum): windows of ten tokens, one token a frame with
//! cached keys and values, and a small network. Also a whole frame of a cable of 40 rods, contacts included.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nerd_model::chain::{ChainSolver, INPUTS, OUTPUTS};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{
    Architecture, PackedForward, PackedStream, Positions, Stream, TransformerConfig, Weights, Windowed,
};
use nerd_sim::prelude::*;

fn inference(c: &mut Criterion) {
    let table = TransformerConfig::paper(37, 4, 192);
    let rotary = TransformerConfig { positions: Positions::Rotary, ..table };
    let small = TransformerConfig { embedding: 48, layers: 2, heads: 3, ..rotary };
    let (windows, stream) = (Weights::init(table, 0), Weights::init(rotary, 0));
    let streams: [(&str, &[usize], Box<dyn Stream>); 3] = [
        ("windows, packed", &[512], Box::new(Windowed::new(PackedForward::new(&windows), table))),
        ("stream, E192", &[1, 512, 2048], Box::new(PackedStream::new(&stream))),
        ("stream, E48", &[1, 2048], Box::new(PackedStream::new(&Weights::init(small, 0)))),
    ];
    let mut group = c.benchmark_group("frame");
    group.sample_size(10);
    for (name, sizes, mut network) in streams {
        for envs in sizes {
            let tokens: Vec<f32> = (0..envs * 37).map(|i| (i as f32 * 0.37).sin()).collect();
            let mut out = Vec::new();
            let mut frame = || network.push(black_box(&tokens), &mut out).expect("well-formed frames");
            group.bench_function(format!("{name}, {envs} environments"), |b| {
                // Fill the window first.
                (0..10).for_each(|_| frame());
                b.iter(&mut frame);
            });
        }
    }
    group.finish();
}

fn chain(c: &mut Criterion) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../nerd-sim/assets/cables/lead-pegs.toml");
    let system = System::named(path).expect("the lead");
    let paper = TransformerConfig::paper(INPUTS, OUTPUTS, 48);
    let network = TransformerConfig {
        layers: 8,
        heads: 1,
        block: 40,
        history: 1,
        head: 1,
        architecture: Architecture::Chain,
        ..paper
    };
    // Outputs are nearly zero, so that the cable stays in place.
    let outputs = Moments { mean: vec![0.0; OUTPUTS], variance: vec![1e-12; OUTPUTS], epsilon: 1e-24 };
    let normalizer = Normalizer { inputs: Moments::identity(INPUTS), outputs };
    let scene = nerd_sim::dataset::begin(&system, &Default::default(), 0, 1).expect("pegs").scenes.remove(0);
    for envs in [1, 64] {
        let mut batch = Batch::new(&system, &scene, envs);
        let torques = vec![0.0; envs * system.robot.joint_count()];
        let mut solver = ChainSolver::new(&Weights::init(network, 0), &normalizer, &system).expect("a chain");
        let name = format!("frame/chain of 40 rods, E48, {envs} environments");
        c.bench_function(&name, |b| b.iter(|| solver.step(black_box(&mut batch), &torques).expect("finite")));
    }
}

criterion_group!(benches, inference, chain);
criterion_main!(benches);
