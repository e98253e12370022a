//! [`CudaLearner`]: one update is one replay of a captured graph.
//!
//! `gather -> fold -> forward -> loss -> backward -> norm -> finish -> Adam (and Muon)`. A rank of several gathers its rows of the
//! batch, and behind the backward pass the gradients of all are added up. What changes between updates (count,
//! learning rate, bias corrections, decay of the average) lives in `Scalars` on the device, so nothing is asked
//! of it while a run goes on.

use nerd_model::transformer::Weights;

use std::ops::Range;

use super::Precision;
use super::layout::Layout;
use super::muon::Muon;
use super::network::Network;
use super::step::{Choice, Data, NORM_BLOCKS, Scalars, Step, gather};
use crate::learner::muon::hidden;
use crate::learner::{LearnError, Learner, LearnerConfig, LearnerState, Optimizer, Progress, validation_rows};
use crate::ranks::Ranks;
use crate::windows::Windows;
use nerd_cuda::Arg::Ptr;
use nerd_cuda::{Buffer, Device, Graph, Sums};

/// The fused CUDA engine of the [`Learner`] trait.
pub struct CudaLearner {
    graph: Graph,
    network: Network,
    config: LearnerConfig,
    /// Of the batch.
    rows: Range<usize>,
    /// Over ranks.
    sums: Option<Sums>,
    lr: f32,
    train: Data,
    validation: Data,
    weights: Buffer<f32>,
    average: Buffer<f32>,
    m: Buffer<f32>,
    v: Buffer<f32>,
    /// Gradients, and behind them the squared error.
    gradients: Buffer<f32>,
    norms: Buffer<f32>,
    head_sums: Buffer<f32>,
    total: Buffer<f64>,
    scalars: Buffer<Scalars>,
    muon: Option<Muon>,
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
    ///
    /// # Errors
    /// As [`CudaLearner::new`]; if NCCL is missing or fails, or another rank is gone.
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
        let ordinal = match (Device::count()?, ranks.local()) {
            // A launcher may show each process its own card alone.
            (1, _) => 0,
            (count, local) if local < count => local,
            (count, local) => {
                return Err(LearnError::Device(format!("LOCAL_RANK is {local}, and {count} GPUs are seen: start fewer ranks")));
            }
        };
        let join = |device: &Device| -> Result<Option<Sums>, LearnError> {
            let id = if ranks.leads() { Sums::id()? } else { Vec::new() };
            Ok(Some(Sums::join(device, &ranks.share(0, || id)?, ranks.rank(), ranks.world())?))
        };
        Self::part((ordinal, ranks.part(config.batch)), config, precision, state, (train, validation), join)
    }

    /// On GPU 0, for these rows of the batch alone, with nothing added to their gradient: those of parts make up the whole's. For checks.
    ///
    /// # Errors
    /// As [`CudaLearner::new`].
    pub fn of_rows(
        rows: Range<usize>,
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        train: &Windows,
        validation: &Windows,
    ) -> Result<Self, LearnError> {
        Self::part((0, rows), config, precision, state, (train, validation), |_| Ok(None))
    }

    fn part(
        (ordinal, rows): (usize, Range<usize>),
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        (train, validation): (&Windows, &Windows),
        join: impl FnOnce(&Device) -> Result<Option<Sums>, LearnError>,
    ) -> Result<Self, LearnError> {
        let shape = state.weights.config;
        let layout = Layout::new(shape)?;
        let p = layout.parameters;
        crate::learner::check(&config, &state, [("training", train), ("validation", validation)])?;
        let columns = layout.head_columns();
        let network = Network::new(ordinal, layout, rows.len(), precision, true)?;
        let d = &network.device;
        let sums = join(d)?;
        let data = |w: &Windows| -> Result<Data, LearnError> {
            Ok(Data { x: d.upload(&w.x)?, y: d.upload(&w.y)?, windows: w.len(), per: w.per_trajectory(), frames: w.frames })
        };
        let scalars = Scalars { step: state.step, bad_step: u64::MAX, ..Scalars::default() };
        let (train, validation) = (data(train)?, data(validation)?);
        let (weights, average) = (d.upload(&state.weights.flat)?, d.upload(&state.average)?);
        let (m, v) = (d.upload(&state.m)?, d.upload(&state.v)?);
        let (gradients, norms) = (d.zeros(p + 1)?, d.zeros(NORM_BLOCKS)?);
        let (head_sums, total, scalars) = (d.zeros(columns)?, d.zeros(1)?, d.upload(&[scalars])?);
        let muon = match config.optimizer {
            Optimizer::Adam => None,
            Optimizer::Muon => Some(Muon::new(d, &hidden(&shape))?),
        };
        let step = Step {
            network: &network,
            config,
            rows: rows.clone(),
            sums: sums.as_ref(),
            train: &train,
            weights: &weights,
            average: &average,
            m: &m,
            v: &v,
            gradients: &gradients,
            norms: &norms,
            scalars: &scalars,
            muon: muon.as_ref(),
        };
        let graph = step.capture()?;
        Ok(Self {
            muon,
            graph,
            network,
            config,
            rows,
            sums,
            lr: 0.0,
            train,
            validation,
            weights,
            average,
            m,
            v,
            gradients,
            norms,
            head_sums,
            total,
            scalars,
        })
    }

    /// Goes on with another arithmetic of the matrix products.
    ///
    /// # Errors
    /// [`LearnError::Device`] if the update cannot be captured again.
    pub fn set_precision(&mut self, precision: Precision) -> Result<(), LearnError> {
        if precision != self.network.device.precision {
            self.network.device.wait()?;
            self.network.device.precision = precision;
            self.graph = self.step().capture()?;
        }
        Ok(())
    }

    /// What this rank's rows add to the gradient of the next update before clipping (in the order of the flat weights) and to its loss,
    /// without making the update. For checks.
    ///
    /// # Errors
    /// [`LearnError::Device`] if the device fails.
    pub fn gradient(&mut self) -> Result<(f32, Vec<f32>), LearnError> {
        self.step().gradient()?;
        let mut g = vec![0.0; self.gradients.len];
        self.network.device.read(&self.gradients, &mut g)?;
        let squares = g.pop().unwrap_or(f32::NAN);
        Ok((squares * self.step().mean(), g))
    }

    /// Puts other weights in the place of the present ones. For checks.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if there are more or fewer of them, [`LearnError::Device`] if the device fails.
    pub fn set_weights(&mut self, flat: &[f32]) -> Result<(), LearnError> {
        if flat.len() != self.weights.len {
            return Err(LearnError::Mismatch(format!("{} weights for a network of {}", flat.len(), self.weights.len)));
        }
        Ok(self.network.device.write(&self.weights, flat)?)
    }

    /// Makes the next update kernel by kernel, without the graph. For profilers.
    ///
    /// # Errors
    /// [`LearnError::Device`] if the device fails.
    pub fn update_eagerly(&mut self, lr: f32) -> Result<(), LearnError> {
        self.set_lr(lr)?;
        self.step().all()
    }

    fn step(&self) -> Step<'_> {
        Step {
            network: &self.network,
            config: self.config,
            rows: self.rows.clone(),
            sums: self.sums.as_ref(),
            train: &self.train,
            weights: &self.weights,
            average: &self.average,
            m: &self.m,
            v: &self.v,
            gradients: &self.gradients,
            norms: &self.norms,
            scalars: &self.scalars,
            muon: self.muon.as_ref(),
        }
    }

    fn set_lr(&mut self, lr: f32) -> Result<(), LearnError> {
        if lr.to_bits() != self.lr.to_bits() {
            self.network.device.set_word(self.scalars.ptr + std::mem::offset_of!(Scalars, lr) as u64, lr.to_bits())?;
            self.lr = lr;
        }
        Ok(())
    }

    fn scalars(&self) -> Result<Scalars, LearnError> {
        let mut s = [Scalars::default()];
        self.network.device.read(&self.scalars, &mut s)?;
        Ok(s[0])
    }
}

impl Learner for CudaLearner {
    fn update(&mut self, lr: f32) -> Result<(), LearnError> {
        self.set_lr(lr)?;
        Ok(self.graph.launch("update")?)
    }

    fn replace(&mut self, first: usize, fresh: &Windows) -> Result<(), LearnError> {
        let (data, c) = (&self.train, self.network.layout.config);
        let trajectories = data.windows / data.per;
        fresh.fits(first, [c.inputs, c.outputs, data.frames, c.sequence()], trajectories).map_err(LearnError::Mismatch)?;
        self.network.device.write_at(&data.x, first * data.frames * c.inputs, &fresh.x)?;
        Ok(self.network.device.write_at(&data.y, first * data.frames * c.outputs, &fresh.y)?)
    }

    fn progress(&mut self) -> Result<Progress, LearnError> {
        let s = self.scalars()?;
        if s.bad_step != u64::MAX {
            return Err(LearnError::NotFinite { step: s.bad_step, loss: s.bad_loss });
        }
        self.network.device.write(&self.scalars, &[Scalars { count: 0, loss_sum: 0.0, norm_sum: 0.0, ..s }])?;
        let count = s.count.max(1) as f64;
        Ok(Progress { loss: (s.loss_sum / count) as f32, gradient_norm: (s.norm_sum / count) as f32 })
    }

    fn validate(&mut self, windows: usize) -> Result<f32, LearnError> {
        let (net, w) = (&self.network, self.average.ptr);
        let c = net.layout.config;
        let chosen = validation_rows(self.validation.windows, windows);
        let (count, numbers) = (chosen.len(), net.device.upload(&chosen)?);
        let error = self.head_sums.at(net.layout.head_columns() - 1);
        net.device.write(&self.total, &[0.0])?;
        net.fold(w)?;
        for first in (0..count).step_by(net.rows) {
            let rows = net.rows.min(count - first);
            gather(net, &self.validation, rows, Choice::These(numbers.at(first)))?;
            net.windows(w, rows)?;
            net.top(w, net.x.ptr, rows * net.layout.tokens)?;
            net.loss(w, rows * net.layout.tokens, rows * net.layout.tokens, None, self.head_sums.ptr)?;
            net.device.launch("add_loss", (1, 1), (1, 1), 0, &[Ptr(error), Ptr(self.total.ptr)])?;
        }
        let mut total = [0.0];
        net.device.read(&self.total, &mut total)?;
        Ok((total[0] / (count * net.layout.tokens * c.outputs) as f64) as f32)
    }

    fn state(&mut self) -> Result<LearnerState, LearnError> {
        let d = &self.network.device;
        let read = |b: &Buffer<f32>| -> Result<Vec<f32>, LearnError> {
            let mut x = vec![0.0; b.len];
            d.read(b, &mut x)?;
            Ok(x)
        };
        let weights = Weights { config: self.network.layout.config, flat: read(&self.weights)? };
        Ok(LearnerState { step: self.scalars()?.step, weights, average: read(&self.average)?, m: read(&self.m)?, v: read(&self.v)? })
    }
}
