//! The network that settings ask for, and what its tokens and targets hold.

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_model::transformer::{Positions, TransformerConfig};
use nerd_sim::prelude::*;

use super::{BaseName, RunConfig};
use crate::error::{Error, Result, refuse};

/// Fewest tokens of a training sequence, if not said: short ones have few tokens with a whole past.
const SEQUENCE: usize = 32;

impl RunConfig {
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
            BaseName::Flight => Base::flight_of(self.record.truth),
        };
        self.variant.check(base)?;
        Ok(base)
    }

    /// Shape of its network.
    ///
    /// # Errors
    /// If there can be none of that shape.
    pub fn network(&self, system: &System, form: Form) -> Result<TransformerConfig> {
        if self.sequence.is_some() && !self.stream {
            refuse!("--sequence means nothing without --stream");
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
}
