//! Weights, moments and gradient on a GPU, and their update.

use std::mem::offset_of;

use super::muon::Muon;
use super::*;

/// Blocks of the first stage of the gradient's norm.
const NORM_BLOCKS: usize = 528;

/// Mirror of the struct in `kernels/common.cu`; `adam` reads four factors from `scale` on.
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

/// The optimiser on the GPU. Step, learning rate, bias corrections and decay of the average change between updates.
/// They are on the GPU too, so no update waits for it.
pub(crate) struct Optimiser {
    pub weights: Buffer<f32>,
    pub average: Buffer<f32>,
    /// Gradients, then one number that [`Optimiser::update`] scales to the loss.
    pub gradients: Buffer<f32>,
    m: Buffer<f32>,
    v: Buffer<f32>,
    norms: Buffer<f32>,
    scalars: Buffer<Scalars>,
    muon: Option<Muon>,
    config: LearnerConfig,
    shape: TransformerConfig,
    /// Adam's second beta.
    beta: f64,
    lr: f32,
}

impl Optimiser {
    /// Resumes `state`. `beta` is Adam's second beta.
    pub fn new(d: &Device, config: LearnerConfig, state: &LearnerState, beta: f64) -> LearnResult<Self> {
        let shape = state.weights.config;
        let scalars = Scalars { step: state.step, bad_step: u64::MAX, ..Scalars::default() };
        let muon = match config.optimizer {
            Optimizer::Adam => None,
            Optimizer::Muon => Some(Muon::new(d, &shape)?),
        };
        Ok(Self {
            weights: d.upload(&state.weights.flat)?,
            average: d.upload(&state.average)?,
            gradients: d.zeros(state.weights.flat.len() + 1)?,
            m: d.upload(&state.m)?,
            v: d.upload(&state.v)?,
            norms: d.zeros(NORM_BLOCKS)?,
            scalars: d.upload(&[scalars])?,
            muon,
            config,
            shape,
            beta,
            lr: 0.0,
        })
    }

    pub fn scalars(&self) -> u64 {
        self.scalars.ptr
    }

    /// Makes an update from the gradients. The number after the gradients is a sum of squared errors, or a chain's
    /// loss. Its product with `mean` is the reported loss.
    pub fn update(&self, d: &Device, mean: f32) -> LearnResult {
        let Self { weights, average, gradients, m, v, norms, scalars, muon, config, beta, .. } = self;
        let p = weights.len;
        d.launch_blocks("square_partial", NORM_BLOCKS, 256, &args![gradients, p, norms])?;
        let loss = gradients.at(p);
        let LearnerConfig { clip, average: decay, .. } = *config;
        let args = args![norms, NORM_BLOCKS, loss, mean, clip, decay, *beta, scalars];
        d.launch_blocks("finish", 1, 256, &args)?;
        let hidden = muon.as_ref().map_or(0, |muon| muon.entries.ptr);
        let factors = scalars.ptr + offset_of!(Scalars, scale) as u64;
        let bad = scalars.ptr + offset_of!(Scalars, bad_step) as u64;
        let args = args![weights, gradients, m, v, average, factors, bad, p, hidden, 0.9_f64, *beta];
        d.launch_each("adam", p, 256, &args)?;
        let vectors = [weights, gradients, m, average].map(|b| b.ptr);
        muon.as_ref().map_or(Ok(()), |muon| Ok(muon.update(d, vectors, scalars.ptr)?))
    }

    pub fn set_lr(&mut self, d: &Device, lr: f32) -> LearnResult {
        if lr.to_bits() != self.lr.to_bits() {
            d.set_word(self.scalars.ptr + offset_of!(Scalars, lr) as u64, lr.to_bits())?;
            self.lr = lr;
        }
        Ok(())
    }

    pub fn progress(&self, d: &Device) -> LearnResult<Progress> {
        let s = d.download(&self.scalars)?[0];
        if s.bad_step != u64::MAX {
            return Err(LearnError::NotFinite { step: s.bad_step, loss: s.bad_loss });
        }
        d.write(&self.scalars, &[Scalars { count: 0, loss_sum: 0.0, norm_sum: 0.0, ..s }])?;
        let count = s.count.max(1) as f64;
        Ok(Progress { loss: (s.loss_sum / count) as f32, gradient_norm: (s.norm_sum / count) as f32 })
    }

    pub fn state(&self, d: &Device) -> LearnResult<LearnerState> {
        let weights = Weights { config: self.shape, flat: d.download(&self.weights)? };
        let (average, m, v) = (d.download(&self.average)?, d.download(&self.m)?, d.download(&self.v)?);
        Ok(LearnerState { step: d.download(&self.scalars)?[0].step, weights, average, m, v })
    }
}
