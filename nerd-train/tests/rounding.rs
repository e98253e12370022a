//! Hidden matrices as f16: nothing else is touched, and rounding with compensation leaves a network's outputs nearer to what they
//! were than the nearest f16 of each weight does, on tokens that it was not made with.

use nerd_model::transformer::{Forward, PackedForward, Positions, Storage, TransformerConfig, Weights};
use nerd_train::learner::round_hidden;
use nerd_train::windows::Windows;

const FRAMES: usize = 40;

/// Tokens of a motion with two degrees of freedom, `[trajectory][frame][3]`.
fn windows(phase: f32) -> Windows {
    let token = |t: usize, f: usize| {
        let (a, b) = (0.7 * t as f32 + 0.2 * f as f32 + phase, 1.3 * t as f32 + 0.31 * f as f32);
        [a.sin(), b.cos(), a.sin() * b.cos()]
    };
    let x: Vec<f32> = (0..64 * FRAMES).flat_map(|i| token(i / FRAMES, i % FRAMES)).collect();
    Windows { inputs: 3, outputs: 2, frames: FRAMES, history: 8, y: vec![0.0; x.len() / 3 * 2], x }
}

fn outputs(weights: &Weights, windows: &Windows) -> Vec<f32> {
    let (count, mut out) = (windows.x.len() / 3 / 8, Vec::new());
    PackedForward::new(weights).forward(&windows.x, 8, &vec![7; count], &mut out).expect("it fits");
    out
}

#[test]
fn compensated_rounding_changes_outputs_less_than_the_nearest_weights() {
    let paper = TransformerConfig::paper(3, 2, 64);
    let config = TransformerConfig { layers: 2, heads: 4, history: 8, block: 8, head: 32, positions: Positions::Table, ..paper };
    let mut exact = Weights::init(config, 1);
    exact.flat.iter_mut().for_each(|w| *w *= 3.0);
    let nearest = exact.to_bytes(Default::default(), Storage::Mixed).and_then(|b| Weights::from_bytes(config, &b)).expect("read");
    let rounded = round_hidden(&exact, &windows(0.0)).expect("rounded");
    for ((name, shape, before), (_, _, after)) in exact.iter().zip(rounded.iter()) {
        let hidden = name.starts_with("blocks.") && shape.len() == 2;
        let half = after.iter().all(|w| half::f16::from_f32(*w).to_f32() == *w);
        assert!(if hidden { half && before != after } else { before == after }, "{name} was not rounded as it should be");
    }
    let fresh = windows(0.35);
    let wanted = outputs(&exact, &fresh);
    let error = |w: &Weights| outputs(w, &fresh).iter().zip(&wanted).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
    let (plain, compensated) = (error(&nearest), error(&rounded));
    println!("outputs moved by {plain:.2e} with the nearest f16, by {compensated:.2e} with compensation");
    assert!(compensated < 0.5 * plain, "compensation leaves {compensated:.2e} of {plain:.2e}, at most half was expected");
}
