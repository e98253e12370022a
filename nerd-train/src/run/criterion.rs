//! The criterion that selects the weights of a run: rollout error.

use super::card::model_config;
use super::data::Judge;
use super::*;
use crate::evaluate::{PassiveReport, Pieces, passive};
use crate::unroll::chain::distance;

/// Added to the criterion (rad or m) if a rollout diverged, so that such weights rank last.
const ASTRAY: f64 = 1e3;

/// Mean error of rollouts against the truth over the paper's horizon, in the robot's first two usual scenes (free
/// space, ground). With recorded motion, rollouts follow the trajectories for choosing the weights. For a robot family,
/// rollouts are of newly drawn robots. For a chain, the error is that of its nodes (m), averaged along the validation
/// motions. The error is infinite if a rollout failed.
pub(super) fn rollout_error(plan: &Plan, identity: &Identity, judge: &Judge, weights: Weights) -> Result<f64> {
    let Plan { config, system, .. } = plan;
    let Judge { normalizer, motions } = judge;
    if let Some(motions) = motions {
        return distance(system, motions, &weights, normalizer);
    }
    let learned = |starts: usize| -> Result<Neural> {
        let model = Model {
            config: model_config(identity, &Default::default()),
            normalizer: normalizer.clone(),
            weights: weights.clone(),
        };
        Ok(Neural::new(model, config.device.network(&weights, starts)?))
    };
    let pieces = match &plan.measured {
        Some(measured) => Some(measured.rollouts(&measured.choosing, &plan.network, config.rollouts)?),
        None if system.spec.vary.is_some() => Some(family(plan)?),
        None => None,
    };
    if let Some(pieces) = pieces {
        return Ok(figure(&pieces.compare(&mut learned(pieces.count())?)?));
    }
    let starts = config.rollouts;
    let steps = horizon(&system.name);
    let seed = 1_000 + config.record.seed;
    let protocol = PassiveConfig { starts, steps, seed, action: Action::Zero };
    let scenes = system.usual_scenes().into_iter().take(2).collect_vec();
    let mut total = 0.0;
    for scene in &scenes {
        let mut truth = config.record.truth(system).solver(system);
        total +=
            figure(&passive(system, &system.scene(scene)?, &mut *truth, &mut learned(starts)?, protocol, &mut |_| ())?);
    }
    Ok(total / scenes.len() as f64)
}

/// Rollouts of newly drawn robots of a family with random torques. The history has half of the frames that a prediction
/// depends on.
fn family(plan: &Plan) -> Result<Pieces> {
    let Plan { config, system, .. } = plan;
    let before = plan.network.reach() / 2;
    let frames = before + horizon(&system.name);
    let transitions = config.rollouts * frames;
    let seed = 1_000 + config.record.seed;
    let recorded = GenerateConfig {
        transitions,
        frames,
        seed,
        hold: config.record.hold,
        resets: 1.0,
        ..GenerateConfig::default()
    };
    Pieces::drawn(system, config.record.truth(system), &recorded, before)
}

fn figure(report: &PassiveReport) -> f64 {
    if report.failed > 0 {
        // A failed rollout keeps its last state, so its error is meaningless.
        return f64::INFINITY;
    }
    // The error of a diverged rollout was frozen, possibly at a small value.
    let gone = if report.first_divergence.is_some() { ASTRAY } else { 0.0 };
    report.error.iter().sum::<f64>() / report.error.len() as f64 + gone
}
