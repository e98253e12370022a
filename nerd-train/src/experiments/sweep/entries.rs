//! What is varied: named changes of one run's settings.

use crate::error::{Result, refuse};
use crate::experiments::changes::Change;
use crate::learner::Optimizer;
use crate::run::{BaseName, RunConfig, Variant};

const fn entry(name: &'static str, change: fn(&mut RunConfig)) -> Change {
    Change { name, change }
}

/// What the others are held against.
pub const BASE: &str = "base";

/// Sets of runs by name.
const SETS: [(&str, &[Change]); 5] =
    [("switches", &SWITCHES), ("sizes", &SIZES), ("smallest", &SMALLEST), ("forms", &FORMS), ("sameness", &SAMENESS)];

/// One decision of training taken back, or added, at a time.
const SWITCHES: [Change; 12] = [
    entry(BASE, |_| ()),
    entry("squares", |r| r.huber = None),
    entry("adam", |r| r.optimizer = Optimizer::Adam),
    entry("no-average", |r| r.average = 0.0),
    entry("constant-rate", |r| r.last_rate = r.rate),
    entry("no-warmup", |r| r.warmup = 0),
    entry("full-torques", |r| r.record.torque_scale = 1.0),
    entry("no-fresh-data", |r| r.fresh = 0),
    // What mirrored legs would bring, where the truth makes data for the asking: more data.
    entry("twice-the-fresh-data", |r| r.fresh *= 2),
    entry("held-actions", |r| r.record.hold = 16),
    entry("starts-of-episodes", |r| r.record.resets = 0.5),
    entry("state", |r| r.base = BaseName::State),
];

/// Width, depth and window of the network.
const SIZES: [Change; 9] = [
    entry("e32-l2", |r| size(r, 32, 2)),
    entry("e48-l2", |r| size(r, 48, 2)),
    entry("e64-l2", |r| size(r, 64, 2)),
    entry("e64-l4", |r| size(r, 64, 4)),
    entry(BASE, |_| ()),
    entry("e128-l6", |r| size(r, 128, 6)),
    entry("e192-l6", |r| size(r, 192, 6)),
    entry("h-1", |r| r.history = 1),
    entry("h-5", |r| r.history = 5),
];

/// The model that ships, made smaller and larger in one thing at a time.
const SMALLEST: [Change; 10] = [
    entry(BASE, |_| ()),
    entry("e32-l2", |r| size(r, 32, 2)),
    entry("e64-l2", |r| size(r, 64, 2)),
    entry("e64-l4", |r| size(r, 64, 4)),
    entry("e192-l6", |r| size(r, 192, 6)),
    entry("h-5", |r| r.history = 5),
    entry("mlp", |r| (r.variant, r.stream, r.sequence) = (Variant::Mlp, false, None)),
    entry("half-the-draft", |r| r.draft = r.draft.div_ceil(2)),
    entry("flight", |r| (r.base, r.draft) = (BaseName::Flight, 1)),
    entry("state", |r| (r.base, r.draft) = (BaseName::State, 1)),
];

/// What a rollout differs in from training: sequences shorter than what a prediction depends on, and small targets. As many
/// tokens an update in each.
const SAMENESS: [Change; 3] = [
    entry(BASE, |_| ()),
    entry("sequence-64", |r| (r.sequence, r.batch) = (Some(64), r.batch / 2)),
    entry("relative-targets", |r| r.epsilon = Some(1e-12)),
];

/// The paper's form, optimiser and loss beside ours.
const FORMS: [Change; 3] = [entry(BASE, |r| size(r, 192, 6)), entry("state", state), entry("paper", paper)];

fn size(run: &mut RunConfig, embedding: usize, layers: usize) {
    (run.embedding, run.layers) = (embedding, layers);
}

fn state(run: &mut RunConfig) {
    size(run, 192, 6);
    run.base = BaseName::State;
}

/// State, position table, Adam, squares, full torques, ten million transitions met again and again: as many tokens an update.
fn paper(run: &mut RunConfig) {
    state(run);
    run.batch = run.batch * run.sequence.unwrap_or(32) / 10;
    run.transitions += run.fresh;
    (run.stream, run.optimizer, run.huber, run.record.torque_scale, run.fresh) = (false, Optimizer::Adam, None, 1.0, 0);
    (run.warmup, run.last_rate) = (0, 1e-4);
}

/// The runs of a set.
///
/// # Errors
/// If there is no such set.
pub fn entries(set: &str) -> Result<Vec<&'static Change>> {
    match SETS.iter().find(|(name, _)| *name == set) {
        Some((_, entries)) => Ok(entries.iter().collect()),
        None => refuse!("--set {set}: known are {}", SETS.map(|s| s.0).join(", ")),
    }
}
