//! Models and solvers whose frames are on a graphics card.

use nerd_sim::articulated::device::{CudaArticulated, Real, Resident, Roll};
use nerd_sim::solver::Slopes;

use crate::learner::cuda::{self, Precision};
use crate::prelude::*;

/// A solver at one setting whose batch stays on a GPU.
pub fn resident(setting: &Setting, system: &Arc<System>, real: Real, precision: Precision) -> Result<Box<dyn Roll>> {
    if let Setting::Neural(folder) = setting {
        let whole = cuda::resident(Model::load(folder, system, None)?, system, real, precision);
        return Ok(Box::new(whole.map_err(|why| Error::Refused(format!("{}: {why}", folder.display())))?));
    }
    let config = setting.articulated(system).ok_or_else(|| Error::Refused(format!("{setting} has no kernels; step it on the CPU")))?;
    Ok(Box::new(CudaArticulated::new(config, real)))
}

/// A model as a solver: whole frames on the device, or `alone` where that has no kernels for them.
pub(super) fn frames(
    model: Model,
    system: &Arc<System>,
    precision: Precision,
    alone: impl FnOnce() -> Result<Box<dyn Solver>> + Send + 'static,
) -> Result<Box<dyn Solver>> {
    let is_chain = model.config.network.architecture == Architecture::Chain;
    match cuda::resident(model, system, Real::F32, precision) {
        Ok(whole) => {
            let rest = if is_chain { "all is on the CPU" } else { "the network alone is on the card" };
            let (whole, alone): (Box<dyn Roll>, Make) = (Box::new(whole), Box::new(alone));
            Ok(Box::new(WithFallback { whole, stepped: false, alone: Some(alone), rest, fallback: None }))
        }
        Err(why) => {
            tell!("{why}");
            alone()
        }
    }
}

/// Makes a solver when it is needed.
type Make = Box<dyn FnOnce() -> Result<Box<dyn Solver>> + Send>;

/// Whole frames on the card, until a batch asks for what has no kernels (a scene with hills, say): from there on the network alone is there, or
/// of a chain nothing.
struct WithFallback {
    whole: Box<dyn Roll>,
    stepped: bool,
    /// Makes the fallback, once.
    alone: Option<Make>,
    rest: &'static str,
    fallback: Option<Box<dyn Solver>>,
}

impl WithFallback {
    /// What makes the frames from here on.
    fn present(&mut self) -> &mut dyn Solver {
        match &mut self.fallback {
            Some(fallback) => &mut **fallback,
            None => &mut *self.whole,
        }
    }
}

impl Solver for WithFallback {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        if let Some(fallback) = &mut self.fallback {
            return fallback.step(batch, torques);
        }
        let why = match self.whole.step(batch, torques) {
            Err(StepError::Refused(why)) => why,
            // A robot too large for the card is known when its kernels are made.
            Err(StepError::Solver(why)) if !self.stepped => why,
            done => {
                self.stepped = true;
                return done;
            }
        };
        // What asks too much of the solver on the card may do so of every one; then that one says it.
        let Some(alone) = self.alone.take() else { return Err(StepError::Refused(why)) };
        let mut fallback = alone().map_err(|e| StepError::Solver(format!("{why}; without kernels: {e}")))?;
        let done = fallback.step(batch, torques);
        if !matches!(done, Err(StepError::Refused(_))) {
            tell!("from now on {}: {why}", self.rest);
        }
        self.fallback = Some(fallback);
        done
    }

    fn inner(&self) -> Option<&dyn Solver> {
        self.fallback.as_deref().map_or_else(|| Some(&*self.whole as &dyn Solver), Some)
    }

    fn inner_mut(&mut self) -> Option<&mut dyn Solver> {
        Some(self.present())
    }

    fn back(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        self.present().back(batch, torques, rows, by_next)
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        if self.fallback.is_some() { None } else { self.whole.resident() }
    }
}
