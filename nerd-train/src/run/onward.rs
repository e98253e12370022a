//! Defaults for training a model further.

use super::*;

/// Fewest frames of a trajectory.
const FRAMES: usize = 120;
/// Transitions to begin with, and fresh ones for each update.
const TRANSITIONS: usize = 1_000_000;
const FRESH: usize = 100;

impl RunConfig {
    /// Settings under which a model is trained on: its own network on its own base, and for the rest settings that suit short
    /// runs of any of them. Data come fresh, half of the trajectories start as tasks do and half are passive.
    ///
    /// # Errors
    /// If it is of a chain, whose runs follow one another.
    pub fn onward(model: &ModelConfig, updates: u64) -> Result<Self> {
        let network = &model.network;
        let mut run = Self { robot: model.robot.clone(), updates, batch: model.batch, ..Self::default() };
        (run.base, run.view, run.told) = (model.base, model.view, model.told);
        if network.architecture == Architecture::Chain {
            refuse!("the model is of a chain; say with --recipe how it is trained on");
        }
        (run.embedding, run.layers, run.history) = (network.embedding, network.layers, network.history);
        if network.architecture == Architecture::Transformer {
            (run.head_width, run.block) = (network.embedding / network.heads, network.block);
        }
        run.stream = network.positions == Positions::Rotary;
        run.transitions = TRANSITIONS;
        // No more than the run looks at.
        run.fresh = usize::try_from(updates).unwrap_or(usize::MAX).saturating_mul(FRESH.min(model.batch * network.sequence()));
        run.optimizer = Optimizer::Muon;
        (run.last_rate, run.warmup, run.huber, run.rollouts) = (0.0, 1000.min(updates / 10), Some(0.01), 256);
        (run.record.frames, run.record.torque_scale) = (FRAMES.max(network.sequence()).max(network.reach()), -1.0);
        (run.record.hold, run.record.resets) = (16, 0.5);
        Ok(run)
    }
}
