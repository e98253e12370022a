//! Training of the critic on the returns of a rollout: minibatch passes on the squared error of normalised values.

use super::*;

impl Shac {
    /// Runs all passes over the rollout; returns the mean squared error of normalised values over all minibatches.
    pub(super) fn learn(&mut self, policy: &Policy, config: &PpoConfig, key: StreamKey) -> f64 {
        (self.critic.seen, self.critic.returns) = (policy.seen.clone(), policy.returns.clone());
        let width = policy.shape.inputs();
        let a = policy.shape.action;
        let mut network = self.critic.network();
        let value_targets = self.returns.iter().map(|x| policy.returns.normalize(0, *x) as f32).collect_vec();
        let mut lost = 0.0;
        let mut batches = 0.0;
        for order in orders(config, key) {
            for batch in order.chunks(config.minibatch) {
                let own = batch.iter().map(|i| *i as usize).collect_vec();
                let rows = own.iter().flat_map(|i| self.steps.rows[i * width..][..width].iter().copied()).collect_vec();
                let scale = 1.0 / batch.len() as f32;
                let (gradient, sum) = through(&self.critic, &network, &rows, By::Parameters, |i, said, by| {
                    let off = said[a] - value_targets[own[i]];
                    by[a] = scale * off;
                    f64::from(off * off)
                });
                let gradient = gradient.into_iter().map(|g| g as f32).collect_vec();
                lost += f64::from(scale * sum as f32);
                batches += 1.0;
                self.adam.step(BETA, &mut self.critic.flat, &gradient);
                network.load(&self.critic.flat);
            }
        }
        lost / batches
    }
}
