//! Rollouts of `CudaEngine`, with episodes on the CPU or on the GPU, and its updates.

use super::*;
use crate::ppo::update;

impl CudaEngine {
    /// Receiver of the permutations of an update, one per pass.
    pub(super) fn orders(&mut self, config: &PpoConfig, key: StreamKey) -> Result<Orders> {
        let found = sizes(config);
        if found != self.sizes {
            refuse!("memory was made for {:?} steps of an iteration and of a minibatch, not for {found:?}", self.sizes);
        }
        if self.orders.as_ref().is_none_or(|(known, asked, _)| known != config || *asked != key) {
            self.ahead(config, key);
        }
        let Some((_, _, orders)) = self.orders.take() else {
            refuse!("no thread could be started to draw the order of steps; allow more (ulimit -u)")
        };
        Ok(orders)
    }

    /// The episodes on the solver's device, moved there in the first call. `None` if they cannot run there; a missing
    /// kernel of the task is printed.
    pub(super) fn world(&mut self, episodes: &mut Episodes) -> Result<Option<World>> {
        Ok(match self.world.take() {
            Some(known) => known,
            None if !self.steps_episodes => None,
            None => match World::new(episodes, &self.net.device, self.returns.then_some(self.kept.horizon)) {
                Err(StepError::Refused(why)) => {
                    tell!("{why}; what is seen goes to the card once a step, and actions come back");
                    None
                }
                // The solver's own kernels failed to compile: the next step of the solver reports the reason.
                Err(StepError::Solver(_)) => None,
                other => other?,
            },
        })
    }
}

impl StepwiseRollout for CudaEngine {
    fn begin(&mut self, policy: &Policy) -> Result<()> {
        Ok(self.take(policy, StreamKey { seed: 0, number: 0 })?)
    }

    fn act(&mut self, rows: &[f64], noise: StreamKey, actions: &mut Vec<f64>) -> Result<()> {
        let Kept { environments: n, horizon, step, .. } = self.kept;
        let width = self.shape.inputs();
        let a = self.shape.action;
        self.fits("rows", rows.len() == n * width && step < horizon)?;
        self.net.device.write_at(&self.kept.observations, step * n * width, rows)?;
        self.net.device.write(&self.kept.noise, &[noise.number])?;
        self.drawn(step, (noise, 0))?;
        let mut kept = vec![0f32; n * a];
        self.net.device.read(&self.kept.actions, &mut kept)?;
        actions.clear();
        actions.extend(kept.into_iter().map(f64::from));
        Ok(())
    }

    fn arrive(&mut self, reached: &[f64], truncated: &[bool]) -> Result<()> {
        let Kept { environments: n, horizon, step, .. } = self.kept;
        let cut = (0..).zip(truncated).filter_map(|(env, over)| over.then_some(env)).collect_vec();
        let right = truncated.len() == n && reached.len() == cut.len() * self.shape.inputs() && step < horizon;
        self.fits("results of a step", right)?;
        if !cut.is_empty() {
            self.net.device.write(&self.kept.rows, reached)?;
            self.net.device.write(&self.kept.which, &cut)?;
            self.ask(self.weights.ptr, self.kept.rows.ptr, self.kept.inputs.ptr, cut.len())?;
            self.value(self.kept.which.ptr, self.kept.cut(step), cut.len())?;
        }
        self.kept.step += 1;
        Ok(())
    }

    fn finish(&mut self, rows: &[f64], rewards: &[f64], ends: &[u8], config: &PpoConfig) -> Result<()> {
        let Kept { environments: n, horizon, step, .. } = self.kept;
        let steps = [step * n, horizon * n, ends.len()];
        self.fits(
            "rows and rewards",
            rows.len() == n * self.shape.inputs() && steps.iter().all(|len| *len == rewards.len()),
        )?;
        self.net.device.write(&self.kept.rows, rows)?;
        self.net.device.write(&self.kept.rewards, rewards)?;
        self.net.device.write(&self.kept.ends, ends)?;
        self.ask(self.weights.ptr, self.kept.rows.ptr, self.kept.inputs.ptr, n)?;
        self.value(0, self.kept.values.at(horizon * n), n)?;
        Ok(self.finished(config)?)
    }
}

impl Engine for CudaEngine {
    fn ahead(&mut self, config: &PpoConfig, key: StreamKey) {
        // A thread draws the permutations during the rollout, as they are needed.
        let (give, orders) = std::sync::mpsc::sync_channel(config.epochs);
        let settings = config.clone();
        let drawn = std::thread::Builder::new().spawn(move || {
            // Stop when nothing receives any more.
            let _ = update::orders(&settings, key).try_for_each(|order| give.send(order));
        });
        self.orders = drawn.is_ok().then(|| (config.clone(), key, orders));
    }

    /// Rolls out on the GPU if the episodes run there. Otherwise policy and episodes take turns.
    fn roll(&mut self, mut on: RolloutInput) -> Result<RolloutStats> {
        let mut world = self.world(on.episodes)?;
        let there = on.episodes.simulation.solver.resident().is_some();
        let taken = match world.as_mut().filter(|_| there) {
            Some(world) => self.stay(world, &mut on).and_then(|taken| {
                self.reached(self.weights.ptr)?;
                self.finished(on.config)?;
                Ok(taken)
            }),
            None => self.turns(on),
        };
        self.world = Some(world);
        taken
    }

    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, key: StreamKey) -> Result<Updated> {
        let orders = self.orders(config, key)?;
        self.loss_inputs(policy, true)?;
        self.net.device.write(&self.moments[0], &adam.m)?;
        self.net.device.write(&self.moments[1], &adam.v)?;
        let updated = self.passes(adam, config, orders.into_iter())?;
        self.net.device.read(&self.weights, &mut policy.flat)?;
        self.net.device.read(&self.moments[0], &mut adam.m)?;
        self.net.device.read(&self.moments[1], &mut adam.v)?;
        self.seen(policy)?;
        Ok(updated)
    }

    fn snapshot(&self, episodes: &Episodes) -> Result<Snapshot, StepError> {
        self.world.iter().flatten().next().map_or_else(|| Ok(episodes.snapshot()), World::snapshot)
    }

    fn restore(&mut self, episodes: &mut Episodes, snapshot: &Snapshot) -> Result<(), StepError> {
        self.world = None;
        episodes.restore(snapshot)
    }
}
