//! Programs in burn: the reference definition of each operation for tests of other engines, and an engine for any
//! device of burn.

use burn::tensor::activation::{gelu, relu, softmax};
use burn::tensor::{Device, Gradients, Tensor, TensorData};

use super::op::{Activation, Op, Program, Slot, Weight};

/// A program with parameters on one device.
pub struct BurnNetwork {
    program: Program,
    /// Parameters, in the order of the program's tensors.
    parameters: Vec<Tensor<1>>,
    device: Device,
}

impl BurnNetwork {
    /// Copies the flat parameters to `device`; an autodiff device makes every tensor trainable.
    pub fn new(program: Program, flat: &[f32], device: &Device) -> Self {
        let tensor = |w: &[usize]| {
            let tensor = Tensor::<1>::from_data(TensorData::new(flat[w[0]..w[1]].to_vec(), [w[1] - w[0]]), device);
            if tensor.is_autodiff() { tensor.require_grad() } else { tensor }
        };
        let parameters = program.starts().windows(2).map(tensor).collect();
        Self { program, parameters, device: device.clone() }
    }

    /// Rows `[windows][tokens][width]` as a tensor on the network's device.
    pub fn tensor(&self, rows: Vec<f32>, windows: usize, tokens: usize) -> Tensor<3> {
        let width = rows.len() / (windows * tokens);
        Tensor::from_data(TensorData::new(rows, [windows, tokens, width]), &self.device)
    }

    /// Predictions `[windows, tokens, outputs]` for normalised inputs `[windows, tokens, inputs]`, oldest token first.
    /// A Transformer's prediction depends on no later token.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [windows, tokens, inputs] = x.dims();
        let mut slots: Vec<Option<Tensor<2>>> = vec![None; self.program.widths.len()];
        let read = |slots: &[Option<Tensor<2>>], slot: Slot| {
            slots[slot.0].clone().expect("a slot is written before it is read")
        };
        slots[0] = Some(x.reshape([windows * tokens, inputs]));
        for step in &self.program.steps {
            let x = read(&slots, step.from);
            let y = match step.op {
                Op::Linear { weight, scale, bias, add } => {
                    let x = scale.map_or(x.clone(), |w| x * self.row(w));
                    let y = x.matmul(self.matrix(weight));
                    let y = bias.map_or(y.clone(), |b| y + self.row(b));
                    if add { read(&slots, step.to) + y } else { y }
                }
                Op::Place(table) => {
                    let rows = self.matrix(table).narrow(0, 0, tokens);
                    x + rows.repeat(&[windows, 1])
                }
                Op::Norm => {
                    let ones = Tensor::ones([x.dims()[1]], &x.device());
                    let rows = x;
                    burn::tensor::module::layer_norm(rows, ones, None, 1e-5)
                }
                Op::Attend { heads, band } => {
                    attend(x, heads, tokens, band.map(|band| (band, self.program.frequencies.as_slice())))
                }
                Op::Neighbours(apart) => neighbours(x, tokens, apart),
                Op::Activate(Activation::Gelu) => gelu(x),
                Op::Activate(Activation::Relu) => relu(x),
                Op::Activate(Activation::Tanh) => x.tanh(),
                Op::Activate(Activation::Elu) => relu(x.clone()) + x.clamp_max(0.0).exp() - 1.0,
                Op::Gate => {
                    let half = x.dims()[1] / 2;
                    gelu(x.clone().narrow(1, 0, half)) * x.narrow(1, half, half)
                }
            };
            slots[step.to.0] = Some(y);
        }
        let width = self.program.width(self.program.predictions());
        read(&slots, self.program.predictions()).reshape([windows, tokens, width])
    }

    /// The parameter gradients of one backward pass as a flat vector, zeros where none was recorded. Waits for the
    /// device.
    pub fn gradients(&self, gradients: &Gradients) -> Tensor<1> {
        let one = |p: &Tensor<1>| p.grad(gradients).unwrap_or_else(|| p.clone().inner().zeros_like());
        Tensor::cat(self.parameters.iter().map(one).collect(), 0)
    }

    fn matrix(&self, weight: Weight) -> Tensor<2> {
        let shape = &self.program.tensors[weight.0].shape;
        self.parameters[weight.0].clone().reshape([shape[0], shape[1]])
    }

    fn row(&self, weight: Weight) -> Tensor<2> {
        self.parameters[weight.0].clone().unsqueeze()
    }
}

/// Attention from `[q k v]`, `[rows, 3 E]`, to its output `[rows, E]`. With a band and frequencies, queries and keys
/// are rotated.
fn attend(qkv: Tensor<2>, heads: usize, tokens: usize, rotary: Option<(usize, &[f64])>) -> Tensor<2> {
    let [rows, width] = qkv.dims();
    let device = qkv.device();
    let windows = rows / tokens;
    let e = width / 3;
    let d = width / 3 / heads;
    let part = |i: usize| qkv.clone().narrow(1, i * e, e).reshape([windows, tokens, heads, d]).swap_dims(1, 2);
    let (q, k, v) = match rotary {
        None => (part(0), part(1), part(2)),
        Some((_, frequencies)) => (turn(part(0), frequencies), turn(part(1), frequencies), part(2)),
    };
    let reach = rotary.map_or(tokens, |(band, _)| band);
    let sees = |i: usize, j: usize| if j <= i && i - j < reach { 0.0 } else { f32::NEG_INFINITY };
    let mask: Vec<f32> = (0..tokens * tokens).map(|n| sees(n / tokens, n % tokens)).collect();
    let mask = Tensor::<4>::from_data(TensorData::new(mask, [1, 1, tokens, tokens]), &device);
    let scores = (q * (d as f64).powf(-0.5)).matmul(k.transpose()) + mask;
    softmax(scores, 3).matmul(v).swap_dims(1, 2).reshape([rows, e])
}

/// Rotates the column pairs (m, m + d/2) of `[windows, heads, tokens, d]` by the angles of each token's position.
fn turn(x: Tensor<4>, frequencies: &[f64]) -> Tensor<4> {
    let [_, _, tokens, d] = x.dims();
    let device = x.device();
    let angles = |f: fn(f64) -> f64| -> Tensor<4> {
        let values: Vec<f32> =
            (0..tokens).flat_map(|k| frequencies.iter().map(move |a| f(k as f64 * a) as f32)).collect();
        Tensor::from_data(TensorData::new(values, [1, 1, tokens, d / 2]), &device)
    };
    let (cos, sin) = (angles(f64::cos), angles(f64::sin));
    let (a, b) = (x.clone().narrow(3, 0, d / 2), x.narrow(3, d / 2, d / 2));
    Tensor::cat(vec![a.clone() * cos.clone() - b.clone() * sin.clone(), a * sin + b * cos], 3)
}

/// Concatenates each row of `[windows tokens, width]` with the rows of the tokens `apart` before and after.
fn neighbours(x: Tensor<2>, tokens: usize, apart: usize) -> Tensor<2> {
    let [rows, width] = x.dims();
    let device = x.device();
    let x = x.reshape([rows / tokens, tokens, width]);
    let beyond = Tensor::<3>::zeros([rows / tokens, apart, width], &device);
    let padded = Tensor::cat(vec![beyond.clone(), x.clone(), beyond], 1);
    let (before, after) = (padded.clone().narrow(1, 0, tokens), padded.narrow(1, 2 * apart, tokens));
    Tensor::cat(vec![before, x, after], 2).reshape([rows, 3 * width])
}
