//! The networks beside the Transformer, against the textbook's equations in plain f64 loops. Bound: rounding of f32.

use burn::tensor::{Tensor, TensorData};
use nerd_model::BurnDevice;
use nerd_model::program::Network;
use nerd_model::transformer::{Architecture, Forward, PackedForward, Positions, Storage, TransformerConfig, Weights};

const ALL: [Architecture; 4] = [Architecture::Transformer, Architecture::Mlp, Architecture::Gru, Architecture::Lstm];

fn config(architecture: Architecture) -> TransformerConfig {
    let positions = Positions::Table;
    TransformerConfig { inputs: 5, outputs: 3, embedding: 8, layers: 2, heads: 2, block: 6, history: 6, head: 7, positions, architecture }
}

/// Weights large enough that gates and positions matter.
fn weights(architecture: Architecture) -> Weights {
    let mut weights = Weights::init(config(architecture), 4);
    if architecture == Architecture::Transformer {
        weights.flat.iter_mut().for_each(|w| *w *= 5.0);
    }
    weights
}

fn inputs(windows: usize, tokens: usize) -> Vec<f32> {
    (0..windows * tokens * 5).map(|i| (i as f32 * 1.37).sin() * 1.5).collect()
}

fn forward(weights: &Weights, x: &[f32], windows: usize, tokens: usize) -> Vec<f32> {
    let device = BurnDevice::flex();
    let x = Tensor::<3>::from_data(TensorData::new(x.to_vec(), [windows, tokens, 5]), &device);
    Network::new(weights, &device).forward(x).into_data().iter::<f32>().collect()
}

/// `x W + b` with `W` of `[in, out]`.
fn linear(x: &[f64], w: &[f32], b: &[f32]) -> Vec<f64> {
    let n = b.len();
    (0..n).map(|j| f64::from(b[j]) + x.iter().enumerate().map(|(i, x)| x * f64::from(w[i * n + j])).sum::<f64>()).collect()
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Outputs at every token of one window.
fn textbook(weights: &Weights, window: &[f32]) -> Vec<f64> {
    let t: Vec<&[f32]> = weights.iter().map(|(_, _, x)| x).collect();
    let head = |x: &[f64], t: &[&[f32]]| {
        let hidden: Vec<f64> = linear(x, t[0], t[1]).into_iter().map(|x| x.max(0.0)).collect();
        linear(&hidden, t[2], t[3])
    };
    let rows = window.chunks(5).map(|r| r.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>());
    if weights.config.architecture == Architecture::Mlp {
        let layers = |x: Vec<f64>| (0..3).fold(x, |x, i| linear(&x, t[2 * i], t[2 * i + 1]).into_iter().map(|x| x.max(0.0)).collect());
        return rows.flat_map(|x| head(&layers(x), &t[6..])).collect();
    }
    let e = weights.config.embedding;
    let mut states = vec![(vec![0.0; e], vec![0.0; e]); 2];
    let mut out = Vec::new();
    for mut x in rows {
        for (i, (h, c)) in states.iter_mut().enumerate() {
            let (u, v) = (linear(&x, t[4 * i], t[4 * i + 1]), linear(h, t[4 * i + 2], t[4 * i + 3]));
            for k in 0..e {
                let gate = |g: usize| u[g * e + k] + v[g * e + k];
                if weights.config.architecture == Architecture::Lstm {
                    c[k] = sigmoid(gate(1)) * c[k] + sigmoid(gate(0)) * gate(2).tanh();
                    h[k] = sigmoid(gate(3)) * c[k].tanh();
                } else {
                    let n = (u[2 * e + k] + sigmoid(gate(0)) * v[2 * e + k]).tanh();
                    h[k] = (1.0 - sigmoid(gate(1))) * n + sigmoid(gate(1)) * h[k];
                }
            }
            x = h.clone();
        }
        out.extend(head(&x, &t[8..]));
    }
    out
}

#[test]
fn outputs_are_the_textbooks() {
    for architecture in [Architecture::Mlp, Architecture::Gru, Architecture::Lstm] {
        let weights = weights(architecture);
        let (x, windows) = (inputs(3, 6), 3);
        let found = forward(&weights, &x, windows, 6);
        let expected: Vec<f64> = x.chunks(6 * 5).flat_map(|w| textbook(&weights, w)).collect();
        let worst = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        let size = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        assert!(found.len() == expected.len() && worst < 1e-6, "{architecture:?}: {worst:.1e} from the textbook, outputs up to {size:.2}");
        assert!(size > 0.05, "{architecture:?}: outputs of {size:.1e} say nothing");
    }
}

#[test]
fn no_token_sees_a_younger_one_and_all_but_the_perceptron_see_older_ones() {
    for architecture in ALL {
        let weights = weights(architecture);
        let mut x = inputs(1, 6);
        let before = forward(&weights, &x, 1, 6);
        x[2 * 5] += 1.0;
        let after = forward(&weights, &x, 1, 6);
        let moved: Vec<bool> =
            before.chunks(3).zip(after.chunks(3)).map(|(a, b)| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-6)).collect();
        let later = architecture != Architecture::Mlp;
        assert_eq!(moved, [false, false, true, later, later, later], "{architecture:?}: tokens changed by token 2");
    }
}

/// Padding behind the newest token, and how windows are spread over threads, play no part.
#[test]
fn the_evaluator_is_the_module_at_the_newest_token() {
    for architecture in ALL {
        let weights = weights(architecture);
        let (windows, tokens) = (7, 6);
        let mut x = inputs(windows, tokens);
        let last: Vec<u32> = (0..windows as u32).map(|w| w % 6).collect();
        let all = forward(&weights, &x, windows, tokens);
        for (w, l) in last.iter().enumerate() {
            x[(w * tokens + *l as usize + 1) * 5..(w + 1) * tokens * 5].fill(9.0);
        }
        let mut found = Vec::new();
        let mut evaluator = PackedForward::new(&weights);
        evaluator.forward(&x, tokens, &last, &mut found).expect("fits");
        let expected = last.iter().enumerate().flat_map(|(w, l)| &all[(w * tokens + *l as usize) * 3..][..3]);
        let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(found.len() == windows * 3 && worst < 1e-5, "{architecture:?}: {worst:.1e}");
        let error = evaluator.forward(&x[1..], tokens, &last, &mut found).expect_err("a value short").to_string();
        assert!(error.contains("209"), "{architecture:?}: {error}");
    }
}

/// A file of one architecture's weights is no other's.
#[test]
fn weights_keep_their_architecture_in_a_file() {
    for architecture in ALL {
        let weights = weights(architecture);
        let bytes = weights.to_bytes(Default::default(), Storage::F32).expect("encoded");
        assert!(Weights::from_bytes(weights.config, &bytes).expect("its own") == weights);
        for other in ALL.into_iter().filter(|o| *o != architecture) {
            assert!(Weights::from_bytes(config(other), &bytes).is_err(), "{architecture:?} read as {other:?}");
        }
    }
    let text = serde_json::to_string(&config(Architecture::Transformer)).expect("JSON");
    assert!(!text.contains("architecture"), "a Transformer's shape is written as ever: {text}");
    let text = serde_json::to_string(&config(Architecture::Gru)).expect("JSON");
    assert_eq!(serde_json::from_str::<TransformerConfig>(&text).expect("read back"), config(Architecture::Gru));
}
