//! Passes of `update.rs` on the device, over the same permutations and minibatches as on the CPU.

use nerd_model::program::Slot;

use super::*;
use crate::ppo::loss::CRITIC;
use crate::ppo::update::GRADIENT_NORM;

impl CudaEngine {
    /// Runs one minibatch: `rows` steps of the permutation, from index `first` on.
    fn minibatch(&self, first: usize, rows: usize, config: &PpoConfig) -> DeviceResult {
        let net = &self.net;
        let w = self.weights.ptr;
        let order = self.order.at(first);
        let a = self.shape.action;
        let entries = rows * net.plan.padded;
        let Steps { inputs, advantages, value_targets, values, neg_log_prob, actions, means, spreads } = &self.steps;
        self.over("ppo_gather", entries, &args![inputs, order, net.at(Slot(0)), entries, net.plan.padded])?;
        net.forward(w, rows)?;
        let Self { spread, terms, squares, gradient, weights, state, moments: [m, v], beta, .. } = self;
        let said = net.predictions();
        let parameter = self.parameter();
        let read = args![said, parameter, order, actions, neg_log_prob, advantages, value_targets, values];
        // SHAC's critic learns by the value loss alone.
        let critic = if config.algorithm == Algorithm::Shac { 1.0 } else { CRITIC };
        let PpoConfig { clip_coef, bounds_coef, ent_coef, value_clip, target_kl, .. } = *config;
        let written = args![means, spreads, &net.targets, spread, terms, rows, a, self.shape.outputs()];
        let numbers = args![clip_coef, critic, bounds_coef, ent_coef, value_clip];
        self.over("ppo_loss", rows, &[&read[..], &written, &numbers].concat())?;
        net.backward(w, Some(gradient.ptr), 0..rows, None)?;
        if !self.shape.state_dependent_std {
            net.sum_rows(spread.ptr, rows, a, Some(gradient.at(weights.len - a)), None)?;
        }
        let n = weights.len;
        let blocks = rows.div_ceil(THREADS);
        let [b1, b2] = *beta;
        net.device.launch_blocks("squares", SQUARES, 256, &args![gradient, n, squares])?;
        let args = args![terms, blocks, squares, SQUARES, rows, GRADIENT_NORM, target_kl, b1, b2, state];
        net.device.launch_blocks("ppo_finish", 1, 224, &args)?;
        let factors = state.ptr + std::mem::offset_of!(PassState, factors) as u64;
        self.over("adam", n, &args![weights, gradient, m, v, 0_u64, factors, 0_u64, n, 0_u64, b1, b2])
    }

    /// Runs all minibatches of one pass. From the second pass with the same settings on, replays a captured graph.
    fn pass(&self, config: &PpoConfig) -> DeviceResult {
        self.replay.run(&self.net.device, "pass", (self.weights.ptr, config.clone()), || {
            let steps = config.steps();
            let mut firsts = (0..steps).step_by(config.minibatch);
            firsts.try_for_each(|first| self.minibatch(first, config.minibatch.min(steps - first), config))
        })
    }

    /// Runs a pass for each permutation; weights and Adam's moments are on the device.
    pub(super) fn passes(
        &mut self,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: impl Iterator<Item = Vec<u32>>,
    ) -> Result<Updated> {
        self.net.device.write(
            &self.state,
            &[PassState { learning_rate: adam.learning_rate, step: adam.step, ..Default::default() }],
        )?;
        let mut passes = 0;
        for order in orders {
            self.net.device.write(&self.order, &order)?;
            self.pass(config)?;
            passes += 1;
        }
        if passes < config.epochs {
            refuse!("the orders of {passes} of {} passes were drawn", config.epochs);
        }
        let mut state = [PassState::default()];
        self.net.device.read(&self.state, &mut state)?;
        let [PassState { learning_rate, sums, norms, batches, step, .. }] = state;
        (adam.learning_rate, adam.step) = (learning_rate, step);
        Ok(Updated { terms: Terms::of(sums).over(batches), gradient_norm: norms / batches })
    }
}
