//! [`CudaEpisodes`]: episodes on a GPU for learners beside this library, whose actions are there and who read there what came of them.

use nerd_cuda::Beside;

use super::*;

const EPISODES: &str = include_str!("episodes.cu");

/// Episodes of a task that never leave a GPU; ended ones restart at once.
pub struct CudaEpisodes {
    episodes: Episodes,
    world: World,
    door: Door,
    replay: Replay<(u64, usize)>,
}

/// What goes into a step and what comes of it.
struct Door {
    device: Device,
    actions: Buffer<f32>,
    rows: Buffer<f64>,
    cut: Buffer<f64>,
    cuts: Buffer<u32>,
    rewards: Buffer<f64>,
    ends: Buffer<u8>,
    shown: Arc<Shown>,
}

/// What learners read after a step: the same memory of the GPU each time.
pub struct Shown {
    /// `[env][observation]`; where an episode ended, the first observation of the next.
    pub observations: Buffer<f32>,
    /// `[env][observation]` before the next episode began where time ran out; elsewhere as `observations`.
    pub reached: Buffer<f32>,
    /// `[env]`.
    pub rewards: Buffer<f32>,
    /// 1 where an episode ended in a terminal state.
    pub terminated: Buffer<u8>,
    /// 1 where its time ran out.
    pub truncated: Buffer<u8>,
}

impl CudaEpisodes {
    /// Takes over episodes, which their solver keeps on a GPU, from their start.
    ///
    /// # Errors
    /// If it does not; else what of task, scene or robot has no kernel, or that there is no GPU or not enough memory.
    pub fn new(mut episodes: Episodes) -> Result<Self> {
        let device = Device::open(EPISODES, &["offer", "show"])?;
        let (n, about) = (episodes.len(), episodes.task.about());
        let (seen, wide) = (n * about.observation, |len: usize| device.zeros::<f64>(len));
        let single = |len: usize| device.zeros::<f32>(len);
        let (terminated, truncated, ends) = (device.zeros(n)?, device.zeros(n)?, device.zeros(n)?);
        let (observations, reached, rewards) = (single(seen)?, single(seen)?, single(n)?);
        let shown = Arc::new(Shown { observations, reached, rewards, terminated, truncated });
        let (actions, cuts, rows, cut, rewards) = (single(n * about.action)?, device.zeros(n)?, wide(seen)?, wide(seen)?, wide(n)?);
        let world = taken(&mut episodes, &device)?;
        let door = Door { device, actions, rows, cut, cuts, rewards, ends, shown };
        door.begin(episodes.observations())?;
        Ok(Self { episodes, world, door, replay: Replay::default() })
    }

    /// Begins the first episodes of a seed.
    pub fn seeded(&mut self, seed: u64) -> Result<()> {
        self.episodes.seeded(seed);
        self.world = taken(&mut self.episodes, &self.door.device)?;
        // What was captured is of the world before.
        self.replay = Replay::default();
        Ok(self.door.begin(self.episodes.observations())?)
    }

    /// One step under actions `[env][action]`, f32 at an address of the GPU. It does not wait for what comes of it.
    pub fn step(&mut self, actions: u64) -> Result<()> {
        let Self { episodes, world, door, replay } = self;
        let Some(resident) = episodes.simulation.solver.resident() else { refuse!("the solver has left the device") };
        let resident = &*resident;
        door.offer(actions)?;
        let rows = [door.rows.ptr, door.rows.ptr, door.cut.ptr, door.cuts.ptr].map(Ptr);
        let judge = [&rows[..], &[Int(1)], &[door.rewards.ptr, door.ends.ptr].map(Ptr)].concat();
        let work = || {
            world.step(resident, 0, door.actions.ptr, &judge)?;
            door.show()
        };
        match world.key(1) {
            Some(key) => replay.run(&door.device, "step", key, work)?,
            None => work()?,
        }
        world.passed(1);
        Ok(())
    }

    /// Episodes that the solver could not go on with since this was asked last, which ended without a reward. It waits for the GPU.
    ///
    /// # Errors
    /// If a start cannot be stepped, or the device stopped.
    pub fn failed(&mut self) -> Result<usize> {
        let Some(resident) = self.episodes.simulation.solver.resident() else { refuse!("the solver has left the device") };
        Ok(self.world.end(&*resident)?)
    }

    /// What learners read.
    pub fn shown(&self) -> &Arc<Shown> {
        &self.door.shown
    }

    /// The stream that steps are in.
    pub fn beside(&self) -> Beside {
        self.door.device.beside()
    }

    /// Actions `[env][action]` that are put on the GPU, for who has none there.
    pub fn upload(&self, actions: &[f32]) -> Result<Buffer<f32>> {
        Ok(self.door.device.upload(actions)?)
    }
}

impl Door {
    fn offer(&self, actions: u64) -> Result<(), DeviceError> {
        let (all, n) = (self.actions.len, self.ends.len);
        over(&self.device, "offer", all.max(n), &[&[actions, self.actions.ptr, self.cuts.ptr].map(Ptr)[..], &[all, n].map(Int)].concat())
    }

    fn show(&self) -> Result<(), DeviceError> {
        let Shown { observations, reached, rewards, terminated, truncated } = &*self.shown;
        let read = [self.rows.ptr, self.cut.ptr, self.rewards.ptr, self.ends.ptr];
        let written = [observations.ptr, reached.ptr, rewards.ptr, terminated.ptr, truncated.ptr];
        let sizes = [self.rows.len, self.rows.len / self.ends.len].map(Int);
        over(&self.device, "show", self.rows.len, &[&read.map(Ptr)[..], &written.map(Ptr), &sizes].concat())
    }

    fn begin(&self, observations: &[f64]) -> Result<(), DeviceError> {
        self.device.write(&self.rows, observations)?;
        self.device.write(&self.rewards, &vec![0.0; self.rewards.len])?;
        self.device.write(&self.ends, &vec![0; self.ends.len])?;
        self.show()
    }
}

fn over(device: &Device, kernel: &str, entries: usize, args: &[Arg]) -> Result<(), DeviceError> {
    device.launch(kernel, (entries.div_ceil(THREADS), 1), (THREADS, 1), 0, args)
}

/// Episodes as a world whose work is done in the order of their solver's, as is that of the device.
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
