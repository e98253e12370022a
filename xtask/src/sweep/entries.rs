//! What is varied: named changes of one run's options.

use nerd_train::learner::Optimizer;
use nerd_train::run::{BaseName, RunConfig};

/// Which set of runs.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// One decision of training taken back, or added, at a time
    Switches,
    /// Width, depth and window of the network
    Sizes,
    /// The paper's form, optimiser and loss beside ours
    Forms,
    /// What a rollout differs in from training: sequences shorter than what a prediction depends on, and small targets
    Sameness,
}

/// One run.
pub struct Entry {
    /// In tables, and the name of its folder.
    pub name: &'static str,
    /// What differs from the base.
    pub change: fn(&mut RunConfig),
}

const fn entry(name: &'static str, change: fn(&mut RunConfig)) -> Entry {
    Entry { name, change }
}

/// What the others are held against.
pub const BASE: &str = "base";

const SWITCHES: [Entry; 12] = [
    entry(BASE, |_| ()),
    entry("squares", |a| a.huber = None),
    entry("adam", |a| a.optimizer = Optimizer::Adam),
    entry("no-average", |a| a.average = 0.0),
    entry("constant-rate", |a| a.last_rate = a.rate),
    entry("no-warmup", |a| a.warmup = 0),
    entry("full-torques", |a| a.record.torque_scale = 1.0),
    entry("no-fresh-data", |a| a.fresh = 0),
    // What mirrored legs would bring, where the truth makes data for the asking: more data.
    entry("twice-the-fresh-data", |a| a.fresh *= 2),
    entry("held-actions", |a| a.record.hold = 16),
    entry("starts-of-episodes", |a| a.record.resets = 0.5),
    entry("state", |a| a.base = BaseName::State),
];

const SIZES: [Entry; 9] = [
    entry("e32-l2", |a| size(a, 32, 2)),
    entry("e48-l2", |a| size(a, 48, 2)),
    entry("e64-l2", |a| size(a, 64, 2)),
    entry("e64-l4", |a| size(a, 64, 4)),
    entry(BASE, |_| ()),
    entry("e128-l6", |a| size(a, 128, 6)),
    entry("e192-l6", |a| size(a, 192, 6)),
    entry("h-1", |a| a.history = 1),
    entry("h-5", |a| a.history = 5),
];

/// As many tokens an update in each.
const SAMENESS: [Entry; 3] = [
    entry(BASE, |_| ()),
    entry("sequence-64", |a| (a.sequence, a.batch) = (Some(64), a.batch / 2)),
    entry("relative-targets", |a| a.epsilon = Some(1e-12)),
];

const FORMS: [Entry; 3] = [entry(BASE, |a| size(a, 192, 6)), entry("state", state), entry("paper", paper)];

fn size(args: &mut RunConfig, embedding: usize, layers: usize) {
    (args.embedding, args.layers) = (embedding, layers);
}

fn state(args: &mut RunConfig) {
    size(args, 192, 6);
    args.base = BaseName::State;
}

/// State, position table, Adam, squares, full torques, ten million transitions met again and again: as many tokens an update.
fn paper(args: &mut RunConfig) {
    state(args);
    args.batch = args.batch * args.sequence.unwrap_or(32) / 10;
    args.transitions += args.fresh;
    (args.stream, args.optimizer, args.huber, args.record.torque_scale, args.fresh) = (false, Optimizer::Adam, None, 1.0, 0);
    (args.warmup, args.last_rate) = (0, 1e-4);
}

impl Set {
    /// Its runs.
    pub fn entries(self) -> &'static [Entry] {
        match self {
            Self::Switches => &SWITCHES,
            Self::Sizes => &SIZES,
            Self::Forms => &FORMS,
            Self::Sameness => &SAMENESS,
        }
    }
}

/// The run that the others change.
pub fn base(robot: &str, asked: &super::SweepArgs, seed: u64) -> RunConfig {
    let mut run = RunConfig::new(robot, "out");
    (run.base, run.stream, run.sequence, run.optimizer) = (BaseName::Flight, true, Some(32), Optimizer::Muon);
    (run.embedding, run.layers, run.batch, run.updates) = (asked.embedding, asked.layers, asked.batch, asked.updates);
    (run.transitions, run.fresh, run.device) = (asked.transitions, asked.fresh, asked.device);
    (run.huber, run.warmup, run.last_rate) = (Some(0.02), asked.updates / 20, 0.0);
    (run.record.torque_scale, run.record.seed) = (-1.0, seed);
    // The end of the run alone is looked at: the last weights or their average.
    (run.validate_every, run.rollouts) = (Some(asked.updates), 32);
    run
}
