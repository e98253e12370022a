//! [`CudaLearner`]: one update is one replay of a captured graph.
//!
//! `gather -> fold -> forward -> loss -> backward -> norm -> finish -> Adam (and Muon)`. What changes between updates (count,
//! learning rate, bias corrections, decay of the average) lives in [`Scalars`] on the device, so nothing is asked
//! of it while a run goes on.

use nerd_model::transformer::Weights;

use super::Precision;
use super::layout::Layout;
use super::muon::{Muon, Vectors};
use super::network::Network;
use crate::learner::muon::hidden;
use crate::learner::{LearnError, Learner, LearnerConfig, LearnerState, Optimizer, Progress, validation_rows};
use crate::windows::Windows;
use nerd_cuda::Arg::{Double, Float, Int, Long, Ptr};
use nerd_cuda::Buffer;
use nerd_cuda::Graph;

/// Blocks of the gradient norm's first stage.
const NORM_BLOCKS: usize = 528;

/// Mirror of the struct in `kernels.cu`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
struct Scalars {
    step: u64,
    bad_step: u64,
    count: u64,
    loss_sum: f64,
    norm_sum: f64,
    lr: f32,
    bad_loss: f32,
    scale: f32,
    rate: f32,
    root: f32,
    blend: f32,
}

/// Windows on the device.
struct Data {
    x: Buffer<f32>,
    y: Buffer<f32>,
    windows: usize,
    per: usize,
    frames: usize,
}

/// The fused CUDA engine of the [`Learner`] trait.
pub struct CudaLearner {
    graph: Graph,
    network: Network,
    config: LearnerConfig,
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
        let shape = state.weights.config;
        let layout = Layout::new(shape)?;
        let p = layout.parameters;
        crate::learner::check(&config, &state, [("training", train), ("validation", validation)])?;
        let columns = layout.head_columns();
        let network = Network::new(layout, config.batch, precision, true)?;
        let d = &network.device;
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

    /// Gradient of the next update before clipping (in the order of the flat weights) and its loss, without making
    /// the update. For checks.
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
            net.loss(w, rows * net.layout.tokens, None, self.head_sums.ptr)?;
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

/// What one update reads and writes.
struct Step<'a> {
    network: &'a Network,
    config: LearnerConfig,
    train: &'a Data,
    weights: &'a Buffer<f32>,
    average: &'a Buffer<f32>,
    m: &'a Buffer<f32>,
    v: &'a Buffer<f32>,
    gradients: &'a Buffer<f32>,
    norms: &'a Buffer<f32>,
    scalars: &'a Buffer<Scalars>,
    muon: Option<&'a Muon>,
}

impl Step<'_> {
    /// From the sum of squared errors to the loss.
    fn mean(&self) -> f32 {
        let c = self.network.layout.config;
        1.0 / (self.config.batch * self.network.layout.tokens * c.outputs) as f32
    }

    fn gradient(&self) -> Result<(), LearnError> {
        let (net, w) = (self.network, self.weights.ptr);
        gather(net, self.train, self.config.batch, Choice::Drawn { scalars: self.scalars.ptr, seed: self.config.seed })?;
        net.fold(w)?;
        net.windows(w, self.config.batch)?;
        net.top(w, net.x.ptr, self.config.batch * net.layout.tokens)?;
        Ok(net.backward(w, self.config.huber, self.gradients.ptr)?)
    }

    fn all(&self) -> Result<(), LearnError> {
        self.gradient()?;
        let (d, p, s) = (&self.network.device, self.network.layout.parameters, Ptr(self.scalars.ptr));
        let [w, g, m, v, a] = [self.weights, self.gradients, self.m, self.v, self.average].map(|b| Ptr(b.ptr));
        d.launch("square_partial", (NORM_BLOCKS, 1), (256, 1), 0, &[g, Long(p as u64), Ptr(self.norms.ptr)])?;
        let args = [
            Ptr(self.norms.ptr),
            Int(NORM_BLOCKS),
            Ptr(self.gradients.at(p)),
            Float(self.mean()),
            Float(self.config.clip),
            Double(self.config.average),
            s,
        ];
        d.launch("finish", (1, 1), (256, 1), 0, &args)?;
        let blocks = if self.muon.is_some() { self.network.layout.config.layers } else { 0 };
        let first = self.network.layout.first_block() as u64;
        d.launch("adam", (p.div_ceil(256), 1), (256, 1), 0, &[w, g, m, v, a, s, Long(p as u64), Long(first), Int(blocks)])?;
        let address = |b: &Buffer<f32>| b.ptr;
        let vectors = Vectors {
            weights: address(self.weights),
            gradients: address(self.gradients),
            m: address(self.m),
            average: address(self.average),
            scalars: self.scalars.ptr,
        };
        self.muon.map_or(Ok(()), |muon| Ok(muon.update(d, &vectors)?))
    }

    /// The whole update as one graph. A gradient first, so that cuBLAS has loaded what it needs.
    fn capture(&self) -> Result<Graph, LearnError> {
        self.gradient()?;
        self.network.device.wait()?;
        self.network.device.capture(|| self.all())
    }
}

/// Which windows.
enum Choice {
    /// Those of the update counted in `scalars`.
    Drawn { scalars: u64, seed: u64 },
    /// Those of the numbers from this address on.
    These(u64),
}

/// Fills the network's inputs and targets with `rows` windows.
fn gather(net: &Network, data: &Data, rows: usize, choice: Choice) -> Result<(), LearnError> {
    let [windows, per, frames] = [data.windows, data.per, data.frames].map(|x| Long(x as u64));
    let (scalars, seed, numbers) = match choice {
        Choice::Drawn { scalars, seed } => (scalars, seed, 0),
        Choice::These(numbers) => (0, 0, numbers),
    };
    let from = [Ptr(data.x.ptr), Ptr(data.y.ptr), Ptr(net.inputs.ptr), Ptr(net.targets.ptr), Ptr(scalars), Long(seed)];
    Ok(net.device.launch("gather", (rows, 1), (128, 1), 0, &[&from[..], &[windows, per, frames, Ptr(numbers)]].concat())?)
}
