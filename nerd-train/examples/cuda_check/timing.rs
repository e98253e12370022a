//! What an update costs.

use std::time::Instant;

use nerd_model::transformer::{Positions, TransformerConfig};
use nerd_train::learner::Learner;
use nerd_train::learner::cuda::Precision;

use crate::Outcome;
use crate::with::learner_of;

/// Windows of ten tokens at several batches, and sequences of 32 tokens of as many tokens a batch.
pub fn timing() -> Outcome {
    let window = TransformerConfig::paper(37, 4, 192);
    let rotary = TransformerConfig { positions: Positions::Rotary, ..window };
    let small = TransformerConfig { embedding: 64, layers: 2, heads: 4, ..rotary };
    let cases = [
        (window, [512, 2048, 8192]),
        (TransformerConfig { embedding: 384, ..window }, [512, 2048, 4096]),
        (rotary, [160, 640, 2560]),
        (small, [160, 640, 2560]),
    ];
    for (c, batches) in cases {
        let (e, seen) = (c.embedding, c.history);
        let matrices = c.layers * 12 * e * e + e * (c.inputs + e + c.head) + c.head * c.outputs;
        for batch in batches {
            let mut learner = learner_of(c, batch, Precision::Tf32, 0.0)?;
            (0..20).try_for_each(|_| learner.update(1e-4))?;
            learner.progress()?;
            let (start, count) = (Instant::now(), 100_000 / batch + 20);
            (0..count).try_for_each(|_| learner.update(1e-4))?;
            learner.progress()?;
            let seconds = start.elapsed().as_secs_f64() / count as f64;
            let flops = 6.0 * (batch * c.sequence() * (matrices + c.layers * 2 * e * seen)) as f64;
            println!(
                "E {e}, {} layers, {:?}, TF32, batch {batch}: {:.3} ms an update, {:.0} windows/s, {:.1} TFLOP/s",
                c.layers,
                c.positions,
                seconds * 1e3,
                batch as f64 / seconds,
                flops / seconds / 1e12
            );
        }
    }
    Ok(())
}
