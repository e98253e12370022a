//! Who may look at whom, and how places are told: masks and rotations.

use burn::tensor::{Device, Tensor, TensorData};

use super::config::{Positions, TransformerConfig};

/// Mask and rotations of one pass.
#[derive(Clone)]
pub struct Places {
    /// `[1 or windows, 1, queries, tokens]`: 0 where a query may look at a token, -inf elsewhere.
    mask: Tensor<4>,
    /// Of the queries and of the keys.
    turns: Option<[Turn; 2]>,
}

/// Cosines and sines, `[1 or windows, 1, tokens, d / 2]`.
#[derive(Clone)]
struct Turn {
    cos: Tensor<4>,
    sin: Tensor<4>,
}

impl Places {
    /// Every token of a window of `tokens` asks: it sees itself and older tokens, at most `history` of them with rotary
    /// positions.
    pub fn all(config: &TransformerConfig, tokens: usize, device: &Device) -> Self {
        let asking: Vec<usize> = (0..tokens).collect();
        Self { mask: mask(config, &asking, [1, 1, tokens, tokens], device), turns: turns(config, &asking, [1, 1, tokens], tokens, device) }
    }

    /// Token `last[w]` of each window asks alone.
    pub fn newest(config: &TransformerConfig, last: &[u32], tokens: usize, device: &Device) -> Self {
        let asking: Vec<usize> = last.iter().map(|l| *l as usize).collect();
        let n = asking.len();
        Self { mask: mask(config, &asking, [n, 1, 1, tokens], device), turns: turns(config, &asking, [n, 1, 1], tokens, device) }
    }

    /// Scores `[windows, heads, queries, tokens]` of `q` and `k` (`[windows, heads, .., d]`), masked.
    pub(super) fn scores(&self, q: Tensor<4>, k: Tensor<4>) -> Tensor<4> {
        let d = q.dims()[3];
        let (q, k) = match &self.turns {
            None => (q, k),
            Some([of_q, of_k]) => (of_q.apply(q), of_k.apply(k)),
        };
        (q * (d as f64).powf(-0.5)).matmul(k.transpose()) + self.mask.clone()
    }
}

impl Turn {
    fn new(config: &TransformerConfig, places: &[usize], [a, b, c]: [usize; 3], device: &Device) -> Self {
        let turns: Vec<(f32, f32)> = places.iter().flat_map(|p| config.turn(*p)).collect();
        let shape = [a, b, c, config.embedding / config.heads / 2];
        let tensor =
            |part: fn(&(f32, f32)) -> f32| Tensor::from_data(TensorData::new(turns.iter().map(part).collect::<Vec<f32>>(), shape), device);
        Self { cos: tensor(|t| t.0), sin: tensor(|t| t.1) }
    }

    /// Turns the columns m and m + d/2 of every row together.
    fn apply(&self, x: Tensor<4>) -> Tensor<4> {
        let half = x.dims()[3] / 2;
        let (a, b) = (x.clone().narrow(3, 0, half), x.narrow(3, half, half));
        let (cos, sin) = (&self.cos, &self.sin);
        let first = a.clone() * cos.clone() - b.clone() * sin.clone();
        Tensor::cat(vec![first, a * sin.clone() + b * cos.clone()], 3)
    }
}

fn mask(config: &TransformerConfig, asking: &[usize], shape: [usize; 4], device: &Device) -> Tensor<4> {
    let tokens = shape[3];
    let reach = if config.positions == Positions::Rotary { config.history } else { tokens };
    let sees = |i: usize, j: usize| if j <= i && i - j < reach { 0.0 } else { f32::NEG_INFINITY };
    let rows = asking.iter().flat_map(|&i| (0..tokens).map(move |j| sees(i, j)));
    Tensor::from_data(TensorData::new(rows.collect::<Vec<f32>>(), shape), device)
}

fn turns(config: &TransformerConfig, asking: &[usize], shape: [usize; 3], tokens: usize, device: &Device) -> Option<[Turn; 2]> {
    let all: Vec<usize> = (0..tokens).collect();
    (config.positions == Positions::Rotary)
        .then(|| [Turn::new(config, asking, shape, device), Turn::new(config, &all, [1, 1, tokens], device)])
}
