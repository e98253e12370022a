//! [`CudaUnrollLearner`]: updates through many frames on the device.
//!
//! The motions, and the states at the end of an update, stay on the device. Forward, each frame is
//! `look -> network -> advance`: observe the states, predict, step the states. Backward, from the last frame, it is
//! `loss and look -> network -> output -> network back -> frame back`. Activations are recomputed instead of stored.
//! One captured graph holds the whole update. The host draws the starts of rollouts, and reads back which rollouts may
//! continue.

use nerd_cuda::{Arg, Buffer, Device, DeviceResult, Replay, args};
use nerd_model::program::Slot;

use nerd_model::chain::INPUTS;

use super::chain::{Cable, ROLLOUT, View};
use super::*;
use crate::learner::cuda::{Network, Optimiser, Plan, Precision};

const KERNELS: [&str; 10] = [
    "unroll_truths",
    "unroll_begin",
    "unroll_look",
    "unroll_advance",
    "unroll_end",
    "unroll_behind",
    "unroll_said",
    "unroll_back",
    "unroll_add",
    "unroll_total",
];
/// Number of torques in a frame: those on the gripper's axes.
const LED: usize = 6;
/// Recorded states per upload.
const SENT: usize = 1 << 16;

/// Trains a cable's network on motions, as [`super::UnrollLearner`] does.
pub struct CudaUnrollLearner {
    /// Threads of a block; each rollout has a block.
    threads: usize,
    config: LearnerConfig,
    course: Course<Cable>,
    /// Place of each rollout at the end of the last update. A resumed run restarts all rollouts.
    ended: Vec<Option<Place<View>>>,
    step: u64,
    network: Network,
    motions: Recorded,
    rollouts: Buffer<f64>,
    /// States of all rollouts `[H + 1][rollout]`, from before the first frame to after the last.
    states: Buffer<f64>,
    /// `upstream`: gradients with respect to states. `kept`: contact normals and gaps for a frame's backward pass.
    upstream: Buffer<f64>,
    kept: Buffer<f64>,
    by_tokens: Buffer<f32>,
    of_frame: Buffer<f32>,
    losses: Buffer<f64>,
    nears: Buffer<i32>,
    optimiser: Optimiser,
    replay: Replay,
}

impl CudaUnrollLearner {
    /// Continues training from `state`.
    ///
    /// # Errors
    /// If motions are shorter than a rollout, scenes or network have no kernels, or the device fails.
    pub fn new(
        system: &Arc<System>,
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        course: Course<Cable>,
    ) -> LearnResult<Self> {
        config.check()?;
        course.check()?;
        let body = &course.body;
        let train = &course.train;
        let frames = course.frames;
        let rows = config.batch;
        state.weights.config.check()?;
        let plan = Plan::new(state.weights.config.program(), body.tokens())?;
        let mut network = Network::new(plan, rows, precision, true)?;
        let colliders = train.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);
        network.device.add(&(body.program(system, colliders) + include_str!("sums.cuh")), &KERNELS)?;
        let d = &network.device;
        let n = rows;
        let rods = body.chain.rods;
        let width = body.width();
        let optimiser = Optimiser::new(d, config, &state, BETA[1])?;
        Ok(Self {
            ended: vec![None; n],
            step: state.step,
            motions: Recorded::on(d, system, body, train, colliders)?,
            rollouts: d.zeros(n * ROLLOUT)?,
            states: d.zeros((frames + 1) * n * width)?,
            upstream: d.zeros(n * width)?,
            kept: d.zeros(n * 4 * rods)?,
            by_tokens: d.zeros(n * rods * INPUTS)?,
            of_frame: d.zeros(optimiser.weights.len)?,
            losses: d.zeros(n)?,
            nears: d.zeros(n)?,
            replay: Replay::default(),
            threads: rods.next_multiple_of(32).min(128),
            config,
            course,
            network,
            optimiser,
        })
    }

    /// Draws the starts of this update's rollouts; returns their rows for the device.
    fn drawn(&mut self) -> LearnResult<Vec<f64>> {
        let frames = self.course.frames;
        let through = self.course.train.frames;
        let draws = self.course.draws(self.config.seed, self.step, self.config.batch);
        // Rollouts of one frame always start from the truth.
        let nears = if frames > 1 { self.network.device.download(&self.nears)? } else { vec![0; self.ended.len()] };
        let mut rows = Vec::with_capacity(self.ended.len() * ROLLOUT);
        for (ended, draw, near) in izip!(&mut self.ended, draws, nears) {
            let kept = ended.filter(|place| near != 0 && !draw.anew && place.frame + frames <= through);
            let place = kept.unwrap_or(draw.place);
            rows.extend(Cable::row(&place, kept.is_none()));
            *ended = Some(Place { frame: place.frame + frames, ..place });
        }
        Ok(rows)
    }

    /// Launches a kernel over all rollouts; its first arguments are rollouts and motions.
    fn along(&self, kernel: &str, args: &[Arg]) -> DeviceResult {
        let Recorded { frames, states, torques, scenes } = &self.motions;
        self.each(kernel, &[&args![&self.rollouts, states, torques, scenes, *frames], args].concat())
    }

    fn each(&self, kernel: &str, args: &[Arg]) -> DeviceResult {
        self.network.device.launch_blocks(kernel, self.network.rows, self.threads, args)
    }

    /// Computes gradient and loss of an update; the loss is stored after the gradient.
    fn pass(&self) -> DeviceResult {
        let net = &self.network;
        let d = &self.network.device;
        let n = self.network.rows;
        let frames = self.course.frames;
        let w = self.optimiser.weights.ptr;
        let all = &self.optimiser.gradients;
        let weight = 1.0 / (self.config.batch * frames) as f64;
        let Self { states, upstream, kept, losses, nears, of_frame, by_tokens, .. } = self;
        let tokens = net.at(Slot(0));
        let outputs = net.predictions();
        let p = of_frame.len;
        self.along("unroll_begin", &args![states, frames])?;
        net.fold(w)?;
        for k in 0..frames {
            self.along("unroll_look", &args![states, k, tokens])?;
            net.predict(w, n)?;
            self.along("unroll_advance", &args![states, k, outputs])?;
        }
        self.along("unroll_end", &args![states, frames, nears])?;
        for k in (0..frames).rev() {
            let later = frames - 1 - k;
            self.along("unroll_behind", &args![states, k, later, weight, upstream, losses, tokens, kept])?;
            net.forward(w, n)?;
            self.each("unroll_said", &args![states, k, outputs, upstream, &net.targets])?;
            net.backward(w, Some(of_frame.ptr), 0..n, Some(by_tokens.ptr))?;
            self.along("unroll_back", &args![states, k, outputs, kept, by_tokens, upstream])?;
            d.launch_each("unroll_add", p, 256, &args![of_frame, all, p, usize::from(later == 0)])?;
        }
        d.launch_blocks("unroll_total", 1, 256, &args![losses, n, all.at(p)])
    }
}

struct Recorded {
    frames: usize,
    states: Buffer<f64>,
    /// Torques on the gripper's axes (N, N m).
    torques: Buffer<f64>,
    scenes: Buffer<f64>,
}

impl Recorded {
    fn on(d: &Device, system: &System, body: &Cable, motions: &Trajectories, colliders: usize) -> LearnResult<Self> {
        let count = motions.count * (motions.frames + 1);
        let truths = d.zeros(count * body.width())?;
        let states = &motions.states;
        let width = states.len() / count.max(1);
        for (i, part) in states.chunks(SENT * width).enumerate() {
            let sent = d.upload(part)?;
            let rows = part.len() / width;
            d.launch_each("unroll_truths", rows, 64, &args![&sent, truths.at(i * SENT * body.width()), rows])?;
            d.wait()?;
        }
        let torques = |i: usize| (0..motions.frames).flat_map(move |k| motions.torques(i, k)[..LED].iter().copied());
        let torques = (0..motions.count).flat_map(torques).chain([0.0]).collect_vec();
        let mut scenes = Vec::new();
        for scene in &motions.scenes {
            scenes.extend(body.record(system, scene, colliders)?);
        }
        Ok(Self { frames: motions.frames, states: truths, torques: d.upload(&torques)?, scenes: d.upload(&scenes)? })
    }
}

impl Learner for CudaUnrollLearner {
    fn update(&mut self, lr: f32) -> LearnResult {
        let rows = self.drawn()?;
        let d = &self.network.device;
        d.write(&self.rollouts, &rows)?;
        self.optimiser.set_lr(d, lr)?;
        self.step += 1;
        self.replay.run(d, "update", (), || {
            self.pass()?;
            self.optimiser.update(d, 1.0)
        })
    }

    fn progress(&mut self) -> LearnResult<Progress> {
        self.optimiser.progress(&self.network.device)
    }

    /// Validates as [`super::UnrollLearner`] does, on the CPU.
    fn validate(&mut self, frames: usize) -> LearnResult<f32> {
        let state = self.state()?;
        let network = Loaded::new(state.weights.config.program(), &state.average);
        Ok(self.course.body.missed(&self.course.validation, &network, frames) as f32)
    }

    fn state(&mut self) -> LearnResult<LearnerState> {
        self.optimiser.state(&self.network.device)
    }
}
