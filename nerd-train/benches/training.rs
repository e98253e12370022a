//! Time of one update of 512 windows of ten tokens on the CPU, by hand-written code and through burn. Networks: E 64, 2
//! layers, 4 heads; and the paper's E 192, 6 layers.
//!
//! `cargo bench -p nerd-train`.

use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use nerd_model::transformer::{TransformerConfig, Weights};
use nerd_train::learner::{BurnLearner, CpuLearner, Learner, LearnerConfig, LearnerState};
use nerd_train::windows::Windows;

fn training(c: &mut Criterion) {
    let mut group = c.benchmark_group("512 windows");
    group.sample_size(10);
    let paper = TransformerConfig::paper(37, 4, 192);
    for (name, network) in
        [("E64 2 layers", TransformerConfig { layers: 2, heads: 4, embedding: 64, ..paper }), ("E192 6 layers", paper)]
    {
        let data = |n: usize| (0..n).map(|i| (i as f32 * 0.37).sin()).collect();
        let windows = Arc::new(Windows {
            inputs: 37,
            outputs: 4,
            frames: 100,
            history: 10,
            x: data(100 * 100 * 37),
            y: data(100 * 100 * 4),
        });
        let config = LearnerConfig {
            batch: 512,
            clip: 1.0,
            average: 0.999,
            seed: 0,
            huber: None,
            optimizer: Default::default(),
        };
        let state = LearnerState::new(Weights::init(network, 0));
        let cpu = CpuLearner::new(config, state.clone(), [windows.clone(), windows.clone()])
            .expect("windows fit the network");
        let burn = BurnLearner::new(config, state, [windows.clone(), windows], &nerd_model::BurnDevice::flex())
            .expect("windows fit the network");
        for (by, mut learner) in [("written out", Box::new(cpu) as Box<dyn Learner>), ("burn flex", Box::new(burn))] {
            group.bench_function(format!("{name}, {by}"), |b| b.iter(|| learner.update(1e-4).expect("a finite loss")));
        }
    }
    group.finish();
}

criterion_group!(benches, training);
criterion_main!(benches);
