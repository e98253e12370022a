//! Rollouts that stay on the device: policy, task, solver and reward, step by step.

use super::*;

impl CudaEngine {
    /// Steps every environment through a horizon from `running`. `reached` computes the bootstrap values later.
    pub(super) fn stay(
        &mut self,
        world: &mut World,
        RolloutInput { episodes, running, policy, config, noise, .. }: &mut RolloutInput,
    ) -> Result<RolloutStats> {
        let resident = on_card(&mut episodes.simulation)?;
        let noise = *noise;
        let horizon = config.horizon;
        let right =
            horizon == self.kept.horizon && running.stack.rows.len() == self.kept.environments * self.shape.inputs();
        self.fits("a rollout's rows and steps", right)?;
        self.take(policy, noise)?;
        self.kept.slots(&self.net, world.cuts(horizon))?;
        let d = &self.net.device;
        d.write(&self.kept.cuts, &vec![0; self.kept.environments])?;
        d.write(&self.kept.observations, &running.stack.rows)?;
        let work = || (0..horizon).try_for_each(|t| self.step((world, resident), t, noise));
        match world.key(horizon) {
            Some((at, place)) => self.rolls.run(d, "rollout", (at, place, key(&noise.rng())), work)?,
            None => work()?,
        }
        world.passed(horizon);
        self.kept.step = horizon;
        Ok(RolloutStats { failed: world.end(resident)?, ended: self.ended(running)?, ..RolloutStats::default() })
    }

    fn step(&self, (world, resident): (&World, &dyn Resident), t: usize, noise: StreamKey) -> DeviceResult {
        let n = self.kept.environments;
        let width = self.shape.inputs();
        let kept = &self.kept;
        self.drawn(t, (noise, t))?;
        let next = if t + 1 == kept.horizon { kept.rows.ptr } else { kept.observations.at((t + 1) * n * width) };
        let now = kept.observations.at(t * n * width);
        let cut = kept.rows.at(n * width);
        let (rewards, ends) = (kept.rewards.at(t * n), kept.ends.at(t * n));
        let judge = args![now, next, cut, &kept.cuts, self.shape.stack, rewards, ends];
        world.step(resident, t, kept.actions.ptr, &judge)
    }

    /// Episodes that ended, with their returns and lengths.
    fn ended(&self, running: &mut Running) -> DeviceResult<Vec<Ended>> {
        let n = self.kept.environments;
        let d = &self.net.device;
        let (rewards, ends) = (d.download(&self.kept.rewards)?, d.download(&self.kept.ends)?);
        d.read(&self.kept.rows, &mut running.stack.rows)?;
        let came = rewards.iter().zip(&ends).enumerate();
        Ok(came.filter_map(|(i, (reward, end))| running.count(i / n, i % n, *reward, *end > 0)).collect())
    }
}
