//! [`CudaUpdater`]: the passes of [`super::update`] on a GPU. What decides about them, the order of steps, is drawn where it always is, so both
//! make the same minibatches.

use nerd_cuda::Arg::{Double, Float, Int, Long, Ptr};
use nerd_cuda::{Arg, Buffer, Device, DeviceError, Lane, Op, Precision};

use super::activation::Activation;
use super::config::PpoConfig;
use super::loss::Terms;
use super::mlp::Mlp;
use super::policy::{Policy, Shape};
use super::rollout::Rollout;
use super::trainer::PpoError;
use super::update::{Adam, Data, Updated, Updater, begun, ended, orders};

const KERNELS: [&str; 7] = ["gather", "activate", "chain", "loss", "squares", "finish", "adam"];
/// Threads of a block, and blocks of the gradient norm's first stage.
const THREADS: usize = 128;
const SQUARES: usize = 64;

/// Mirror of the struct in `kernels.cu`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
struct Scalars {
    rate: f64,
    sums: [f64; 6],
    norms: f64,
    batches: f64,
    step: u64,
    factors: [f32; 4],
}

/// Memory on a GPU for updates of one shape.
pub struct CudaUpdater {
    device: Device,
    network: Mlp,
    shape: Shape,
    /// Of a rollout, by step.
    steps: [Buffer<f32>; 8],
    order: Buffer<u32>,
    /// Of a minibatch: rows into each layer and out of the last, and gradients of two layers turn about.
    layers: Vec<Buffer<f32>>,
    behind: [Buffer<f32>; 2],
    spread: Buffer<f32>,
    ones: Buffer<f32>,
    terms: Buffer<f64>,
    squares: Buffer<f64>,
    weights: Buffer<f32>,
    gradient: Buffer<f32>,
    moments: [Buffer<f32>; 2],
    scalars: Buffer<Scalars>,
}

impl CudaUpdater {
    /// Memory for a policy's updates under these settings.
    ///
    /// # Errors
    /// If there is no GPU, a library is missing or memory runs out.
    pub fn new(shape: &Shape, config: &PpoConfig) -> Result<Self, DeviceError> {
        let device = Device::open(include_str!("kernels.cu"), &KERNELS)?.with_products(Precision::F32)?;
        let (network, n, a) = (shape.network(), config.steps(), shape.action);
        let (rows, parameters) = (config.minibatch.min(n), shape.parameters());
        let widest = network.sizes.iter().copied().max().unwrap_or(1);
        let zeros = |len: usize| device.zeros::<f32>(len);
        // Inputs, advantages, goals, values, surprise; actions, means and spreads.
        let [one, all] = [1, a].map(|width| n * width);
        let steps =
            [zeros(n * network.sizes[0])?, zeros(one)?, zeros(one)?, zeros(one)?, zeros(one)?, zeros(all)?, zeros(all)?, zeros(all)?];
        Ok(Self {
            steps,
            order: device.zeros(n)?,
            layers: network.sizes.iter().map(|width| zeros(rows * width)).collect::<Result<_, _>>()?,
            behind: [zeros(rows * widest)?, zeros(rows * widest)?],
            spread: zeros(rows * a)?,
            ones: device.upload(&vec![1.0; rows])?,
            terms: device.zeros(6 * rows.div_ceil(THREADS))?,
            squares: device.zeros(SQUARES)?,
            weights: zeros(parameters)?,
            gradient: zeros(parameters)?,
            moments: [zeros(parameters)?, zeros(parameters)?],
            scalars: device.zeros(1)?,
            shape: shape.clone(),
            network,
            device,
        })
    }

    /// A kernel over so many entries.
    fn over(&self, kernel: &str, entries: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.device.launch(kernel, (entries.div_ceil(THREADS), 1), (THREADS, 1), 0, args)
    }

    /// Row-major `c = a b`, inner size k.
    fn product(
        &self,
        ops: (Op, Op),
        size: (usize, usize, usize),
        a: (u64, usize),
        b: (u64, usize),
        c: (u64, usize),
    ) -> Result<(), DeviceError> {
        self.device.product(Lane::Main, ops, size, a, b, 0.0, c)
    }

    /// One minibatch, the `rows` steps that `order` has from `first` on.
    fn minibatch(&self, first: usize, rows: usize, config: &PpoConfig) -> Result<(), DeviceError> {
        let (sizes, order, a) = (&self.network.sizes, self.order.at(first), self.shape.action);
        let kind = match self.shape.activation {
            Activation::Tanh => 1,
            Activation::Relu => 2,
            Activation::Elu => 3,
        };
        let (last, outputs) = (sizes.len() - 1, sizes[sizes.len() - 1]);
        let starts: Vec<usize> = sizes.windows(2).scan(0, |at, w| Some(std::mem::replace(at, *at + (w[0] + 1) * w[1]))).collect();
        let entries = (rows * sizes[0]) as u64;
        let inputs = [Ptr(self.steps[0].ptr), Ptr(order), Ptr(self.layers[0].ptr), Long(entries), Int(sizes[0])];
        self.over("gather", rows * sizes[0], &inputs)?;
        for (l, w) in sizes.windows(2).enumerate() {
            let (x, y, at) = (self.layers[l].ptr, self.layers[l + 1].ptr, self.weights.at(starts[l]));
            self.product((Op::Plain, Op::Plain), (w[1], rows, w[0]), (at, w[1]), (x, w[0]), (y, w[1]))?;
            let bias = self.weights.at(starts[l] + w[0] * w[1]);
            let args = [Ptr(y), Ptr(bias), Long((rows * w[1]) as u64), Int(w[1]), Int(if l + 1 < last { kind } else { 0 })];
            self.over("activate", rows * w[1], &args)?;
        }
        let parameter = if self.shape.spread_by_state { 0 } else { self.weights.at(self.network.parameters()) };
        let [_, advantages, goals, values, surprise, actions, means, spreads] = &self.steps;
        let read = [self.layers[last].ptr, parameter, order, actions.ptr, surprise.ptr, advantages.ptr, goals.ptr, values.ptr];
        let written = [means.ptr, spreads.ptr, self.behind[0].ptr, self.spread.ptr, self.terms.ptr];
        let numbers = [config.clip, config.critic, config.bounds, config.entropy, config.value_clip].map(Float);
        let args = [&read.map(Ptr)[..], &written.map(Ptr)[..], &[rows, a, outputs].map(Int)[..], &numbers[..]].concat();
        self.over("loss", rows, &args)?;
        let [mut behind, mut before] = [self.behind[0].ptr, self.behind[1].ptr];
        for (l, w) in sizes.windows(2).enumerate().rev() {
            let (x, at, to) = (self.layers[l].ptr, self.weights.at(starts[l]), self.gradient.at(starts[l]));
            self.product((Op::Plain, Op::Transposed), (w[1], w[0], rows), (behind, w[1]), (x, w[0]), (to, w[1]))?;
            self.sum(behind, rows, w[1], self.gradient.at(starts[l] + w[0] * w[1]))?;
            if l > 0 {
                self.product((Op::Transposed, Op::Plain), (w[0], rows, w[1]), (at, w[1]), (behind, w[1]), (before, w[0]))?;
                self.over("chain", rows * w[0], &[Ptr(before), Ptr(x), Long((rows * w[0]) as u64), Int(kind)])?;
                std::mem::swap(&mut behind, &mut before);
            }
        }
        if !self.shape.spread_by_state {
            self.sum(self.spread.ptr, rows, a, self.gradient.at(self.network.parameters()))?;
        }
        let n = Long(self.weights.len as u64);
        self.device.launch("squares", (SQUARES, 1), (256, 1), 0, &[Ptr(self.gradient.ptr), n, Ptr(self.squares.ptr)])?;
        let (terms, squares) = ([Ptr(self.terms.ptr), Int(rows.div_ceil(THREADS))], [Ptr(self.squares.ptr), Int(SQUARES)]);
        let rest = [Int(rows), Float(config.gradient_norm), Double(config.kl), Ptr(self.scalars.ptr)];
        self.device.launch("finish", (1, 1), (224, 1), 0, &[&terms[..], &squares[..], &rest[..]].concat())?;
        let [m, v] = &self.moments;
        let vectors = [self.weights.ptr, self.gradient.ptr, m.ptr, v.ptr, self.scalars.ptr].map(Ptr);
        self.over("adam", self.weights.len, &[&vectors[..], &[n]].concat())
    }

    /// Sums of the columns of `[rows][width]`.
    fn sum(&self, from: u64, rows: usize, width: usize, to: u64) -> Result<(), DeviceError> {
        self.product((Op::Plain, Op::Plain), (width, 1, rows), (from, width), (self.ones.ptr, rows), (to, width))
    }

    fn passes(
        &self,
        policy: &mut Policy,
        adam: &mut Adam,
        data: &Data,
        config: &PpoConfig,
        seeds: (u64, u64),
    ) -> Result<Updated, DeviceError> {
        let d = &self.device;
        for (there, here) in self.steps.iter().zip(data.columns()) {
            d.write(there, here)?;
        }
        let [m, v] = &self.moments;
        d.write(&self.weights, &policy.flat)?;
        d.write(m, &adam.m)?;
        d.write(v, &adam.v)?;
        d.write(&self.scalars, &[Scalars { rate: adam.rate, step: adam.step, ..Default::default() }])?;
        for order in orders(data.len(), config, seeds) {
            d.write(&self.order, &order)?;
            for first in (0..order.len()).step_by(config.minibatch) {
                self.minibatch(first, config.minibatch.min(order.len() - first), config)?;
            }
        }
        let mut scalars = [Scalars::default()];
        d.read(&self.weights, &mut policy.flat)?;
        d.read(m, &mut adam.m)?;
        d.read(v, &mut adam.v)?;
        d.read(&self.scalars, &mut scalars)?;
        let [Scalars { rate, sums, norms, batches, step, .. }] = scalars;
        (adam.rate, adam.step) = (rate, step);
        let [actor, critic, bounds, entropy, kl, clipped] = sums;
        Ok(Updated::new(&Terms { actor, critic, bounds, entropy, kl, clipped }.over(batches), norms / batches))
    }
}

impl Updater for CudaUpdater {
    fn update(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        rollout: &Rollout,
        config: &PpoConfig,
        seeds: (u64, u64),
    ) -> Result<Updated, PpoError> {
        let data = begun(policy, rollout);
        let updated = self.passes(policy, adam, &data, config, seeds).map_err(|e| PpoError::Device(e.to_string()))?;
        ended(policy, rollout);
        Ok(updated)
    }
}
