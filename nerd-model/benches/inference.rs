//! Predictions for windows of ten tokens through burn on the CPU (paper network, E 192, double pendulum's widths).
//!
//! `cargo bench -p nerd-model`.

use std::hint::black_box;

use burn::tensor::Device;
use criterion::{Criterion, criterion_group, criterion_main};
use nerd_model::transformer::{BurnForward, Forward, TransformerConfig, Weights};

fn inference(c: &mut Criterion) {
    let mut group = c.benchmark_group("flex E192");
    group.sample_size(10);
    let config = TransformerConfig::paper(37, 4, 192);
    let mut network = BurnForward::new(&Weights::init(config, 0), &Device::flex());
    for windows in [1usize, 512] {
        let inputs: Vec<f32> = (0..windows * 10 * 37).map(|i| (i as f32 * 0.37).sin()).collect();
        let (last, mut out) = (vec![9; windows], Vec::new());
        group.bench_function(format!("{windows} windows"), |b| {
            b.iter(|| network.forward(black_box(&inputs), 10, &last, &mut out).expect("well-formed windows"));
        });
    }
    group.finish();
}

criterion_group!(benches, inference);
criterion_main!(benches);
