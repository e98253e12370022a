//! What a run learns from and is judged by, and what trains on it: windows of tokens, or motions of a chain.

use std::sync::{Arc, Mutex, PoisonError};

use nerd_model::chain::{Chain, ChainSolver};
use nerd_model::normalizer::Normalizer;
use nerd_sim::dataset::GenerateConfig;

use super::engine::{engine, unrolled};
use super::{Run, RunConfig, memory};
use crate::chain::{ChainLearner, Motions, scales};
use crate::device::Device;
use crate::error::{Error, Result, refuse};
use crate::learner::{Learner, LearnerState};
use crate::prepare::{moments, normalize, read};
use crate::windows::Windows;

/// Transitions that are validated on, and the paper's distance of their seed from the training data's.
const VALIDATION: (usize, u64) = (200_000, 10);

/// What a run learns from.
pub struct Data {
    /// Of it.
    pub sha256: String,
    pub transitions: usize,
    /// Places that a draw may begin with.
    pub windows: usize,
    pub judge: Judge,
    pub matter: Matter,
}

/// What its weights are judged by.
pub struct Judge {
    pub normalizer: Normalizer,
    /// Of a chain.
    pub motions: Option<Arc<Motions>>,
}

/// What it trains on.
pub enum Matter {
    /// Normalised, those of the validation behind.
    Windows([Arc<Windows>; 2]),
    /// Of a chain, and the mean change of a node's velocity over a frame (m/s).
    Motions(Arc<Motions>, f64),
}

/// Motions that a run before has read or recorded: those of a recipe have mostly the same.
#[derive(Default)]
pub struct Known(Mutex<Vec<(String, Arc<Motions>)>>);

/// Sets that are kept: to train on, and to be judged by.
const KEPT: usize = 2;

impl Known {
    /// Those known by `name`, or else what is made.
    fn get(&self, name: impl std::fmt::Debug, make: impl FnOnce() -> Result<Motions>) -> Result<Arc<Motions>> {
        let (name, mut all) = (format!("{name:?}"), self.0.lock().unwrap_or_else(PoisonError::into_inner));
        if let Some((_, known)) = all.iter().find(|(known, _)| *known == name) {
            return Ok(known.clone());
        }
        let made = Arc::new(make()?);
        all.push((name, made.clone()));
        let old = all.len().saturating_sub(KEPT);
        all.drain(..old);
        Ok(made)
    }
}

impl Run {
    /// Records or reads what is learned from, and normalises it.
    pub(super) fn data(&self) -> Result<Data> {
        if self.config.unrolled().is_some() {
            return self.motions();
        }
        let (record, sequence) = (&self.config.record, self.network.sequence());
        let mut training = match &self.config.data {
            Some(folder) => read(&self.system, &record.truth(&self.system).name(), folder, sequence, self.form)?,
            None => record.tokens(&self.ranks, &self.system, &self.recording, sequence, self.form)?,
        };
        let validation = self.validation(VALIDATION.0.min(self.config.transitions));
        let mut validation = record.tokens(&self.ranks, &self.system, &validation, sequence, self.form)?.windows;
        let windows = &training.windows;
        if windows.is_empty() || validation.is_empty() {
            refuse!("{} trajectories of {} frames hold no sequence of {sequence} tokens", windows.trajectories(), windows.frames);
        }
        let own = || {
            let mut own = self.config.variant.normalizer(moments(windows));
            own.outputs.epsilon = self.config.epsilon.unwrap_or(own.outputs.epsilon);
            own
        };
        let normalizer = self.parent.as_ref().map_or_else(own, |p| p.normalizer.clone());
        normalize(&mut training.windows, &normalizer);
        normalize(&mut validation, &normalizer);
        let windows = training.windows;
        Ok(Data {
            sha256: training.sha256,
            transitions: windows.trajectories() * windows.frames,
            windows: windows.len(),
            judge: Judge { normalizer, motions: None },
            matter: Matter::Windows([Arc::new(windows), Arc::new(validation)]),
        })
    }

    /// The same of a chain.
    fn motions(&self) -> Result<Data> {
        let (record, system) = (&self.config.record, &self.system);
        let truth = record.truth(system).name();
        let motions = match &self.config.data {
            Some(folder) => self.known.get(folder, || Ok(Motions::read(system, &truth, folder)?))?,
            None => self.recorded(&self.recording)?,
        };
        let validation = self.recorded(&self.validation(self.config.rollouts.max(1) * record.frames))?;
        let (own, velocity) = scales(&self.chain()?, &motions);
        let normalizer = self.parent.as_ref().map_or(own, |p| p.normalizer.clone());
        Ok(Data {
            sha256: motions.sha256.clone(),
            transitions: motions.len() * motions.frames,
            windows: motions.len() * motions.frames,
            judge: Judge { normalizer, motions: Some(validation) },
            matter: Matter::Motions(motions, velocity),
        })
    }

    fn recorded(&self, config: &GenerateConfig) -> Result<Arc<Motions>> {
        let RunConfig { record, device, .. } = &self.config;
        let truth = record.truth(&self.system).name();
        self.known.get((&self.config.robot, truth, config, device), || record.motions(&self.system, config, *device))
    }

    fn validation(&self, transitions: usize) -> GenerateConfig {
        GenerateConfig { transitions, seed: self.config.record.seed + VALIDATION.1, ..self.recording.clone() }
    }

    fn chain(&self) -> Result<Chain> {
        Chain::of(&self.system).map_err(|e| Error::Refused(e.to_string()))
    }

    /// What learns, at the state it goes on from.
    pub(super) fn engine(&self, state: LearnerState, matter: Matter, judge: &Judge) -> Result<Box<dyn Learner>> {
        match (matter, &judge.motions) {
            (Matter::Motions(motions, velocity), Some(validation)) => {
                let frames = self.config.unrolled().unwrap_or(1);
                let scale = ChainSolver::scale(&judge.normalizer).map_err(Error::Refused)?;
                let sets = [motions, validation.clone()];
                if self.config.device == Device::Cuda {
                    return unrolled((&self.system, &self.ranks), (self.learner, self.config.f32), state, sets, (scale, velocity), frames);
                }
                memory::unrolled(&self.network, frames)?;
                let learner = ChainLearner::new(self.chain()?, self.learner, state, sets, (scale, velocity), frames)?;
                Ok(Box::new(learner.among(&self.ranks)))
            }
            (Matter::Windows(sets), _) => engine(self.config.device, self.config.f32, self.learner, state, sets, &self.ranks),
            (Matter::Motions(..), None) => refuse!("motions that nothing is judged by"),
        }
    }
}
