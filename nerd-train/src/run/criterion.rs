//! The criterion that selects a run's weights.

use super::card::model_config;
use super::data::Judge;
use super::*;
use crate::evaluate::{PassiveReport, Pieces, passive};
use crate::unroll::chain::distance;

/// Counted where a rollout is gone (rad or m): such weights rank behind all others.
const ASTRAY: f64 = 1e3;

/// Mean error over the paper's horizon, in free space and, where there is one, on the first ground; of recorded motion on the part that
/// chooses. Of a chain that of its nodes (m) along motions like those it learns from, of a
/// family that of robots of it. Infinite if a rollout failed.
pub(super) fn rollout_error(plan: &Plan, identity: &Identity, judge: &Judge, weights: Weights) -> Result<f64> {
    let Plan { config, system, .. } = plan;
    let Judge { normalizer, motions } = judge;
    if let Some(motions) = motions {
        return distance(system, motions, &weights, normalizer);
    }
    let learned = |starts: usize| -> Result<Neural> {
        let model = Model { config: model_config(identity, &Default::default()), normalizer: normalizer.clone(), weights: weights.clone() };
        Ok(Neural::new(model, config.device.network(&weights, starts)?))
    };
    if let Some(measured) = &plan.measured {
        let pieces = measured.rollouts(&measured.choosing, &plan.network, config.rollouts)?;
        return Ok(figure(&pieces.compare(&mut learned(pieces.count())?)?));
    }
    if system.spec.vary.is_some() {
        let pieces = family(plan)?;
        return Ok(figure(&pieces.compare(&mut learned(pieces.count())?)?));
    }
    let (starts, steps, seed) = (config.rollouts, horizon(&system.name), 1_000 + config.record.seed);
    let protocol = PassiveConfig { starts, steps, seed, action: Action::Zero };
    let scenes: Vec<&str> = system.usual_scenes().into_iter().take(2).collect();
    let mut total = 0.0;
    for scene in &scenes {
        let mut truth = config.record.truth(system).solver(system);
        total += figure(&passive(system, &system.scene(scene)?, &mut *truth, &mut learned(starts)?, protocol, &mut |_| ())?);
    }
    Ok(total / scenes.len() as f64)
}

/// Driven rollouts of robots of a family that nothing learns from, each after half of the frames that a prediction depends on.
fn family(plan: &Plan) -> Result<Pieces> {
    let Plan { config, system, .. } = plan;
    let before = plan.network.reach() / 2;
    let frames = before + horizon(&system.name);
    let (transitions, seed) = (config.rollouts * frames, 1_000 + config.record.seed);
    let recorded = GenerateConfig { transitions, frames, seed, hold: config.record.hold, resets: 1.0, ..GenerateConfig::default() };
    Pieces::drawn(system, config.record.truth(system), &recorded, before)
}

fn figure(report: &PassiveReport) -> f64 {
    if report.failed > 0 {
        // Where they stood when they failed says nothing of how far they would have gone.
        return f64::INFINITY;
    }
    // Where a rollout left all reasonable numbers its error was frozen, which may have been lucky.
    let gone = if report.first_divergence.is_some() { ASTRAY } else { 0.0 };
    report.error.iter().sum::<f64>() / report.error.len() as f64 + gone
}
