//! What settings come to: what predictions are added to, network, learner, trainer.

use nerd_model::base::Base;
use nerd_model::chain::{self, Chain};
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_model::transformer::{Architecture, Positions, TransformerConfig};
use nerd_sim::prelude::*;

use super::{BaseName, RunConfig, Variant};
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
        let chain = self.variant == Variant::Chain;
        let foreign = [
            ("stream", self.stream),
            ("base", self.base != BaseName::State),
            ("fresh", self.fresh > 0),
            ("epsilon", self.epsilon.is_some()),
            ("huber", self.huber.is_some()),
        ];
        if let Some((key, _)) = foreign.iter().find(|(_, given)| *given && chain) {
            refuse!("--{key} means nothing with --variant chain");
        }
        if self.sequence.is_some() && !self.stream && !chain {
            refuse!("--sequence means nothing without --stream or --variant chain");
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
        self.variant.check(base)?;
        Ok(base)
    }

    /// Shape of its network.
    ///
    /// # Errors
    /// If there can be none of that shape.
    pub fn network(&self, system: &System, form: Form) -> Result<TransformerConfig> {
        if self.variant == Variant::Chain {
            return self.along(system);
        }
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

    /// That along a chain.
    fn along(&self, system: &System) -> Result<TransformerConfig> {
        let chain = Chain::of(system).map_err(|e| Error::Refused(e.to_string()))?;
        let Self { embedding, layers, .. } = *self;
        let paper = TransformerConfig::paper(chain::INPUTS, chain::OUTPUTS, embedding);
        let network =
            TransformerConfig { layers, heads: 1, block: chain.rods, history: 1, head: 1, architecture: Architecture::Chain, ..paper };
        network.check().map_err(|reason| Error::Refused(format!("--embedding {embedding}, --layers {layers}: {reason}")))?;
        Ok(network)
    }

    /// Frames of a rollout in the training of a chain.
    pub fn unrolled(&self) -> Option<usize> {
        (self.variant == Variant::Chain).then(|| self.sequence.unwrap_or(1))
    }

    /// Whether rollouts choose its weights: where a chain is taught single frames, they say little of what it has learned.
    pub(super) fn rolls(&self) -> bool {
        self.rollouts > 0 && self.unrolled() != Some(1)
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
