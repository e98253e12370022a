//! Passes over a rollout that is on the device, of [`super::super::update`]. What decides about them, the order of steps, is drawn where it
//! always is, so both make the same minibatches.

use nerd_cuda::Arg::{Double, Float, Int, Long, Ptr};
use nerd_cuda::{DeviceError, Op};

use super::super::config::PpoConfig;
use super::super::loss::Terms;
use super::super::policy::Policy;
use super::super::update::{Adam, Updated};
use super::{CudaEngine, SQUARES, THREADS};

/// Mirror of the struct in `kernels.cu`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(super) struct Scalars {
    rate: f64,
    sums: [f64; 6],
    norms: f64,
    batches: f64,
    step: u64,
    factors: [f32; 4],
}

impl CudaEngine {
    /// One minibatch of `whole` steps, of which `order` has these `rows` from `first` on.
    fn minibatch(&self, (first, rows): (usize, usize), whole: usize, config: &PpoConfig) -> Result<(), DeviceError> {
        let (sizes, order, a) = (&self.network.sizes, self.order.at(first), self.shape.action);
        let (kind, outputs, starts) = (self.kind(), self.outputs(), self.starts());
        let entries = (rows * sizes[0]) as u64;
        let inputs = [Ptr(self.steps[0].ptr), Ptr(order), Ptr(self.layers[0].ptr), Long(entries), Int(sizes[0])];
        self.over("gather", rows * sizes[0], &inputs)?;
        self.forward(self.layers[0].ptr, rows)?;
        let [_, advantages, goals, values, surprise, actions, means, spreads] = &self.steps;
        let read = [self.said(), self.parameter(), order, actions.ptr, surprise.ptr, advantages.ptr, goals.ptr, values.ptr];
        let written = [means.ptr, spreads.ptr, self.behind[0].ptr, self.spread.ptr, self.terms.ptr];
        let numbers = [config.clip, config.critic, config.bounds, config.entropy, config.value_clip].map(Float);
        let args = [&read.map(Ptr)[..], &written.map(Ptr)[..], &[rows, whole, a, outputs].map(Int)[..], &numbers[..]].concat();
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
        let blocks = self.joined(rows.div_ceil(THREADS))?;
        let n = Long(self.weights.len as u64);
        self.device.launch("squares", (SQUARES, 1), (256, 1), 0, &[Ptr(self.gradient.ptr), n, Ptr(self.squares.ptr)])?;
        let (terms, squares) = ([Ptr(self.terms.ptr), Int(blocks)], [Ptr(self.squares.ptr), Int(SQUARES)]);
        let rest = [Int(whole), Float(config.gradient_norm), Double(config.kl), Ptr(self.scalars.ptr)];
        self.device.launch("finish", (1, 1), (224, 1), 0, &[&terms[..], &squares[..], &rest[..]].concat())?;
        let [m, v] = &self.moments;
        let vectors = [self.weights.ptr, self.gradient.ptr, m.ptr, v.ptr, self.scalars.ptr].map(Ptr);
        self.over("adam", self.weights.len, &[&vectors[..], &[n]].concat())
    }

    /// Sums of the columns of `[rows][width]`.
    fn sum(&self, from: u64, rows: usize, width: usize, to: u64) -> Result<(), DeviceError> {
        self.product((Op::Plain, Op::Plain), (width, 1, rows), (from, width), (self.ones.ptr, rows), (to, width))
    }

    /// All minibatches of one pass, as a graph from the second pass of the same settings on.
    fn pass(&mut self, config: &PpoConfig) -> Result<(), DeviceError> {
        if let Some((_, graph)) = self.graph.as_ref().filter(|(known, _)| known == config) {
            return graph.launch("pass");
        }
        let all = || {
            let steps = config.steps();
            (0..steps).step_by(config.minibatch).enumerate().try_for_each(|(k, first)| {
                let whole = config.minibatch.min(steps - first);
                let rows = if self.among.is_some() { (k * self.rows, self.rows) } else { (first, whole) };
                self.minibatch(rows, whole, config)
            })
        };
        // Once outside of a capture, so that libraries have loaded what they load at their first call.
        all()?;
        self.device.wait()?;
        self.graph = Some((config.clone(), self.device.capture(all)?));
        Ok(())
    }

    /// All passes in these orders; the policy's weights are there since the rollout began.
    pub(super) fn passes(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: impl Iterator<Item = Result<Vec<u32>, String>>,
    ) -> Result<Updated, DeviceError> {
        self.device.write(&self.moments[0], &adam.m)?;
        self.device.write(&self.moments[1], &adam.v)?;
        self.device.write(&self.scalars, &[Scalars { rate: adam.rate, step: adam.step, ..Default::default() }])?;
        let mut passes = 0;
        for order in orders {
            self.device.write(&self.order, &order.map_err(DeviceError)?)?;
            self.pass(config)?;
            passes += 1;
        }
        if passes < config.epochs {
            return Err(DeviceError(format!("the orders of {passes} of {} passes were drawn", config.epochs)));
        }
        let (d, [m, v]) = (&self.device, &self.moments);
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
