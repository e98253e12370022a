//! Passes of `update.rs` on the device, over the same permutations and minibatches as on the CPU.

use nerd_model::program::Slot;

use super::*;
use crate::ppo::loss::CRITIC;
use crate::ppo::update::GRADIENT_NORM;

impl CudaEngine {
    /// One minibatch: `rows` steps of the permutation from `first` on.
    fn minibatch(&self, first: usize, rows: usize, config: &PpoConfig) -> Result<(), DeviceError> {
        let (net, w, order, a) = (&self.net, self.weights.ptr, self.order.at(first), self.shape.action);
        let entries = rows * net.plan.padded;
        let inputs = [self.steps.inputs.ptr, order, net.at(Slot(0))].map(Ptr);
        self.over("ppo_gather", entries, &[&inputs[..], &[Long(entries as u64), Int(net.plan.padded)]].concat())?;
        net.forward(w, rows)?;
        let Steps { advantages, value_targets, values, neg_log_prob, actions, means, spreads, .. } = &self.steps;
        let read = [
            self.said(),
            self.parameter(),
            order,
            actions.ptr,
            neg_log_prob.ptr,
            advantages.ptr,
            value_targets.ptr,
            values.ptr,
        ];
        let written = [means.ptr, spreads.ptr, net.targets.ptr, self.spread.ptr, self.terms.ptr];
        // SHAC's critic learns by the value loss alone.
        let critic = if config.algorithm == Algorithm::Shac { 1.0 } else { CRITIC };
        let numbers = [config.clip_coef, critic, config.bounds_coef, config.ent_coef, config.value_clip].map(Float);
        let sizes = [rows, a, self.shape.outputs()].map(Int);
        self.over("ppo_loss", rows, &[&read.map(Ptr)[..], &written.map(Ptr)[..], &sizes, &numbers].concat())?;
        net.backward(w, Some(self.gradient.ptr), 0..rows, None)?;
        if !self.shape.state_dependent_std {
            net.sum_rows(self.spread.ptr, rows, a, Some(self.gradient.at(self.weights.len - a)), None)?;
        }
        let n = Long(self.weights.len as u64);
        self.net.device.launch(
            "squares",
            (SQUARES, 1),
            (256, 1),
            0,
            &[Ptr(self.gradient.ptr), n, Ptr(self.squares.ptr)],
        )?;
        let (terms, squares) =
            ([Ptr(self.terms.ptr), Int(rows.div_ceil(THREADS))], [Ptr(self.squares.ptr), Int(SQUARES)]);
        let rest = [Int(rows), Float(GRADIENT_NORM), Double(config.target_kl)];
        let args = [&terms[..], &squares, &rest, &self.beta.map(Double), &[Ptr(self.state.ptr)]].concat();
        self.net.device.launch("ppo_finish", (1, 1), (224, 1), 0, &args)?;
        let [m, v] = &self.moments;
        let factors = self.state.ptr + std::mem::offset_of!(PassState, factors) as u64;
        let vectors = [self.weights.ptr, self.gradient.ptr, m.ptr, v.ptr, 0, factors, 0].map(Ptr);
        self.over("adam", self.weights.len, &[&vectors[..], &[n, Ptr(0)], &self.beta.map(Double)].concat())
    }

    /// All minibatches of one pass; replays a captured graph from the second pass with the same settings on.
    fn pass(&self, config: &PpoConfig) -> Result<(), DeviceError> {
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
