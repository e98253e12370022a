//! [`CudaEpisodes`]: episodes on a GPU for external learners, which keep actions and results in GPU memory.

use nerd_cuda::Beside;

use super::*;

const EPISODES: &str = include_str!("episodes.cu");

/// Episodes of a task that never leave a GPU; an ended episode restarts at once.
pub struct CudaEpisodes {
    episodes: Episodes,
    world: World,
    exchange: Exchange,
    replay: Replay<(u64, usize)>,
}

/// Inputs and results of a step.
struct Exchange {
    device: Device,
    actions: Buffer<f32>,
    rows: Buffer<f64>,
    cut: Buffer<f64>,
    cuts: Buffer<u32>,
    rewards: Buffer<f64>,
    ends: Buffer<u8>,
    shown: Arc<Shown>,
}

/// Results of a step; their GPU addresses are the same in every step.
pub struct Shown {
    /// Observations `[env][observation]`; after an ended episode, the first observation of the next episode.
    pub observations: Buffer<f32>,
    /// Final observations `[env][observation]` of truncated episodes; in other environments equal to `observations`.
    pub reached: Buffer<f32>,
    /// Rewards `[env]`.
    pub rewards: Buffer<f32>,
    /// 1 where an episode terminated, `[env]`.
    pub terminated: Buffer<u8>,
    /// 1 where an episode was truncated, `[env]`.
    pub truncated: Buffer<u8>,
}

impl CudaEpisodes {
    /// Moves episodes to the GPU of their solver, from their start.
    ///
    /// # Errors
    /// If the solver keeps no batch on a GPU, or a part of task, scene or robot has no kernel. Also if there is no GPU,
    /// or not enough memory.
    pub fn new(mut episodes: Episodes) -> Result<Self> {
        let device = Device::open(EPISODES, &["offer", "show"])?;
        let n = episodes.len();
        let about = episodes.task.about();
        let seen = n * about.observation;
        let wide = |len: usize| device.zeros::<f64>(len);
        let single = |len: usize| device.zeros::<f32>(len);
        let (terminated, truncated, ends) = (device.zeros(n)?, device.zeros(n)?, device.zeros(n)?);
        let (observations, reached, rewards) = (single(seen)?, single(seen)?, single(n)?);
        let shown = Arc::new(Shown { observations, reached, rewards, terminated, truncated });
        let actions = single(n * about.action)?;
        let cuts = device.zeros(n)?;
        let rows = wide(seen)?;
        let cut = wide(seen)?;
        let rewards = wide(n)?;
        let world = taken(&mut episodes, &device)?;
        let exchange = Exchange { device, actions, rows, cut, cuts, rewards, ends, shown };
        exchange.begin(episodes.observations())?;
        Ok(Self { episodes, world, exchange, replay: Replay::default() })
    }

    /// Begins the first episodes of another seed.
    pub fn seeded(&mut self, seed: u64) -> Result<()> {
        self.episodes.seeded(seed);
        self.world = taken(&mut self.episodes, &self.exchange.device)?;
        // The captured graph belongs to the previous world.
        self.replay = Replay::default();
        Ok(self.exchange.begin(self.episodes.observations())?)
    }

    /// Enqueues one step; `actions` is the GPU address of f32 actions `[env][action]`. Does not wait for the results.
    pub fn step(&mut self, actions: u64) -> Result<()> {
        let Self { episodes, world, exchange, replay } = self;
        let resident = on_card(&mut episodes.simulation)?;
        exchange.offer(actions)?;
        let Exchange { rows, cut, cuts, rewards, ends, .. } = &*exchange;
        let judge = args![rows, rows, cut, cuts, 1_usize, rewards, ends];
        let work = || {
            world.step(resident, 0, exchange.actions.ptr, &judge)?;
            exchange.show()
        };
        match world.key(1) {
            Some(key) => replay.run(&exchange.device, "step", key, work)?,
            None => work()?,
        }
        world.passed(1);
        Ok(())
    }

    /// Number of episodes ended by a solver failure, with reward 0, since the last call. Waits for the GPU.
    ///
    /// # Errors
    /// If a start cannot be stepped, or the device failed.
    pub fn failed(&mut self) -> Result<usize> {
        Ok(self.world.end(on_card(&mut self.episodes.simulation)?)?)
    }

    /// Results of the last step.
    pub fn shown(&self) -> &Arc<Shown> {
        &self.exchange.shown
    }

    /// Stream that the steps run on.
    pub fn beside(&self) -> Beside {
        self.exchange.device.beside()
    }

    /// Uploads actions `[env][action]` for callers without GPU memory.
    pub fn upload(&self, actions: &[f32]) -> Result<Buffer<f32>> {
        Ok(self.exchange.device.upload(actions)?)
    }
}

impl Exchange {
    fn offer(&self, actions: u64) -> DeviceResult {
        let (all, n) = (self.actions.len, self.ends.len);
        self.device.launch_each("offer", all.max(n), THREADS, &args![actions, &self.actions, &self.cuts, all, n])
    }

    fn show(&self) -> DeviceResult {
        let Shown { observations, reached, rewards, terminated, truncated } = &*self.shown;
        let Self { device, rows, cut, ends, .. } = self;
        let read = args![rows, cut, &self.rewards, ends];
        let written = args![observations, reached, rewards, terminated, truncated, rows.len, rows.len / ends.len];
        device.launch_each("show", rows.len, THREADS, &[&read[..], &written].concat())
    }

    fn begin(&self, observations: &[f64]) -> DeviceResult {
        self.device.write(&self.rows, observations)?;
        self.device.write(&self.rewards, &vec![0.0; self.rewards.len])?;
        self.device.write(&self.ends, &vec![0; self.ends.len])?;
        self.show()
    }
}

/// Episodes as a world on their solver's stream, which `device` joins.
fn taken(episodes: &mut Episodes, device: &Device) -> Result<World> {
    let Simulation { batch, solver } = &mut episodes.simulation;
    if let Some(resident) = solver.resident() {
        resident.hold(batch)?;
        if let Some((theirs, _)) = resident.held() {
            device.join(theirs)?;
        }
    }
    match World::new(episodes, device, None)? {
        Some(world) => Ok(world),
        None => refuse!("the solver of these episodes does not stay on a card: step them on the CPU"),
    }
}
