//! Predictions on the GPU, of programs, windows and streams, against the CPU or burn; and inputs that must be refused.

use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::program::specimens::{Specimen, TOKENS, WINDOWS, networks, operations as each};
use nerd_model::transformer::{
    Architecture, Forward, PackedForward, PackedStream, Positions, Stream, TransformerConfig, Weights,
};
use nerd_train::learner::cuda::{CudaForward, CudaProgram, CudaStream, Precision};

use crate::with::{Checks, Outcome, apart, numbers, others, weights, windows as drawn, worse};

/// Every operation and network against burn: outputs, gradients by weights and gradients by tokens. Runs twice, since a
/// pass reuses the memory of the last.
pub fn operations(checks: &mut Checks) -> Outcome {
    for specimen in each().into_iter().chain(networks()) {
        let Specimen { program, flat, tokens, upstream, name } = &specimen;
        let (expected, mut cuda) =
            (specimen.by_burn(), CudaProgram::new(program.clone(), flat, Precision::F32, WINDOWS, TOKENS)?);
        let mut worst = 0.0f32;
        for _ in 0..2 {
            let predictions = cuda.forward(tokens)?;
            let (by_weights, by_tokens) = cuda.backward(upstream)?;
            worst = worse(worst, [predictions, by_weights, by_tokens].iter().zip(&expected).map(|(a, b)| apart(a, b)));
        }
        checks.demand(worst < 2e-5, format!("{name}: output and gradients {worst:.1e} from burn's"));
    }
    Ok(())
}

/// Predictions for one token per window against the CPU; for a chain, predictions of all rods.
pub fn windows(checks: &mut Checks) -> Outcome {
    let table = TransformerConfig { layers: 2, ..TransformerConfig::paper(37, 4, 192) };
    let is_chain = |config: &&TransformerConfig| config.architecture == Architecture::Chain;
    for config in others().iter().chain([&table]).filter(|config| !is_chain(config)) {
        let (w, mut here, mut there) = (weights(*config), Vec::new(), Vec::new());
        let mut cuda = CudaForward::new(&w, Precision::F32, 40)?;
        // Sizes with a captured graph each; the last repeats one.
        for (count, tokens) in [(40, 10), (33, 10), (9, 6), (9, 10)] {
            let inputs = numbers(2, count * tokens * 37);
            let last: Vec<u32> = (0..count).map(|w| (w * 7 % tokens) as u32).collect();
            PackedForward::new(&w).forward(&inputs, tokens, &last, &mut there)?;
            cuda.forward(&inputs, tokens, &last, &mut here)?;
            let off = apart(&here, &there);
            checks.demand(
                off < 1e-4,
                format!("{:?}, {count} windows of {tokens}: {off:.1e} from the CPU", config.architecture),
            );
        }
    }
    for config in others().iter().filter(is_chain) {
        let (w, inputs, rows) = (weights(*config), numbers(2, 33 * 10 * 37), (0..33 * 10).collect::<Vec<_>>());
        let (loaded, mut memory) = (Loaded::new(config.program(), &w.flat), Memory::default());
        let there = loaded.forward(&inputs, &mut memory, Pass::Windows(10, &rows));
        let off = apart(&CudaProgram::new(config.program(), &w.flat, Precision::F32, 33, 10)?.predict(&inputs)?, there);
        checks.demand(off < 1e-4, format!("a chain's windows: {off:.1e} from the CPU"));
    }
    Ok(())
}

/// Eighty frames of 100 environments, with memory cleared now and then, against the CPU.
pub fn streams(checks: &mut Checks) -> Outcome {
    let config = TransformerConfig { positions: Positions::Rotary, ..TransformerConfig::paper(247, 29, 192) };
    let (w, envs) = (weights(config), 100);
    let (mut cuda, mut cpu) = (CudaStream::new(&w, Precision::F32, envs)?, PackedStream::new(&w));
    let (mut a, mut b, mut worst) = (Vec::new(), Vec::new(), 0.0f32);
    for frame in 0..80 {
        let tokens = drawn(20 + frame as u64, config, envs, 1).x;
        if frame % 7 == 3 {
            cuda.clear(frame);
            cpu.clear(frame);
        }
        cuda.push(&tokens, &mut a)?;
        cpu.push(&tokens, &mut b)?;
        worst = worse(worst, [apart(&a, &b)]);
    }
    checks.demand(worst < 1e-3, format!("80 frames of {envs} environments: {worst:.1e} from the CPU"));
    Ok(())
}

/// Refuses shapes without kernels or memory, and propagates NaN.
pub fn refusals(checks: &mut Checks) -> Outcome {
    let rotary = TransformerConfig { positions: Positions::Rotary, layers: 2, ..TransformerConfig::paper(37, 4, 192) };
    let mut stream = CudaStream::new(&weights(rotary), Precision::F32, 40)?;
    let refused = stream.push(&drawn(3, rotary, 41, 1).x, &mut Vec::new()).is_err();
    checks.demand(refused, "41 environments in a stream for 40".into());
    let table = TransformerConfig { positions: Positions::Table, ..rotary };
    for other in [table, TransformerConfig { architecture: Architecture::Chain, ..table }] {
        let made = CudaStream::new(&Weights::init(other, 0), Precision::F32, 4).err().map(|e| e.to_string());
        checks.demand(
            made.is_some_and(|e| e.contains("sees no windows")),
            format!("{:?} frame by frame", other.architecture),
        );
    }
    checks.demand(CudaForward::new(&weights(rotary), Precision::F32, 4).is_err(), "windows of rotary positions".into());
    let mut first = 0;
    for tensor in table.tensors() {
        let mut none = weights(table);
        // Every window reads the first entry, also in the position table.
        none.flat[first] = f32::NAN;
        first += tensor.len();
        let mut y = Vec::new();
        CudaForward::new(&none, Precision::F32, 8)?.forward(&drawn(3, table, 8, 10).x, 10, &[9; 8], &mut y)?;
        checks.demand(y.iter().any(|y| !y.is_finite()), format!("NaN in {} comes out", tensor.name));
    }
    Ok(())
}
