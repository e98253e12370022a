//! [`CudaUnrollLearner`]: updates through many frames, on the device.
//!
//! Where an update ends stays there, and so do the motions. Forward `look -> network -> advance`, frame by frame; back, from the last
//! frame on, `loss and look -> network -> output -> network back -> frame back`: activations are made once more in place of being kept.
//! All of it is one captured graph. The host draws where rollouts begin, and reads back which are near enough to be carried on.

use nerd_cuda::Arg::{Double, Int, Long, Ptr};
use nerd_cuda::{Arg, Buffer, Device, DeviceError, Replay};
use nerd_model::program::Slot;

use super::*;
use crate::learner::cuda::{Network, Optimiser, Plan, Precision};

const KERNELS: [&str; 9] = [
    "unroll_truths",
    "unroll_begin",
    "unroll_look",
    "unroll_advance",
    "unroll_behind",
    "unroll_said",
    "unroll_back",
    "unroll_add",
    "unroll_total",
];
/// Recorded states that are sent at a time.
const SENT: usize = 1 << 16;

/// Trains a network on motions, as [`super::UnrollLearner`] does.
pub struct CudaUnrollLearner<B: OnCard> {
    widths: Widths,
    config: LearnerConfig,
    course: Course<B>,
    /// Where the last update ended; a resumed run restarts all of them.
    ended: Vec<Option<Place<B::View>>>,
    step: u64,
    network: Network,
    motions: Recorded,
    rollouts: Buffer<f64>,
    /// `[frame][rollout]`.
    states: Buffer<f64>,
    /// Gradients by them, and what a frame keeps for its way back.
    upstream: Buffer<f64>,
    kept: Buffer<f64>,
    by_tokens: Buffer<f32>,
    of_frame: Buffer<f32>,
    losses: Buffer<f64>,
    nears: Buffer<i32>,
    optimiser: Optimiser,
    replay: Replay,
}

impl<B: OnCard> CudaUnrollLearner<B> {
    /// Continues `state`.
    ///
    /// # Errors
    /// If no motion is as long as a rollout, a scene or the network has no kernels, or the device fails.
    pub fn new(
        system: &Arc<System>,
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        course: Course<B>,
    ) -> Result<Self, LearnError> {
        config.check().map_err(LearnError::Mismatch)?;
        course.check()?;
        let (body, train, frames, rows) = (&course.body, &course.train, course.frames, config.batch);
        state.weights.config.check().map_err(LearnError::Mismatch)?;
        let plan = Plan::new(state.weights.config.program(), body.tokens())?;
        let mut network = Network::new(plan, rows, precision, true)?;
        let colliders = train.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);
        let text = body.program(system, rows, colliders);
        let last = B::CARRIED.then_some("unroll_end");
        network.device.add(&(text + include_str!("sums.cuh")), &KERNELS.into_iter().chain(last).collect::<Vec<_>>())?;
        let (d, n, widths) = (&network.device, rows, body.widths());
        let optimiser = Optimiser::new(d, config, &state, BETA[1])?;
        Ok(Self {
            ended: vec![None; n],
            step: state.step,
            motions: Recorded::on(d, system, body, train, colliders)?,
            rollouts: d.zeros(n * ROLLOUT)?,
            states: d.zeros((frames + 1) * n * widths.state)?,
            upstream: d.zeros(n * widths.state)?,
            kept: d.zeros((n * widths.kept).max(1))?,
            by_tokens: d.zeros(n * widths.inputs)?,
            of_frame: d.zeros(optimiser.weights.len)?,
            losses: d.zeros(n)?,
            nears: d.zeros(n)?,
            replay: Replay::default(),
            widths,
            config,
            course,
            network,
            optimiser,
        })
    }

    /// Where this update's rollouts begin: the host's numbers of each.
    fn drawn(&mut self) -> Result<Vec<f64>, LearnError> {
        let (frames, through) = (self.course.frames, self.course.train.frames);
        let draws = self.course.draws(self.config.seed, self.step, self.config.batch);
        // Single frames are learned from the truth alone.
        let nears = if B::CARRIED && frames > 1 { self.network.device.download(&self.nears)? } else { vec![0; self.ended.len()] };
        let mut rows = Vec::with_capacity(self.ended.len() * ROLLOUT);
        for ((ended, draw), near) in self.ended.iter_mut().zip(draws).zip(nears) {
            let kept = ended.filter(|place| near != 0 && !draw.anew && place.frame + frames <= through);
            let place = kept.unwrap_or(draw.place);
            rows.extend(B::row(&place, kept.is_none()));
            *ended = Some(Place { frame: place.frame + frames, ..place });
        }
        Ok(rows)
    }

    /// A kernel over all rollouts; its first arguments are these and the motions.
    fn along(&self, kernel: &str, args: &[Arg]) -> Result<(), DeviceError> {
        let Recorded { frames, states, torques, scenes } = &self.motions;
        let world = [self.rollouts.ptr, states.ptr, torques.ptr, scenes.ptr].map(Ptr);
        self.each(kernel, &[&world[..], &[Int(*frames)], args].concat())
    }

    fn each(&self, kernel: &str, args: &[Arg]) -> Result<(), DeviceError> {
        self.network.device.launch(kernel, (self.network.rows, 1), (self.widths.threads, 1), 0, args)
    }

    /// The gradient of an update, followed by the loss.
    fn pass(&self) -> Result<(), DeviceError> {
        let (net, d, n, frames) = (&self.network, &self.network.device, self.network.rows, self.course.frames);
        let (w, all) = (self.optimiser.weights.ptr, &self.optimiser.gradients);
        let weight = 1.0 / (self.config.batch * frames) as f64;
        let [states, tokens, outputs, upstream, kept] =
            [self.states.ptr, net.at(Slot(0)), net.predictions().ptr, self.upstream.ptr, self.kept.ptr].map(Ptr);
        self.along("unroll_begin", &[states, Int(frames)])?;
        net.fold(w)?;
        for k in 0..frames {
            self.along("unroll_look", &[states, Int(k), tokens])?;
            net.predict(w, n)?;
            self.along("unroll_advance", &[states, Int(k), outputs])?;
        }
        if B::CARRIED {
            self.along("unroll_end", &[states, Int(frames), Ptr(self.nears.ptr)])?;
        }
        for k in (0..frames).rev() {
            let later = frames - 1 - k;
            let rest = [Double(weight), upstream, Ptr(self.losses.ptr), tokens, kept];
            self.along("unroll_behind", &[&[states, Int(k), Int(later)][..], &rest].concat())?;
            net.forward(w, n)?;
            self.each("unroll_said", &[states, Int(k), outputs, upstream, Ptr(net.targets.ptr)])?;
            net.backward(w, Some(self.of_frame.ptr), 0..n, Some(self.by_tokens.ptr))?;
            self.along("unroll_back", &[states, Int(k), outputs, kept, Ptr(self.by_tokens.ptr), upstream])?;
            let p = self.of_frame.len;
            let args = [Ptr(self.of_frame.ptr), Ptr(all.ptr), Int(p), Int(usize::from(later == 0))];
            d.launch("unroll_add", (p.div_ceil(256), 1), (256, 1), 0, &args)?;
        }
        d.launch("unroll_total", (1, 1), (256, 1), 0, &[Ptr(self.losses.ptr), Int(n), Ptr(all.at(self.of_frame.len))])
    }
}

/// Motions in the device's memory.
struct Recorded {
    frames: usize,
    states: Buffer<f64>,
    /// Those that are seen.
    torques: Buffer<f64>,
    scenes: Buffer<f64>,
}

impl Recorded {
    fn on<B: OnCard>(d: &Device, system: &System, body: &B, motions: &Motions, colliders: usize) -> Result<Self, LearnError> {
        let (count, widths) = (motions.len() * (motions.frames + 1), body.widths());
        let truths = d.zeros(count * widths.state)?;
        let states = motions.states();
        let width = states.len() / count.max(1);
        for (i, part) in states.chunks(SENT * width).enumerate() {
            let (sent, rows) = (d.upload(part)?, part.len() / width);
            let args = [Ptr(sent.ptr), Ptr(truths.at(i * SENT * widths.state)), Long(rows as u64)];
            d.launch("unroll_truths", (rows.div_ceil(64), 1), (64, 1), 0, &args)?;
            d.wait()?;
        }
        let torques = |i: usize| (0..motions.frames).flat_map(move |k| motions.torques(i, k)[..widths.torques].iter().copied());
        let torques: Vec<f64> = (0..motions.len()).flat_map(torques).chain([0.0]).collect();
        let mut scenes = Vec::new();
        for scene in &motions.scenes {
            scenes.extend(body.record(system, scene, colliders).map_err(LearnError::Mismatch)?);
        }
        Ok(Self { frames: motions.frames, states: truths, torques: d.upload(&torques)?, scenes: d.upload(&scenes)? })
    }
}

impl<B: OnCard> Learner for CudaUnrollLearner<B> {
    fn update(&mut self, lr: f32) -> Result<(), LearnError> {
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

    fn progress(&mut self) -> Result<Progress, LearnError> {
        self.optimiser.progress(&self.network.device)
    }

    /// As [`super::UnrollLearner`]'s, on the CPU.
    fn validate(&mut self, frames: usize) -> Result<f32, LearnError> {
        let state = self.state()?;
        let network = Loaded::new(state.weights.config.program(), &state.average);
        Ok(self.course.body.missed(&self.course.validation, &network, frames) as f32)
    }

    fn state(&mut self) -> Result<LearnerState, LearnError> {
        self.optimiser.state(&self.network.device)
    }
}
