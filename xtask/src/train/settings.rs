//! What a run's options come to: network, learner, trainer.

use anyhow::{Result, bail};
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_model::transformer::{Positions, TransformerConfig};
use nerd_sim::prelude::*;
use nerd_train::learner::{LearnerConfig, Optimizer};
use nerd_train::schedule::Schedule;
use nerd_train::trainer::TrainerConfig;

use super::args::{BaseName, OptimizerName, Preset, TrainArgs};
use super::memory;

/// What options come to.
pub struct Settings {
    /// What predictions are added to.
    pub base: Base,
    /// What tokens and targets hold.
    pub form: Form,
    /// Shape of the network.
    pub network: TransformerConfig,
    /// How it learns.
    pub learner: LearnerConfig,
    /// How long.
    pub trainer: TrainerConfig,
    /// Transitions to record before.
    pub transitions: usize,
}

impl Settings {
    /// Those of a run's options.
    ///
    /// # Errors
    /// If one of them makes no sense; its message names the option.
    pub fn new(args: &TrainArgs, system: &System) -> Result<Self> {
        let small = args.preset == Preset::Small;
        let base = match args.base {
            BaseName::State => Base::State,
            BaseName::Flight if system.robot.contact_points.is_empty() => {
                bail!(
                    "`{}` has nothing to touch: a frame of flight is its whole motion and needs no network; use --solver articulated",
                    args.robot
                )
            }
            BaseName::Flight => Base::flight_of(args.truth),
        };
        args.variant.check(base)?;
        let form = args.variant.form(base);
        let network = network(args, system, form)?;
        let updates = args.updates.unwrap_or(if small { 6_000 } else { 500_000 });
        let optimizer = match args.optimizer {
            OptimizerName::Adam => Optimizer::Adam,
            OptimizerName::Muon => Optimizer::Muon,
        };
        let learner = LearnerConfig {
            batch: args.batch.unwrap_or(if small { 128 } else { 512 }),
            clip: 1.0,
            average: args.average,
            seed: args.seed,
            huber: args.huber,
            optimizer,
        };
        let tail = (args.tail * updates as f64) as u64;
        let every = args.validate_every.unwrap_or(updates.div_ceil(50));
        let trainer = TrainerConfig {
            updates,
            schedule: Schedule { start: args.rate, end: args.last_rate, warmup: args.warmup, tail },
            validate_every: every,
            checkpoint_every: updates.div_ceil(10),
            validation_windows: if small { 4096 } else { 16_384 },
            log_every: if small { 20 } else { 500 },
        };
        let transitions = args.transitions.unwrap_or(if small { 400_000 } else { 10_000_000 });
        learner.check()?;
        trainer.check()?;
        // More than the run looks at would be recorded for nobody, at whatever price.
        let looked_at = u128::from(updates) * (learner.batch * network.sequence()) as u128;
        if args.fresh as u128 > looked_at {
            bail!(
                "--fresh {}: {updates} updates of {} sequences of {} look at {looked_at} tokens",
                args.fresh,
                learner.batch,
                network.sequence()
            );
        }
        if args.fresh > 0 && args.data.is_some() {
            bail!("--fresh records by itself: leave out --data");
        }
        memory::check(args, &network, learner.batch, transitions)?;
        Ok(Self { base, form, network, learner, trainer, transitions })
    }
}

/// Fewest tokens of a training sequence, if not said: short ones have few tokens with a whole past.
const SEQUENCE: usize = 32;

fn network(args: &TrainArgs, system: &System, form: Form) -> Result<TransformerConfig> {
    let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
    let mut network = TransformerConfig::paper(inputs, outputs, 192);
    if args.preset == Preset::Small {
        network = TransformerConfig { embedding: 48, layers: 2, heads: 4, block: 16, ..network };
    }
    network.history = args.history.unwrap_or(network.history);
    network.block = network.block.max(network.history);
    network.layers = args.layers.unwrap_or(network.layers);
    if args.stream {
        network.positions = Positions::Rotary;
        // All that a rollout's prediction will depend on, so that none has a longer past than training ever showed.
        network.block = args.sequence.unwrap_or(network.reach().max(SEQUENCE)).max(network.history);
    }
    // Before the width of a rival is looked for by counting its parameters.
    network.check().map_err(anyhow::Error::msg)?;
    if let Some(embedding) = args.embedding {
        // Heads keep their width.
        let heads = (embedding * network.heads).div_euclid(network.embedding).max(1);
        network = TransformerConfig { embedding, heads, ..network };
        network.check().map_err(|e| anyhow::anyhow!("--embedding {embedding}: {e}"))?;
    }
    let network = args.variant.network(network);
    network.check().map_err(anyhow::Error::msg)?;
    Ok(network)
}
