//! Programs in burn: what each operation means, which the other engines are tested against, and what computes on any device of burn.

use burn::tensor::activation::{gelu, relu, sigmoid, softmax};
use burn::tensor::{Device, Gradients, Tensor, TensorData};

use super::op::{Activation, Op, Program, Slot, Weight};

/// A program with its parameters on one device.
pub struct BurnNetwork {
    program: Program,
    /// In the order of the program's tensors.
    parameters: Vec<Tensor<1>>,
    device: Device,
}

impl BurnNetwork {
    /// With the flat parameters on `device`; an autodiff device makes every tensor trainable.
    pub fn new(program: Program, flat: &[f32], device: &Device) -> Self {
        let tensor = |w: &[usize]| {
            let tensor = Tensor::<1>::from_data(TensorData::new(flat[w[0]..w[1]].to_vec(), [w[1] - w[0]]), device);
            if tensor.is_autodiff() { tensor.require_grad() } else { tensor }
        };
        let parameters = program.starts().windows(2).map(tensor).collect();
        Self { program, parameters, device: device.clone() }
    }

    /// Rows `[windows][tokens][width]` on the network's device.
    pub fn tensor(&self, rows: Vec<f32>, windows: usize, tokens: usize) -> Tensor<3> {
        let width = rows.len() / (windows * tokens);
        Tensor::from_data(TensorData::new(rows, [windows, tokens, width]), &self.device)
    }

    /// Predictions `[windows, tokens, outputs]` for normalised inputs `[windows, tokens, inputs]`, oldest token first; none sees
    /// a younger one.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [windows, tokens, inputs] = x.dims();
        let mut slots: Vec<Option<Tensor<2>>> = vec![None; self.program.widths.len()];
        let read = |slots: &[Option<Tensor<2>>], slot: Slot| slots[slot.0].clone().expect("a slot is written before it is read");
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
                    let (ones, rows) = (Tensor::ones([x.dims()[1]], &x.device()), x);
                    burn::tensor::module::layer_norm(rows, ones, None, 1e-5)
                }
                Op::Attend { heads, band } => attend(x, heads, tokens, band.map(|band| (band, self.program.frequencies.as_slice()))),
                Op::Neighbours(apart) => neighbours(x, tokens, apart),
                Op::Activate(Activation::Gelu) => gelu(x),
                Op::Activate(Activation::Relu) => relu(x),
                Op::Activate(Activation::Tanh) => x.tanh(),
                Op::Activate(Activation::Elu) => relu(x.clone()) + x.clamp_max(0.0).exp() - 1.0,
                Op::Gate => {
                    let half = x.dims()[1] / 2;
                    gelu(x.clone().narrow(1, 0, half)) * x.narrow(1, half, half)
                }
                Op::Cell { weight, bias, lstm } => cell(x, tokens, self.matrix(weight), self.row(bias), lstm),
            };
            slots[step.to.0] = Some(y);
        }
        let width = self.program.width(self.program.predictions());
        read(&slots, self.program.predictions()).reshape([windows, tokens, width])
    }

    /// The gradients of one backward pass in the order of the flat vector, zeros where none was recorded; waits for the device.
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

/// Rows `[q k v]` of windows to mixed values; with a band and frequencies, queries and keys are turned.
fn attend(qkv: Tensor<2>, heads: usize, tokens: usize, rotary: Option<(usize, &[f64])>) -> Tensor<2> {
    let ([rows, width], device) = (qkv.dims(), qkv.device());
    let (windows, e, d) = (rows / tokens, width / 3, width / 3 / heads);
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

/// Turns the columns m and m + d/2 of `[windows, heads, tokens, d]` together, by the angles of a token's place.
fn turn(x: Tensor<4>, frequencies: &[f64]) -> Tensor<4> {
    let ([_, _, tokens, d], device) = (x.dims(), x.device());
    let angles = |f: fn(f64) -> f64| -> Tensor<4> {
        let values: Vec<f32> = (0..tokens).flat_map(|k| frequencies.iter().map(move |a| f(k as f64 * a) as f32)).collect();
        Tensor::from_data(TensorData::new(values, [1, 1, tokens, d / 2]), &device)
    };
    let (cos, sin) = (angles(f64::cos), angles(f64::sin));
    let (a, b) = (x.clone().narrow(3, 0, d / 2), x.narrow(3, d / 2, d / 2));
    Tensor::cat(vec![a.clone() * cos.clone() - b.clone() * sin.clone(), a * sin + b * cos], 3)
}

/// Rows `[windows tokens, width]` beside those of the tokens before and after.
fn neighbours(x: Tensor<2>, tokens: usize, apart: usize) -> Tensor<2> {
    let ([rows, width], device) = (x.dims(), x.device());
    let (x, beyond) = (x.reshape([rows / tokens, tokens, width]), Tensor::<3>::zeros([rows / tokens, apart, width], &device));
    let padded = Tensor::cat(vec![beyond.clone(), x.clone(), beyond], 1);
    let (before, after) = (padded.clone().narrow(1, 0, tokens), padded.narrow(1, 2 * apart, tokens));
    Tensor::cat(vec![before, x, after], 2).reshape([rows, 3 * width])
}

/// Tokens' inputs to the gates, `[windows tokens, gates E]`, to states `[windows tokens, E]`.
fn cell(u: Tensor<2>, tokens: usize, weight: Tensor<2>, bias: Tensor<2>, lstm: bool) -> Tensor<2> {
    let ([rows, width], e, device) = (u.dims(), weight.dims()[0], u.device());
    let (windows, u) = (rows / tokens, u.reshape([rows / tokens, tokens, width]));
    let mut h = Tensor::<2>::zeros([windows, e], &device);
    let (mut c, mut states) = (h.clone(), Vec::with_capacity(tokens));
    let gate = |x: &Tensor<2>, i: usize| x.clone().narrow(1, i * e, e);
    for k in 0..tokens {
        let u = u.clone().narrow(1, k, 1).reshape([windows, width]);
        let v = h.clone().matmul(weight.clone()) + bias.clone();
        if lstm {
            let x = u + v;
            let [i, f, o] = [0, 1, 3].map(|k| sigmoid(gate(&x, k)));
            c = f * c + i * gate(&x, 2).tanh();
            h = o * c.clone().tanh();
        } else {
            let [r, z] = [0, 1].map(|k| sigmoid(gate(&u, k) + gate(&v, k)));
            let n = (gate(&u, 2) + r * gate(&v, 2)).tanh();
            h = n.clone() + z * (h - n);
        }
        states.push(h.clone());
    }
    Tensor::stack::<3>(states, 1).reshape([rows, e])
}
