//! [`World`]: episodes whose states, goals and ends never leave the device, stepped by a solver that keeps its batch there.

use super::*;

/// Mirror of `World` in `task.cuh`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Fields {
    /// States, goals, torques; scenes and whose they are; faults, memory, failed; frames and begun.
    at: [u64; 10],
    key: [u64; 4],
    first: u64,
    counts: u64,
    n: i32,
}

/// Episodes of one task on a device.
pub(super) struct World {
    device: Device,
    fields: Buffer<Fields>,
    goals: Buffer<f64>,
    frames: Buffer<u64>,
    begun: Buffer<u64>,
    _failed: Buffer<u32>,
    counts: Buffer<u32>,
    past: Past,
    /// Between this and the solver.
    turns: [Event; 2],
    /// States when the last rollout ended, and frames of a step.
    states: Vec<f64>,
    step: u64,
    /// Steps of an episode.
    length: u64,
    n: usize,
}

/// The last frames that were stepped: states before them, torques in them; frame k of all is in place k of `most`.
struct Past {
    most: usize,
    states: Buffer<f64>,
    torques: Buffer<f64>,
    /// Numbers of a frame, and frames so far.
    sizes: [usize; 2],
    count: usize,
}

impl World {
    /// Takes episodes over where they are; none where their solver is elsewhere.
    ///
    /// # Errors
    /// What of task, scene or robot has no kernel; or that there is not enough memory.
    pub(super) fn new(episodes: &mut Episodes) -> Result<Option<Self>, StepError> {
        let (kept, most, (seed, first), task) = (episodes.snapshot(), episodes.remembered(), episodes.draws(), &episodes.task);
        let Simulation { batch, solver } = &mut episodes.simulation;
        let Some(resident) = solver.resident() else { return Ok(None) };
        let (n, system) = (batch.len(), &batch.system);
        let colliders = batch.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);
        let text = task.kernels(system, colliders, false).map_err(StepError::Refused)?;
        resident.hold(batch)?;
        let memory = resident.memory();
        let Some((_, held)) = resident.held() else { return Err(StepError::Refused("no environments".into())) };
        let make = || -> Result<Self, DeviceError> {
            let device = Device::open(nerd_cuda::ordinal(), &text, &["task_act", "task_judge"])?;
            let (goals, frames, begun) = (device.upload(&kept.goals)?, device.upload(&kept.frames)?, device.upload(&kept.begun)?);
            let (failed, counts) = (device.zeros::<u32>(n)?, device.zeros::<u32>(2)?);
            let world = [held.states.ptr, goals.ptr, held.torques.ptr, held.records.ptr, held.scene_of.ptr];
            let mut at = [0; 10];
            at[..5].copy_from_slice(&world);
            at[5..].copy_from_slice(&[held.faults.ptr, memory, failed.ptr, frames.ptr, begun.ptr]);
            let fields = Fields { at, key: key(&stream(seed, 0)), first: first as u64, counts: counts.ptr, n: n as i32 };
            let sizes = [kept.states.len(), n * system.robot.joint_count()];
            let past = Past { most, states: device.zeros(most * sizes[0])?, torques: device.zeros(most * sizes[1])?, sizes, count: 0 };
            let turns = [device.event()?, device.event()?];
            let fields = device.upload(&[fields])?;
            let (step, length, states) = (task.frames(), task.episode_length().max(1), kept.states.clone());
            Ok(Self { fields, goals, frames, begun, _failed: failed, counts, past, turns, states, step, length, n, device })
        };
        // Kernels of the task that do not compile, or no memory beside the solver: then tasks run on the CPU, and the reason is printed.
        let mut world = make().map_err(|e| StepError::Refused(e.to_string()))?;
        world.past.take(&world.device, &kept).map_err(failed)?;
        Ok(Some(world))
    }

    /// How often at most one environment runs out of time in so many steps.
    pub(super) fn cuts(&self, steps: usize) -> usize {
        1 + (steps.saturating_sub(1) as u64 / self.length) as usize
    }

    fn launch(&self, kernel: &str, args: &[Arg]) -> Result<(), DeviceError> {
        self.device.launch(kernel, (self.n.div_ceil(BLOCK), 1), (BLOCK, 1), 0, &[&[Ptr(self.fields.ptr)], args].concat())
    }

    /// One step under actions on the device, after the work that `acted` marks; `judged` marks its own, which has these arguments.
    pub(super) fn step(
        &mut self,
        resident: &mut dyn Resident,
        actions: u64,
        judge: &[Arg],
        [acted, judged]: [&Event; 2],
    ) -> Result<(), DeviceError> {
        self.device.after(Lane::Main, acted)?;
        for frame in 0..self.step {
            let [states, torques] = self.past.next();
            self.launch("task_act", &[Ptr(actions), Int(usize::from(frame > 0)), Ptr(states), Ptr(torques)])?;
            self.device.mark(Lane::Main, &self.turns[0])?;
            if let Some((device, _)) = resident.held() {
                device.after(Lane::Main, &self.turns[0])?;
            }
            resident.frame()?;
            if let Some((device, _)) = resident.held() {
                device.mark(Lane::Main, &self.turns[1])?;
            }
            self.device.after(Lane::Main, &self.turns[1])?;
        }
        self.launch("task_judge", judge)?;
        self.device.mark(Lane::Main, judged)
    }

    /// After a rollout: episodes that failed in it.
    pub(super) fn end(&mut self, resident: &dyn Resident) -> Result<usize, StepError> {
        let mut counts = [0; 2];
        self.device.read(&self.counts, &mut counts).map_err(failed)?;
        self.device.write(&self.counts, &[0, 0]).map_err(failed)?;
        if let Some((device, held)) = resident.held() {
            device.read(&held.states, &mut self.states).map_err(failed)?;
        }
        if let Some(env) = counts[1].checked_sub(1) {
            let reason = "a start that cannot be stepped would restart for ever".into();
            return Err(StepError::Environments(vec![Fault { env: env as usize, frame: 0, reason }]));
        }
        Ok(counts[0] as usize)
    }

    /// What later steps depend on, as it was when the last rollout ended.
    pub(super) fn snapshot(&self) -> Result<Snapshot, StepError> {
        let d = &self.device;
        let mut kept = Snapshot { states: self.states.clone(), frames: vec![0; self.n], begun: vec![0; self.n], ..Default::default() };
        kept.goals.resize(self.goals.len, 0.0);
        d.read(&self.frames, &mut kept.frames).map_err(failed)?;
        d.read(&self.begun, &mut kept.begun).map_err(failed)?;
        d.read(&self.goals, &mut kept.goals).map_err(failed)?;
        self.past.give(d, &mut kept).map_err(failed)?;
        Ok(kept)
    }
}

impl Past {
    /// Where the next frame goes; 0 if none is kept.
    fn next(&mut self) -> [u64; 2] {
        if self.most == 0 {
            return [0; 2];
        }
        let place = self.count % self.most;
        self.count += 1;
        [self.states.at(place * self.sizes[0]), self.torques.at(place * self.sizes[1])]
    }

    fn take(&mut self, device: &Device, kept: &Snapshot) -> Result<(), DeviceError> {
        self.count = kept.past_states.len().checked_div(self.sizes[0]).unwrap_or(0).min(self.most);
        device.write(&self.states, &kept.past_states)?;
        device.write(&self.torques, &kept.past_torques)
    }

    fn give(&self, device: &Device, kept: &mut Snapshot) -> Result<(), DeviceError> {
        let frames = self.count.min(self.most);
        let oldest = if self.count > self.most { self.count % self.most } else { 0 };
        for (from, to, size) in
            [(&self.states, &mut kept.past_states, self.sizes[0]), (&self.torques, &mut kept.past_torques, self.sizes[1])]
        {
            to.resize(frames * size, 0.0);
            device.read(from, to)?;
            to.rotate_left(oldest * size);
        }
        Ok(())
    }
}
