//! [`CudaShac`]: SHAC whose rollouts, ways back and critic are on a GPU. Of an iteration come back what steps earned and how they ended, and
//! the gradient; the policy's step is the CPU's. Episodes that have no kernels are stepped by the CPU's engine, [`Shac`].

mod way;

use super::*;
use crate::ppo::shac::{BETA, KEPT};
use way::{Rolled, Way};

/// SHAC on a GPU.
pub struct CudaShac {
    /// Its gradient and J belong to the last rollout, made on the CPU or the GPU.
    pub shac: Shac,
    engine: CudaEngine,
    critic: Critic,
    /// Of the present world.
    way: Option<Way>,
    /// Whether the last rollout was on the device.
    resident: bool,
    spent: Vec<(&'static str, f64)>,
}

/// The critic's weights on the device with their moments, and the weights of V'.
struct Critic {
    weights: Buffer<f32>,
    moments: [Buffer<f32>; 2],
    slow: Buffer<f32>,
    /// Whether they are there, and newer than the CPU's.
    loaded: bool,
}

impl CudaShac {
    /// Memory for rollouts and updates under the settings that `shac` was made for.
    pub fn new(shac: Shac, policy: &Policy, config: &PpoConfig) -> Result<Self> {
        let mut engine = CudaEngine::new(&policy.shape, config)?;
        engine.beta = BETA;
        let zeros = || engine.net.device.zeros(shac.critic.flat.len());
        let critic = Critic { weights: zeros()?, moments: [zeros()?, zeros()?], slow: zeros()?, loaded: false };
        Ok(Self { shac, engine, critic, way: None, resident: false, spent: Vec::new() })
    }

    /// A rollout on the device and the way back through it.
    fn travel(&mut self, world: &mut World, mut on: Stage) -> Result<Taken> {
        let mut started = Instant::now();
        self.spent.clear();
        let mut taken = self.engine.stay(world, &mut on)?;
        self.part("rollout", &mut started)?;
        self.load()?;
        let Stage { episodes, running, policy, config, .. } = on;
        let Simulation { batch, solver } = &mut episodes.simulation;
        let Some(resident) = solver.resident() else { refuse!("the solver has left the device") };
        let way = match self.way.take() {
            Some(way) => way,
            None => Way::new(&self.engine, world, &batch.system.robot, config)?,
        };
        let rolled = Rolled { engine: &self.engine, world, resident, config, slow: self.critic.slow.ptr };
        for (name, go) in
            [("values", Way::value as fn(&Way, Rolled) -> Result<(), DeviceError>), ("recall", Way::recall), ("way back", Way::back)]
        {
            go(&way, rolled)?;
            rolled.engine.net.device.wait()?;
            self.spent.push((name, started.elapsed().as_secs_f64()));
            started = Instant::now();
        }
        let d = &self.engine.net.device;
        self.shac.gradient.resize(policy.flat.len(), 0.0);
        d.read(&self.engine.gradient, &mut self.shac.gradient)?;
        self.shac.earned = d.download(&way.earned)?.iter().sum();
        let without: Vec<usize> = d.download(&way.without)?.iter().enumerate().filter(|(_, x)| **x > 0).map(|(env, _)| env).collect();
        if !without.is_empty() {
            way.begin_again(rolled)?;
            d.read(&self.engine.kept.rows, &mut running.stack.rows)?;
            without.iter().for_each(|env| (running.rewards[*env], running.lengths[*env]) = (0.0, 0.0));
            taken.failed += without.len();
        }
        self.way = Some(way);
        Ok(taken)
    }

    /// The critic goes to the device, unless it is there.
    fn load(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.critic.loaded, true) {
            let (d, Shac { critic, slow, adam, .. }) = (&self.engine.net.device, &self.shac);
            let there = [&self.critic.weights, &self.critic.slow, &self.critic.moments[0], &self.critic.moments[1]];
            there.into_iter().zip([&critic.flat, slow, &adam.m, &adam.v]).try_for_each(|(to, from)| d.write(to, from))?;
        }
        Ok(())
    }

    /// The critic learns the returns of the rollout, and V' follows; its mean squared error.
    fn learn(&mut self, policy: &mut Policy, config: &PpoConfig, orders: StreamKey) -> Result<f64> {
        let (config, Self { engine, critic, shac, .. }) = (of_critic(config), self);
        let orders = engine.orders(&config, orders)?;
        engine.goals(policy, false)?;
        let mut swap = |engine: &mut CudaEngine| {
            std::mem::swap(&mut engine.weights, &mut critic.weights);
            std::mem::swap(&mut engine.moments, &mut critic.moments);
        };
        swap(engine);
        let learned = engine.passes(&mut shac.adam, &config, orders.into_iter());
        swap(engine);
        let n = critic.weights.len;
        engine.over("shac_follow", n, &[Ptr(critic.slow.ptr), Ptr(critic.weights.ptr), Float(KEPT), Long(n as u64)])?;
        Ok(learned?.terms.critic)
    }

    /// Notes what a part took, once it is done.
    fn part(&mut self, name: &'static str, started: &mut Instant) -> Result<()> {
        self.engine.net.device.wait()?;
        self.spent.push((name, started.elapsed().as_secs_f64()));
        *started = Instant::now();
        Ok(())
    }
}

/// The critic's settings of a pass of PPO: the error of its value is all that counts.
fn of_critic(config: &PpoConfig) -> PpoConfig {
    PpoConfig { critic: 1.0, bounds: 0.0, entropy: 0.0, kl: 0.0, value_clip: 0.0, ..config.clone() }
}

impl Engine for CudaShac {
    fn ahead(&mut self, config: &PpoConfig, orders: StreamKey) {
        self.engine.ahead(&of_critic(config), orders);
    }

    fn roll(&mut self, on: Stage) -> Result<Taken> {
        let mut world = self.engine.world(on.episodes)?;
        self.resident = world.is_some();
        let taken = match &mut world {
            Some(world) => self.travel(world, on),
            None => self.shac.roll(on),
        };
        self.engine.world = Some(world);
        taken
    }

    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, orders: StreamKey) -> Result<Updated> {
        if !self.resident {
            return self.shac.update(policy, adam, config, orders);
        }
        let mut started = Instant::now();
        let norm = self.shac.climb(policy, adam, config, orders);
        self.part("policy", &mut started)?;
        let critic = self.learn(policy, config, orders)?;
        self.engine.seen(policy)?;
        self.part("critic", &mut started)?;
        Ok(self.shac.told(policy, norm, critic))
    }

    fn snapshot(&self, episodes: &Episodes) -> Result<Snapshot, StepError> {
        self.engine.snapshot(episodes)
    }

    fn restore(&mut self, episodes: &mut Episodes, snapshot: &Snapshot) -> Result<(), StepError> {
        self.way = None;
        self.engine.restore(episodes, snapshot)
    }

    fn learned(&mut self) -> Result<Vec<(&'static str, &mut Vec<f32>)>> {
        // Whoever asks may change them.
        if std::mem::take(&mut self.critic.loaded) {
            let (d, Shac { critic, slow, adam, .. }) = (&self.engine.net.device, &mut self.shac);
            let here = [&mut critic.flat, slow, &mut adam.m, &mut adam.v];
            let there = [&self.critic.weights, &self.critic.slow, &self.critic.moments[0], &self.critic.moments[1]];
            there.into_iter().zip(here).try_for_each(|(from, to)| d.read(from, to))?;
        }
        self.shac.learned()
    }

    fn spent(&self) -> &[(&'static str, f64)] {
        &self.spent
    }
}
