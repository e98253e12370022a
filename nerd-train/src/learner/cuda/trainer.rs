//! [`CudaLearner`]: one update is one replay of a captured graph.
//!
//! `gather -> fold -> forward -> loss -> backward -> norm -> finish -> Adam (and Muon)`. A rank of several gathers its rows of the
//! batch, and after the backward pass all gradients are summed.

use std::ops::Range;

use nerd_model::transformer::TransformerConfig;

use super::Precision;
use super::network::Network;
use super::optimiser::Optimiser;
use super::plan::Plan;
use super::step::{Choice, Data, Step, gather};
use crate::learner::{LearnError, Learner, LearnerConfig, LearnerState, Progress, validation_rows};
use crate::ranks::Ranks;
use crate::windows::Windows;
use nerd_cuda::Arg::Ptr;
use nerd_cuda::{Buffer, Device, Replay, Sums};

/// Adam's second beta.
const BETA: f64 = 0.999;

/// The CUDA engine of the [`Learner`] trait.
pub struct CudaLearner {
    replay: Replay,
    step: Step,
    shape: TransformerConfig,
    validation: Data,
    total: Buffer<f64>,
}

impl CudaLearner {
    /// Takes up `state` on GPU 0 with all windows in device memory.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if windows, state and network do not fit together, [`LearnError::Device`] if there
    /// is no GPU, a library is missing or memory runs out.
    pub fn new(
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        train: &Windows,
        validation: &Windows,
    ) -> Result<Self, LearnError> {
        Self::of_rows(0..config.batch, config, precision, state, train, validation)
    }

    /// The same as one of several ranks, on the GPU of its number on this machine. Gradients are added up by NCCL.
    pub fn among(
        ranks: &Ranks,
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        train: &Windows,
        validation: &Windows,
    ) -> Result<Self, LearnError> {
        if ranks.world() == 1 {
            return Self::new(config, precision, state, train, validation);
        }
        let ordinal = nerd_cuda::take(ranks.local())?;
        let join = |device: &Device| joined(ranks, device);
        Self::part(ordinal, ranks.part(config.batch), config, precision, state, [train, validation], join)
    }

    /// On GPU 0, for these rows of the batch alone, with nothing added to their gradient: those of parts make up the whole's. For checks.
    pub fn of_rows(
        rows: Range<usize>,
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        train: &Windows,
        validation: &Windows,
    ) -> Result<Self, LearnError> {
        Self::part(0, rows, config, precision, state, [train, validation], |_| Ok(None))
    }

    fn part(
        ordinal: usize,
        rows: Range<usize>,
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        [train, validation]: [&Windows; 2],
        join: impl FnOnce(&Device) -> Result<Option<Sums>, LearnError>,
    ) -> Result<Self, LearnError> {
        let shape = state.weights.config;
        crate::learner::check(&config, &state, [("training", train), ("validation", validation)])?;
        let network = Network::new(ordinal, Plan::of(&shape, shape.sequence())?, rows.len(), precision, true)?;
        let d = &network.device;
        let sums = join(d)?;
        let data = |w: &Windows| -> Result<Data, LearnError> {
            Ok(Data { x: d.upload(&w.x)?, y: d.upload(&w.y)?, windows: w.len(), per: w.per_trajectory(), frames: w.frames })
        };
        let (total, validation) = (d.zeros(1)?, data(validation)?);
        let optimiser = Optimiser::new(d, config, &state, BETA, sums)?;
        let step = Step { config, rows, train: data(train)?, optimiser, network };
        Ok(Self { replay: Replay::default(), step, shape, validation, total })
    }

    /// What this rank's rows add to the gradient of the next update before clipping (in the order of the flat weights) and to its loss,
    /// without making the update. For checks.
    pub fn gradient(&mut self) -> Result<(f32, Vec<f32>), LearnError> {
        self.step.gradient()?;
        let gradients = &self.step.optimiser.gradients;
        let mut g = vec![0.0; gradients.len];
        self.device().read(gradients, &mut g)?;
        let squares = g.pop().unwrap_or(f32::NAN);
        Ok((squares * self.step.mean(), g))
    }

    /// Puts other weights in the place of the present ones. For checks.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if there are more or fewer of them, [`LearnError::Device`] if the device fails.
    pub fn set_weights(&mut self, flat: &[f32]) -> Result<(), LearnError> {
        let weights = &self.step.optimiser.weights;
        if flat.len() != weights.len {
            return Err(LearnError::Mismatch(format!("{} weights for a network of {}", flat.len(), weights.len)));
        }
        Ok(self.device().write(weights, flat)?)
    }

    fn device(&self) -> &Device {
        &self.step.network.device
    }
}

impl Learner for CudaLearner {
    fn update(&mut self, lr: f32) -> Result<(), LearnError> {
        self.step.optimiser.set_lr(&self.step.network.device, lr)?;
        self.replay.run(self.device(), "update", (), || self.step.all())
    }

    fn replace(&mut self, first: usize, fresh: &Windows) -> Result<(), LearnError> {
        let (data, c) = (&self.step.train, self.shape);
        let trajectories = data.windows / data.per;
        fresh.fits(first, [c.inputs, c.outputs, data.frames, c.sequence()], trajectories).map_err(LearnError::Mismatch)?;
        self.device().write_at(&data.x, first * data.frames * c.inputs, &fresh.x)?;
        Ok(self.device().write_at(&data.y, first * data.frames * c.outputs, &fresh.y)?)
    }

    fn progress(&mut self) -> Result<Progress, LearnError> {
        self.step.optimiser.progress(self.device())
    }

    fn validate(&mut self, windows: usize) -> Result<f32, LearnError> {
        let Step { network: net, optimiser: Optimiser { average, gradients, .. }, .. } = &self.step;
        let (w, outputs, tokens) = (average.ptr, net.plan.outputs(), net.plan.tokens);
        let chosen = validation_rows(self.validation.windows, windows);
        let (count, numbers) = (chosen.len(), net.device.upload(&chosen)?);
        net.device.write(&self.total, &[0.0])?;
        net.fold(w)?;
        for first in (0..count).step_by(net.rows) {
            let rows = net.rows.min(count - first);
            gather(net, &self.validation, rows, Choice::These(numbers.at(first)))?;
            net.windows(w, rows)?;
            // Every update overwrites the gradients.
            net.loss(w, rows * tokens, rows * tokens, None, gradients.ptr)?;
            let error = gradients.at(net.plan.parameters());
            net.device.launch("add_loss", (1, 1), (1, 1), 0, &[Ptr(error), Ptr(self.total.ptr)])?;
        }
        let mut total = [0.0];
        net.device.read(&self.total, &mut total)?;
        Ok((total[0] / (count * tokens * outputs) as f64) as f32)
    }

    fn state(&mut self) -> Result<LearnerState, LearnError> {
        self.step.optimiser.state(self.device())
    }
}

/// Makes this rank's sums over all of them; none where it is alone.
pub(crate) fn joined(ranks: &Ranks, device: &Device) -> Result<Option<Sums>, LearnError> {
    if ranks.world() == 1 {
        return Ok(None);
    }
    let id = if ranks.leads() { Sums::id()? } else { Vec::new() };
    Ok(Some(Sums::join(device, &ranks.share(0, || id)?, ranks.rank(), ranks.world())?))
}
