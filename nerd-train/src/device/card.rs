//! Solvers that compute whole frames on a GPU, with a fallback for batches that have no kernels.

use nerd_sim::articulated::device::{Real, Resident, Roll};
use nerd_sim::solver::Gradients;

use crate::learner::cuda::{self, Precision};
use crate::prelude::*;

/// Makes a solver that computes whole frames of a model on the GPU. Without kernels for the model, calls `alone` for a
/// solver.
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

/// Function that makes the fallback solver.
type Make = Box<dyn FnOnce() -> Result<Box<dyn Solver>> + Send>;

/// Computes whole frames on the GPU until a batch has no kernels (a scene with hills, say). From then on only the
/// network runs on the GPU, and a chain runs on the CPU.
struct WithFallback {
    whole: Box<dyn Roll>,
    stepped: bool,
    /// Makes the fallback; `None` after that.
    alone: Option<Make>,
    rest: &'static str,
    fallback: Option<Box<dyn Solver>>,
}

impl WithFallback {
    /// The solver that computes the next frames.
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
            // Kernels are compiled at the first step, which refuses a robot that is too large for them.
            Err(StepError::Solver(why)) if !self.stepped => why,
            done => {
                self.stepped = true;
                return done;
            }
        };
        // If the fallback refuses the batch, too, the fallback's error is returned.
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

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        self.present().vjp(batch, torques, rows, grad_next)
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        if self.fallback.is_some() { None } else { self.whole.resident() }
    }
}
