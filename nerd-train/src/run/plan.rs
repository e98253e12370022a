//! What settings come to: what predictions are added to, network, learner, trainer.

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_model::transformer::{Positions, TransformerConfig};
use nerd_sim::prelude::*;

use super::{BaseName, RunConfig};
use crate::device::Device;
use crate::error::{Error, Result, refuse};
use crate::learner::LearnerConfig;
use crate::schedule::Schedule;
use crate::trainer::TrainerConfig;

/// Fewest tokens of a training sequence, if not said: short ones have few tokens with a whole past.
const SEQUENCE: usize = 32;

impl RunConfig {
    /// Refuses settings that mean nothing together.
    ///
    /// # Errors
    /// The first of them.
    pub fn check(&self) -> Result<()> {
        for (key, empty) in [("robot", self.robot.is_empty()), ("out", self.out.as_os_str().is_empty())] {
            if empty {
                refuse!("--{key} is needed: see `cargo xtask train --help`");
            }
        }
        let recorded = [("fresh", self.fresh > 0), ("policy", !self.record.policy.is_empty())];
        if let Some((key, _)) = recorded.iter().find(|(_, given)| *given && self.data.is_some()) {
            refuse!("--{key} records by itself: leave out --data");
        }
        if self.sequence.is_some() && !self.stream {
            refuse!("--sequence means nothing without --stream");
        }
        if self.epsilon.is_some() && self.from.is_some() {
            refuse!("--epsilon cannot be used with --from: the model it starts from has its own");
        }
        if self.draft != Self::default().draft && self.base != BaseName::Draft {
            refuse!("--draft means nothing without --base draft");
        }
        if self.f32 && self.device != Device::Cuda {
            refuse!("--f32 means nothing without --device cuda");
        }
        Ok(())
    }

    /// What predictions are added to.
    ///
    /// # Errors
    /// If the robot has nothing to learn so, or the variant predicts states.
    pub fn base(&self, system: &System) -> Result<Base> {
        let base = match self.base {
            BaseName::State => Base::State,
            BaseName::Flight if system.robot.contact_points.is_empty() => refuse!(
                "`{}` has nothing to touch: a frame of flight is its whole motion and needs no network; use --solver articulated",
                self.robot
            ),
            BaseName::Flight => Base::flight_of(self.record.truth(system)),
            BaseName::Draft => Base::Draft(self.draft),
        };
        self.variant.check(base, self.turns)?;
        Ok(base)
    }

    /// Shape of its network.
    ///
    /// # Errors
    /// If there can be none of that shape.
    pub fn network(&self, system: &System, form: Form) -> Result<TransformerConfig> {
        let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
        let Self { embedding, layers, history, .. } = *self;
        let heads = (embedding / self.head_width.max(1)).max(1);
        let paper = TransformerConfig::paper(inputs, outputs, embedding);
        let mut network = TransformerConfig { layers, heads, history, block: self.block.max(history), ..paper };
        let wrong = |reason: String| Error::Refused(format!("--embedding {embedding}, --layers {layers}: {reason}"));
        if self.stream {
            network.positions = Positions::Rotary;
            // All that a rollout's prediction will depend on, so that none has a longer past than training ever showed.
            network.block = self.sequence.unwrap_or(network.reach().max(SEQUENCE)).max(history);
        }
        // Before the width of a rival is looked for by counting its parameters.
        network.check().map_err(wrong)?;
        let network = self.variant.network(network);
        network.check().map_err(wrong)?;
        Ok(network)
    }

    /// What an update needs beside the learning rate.
    pub fn learner(&self) -> LearnerConfig {
        let Self { batch, average, huber, optimizer, .. } = *self;
        LearnerConfig { batch, clip: 1.0, average, seed: self.record.seed, huber, optimizer }
    }

    /// Length of the run, its learning rate, and how often it does what.
    pub fn trainer(&self) -> TrainerConfig {
        let Self { updates, rate, last_rate, warmup, validation_windows, log_every, .. } = *self;
        let tail = (self.tail * updates as f64) as u64;
        TrainerConfig {
            updates,
            schedule: Schedule { start: rate, end: last_rate, warmup, tail },
            validate_every: self.validate_every.unwrap_or(updates.div_ceil(50)),
            checkpoint_every: updates.div_ceil(10),
            validation_windows,
            log_every,
        }
    }
}
