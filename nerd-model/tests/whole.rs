//! Small programs as one kernel, without a device: their text is compiled as C++, and held against the CPU's engine.

#[path = "../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;

use nerd_model::device::{Products, padded, whole_program};
use nerd_model::program::Program;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::transformer::{Architecture, TransformerConfig, Weights};

const WINDOWS: usize = 3;

fn network(architecture: Architecture, [inputs, outputs, embedding, layers]: [usize; 4], tokens: usize) -> Weights {
    let paper = TransformerConfig::paper(inputs, outputs, embedding);
    let shape = TransformerConfig { layers, heads: 1, block: tokens, history: 1, head: 8, architecture, ..paper };
    let mut weights = Weights::init(shape, 5);
    // Nothing at zero, so that every tensor is seen.
    weights.flat.iter_mut().enumerate().for_each(|(k, w)| *w += 0.05 * (k as f32 * 0.37).sin());
    weights
}

#[test]
fn a_pass_in_one_kernel_is_that_of_the_engine() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let place = tempfile::tempdir().expect("a folder");
    let cases = [
        ("chain", network(Architecture::Chain, [30, 18, 48, 8], 40), 40),
        ("short", network(Architecture::Chain, [30, 18, 12, 3], 7), 7),
        ("mlp", network(Architecture::Mlp, [10, 3, 8, 3], 1), 1),
    ];
    let cases = cases.iter().flat_map(|case| [Products::F32, Products::Tf32].map(|products| (case, products)));
    for ((name, weights, tokens), products) in cases {
        let (tokens, most) = (*tokens, if products == Products::F32 { 1e-5 } else { 5e-3 });
        let (program, c) = (weights.config.program(), weights.config);
        let whole = whole_program(&program, tokens, products).expect("it fits");
        let made = cpp::compile(compiler, &whole.text, place.path(), &format!("{name}-{products:?}"));
        let inputs: Vec<f32> = (0..WINDOWS * tokens * c.inputs).map(|k| (k as f32 * 0.71).sin()).collect();
        let mut input: Vec<u8> = [WINDOWS as i32, weights.flat.len() as i32].iter().flat_map(|x| x.to_le_bytes()).collect();
        input.extend(weights.flat.iter().flat_map(|x| x.to_le_bytes()));
        for row in inputs.chunks(c.inputs) {
            let full = row.iter().copied().chain(std::iter::repeat(0.0)).take(padded(c.inputs));
            input.extend(full.flat_map(f32::to_le_bytes));
        }
        let said = cpp::talk(&made, input);
        let said: Vec<f32> = said.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let (network, rows) = (Loaded::new(program, &weights.flat), Vec::from_iter(0..WINDOWS * tokens));
        let wanted = network.forward(&inputs, &mut Memory::default(), Pass::Windows(tokens, &rows)).clone();
        let size = wanted.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let off = said
            .iter()
            .zip(&wanted)
            .map(|(a, b)| (a - b).abs() / size)
            .fold(0.0f32, |most, off| if most.is_nan() || off <= most { most } else { off });
        println!("{name}, {products:?}: {off:.1e} off, {} threads, {} windows", whole.threads, whole.windows);
        assert!(said.len() == wanted.len() && off < most, "{name}, {products:?}: {off:e} off, {} of {} numbers", said.len(), wanted.len());
    }
}

#[test]
fn what_has_no_such_form_has_none() {
    let of = |architecture, tokens| -> Program { network(architecture, [30, 18, 48, 2], tokens).config.program() };
    assert!(whole_program(&of(Architecture::Transformer, 10), 10, Products::F32).is_none(), "attention");
    assert!(whole_program(&of(Architecture::Gru, 10), 10, Products::F32).is_none(), "cells");
    assert!(whole_program(&of(Architecture::Chain, 400), 400, Products::F32).is_none(), "too long for a block's memory");
}
