//! [`World`]: episodes with states, goals and ends on the device, stepped by a solver that keeps its batch there.

use super::*;

/// Mirror of `World` in `task.cuh`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Fields {
    /// Addresses: states, goals, torques, scenes, indices of scenes, faults, memory, failed, frames, begun.
    at: [u64; 10],
    key: [u64; 4],
    first: u64,
    counts: u64,
    n: i32,
    climbs: i32,
    before: u64,
}

/// Kernels of a task; all but the first two belong to the backward pass.
const KERNELS: [&str; 6] =
    ["task_act", "task_judge", "task_arrive_back", "task_acted_back", "task_leave", "task_begin_again"];

/// Episodes of one task on a device.
pub(super) struct World {
    device: Device,
    fields: Buffer<Fields>,
    goals: Buffer<f64>,
    frames: Buffer<u64>,
    begun: Buffer<u64>,
    _failed: Buffer<u32>,
    counts: Buffer<u32>,
    _before: Buffer<f64>,
    past: Past,
    /// States after each step, if rollouts are differentiated.
    reached: Option<Buffer<f64>>,
    /// `states`: states at the end of the last rollout. `step`: frames per step.
    states: Vec<f64>,
    step: usize,
    length: u64,
    n: usize,
}

/// Ring buffer of stepped frames: states and goals before each frame, torques during it. Frame k is at index
/// `k % room`.
struct Past {
    /// `most`: number of past frames that later frames depend on. `known`: how many of these are stored.
    most: usize,
    known: usize,
    room: usize,
    states: Buffer<f64>,
    torques: Buffer<f64>,
    goals: Buffer<f64>,
    sizes: [usize; 3],
    count: usize,
}

impl World {
    /// Moves episodes to their solver's device, on the stream of `beside`. `None` if the solver keeps no batch on a
    /// device. `back` is the horizon (steps) of rollouts that are differentiated; `None` if none are.
    pub fn new(episodes: &mut Episodes, beside: &Device, back: Option<usize>) -> Result<Option<Self>, StepError> {
        let kept = episodes.snapshot();
        let most = episodes.remembered();
        let (seed, first) = episodes.draws();
        let task = &episodes.task;
        let climbs = i32::from(episodes.climbs());
        let Simulation { batch, solver } = &mut episodes.simulation;
        let Some(resident) = solver.resident() else { return Ok(None) };
        let n = batch.len();
        let system = &batch.system;
        let text = task.kernels(Reach::of(batch), back.is_some()).map_err(StepError::Refused)?;
        let _foreseen = beside.foresee(&text)?;
        resident.hold(batch)?;
        if let Some((device, _)) = resident.held() {
            device.join(beside)?;
        }
        let steps = back.unwrap_or(0);
        if back.is_some() {
            resident.keep(batch, steps * task.frames() as usize)?;
        }
        let memory = resident.memory();
        let Some((_, held)) = resident.held() else { return Err(StepError::Refused("no environments".into())) };
        let make = || -> DeviceResult<Self> {
            let kernels = if back.is_some() { &KERNELS[..] } else { &KERNELS[..2] };
            let device = Device::open(&text, kernels)?;
            device.join(beside)?;
            let (goals, frames, begun) =
                (device.upload(&kept.goals)?, device.upload(&kept.frames)?, device.upload(&kept.begun)?);
            let failed = device.zeros::<u32>(n)?;
            let counts = device.zeros::<u32>(2)?;
            let [states, torques, records, of] =
                [held.states.ptr, held.torques.ptr, held.records.ptr, held.scene_of.ptr];
            let at =
                [states, goals.ptr, torques, records, of, held.faults.ptr, memory, failed.ptr, frames.ptr, begun.ptr];
            let before = device.upload(&before(&kept, if system.sensed() { LATEST as usize } else { 0 }, n))?;
            let fields = Fields {
                at,
                key: key(&stream(seed, 0)),
                first: first as u64,
                counts: counts.ptr,
                n: n as i32,
                climbs,
                before: before.ptr,
            };
            let frames_back = steps * task.frames() as usize;
            let room = most.max(frames_back);
            let sizes = [kept.states.len(), n * system.robot.joint_count(), kept.goals.len()];
            let [states, torques, asked] = sizes.map(|size| device.zeros(room * size));
            let past =
                Past { most, known: 0, room, states: states?, torques: torques?, goals: asked?, sizes, count: 0 };
            let reached = back.map(|steps| device.zeros(steps * kept.states.len())).transpose()?;
            let fields = device.upload(&[fields])?;
            let step = task.frames() as usize;
            let length = task.episode_length().max(1);
            let states = kept.states.clone();
            Ok(Self {
                fields,
                goals,
                frames,
                begun,
                _failed: failed,
                counts,
                _before: before,
                past,
                reached,
                states,
                step,
                length,
                n,
                device,
            })
        };
        // If the task's kernels do not compile, or memory runs out, print the reason and run the task on the CPU.
        let mut world = make().map_err(|e| StepError::Refused(e.to_string()))?;
        world.past.take(&world.device, &kept)?;
        Ok(Some(world))
    }

    pub fn frames(&self) -> usize {
        self.step
    }

    /// Upper bound on the time-outs of one environment within `steps` steps.
    pub fn cuts(&self, steps: usize) -> usize {
        1 + (steps.saturating_sub(1) as u64 / self.length) as usize
    }

    fn launch(&self, kernel: &str, args: &[Arg]) -> DeviceResult {
        self.device.launch_each(kernel, self.n, BLOCK, &[&args![&self.fields], args].concat())
    }

    /// Launches step t of a rollout under the actions at address `actions`. `judge` holds arguments of the kernel
    /// `task_judge`.
    pub fn step(&self, resident: &dyn Resident, t: usize, actions: u64, judge: &[Arg]) -> DeviceResult {
        for frame in 0..self.step {
            let [states, torques, goals] = self.past.place(t * self.step + frame);
            self.launch("task_act", &args![actions, frame, states, torques, goals])?;
            resident.frame()?;
        }
        let reached = self.reached.as_ref().map_or(0, |reached| reached.at(t * self.states.len()));
        self.launch("task_judge", &[judge, &args![reached]].concat())
    }

    /// Key of a captured rollout: address of the world and ring index of the next frame. `None` if successive rollouts
    /// of `steps` steps begin at different indices of the ring.
    pub fn key(&self, steps: usize) -> Option<(u64, usize)> {
        let Past { room, count, .. } = self.past;
        (room == 0 || (steps * self.step).is_multiple_of(room))
            .then(|| (self.fields.ptr, count.checked_rem(room).unwrap_or(0)))
    }

    pub fn passed(&mut self, steps: usize) {
        let past = &mut self.past;
        past.count += steps * self.step;
        past.known = (past.known + steps * self.step).min(past.most);
    }

    /// Storage that the backward pass reads: stored frames, then addresses of goals before each frame and of states
    /// after each step.
    pub fn trail(&self) -> (Trail, [u64; 2]) {
        let Past { room, states, torques, goals, .. } = &self.past;
        let reached = self.reached.as_ref().map_or(0, |reached| reached.ptr);
        (Trail { states: states.ptr, torques: torques.ptr, frames: *room }, [goals.ptr, reached])
    }

    /// Launches a kernel of the backward pass in `rows` rows of blocks. `steps` is the address of the kernel's `Steps`.
    pub fn back(&self, kernel: &str, rows: usize, steps: u64, args: &[Arg]) -> DeviceResult {
        let args = [&args![&self.fields, steps], args].concat();
        self.device.launch(kernel, (self.n.div_ceil(BLOCK), rows), (BLOCK, 1), 0, &args)
    }

    /// Ends a rollout: downloads the states and returns the number of failed episodes.
    pub fn end(&mut self, resident: &dyn Resident) -> Result<usize, StepError> {
        let mut counts = [0; 2];
        self.device.read(&self.counts, &mut counts)?;
        self.device.write(&self.counts, &[0, 0])?;
        if let Some((device, held)) = resident.held() {
            device.read(&held.states, &mut self.states)?;
        }
        if let Some(env) = counts[1].checked_sub(1) {
            let reason = "a start that cannot be stepped would restart for ever".into();
            return Err(StepError::Environments(vec![Fault { env: env as usize, frame: 0, reason }]));
        }
        Ok(counts[0] as usize)
    }

    /// Snapshot of the episodes at the end of the last rollout.
    pub fn snapshot(&self) -> Result<Snapshot, StepError> {
        let d = &self.device;
        let mut kept = Snapshot {
            states: self.states.clone(),
            frames: vec![0; self.n],
            begun: vec![0; self.n],
            ..Default::default()
        };
        kept.goals.resize(self.goals.len, 0.0);
        d.read(&self.frames, &mut kept.frames)?;
        d.read(&self.begun, &mut kept.begun)?;
        d.read(&self.goals, &mut kept.goals)?;
        self.past.give(d, &mut kept)?;
        Ok(kept)
    }
}

/// States `[env][frame][state]` before the last `frames` frames, newest first; zeros for missing frames.
fn before(kept: &Snapshot, frames: usize, n: usize) -> Vec<f64> {
    let all = kept.states.len();
    let d = kept.states.len() / n.max(1);
    let mut out = vec![0.0; frames * all];
    for (k, states) in kept.past_states.chunks_exact(all.max(1)).rev().take(frames).enumerate() {
        for (env, state) in states.chunks_exact(d).enumerate() {
            out[(env * frames + k) * d..][..d].copy_from_slice(state);
        }
    }
    out
}

impl Past {
    /// Addresses in the ring for state, torques and goal of the frame `later` frames ahead; 0 without a ring.
    fn place(&self, later: usize) -> [u64; 3] {
        let Some(place) = (self.count + later).checked_rem(self.room) else { return [0; 3] };
        let [states, torques, goals] = self.sizes.map(|size| place * size);
        [self.states.at(states), self.torques.at(torques), self.goals.at(goals)]
    }

    fn take(&mut self, device: &Device, kept: &Snapshot) -> DeviceResult {
        self.known = kept.past_states.len().checked_div(self.sizes[0]).unwrap_or(0).min(self.most);
        // Fill the end of the ring, so that the next rollout begins at index 0.
        let first = self.room - self.known;
        self.count = self.room;
        device.write_at(&self.states, first * self.sizes[0], &kept.past_states)?;
        device.write_at(&self.torques, first * self.sizes[1], &kept.past_torques)
    }

    fn give(&self, device: &Device, kept: &mut Snapshot) -> DeviceResult {
        let [states, torques] = [device.download(&self.states)?, device.download(&self.torques)?];
        for frame in self.count - self.known..self.count {
            let part = |of: &[f64], size: usize| of[frame % self.room * size..][..size].to_vec();
            kept.past_states.extend(part(&states, self.sizes[0]));
            kept.past_torques.extend(part(&torques, self.sizes[1]));
        }
        Ok(())
    }
}
