//! [`CudaShac`]: SHAC with rollouts, backward passes and critic on a GPU. Each iteration downloads rewards, ends and
//! the gradient; the CPU takes the policy's Adam step. Episodes without kernels use the CPU's engine, [`Shac`].

mod backward;

use super::*;
use crate::ppo::shac::{BETA, KEPT};
use backward::{BackwardPass, Rolled};

/// SHAC on a GPU.
pub struct CudaShac {
    /// Holds gradient and J of the last rollout, made on the CPU or the GPU.
    pub shac: Shac,
    engine: CudaEngine,
    critic: Critic,
    /// Backward pass of the present world.
    way: Option<BackwardPass>,
    /// Whether the last rollout ran on the device.
    resident: bool,
    spent: Vec<(&'static str, f64)>,
}

/// The critic's weights and Adam moments on the device, and the weights of V'.
struct Critic {
    weights: Buffer<f32>,
    moments: [Buffer<f32>; 2],
    target_critic: Buffer<f32>,
    /// Whether the device's copy is newer than the CPU's.
    loaded: bool,
}

impl Critic {
    fn vectors(&self) -> [&Buffer<f32>; 4] {
        [&self.weights, &self.target_critic, &self.moments[0], &self.moments[1]]
    }
}

impl CudaShac {
    /// Allocates memory for rollouts and updates under the settings of `shac`.
    pub fn new(shac: Shac, policy: &Policy, config: &PpoConfig) -> Result<Self> {
        let mut engine = CudaEngine::new(&policy.shape, config)?;
        engine.beta = BETA;
        let zeros = || engine.net.device.zeros(shac.critic.flat.len());
        let critic =
            Critic { weights: zeros()?, moments: [zeros()?, zeros()?], target_critic: zeros()?, loaded: false };
        Ok(Self { shac, engine, critic, way: None, resident: false, spent: Vec::new() })
    }

    /// Runs a rollout on the device and its backward pass.
    fn travel(&mut self, world: &mut World, mut on: RolloutInput) -> Result<RolloutStats> {
        let mut started = Instant::now();
        self.spent.clear();
        let mut taken = self.engine.stay(world, &mut on)?;
        self.part("rollout", &mut started)?;
        self.load()?;
        let RolloutInput { episodes, running, policy, config, .. } = on;
        let way = match self.way.take() {
            Some(way) => way,
            None => BackwardPass::new(&self.engine, world, &episodes.simulation.batch.system.robot, config)?,
        };
        let resident = on_card(&mut episodes.simulation)?;
        let rolled =
            Rolled { engine: &self.engine, world, resident, config, target_critic: self.critic.target_critic.ptr };
        for (name, go) in [
            ("values", BackwardPass::value as fn(&BackwardPass, Rolled) -> DeviceResult),
            ("recall", BackwardPass::recall),
            ("way back", BackwardPass::back),
        ] {
            go(&way, rolled)?;
            rolled.engine.net.device.wait()?;
            self.spent.push((name, started.elapsed().as_secs_f64()));
            started = Instant::now();
        }
        let d = &self.engine.net.device;
        self.shac.gradient.resize(policy.flat.len(), 0.0);
        d.read(&self.engine.gradient, &mut self.shac.gradient)?;
        self.shac.earned = d.download(&way.earned)?.iter().sum();
        let without =
            d.download(&way.without)?.iter().enumerate().filter(|(_, x)| **x > 0).map(|(env, _)| env).collect_vec();
        if !without.is_empty() {
            way.begin_again(rolled)?;
            d.read(&self.engine.kept.rows, &mut running.stack.rows)?;
            without.iter().for_each(|env| (running.rewards[*env], running.lengths[*env]) = (0.0, 0.0));
            taken.failed += without.len();
        }
        self.way = Some(way);
        Ok(taken)
    }

    /// Uploads the critic, unless the device has it.
    fn load(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.critic.loaded, true) {
            let d = &self.engine.net.device;
            let Shac { critic, target_critic, adam, .. } = &self.shac;
            let here = [&critic.flat, target_critic, &adam.m, &adam.v];
            self.critic.vectors().into_iter().zip(here).try_for_each(|(to, from)| d.write(to, from))?;
        }
        Ok(())
    }

    /// Trains the critic on the returns of the rollout and moves V'. Returns the mean squared error of normalised
    /// values.
    fn learn(&mut self, policy: &mut Policy, config: &PpoConfig, orders: StreamKey) -> Result<f64> {
        let config = of_critic(config);
        let Self { engine, critic, shac, .. } = self;
        let orders = engine.orders(&config, orders)?;
        engine.loss_inputs(policy, false)?;
        let mut swap = |engine: &mut CudaEngine| {
            std::mem::swap(&mut engine.weights, &mut critic.weights);
            std::mem::swap(&mut engine.moments, &mut critic.moments);
        };
        swap(engine);
        let learned = engine.passes(&mut shac.adam, &config, orders.into_iter());
        swap(engine);
        let n = critic.weights.len;
        engine.over("shac_follow", n, &args![&critic.target_critic, &critic.weights, KEPT, n])?;
        Ok(learned?.terms.critic)
    }

    /// Waits for a stage to end and records its time.
    fn part(&mut self, name: &'static str, started: &mut Instant) -> Result<()> {
        self.engine.net.device.wait()?;
        self.spent.push((name, started.elapsed().as_secs_f64()));
        *started = Instant::now();
        Ok(())
    }
}

/// Settings of a PPO pass for the critic: only the value loss counts.
fn of_critic(config: &PpoConfig) -> PpoConfig {
    PpoConfig { bounds_coef: 0.0, ent_coef: 0.0, target_kl: 0.0, value_clip: 0.0, ..config.clone() }
}

impl Engine for CudaShac {
    fn ahead(&mut self, config: &PpoConfig, orders: StreamKey) {
        self.engine.ahead(&of_critic(config), orders);
    }

    fn roll(&mut self, on: RolloutInput) -> Result<RolloutStats> {
        let mut world = self.engine.world(on.episodes)?;
        self.resident = world.is_some();
        let taken = match &mut world {
            Some(world) => self.travel(world, on),
            None => self.shac.roll(on),
        };
        self.engine.world = Some(world);
        taken
    }

    fn update(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: StreamKey,
    ) -> Result<Updated> {
        if !self.resident {
            return self.shac.update(policy, adam, config, orders);
        }
        let mut started = Instant::now();
        let norm = self.shac.policy_step(policy, adam, config, orders);
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
        // The caller may change these vectors, so the device's copy becomes stale.
        if std::mem::take(&mut self.critic.loaded) {
            let d = &self.engine.net.device;
            let Shac { critic, target_critic, adam, .. } = &mut self.shac;
            let here = [&mut critic.flat, target_critic, &mut adam.m, &mut adam.v];
            self.critic.vectors().into_iter().zip(here).try_for_each(|(from, to)| d.read(from, to))?;
        }
        self.shac.learned()
    }

    fn spent(&self) -> &[(&'static str, f64)] {
        &self.spent
    }
}
