//! A rollout that never leaves the device: policy, task, solver and reward, step by step.

use super::*;

impl CudaEngine {
    /// Steps every environment through a horizon, from where `running` is.
    pub(super) fn stay(
        &mut self,
        (world, resident): (&mut World, &mut dyn Resident),
        running: &mut Running,
        policy: &Policy,
        config: &PpoConfig,
        noise: StreamKey,
    ) -> Result<Taken> {
        let horizon = config.horizon;
        let right = horizon == self.kept.horizon && running.stack.rows.len() == self.kept.environments * self.shape.inputs();
        self.fits("a rollout's rows and steps", right)?;
        self.take(policy)?;
        self.ready(running, world.cuts(horizon))?;
        for t in 0..horizon {
            let noise = StreamKey { number: noise.number + t as u64, ..noise };
            self.step((world, resident), t, noise)?;
        }
        let taken = Taken { failed: world.end(resident)?, ended: self.ended(running)? };
        self.finished(config)?;
        Ok(taken)
    }

    /// Memory for rows where time runs out; rows as they are.
    fn ready(&mut self, running: &Running, slots: usize) -> Result<(), DeviceError> {
        let d = &self.net.device;
        let rows = running.stack.rows.len();
        if self.kept.over.as_ref().is_none_or(|(over, _)| over.len < slots * rows) {
            self.kept.over = Some((d.zeros(slots * rows)?, d.zeros(self.kept.environments)?));
            self.kept.slots = slots;
        }
        if let Some((_, cuts)) = &self.kept.over {
            d.write(cuts, &vec![0; self.kept.environments])?;
        }
        d.write(&self.kept.observations, &running.stack.rows)
    }

    fn step(&mut self, (world, resident): (&mut World, &mut dyn Resident), t: usize, noise: StreamKey) -> Result<(), DeviceError> {
        let (n, width) = (self.kept.environments, self.shape.inputs());
        self.drawn(t, noise)?;
        let last = t + 1 == self.kept.horizon;
        let next = if last { self.kept.rows.ptr } else { self.kept.observations.at((t + 1) * n * width) };
        let [cut, cuts] = self.kept.over.as_ref().map_or([0; 2], |(rows, counts)| [rows.ptr, counts.ptr]);
        let [rows, rewards, ends] = [self.kept.observations.at(t * n * width), self.kept.rewards.at(t * n), self.kept.ends.at(t * n)];
        let judge = [Ptr(rows), Ptr(next), Ptr(cut), Ptr(cuts), Int(self.shape.stack), Ptr(rewards), Ptr(ends)];
        let [acted, judged] = &self.kept.marks;
        self.net.device.mark(Lane::Main, acted)?;
        world.step(resident, self.kept.actions.ptr, &judge, [acted, judged])?;
        self.net.device.after(Lane::Main, judged)?;
        self.kept.step = t + 1;
        Ok(())
    }

    /// What came of the steps; episodes that ended, with their returns and lengths. Values of states where time ran out are where
    /// advantages look for them.
    fn ended(&mut self, running: &mut Running) -> Result<Vec<Ended>, DeviceError> {
        let (n, steps) = (self.kept.environments, self.kept.horizon * self.kept.environments);
        let (mut rewards, mut ends) = (vec![0.0; steps], vec![0u8; steps]);
        self.net.device.read(&self.kept.rewards, &mut rewards)?;
        self.net.device.read(&self.kept.ends, &mut ends)?;
        self.net.device.read(&self.kept.rows, &mut running.stack.rows)?;
        let (mut ended, mut cut) = (Vec::new(), vec![vec![u32::MAX; n]; self.kept.slots]);
        let mut cuts = vec![0; n];
        for (i, (reward, end)) in rewards.iter().zip(&ends).enumerate() {
            let env = i % n;
            ended.extend(running.count(i / n, env, *reward, *end > 0));
            if *end == 2 {
                cut[cuts[env]][env] = i as u32;
                cuts[env] += 1;
            }
        }
        let Some((rows, _)) = &self.kept.over else { return Ok(ended) };
        for (slot, which) in cut.iter().enumerate().filter(|(_, which)| which.iter().any(|i| *i != u32::MAX)) {
            self.net.device.write(&self.kept.which, which)?;
            self.ask(rows.at(slot * n * self.shape.inputs()), self.kept.inputs.ptr, n)?;
            self.value(self.kept.which.ptr, self.kept.cut.ptr, n)?;
        }
        Ok(ended)
    }
}
