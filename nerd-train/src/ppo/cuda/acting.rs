//! Rollout on the device by the kernels of `acting.cu`: actions, values, advantages and moments.

use super::memory::PARTS;
use super::*;
use crate::ppo::gae::LAMBDA;

/// Units of the network's values: mean and scale of the returns.
fn units(policy: &Policy) -> [f64; 2] {
    [policy.returns.mean[0], policy.returns.scale(0)]
}

impl CudaEngine {
    /// Begins a rollout of a policy; `noise` is the noise stream of the first step.
    pub(super) fn take(&mut self, policy: &Policy, noise: StreamKey) -> DeviceResult {
        let inverse = (0..policy.seen.mean.len()).map(|k| policy.seen.scale(k).recip()).collect_vec();
        self.net.device.write(&self.weights, &policy.flat)?;
        self.net.device.write(&self.kept.seen[0], &policy.seen.mean)?;
        self.net.device.write(&self.kept.seen[1], &inverse)?;
        self.net.device.write(&self.kept.units, &units(policy))?;
        self.net.device.write(&self.kept.noise, &[noise.number])?;
        self.kept.step = 0;
        Ok(())
    }

    /// Normalises `count` observations at `rows` to `inputs`, then evaluates the network on them. `weights`, `rows` and
    /// `inputs` are addresses.
    pub(super) fn ask(&self, weights: u64, rows: u64, inputs: u64, count: usize) -> DeviceResult {
        let width = self.shape.inputs();
        let [mean, inverse] = &self.kept.seen;
        let args = args![rows, mean, inverse, inputs, count * width, width, self.net.plan.padded];
        self.over("normalize", count * width, &args)?;
        self.net.forward_from(inputs, weights, count)
    }

    /// Writes the values of the last evaluation to the address `to`, at the indices stored at `which`. If `which` is 0,
    /// writes them in order.
    pub(super) fn value(&self, which: u64, to: u64, count: usize) -> DeviceResult {
        let said = self.net.predictions();
        let units = &self.kept.units;
        self.over("value", count, &args![said, which, units, to, count, self.shape.action, self.shape.outputs()])
    }

    /// Refuses the data `what` unless `right`: its sizes must be those that the memory was made for.
    pub(super) fn fits(&self, what: &str, right: bool) -> Result<()> {
        let Kept { environments, horizon, .. } = self.kept;
        if !right {
            refuse!("{what} are not those of {environments} environments over {horizon} steps");
        }
        Ok(())
    }

    /// Samples the actions of step t from the observations on the device. The number of their noise stream is `later`
    /// plus the number in `kept.noise`.
    pub(super) fn drawn(&self, t: usize, (noise, later): (StreamKey, usize)) -> DeviceResult {
        let n = self.kept.environments;
        let width = self.shape.inputs();
        let a = self.shape.action;
        let first = t * n;
        self.ask(
            self.weights.ptr,
            self.kept.observations.at(first * width),
            self.steps.inputs.at(first * self.net.plan.padded),
            n,
        )?;
        let Steps { neg_log_prob, actions, means, spreads, .. } = &self.steps;
        let [means, spreads, actions] = [means, spreads, actions].map(|of| of.at(first * a));
        let neg_log_prob = neg_log_prob.at(first);
        let kept = &self.kept;
        let [k0, k1, k2, k3] = key(&noise.rng());
        let read = args![self.net.predictions(), self.parameter(), k0, k1, k2, k3, &kept.noise, later, &kept.units];
        let values = kept.values.at(first);
        let acted = &kept.actions;
        let outputs = self.shape.outputs();
        let written = args![means, spreads, actions, neg_log_prob, values, acted, n, a, outputs];
        self.over("act", n, &[&read[..], &written].concat())
    }

    /// Computes the values of states after the last step and of final states of truncated episodes. `weights` is the
    /// address of the weights.
    pub(super) fn reached(&self, weights: u64) -> DeviceResult {
        let Kept { environments: n, horizon, slots, rows, inputs, which, ends, .. } = &self.kept;
        self.over("reached", *n, &args![ends, which, *n, *horizon, *slots])?;
        let width = self.shape.inputs();
        let padded = self.net.plan.padded;
        let most = self.net.rows / n * n;
        (0..(1 + slots) * n).step_by(most).try_for_each(|first| {
            let count = most.min((1 + slots) * n - first);
            self.ask(weights, rows.at(first * width), inputs.at(first * padded), count)?;
            self.value(which.at(first), self.kept.values.ptr, count)
        })
    }

    /// Computes advantages and returns from values on the device.
    pub(super) fn finished(&self, config: &PpoConfig) -> DeviceResult {
        let Kept { environments: n, horizon, rewards, ends, values, both, .. } = &self.kept;
        let args = args![rewards, ends, values, self.kept.cut(0), both, *n, *horizon, config.gamma, LAMBDA];
        self.over("gae", *n, &args)
    }

    fn moments_of(&self, rows: u64, width: usize) -> Result<RunningMoments> {
        let n = self.kept.horizon * self.kept.environments;
        let partial = &self.kept.partial;
        let mut moments = [vec![0.0; width], vec![0.0; width]];
        let mut about = 0;
        for (out, moments) in self.kept.means.iter().zip(&mut moments) {
            self.over("columns", PARTS * width, &args![rows, about, n, width, PARTS, partial])?;
            self.over("mean", width, &args![partial, n, width, PARTS, out])?;
            self.net.device.read(out, moments)?;
            about = out.ptr;
        }
        let [mean, variance] = moments;
        Ok(RunningMoments { mean, variance, count: n as f64 })
    }

    /// Absorbs the returns into their moments and writes the inputs of the loss. Without `advantages` the normalised
    /// advantages are 0.
    pub(super) fn loss_inputs(&self, policy: &mut Policy, advantages: bool) -> Result<()> {
        let n = self.kept.horizon * self.kept.environments;
        // `both` has two columns: advantages and returns.
        let RunningMoments { mean, variance, count } = self.moments_of(self.kept.both.ptr, 2)?;
        // Normalise old values by the moments that they were predicted with. By the updated moments, value clipping
        // would compare with values that were never predicted.
        let said = units(policy);
        policy.returns.absorb(&RunningMoments { mean: vec![mean[1]], variance: vec![variance[1]], count });
        let [goal, goal_scale] = units(policy);
        let deviation = if advantages { variance[0].sqrt() + 1e-8 } else { f64::INFINITY };
        let Steps { advantages, value_targets, values: old, .. } = &self.steps;
        let Kept { both, values, .. } = &self.kept;
        let laws = args![both, values, n, mean[0], deviation, goal, goal_scale, said[0], said[1]];
        Ok(self.over("loss_inputs", n, &[&laws[..], &args![advantages, value_targets, old]].concat())?)
    }

    pub(super) fn seen(&self, policy: &mut Policy) -> Result<()> {
        policy.seen.absorb(&self.moments_of(self.kept.observations.ptr, self.shape.inputs())?);
        Ok(())
    }

    /// Downloads the last rollout, for inspection before an update.
    pub fn rollout(&self) -> DeviceResult<Rollout> {
        let Kept { horizon, environments, observations, values, both, .. } = &self.kept;
        let d = &self.net.device;
        let Steps { neg_log_prob, actions, means, spreads, .. } = &self.steps;
        let mut values = d.download(values)?;
        values.truncate(horizon * environments);
        Ok(Rollout {
            observations: d.download(observations)?,
            actions: d.download(actions)?,
            mean: d.download(means)?,
            spread: d.download(spreads)?,
            neg_log_prob: d.download(neg_log_prob)?,
            values,
            advantages: d.download(both)?.into_iter().step_by(2).collect(),
        })
    }
}
