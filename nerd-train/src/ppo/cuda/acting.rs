//! A rollout on the device: actions, values, advantages and moments, by the kernels of `acting.cu`.

use super::memory::PARTS;
use super::*;

/// Values of the network in units of reward: mean and scale.
fn units(policy: &Policy) -> [f64; 2] {
    [policy.returns.mean[0], policy.returns.scale(0)]
}

impl CudaEngine {
    /// Begins a rollout of a policy.
    pub(super) fn take(&mut self, policy: &Policy) -> Result<(), DeviceError> {
        let inverse: Vec<f64> = (0..policy.seen.mean.len()).map(|k| policy.seen.scale(k).recip()).collect();
        self.net.device.write(&self.weights, &policy.flat)?;
        self.net.device.write(&self.kept.seen[0], &policy.seen.mean)?;
        self.net.device.write(&self.kept.seen[1], &inverse)?;
        (self.kept.step, self.kept.returns) = (0, units(policy));
        Ok(())
    }

    /// The network where so many rows on the device are seen.
    pub(super) fn ask(&self, rows: u64, inputs: u64, count: usize) -> Result<(), DeviceError> {
        let (width, [mean, inverse]) = (self.shape.inputs(), &self.kept.seen);
        let args = [rows, mean.ptr, inverse.ptr, inputs].map(Ptr);
        let sizes = [Long((count * width) as u64), Int(width), Int(self.net.plan.padded)];
        self.over("normalize", count * width, &[&args[..], &sizes].concat())?;
        self.net.forward_from(inputs, self.weights.ptr, count)
    }

    /// Values of the rows last asked about, to where `which` says.
    pub(super) fn value(&self, which: u64, to: u64, count: usize) -> Result<(), DeviceError> {
        let [mean, scale] = self.kept.returns.map(Double);
        let sizes = [count, self.shape.action, self.shape.outputs()].map(Int);
        self.over("value", count, &[&[Ptr(self.said()), Ptr(which), mean, scale, Ptr(to)][..], &sizes].concat())
    }

    /// Refuses what there is no memory for.
    pub(super) fn fits(&self, what: &str, right: bool) -> Result<()> {
        let Kept { environments, horizon, .. } = self.kept;
        if !right {
            refuse!("{what} are not those of {environments} environments over {horizon} steps");
        }
        Ok(())
    }

    /// Draws the actions of step t of a rollout, whose observations are there.
    pub(super) fn drawn(&self, t: usize, noise: StreamKey) -> Result<(), DeviceError> {
        let (n, width, a) = (self.kept.environments, self.shape.inputs(), self.shape.action);
        let first = t * n;
        self.ask(self.kept.observations.at(first * width), self.steps.inputs.at(first * self.net.plan.padded), n)?;
        let Steps { surprise, actions, means, spreads, .. } = &self.steps;
        let written = [means.at(first * a), spreads.at(first * a), actions.at(first * a), surprise.at(first)];
        let read = [self.said(), self.parameter()].map(Ptr);
        let [key0, key1, key2, key3] = key(&noise.rng());
        let noise = [key0, key1, key2, key3, noise.number].map(Long);
        let (units, kept) = (self.kept.returns.map(Double), [self.kept.values.at(first), self.kept.actions.ptr].map(Ptr));
        let (sizes, own) = ([n, a, self.shape.outputs()].map(Int), [Long(self.team.part.start as u64)]);
        self.over("act", n, &[&read[..], &noise, &units, &written.map(Ptr), &kept, &sizes, &own].concat())
    }

    /// Advantages and returns of a rollout that is there, the rows where it ends too.
    pub(super) fn finished(&self, config: &PpoConfig) -> Result<(), DeviceError> {
        let Kept { environments: n, horizon, rewards, ends, values, cut, both, .. } = &self.kept;
        let (n, horizon) = (*n, *horizon);
        self.ask(self.kept.rows.ptr, self.kept.inputs.ptr, n)?;
        self.value(0, self.kept.values.at(horizon * n), n)?;
        let all = [rewards.ptr, ends.ptr, values.ptr, cut.ptr, both.ptr].map(Ptr);
        self.over("gae", n, &[&all[..], &[Int(n), Int(horizon), Double(config.gamma), Double(config.lambda)]].concat())
    }

    /// Moments of columns over all steps.
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
        Ok(self.team.pool(RunningMoments { mean, variance, count: n as f64 })?)
    }

    /// Takes the returns into their moments, and makes of the rollout what the loss asks for.
    pub(super) fn goals(&self, policy: &mut Policy) -> Result<()> {
        let n = self.kept.horizon * self.kept.environments;
        // Of advantages and of returns.
        let RunningMoments { mean, variance, count } = self.moments_of(self.kept.both.ptr, 2)?;
        // As predicted: in updated moments a value would be clipped to something that was never predicted.
        let said = units(policy);
        policy.returns.absorb(&RunningMoments { mean: vec![mean[1]], variance: vec![variance[1]], count });
        let [goal, goal_scale] = units(policy);
        let laws = [mean[0], variance[0].sqrt() + 1e-8, goal, goal_scale, said[0], said[1]].map(Double);
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
        let (n, Kept { observations, values, both, .. }) = (self.kept.horizon * self.kept.environments, &self.kept);
        let of_steps = |from: &Buffer<f32>| {
            let mut out = vec![0.0; from.len];
            self.net.device.read(from, &mut out).map(|()| out)
        };
        let numbers = |from: &Buffer<f64>, len: usize| {
            let mut out = vec![0.0; len];
            self.net.device.read(from, &mut out).map(|()| out)
        };
        let Steps { surprise, actions, means, spreads, .. } = &self.steps;
        Ok(Rollout {
            observations: numbers(observations, observations.len)?,
            actions: of_steps(actions)?,
            mean: of_steps(means)?,
            spread: of_steps(spreads)?,
            surprise: of_steps(surprise)?,
            values: numbers(values, n)?,
            advantages: numbers(both, 2 * n)?.into_iter().step_by(2).collect(),
        })
    }
}
