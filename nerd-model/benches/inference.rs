//! Predictions for windows of ten tokens on the CPU, through burn and without it (paper network, E 192, double pendulum's
//! widths).
//!
//! `cargo bench -p nerd-model`.

use std::hint::black_box;

use burn::tensor::Device;
use criterion::{Criterion, criterion_group, criterion_main};
use nerd_model::transformer::{BurnForward, Forward, PackedForward, TransformerConfig, Weights};

fn inference(c: &mut Criterion) {
    let config = TransformerConfig::paper(37, 4, 192);
    let weights = Weights::init(config, 0);
    let engines: [(&str, Box<dyn Forward>); 2] =
        [("burn", Box::new(BurnForward::new(&weights, &Device::flex()))), ("packed", Box::new(PackedForward::new(&weights)))];
    let mut group = c.benchmark_group("E192");
    group.sample_size(10);
    for (name, mut network) in engines {
        for windows in [1usize, 512] {
            let inputs: Vec<f32> = (0..windows * 10 * 37).map(|i| (i as f32 * 0.37).sin()).collect();
            let (last, mut out) = (vec![9; windows], Vec::new());
            group.bench_function(format!("{name}, {windows} windows"), |b| {
                b.iter(|| network.forward(black_box(&inputs), 10, &last, &mut out).expect("well-formed windows"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, inference);
criterion_main!(benches);
