//! A rollout on the device: actions, values, advantages and moments, by the kernels of `acting.cu`.

use super::memory::PARTS;
use super::*;

/// Values of the network in units of reward: mean and scale.
fn units(policy: &Policy) -> [f64; 2] {
    [policy.returns.mean[0], policy.returns.scale(0)]
}

impl CudaEngine {
    /// Begins a rollout of a policy, whose first step has this noise.
    pub(super) fn take(&mut self, policy: &Policy, noise: StreamKey) -> Result<(), DeviceError> {
        let inverse: Vec<f64> = (0..policy.seen.mean.len()).map(|k| policy.seen.scale(k).recip()).collect();
        self.net.device.write(&self.weights, &policy.flat)?;
        self.net.device.write(&self.kept.seen[0], &policy.seen.mean)?;
        self.net.device.write(&self.kept.seen[1], &inverse)?;
        self.net.device.write(&self.kept.units, &units(policy))?;
        self.net.device.write(&self.kept.noise, &[noise.number])?;
        self.kept.step = 0;
        Ok(())
    }

    /// Runs the network of these weights on `count` rows on the device; writes the normalised rows to `inputs`.
    pub(super) fn ask(&self, weights: u64, rows: u64, inputs: u64, count: usize) -> Result<(), DeviceError> {
        let (width, [mean, inverse]) = (self.shape.inputs(), &self.kept.seen);
        let args = [rows, mean.ptr, inverse.ptr, inputs].map(Ptr);
        let sizes = [Long((count * width) as u64), Int(width), Int(self.net.plan.padded)];
        self.over("normalize", count * width, &[&args[..], &sizes].concat())?;
        self.net.forward_from(inputs, weights, count)
    }

    /// Values of the rows last asked about, to where `which` says.
    pub(super) fn value(&self, which: u64, to: u64, count: usize) -> Result<(), DeviceError> {
        let sizes = [count, self.shape.action, self.shape.outputs()].map(Int);
        self.over("value", count, &[&[self.said(), which, self.kept.units.ptr, to].map(Ptr)[..], &sizes].concat())
    }

    /// Refuses what there is no memory for.
    pub(super) fn fits(&self, what: &str, right: bool) -> Result<()> {
        let Kept { environments, horizon, .. } = self.kept;
        if !right {
            refuse!("{what} are not those of {environments} environments over {horizon} steps");
        }
        Ok(())
    }

    /// Draws the actions of step t of a rollout, whose observations are there, with noise from the stream `later` after the key's.
    pub(super) fn drawn(&self, t: usize, (noise, later): (StreamKey, usize)) -> Result<(), DeviceError> {
        let (n, width, a) = (self.kept.environments, self.shape.inputs(), self.shape.action);
        let first = t * n;
        self.ask(self.weights.ptr, self.kept.observations.at(first * width), self.steps.inputs.at(first * self.net.plan.padded), n)?;
        let Steps { surprise, actions, means, spreads, .. } = &self.steps;
        let written = [means.at(first * a), spreads.at(first * a), actions.at(first * a), surprise.at(first)];
        let read = [self.said(), self.parameter()].map(Ptr);
        let (key, noise) = (key(&noise.rng()).map(Long), [Ptr(self.kept.noise.ptr), Long(later as u64), Ptr(self.kept.units.ptr)]);
        let kept = [self.kept.values.at(first), self.kept.actions.ptr].map(Ptr);
        let sizes = [n, a, self.shape.outputs()].map(Int);
        self.over("act", n, &[&read[..], &key, &noise, &written.map(Ptr), &kept, &sizes].concat())
    }

    /// Values, by these weights, of the states after the last step and at time-outs, in a rollout on the device.
    pub(super) fn reached(&self, weights: u64) -> Result<(), DeviceError> {
        let Kept { environments: n, horizon, slots, rows, inputs, which, ends, .. } = &self.kept;
        self.over("reached", *n, &[Ptr(ends.ptr), Ptr(which.ptr), Int(*n), Int(*horizon), Int(*slots)])?;
        let (width, padded, most) = (self.shape.inputs(), self.net.plan.padded, self.net.rows / n * n);
        (0..(1 + slots) * n).step_by(most).try_for_each(|first| {
            let count = most.min((1 + slots) * n - first);
            self.ask(weights, rows.at(first * width), inputs.at(first * padded), count)?;
            self.value(which.at(first), self.kept.values.ptr, count)
        })
    }

    /// Advantages and returns of a rollout whose values are there.
    pub(super) fn finished(&self, config: &PpoConfig) -> Result<(), DeviceError> {
        let Kept { environments: n, horizon, rewards, ends, values, both, .. } = &self.kept;
        let all = [rewards.ptr, ends.ptr, values.ptr, self.kept.cut(0), both.ptr].map(Ptr);
        self.over("gae", *n, &[&all[..], &[Int(*n), Int(*horizon), Double(config.gamma), Double(config.lambda)]].concat())
    }

    fn moments_of(&self, rows: u64, width: usize) -> Result<RunningMoments> {
        let (n, partial) = (self.kept.horizon * self.kept.environments, self.kept.partial.ptr);
        let mut moments = [vec![0.0; width], vec![0.0; width]];
        let mut about = 0;
        for (out, moments) in self.kept.means.iter().zip(&mut moments) {
            self.over("columns", PARTS * width, &[Ptr(rows), Ptr(about), Long(n as u64), Int(width), Int(PARTS), Ptr(partial)])?;
            self.over("mean", width, &[Ptr(partial), Long(n as u64), Int(width), Int(PARTS), Ptr(out.ptr)])?;
            self.net.device.read(out, moments)?;
            about = out.ptr;
        }
        let [mean, variance] = moments;
        Ok(RunningMoments { mean, variance, count: n as f64 })
    }

    /// Takes the returns into their moments, and makes of the rollout what the loss asks for; advantages are nothing if they do not count.
    pub(super) fn goals(&self, policy: &mut Policy, advantages: bool) -> Result<()> {
        let n = self.kept.horizon * self.kept.environments;
        // Of advantages and of returns.
        let RunningMoments { mean, variance, count } = self.moments_of(self.kept.both.ptr, 2)?;
        // As predicted: in updated moments a value would be clipped to something that was never predicted.
        let said = units(policy);
        policy.returns.absorb(&RunningMoments { mean: vec![mean[1]], variance: vec![variance[1]], count });
        let [goal, goal_scale] = units(policy);
        let deviation = if advantages { variance[0].sqrt() + 1e-8 } else { f64::INFINITY };
        let laws = [mean[0], deviation, goal, goal_scale, said[0], said[1]].map(Double);
        let Steps { advantages, goals, values, .. } = &self.steps;
        let read = [Ptr(self.kept.both.ptr), Ptr(self.kept.values.ptr), Long(n as u64)];
        Ok(self.over("goals", n, &[&read[..], &laws, &[advantages.ptr, goals.ptr, values.ptr].map(Ptr)].concat())?)
    }

    pub(super) fn seen(&self, policy: &mut Policy) -> Result<()> {
        policy.seen.absorb(&self.moments_of(self.kept.observations.ptr, self.shape.inputs())?);
        Ok(())
    }

    /// The rollout, to be looked at before an update.
    pub fn rollout(&self) -> Result<Rollout, DeviceError> {
        let (Kept { horizon, environments, observations, values, both, .. }, d) = (&self.kept, &self.net.device);
        let (Steps { surprise, actions, means, spreads, .. }, mut values) = (&self.steps, d.download(values)?);
        values.truncate(horizon * environments);
        Ok(Rollout {
            observations: d.download(observations)?,
            actions: d.download(actions)?,
            mean: d.download(means)?,
            spread: d.download(spreads)?,
            surprise: d.download(surprise)?,
            values,
            advantages: d.download(both)?.into_iter().step_by(2).collect(),
        })
    }
}
