//! What a model's frame costs.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;

use crate::device::Device;
use crate::error::{Error, Result};
use crate::evaluate::{Action, PassiveConfig, passive};

/// Microseconds that a model takes for a frame of one environment on one core of the CPU, best of five.
///
/// # Errors
/// If the model cannot be read or cannot step.
pub fn microseconds(folder: &Path, system: &Arc<System>, scene: &Arc<Scene>) -> Result<f64> {
    const ENVIRONMENTS: usize = 256;
    const FRAMES: usize = 40;
    const REPEATS: usize = 5;
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| Error::Refused(e.to_string()))?;
    one.install(|| {
        let truth = ModelConfig::truth_of(folder)?;
        let protocol = PassiveConfig { starts: ENVIRONMENTS, steps: FRAMES, seed: 501, action: Action::Zero };
        let mut best = f64::INFINITY;
        for _ in 0..REPEATS {
            let mut learned = Timed(Box::new(Device::Cpu.neural(folder, system, None, ENVIRONMENTS)?), Duration::ZERO);
            passive(system, scene, &mut *truth.solver(system), &mut learned, protocol, &mut |_| ())?;
            best = best.min(learned.1.as_secs_f64() * 1e6 / (ENVIRONMENTS * FRAMES) as f64);
        }
        Ok(best)
    })
}

/// Adds up the time its solver takes.
struct Timed(Box<dyn Solver>, Duration);

impl Solver for Timed {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> std::result::Result<(), StepError> {
        let start = Instant::now();
        let done = self.0.step(batch, torques);
        self.1 += start.elapsed();
        done
    }

    fn reset(&mut self, env: usize) {
        self.0.reset(env);
    }
}
