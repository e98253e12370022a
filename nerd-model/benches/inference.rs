//! Predictions on the CPU (double pendulum's widths): windows of ten tokens through burn and without it, one token a frame
//! with kept keys and values, and that of a small network.
//!
//! `cargo bench -p nerd-model`.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nerd_model::transformer::{PackedForward, PackedStream, Positions, Stream, TransformerConfig, Weights, Windowed};

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
            let (asked, mut out): (Vec<usize>, _) = ((0..*envs).collect(), Vec::new());
            let mut frame = || network.push(black_box(&tokens), &asked, &mut out).expect("well-formed frames");
            group.bench_function(format!("{name}, {envs} environments"), |b| {
                // With a full past.
                (0..10).for_each(|_| frame());
                b.iter(&mut frame);
            });
        }
    }
    group.finish();
}

criterion_group!(benches, inference);
criterion_main!(benches);
