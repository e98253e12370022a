//! What chooses between the weights of a run.

use std::sync::Arc;

use anyhow::Result;
use nerd_model::base::Base;
use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_model::normalizer::Normalizer;
use nerd_model::transformer::Weights;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive};

use super::TrainArgs;
use super::card::{Run, model_config};
use super::engine::network;
use crate::paper;

/// Mean error over the paper's horizon: in free space and, where there is one, on the first ground; of a model on flight, on
/// all grounds. Infinite if a rollout failed.
pub fn rollout_error(system: &Arc<System>, run: &Run, normalizer: &Normalizer, weights: Weights, args: &TrainArgs) -> Result<f64> {
    let steps = paper::horizon(&system.name);
    let config = PassiveConfig { starts: args.rollouts, steps, seed: 1_000 + args.seed, action: Action::Zero };
    // Flight has no error where there is nothing to touch.
    let scenes: Vec<&str> = match run.base {
        Base::State | Base::Nothing => system.usual_scenes().into_iter().take(2).collect(),
        Base::Flight | Base::ExactFlight => system.usual_scenes().into_iter().filter(|s| *s != "free").collect(),
    };
    let mut total = 0.0;
    for scene in &scenes {
        let model = Model { config: model_config(run, &Default::default()), normalizer: normalizer.clone(), weights: weights.clone() };
        let network = network(&model.weights, args.device, args.rollouts)?;
        let mut learned = Neural::new(model, system, network);
        let report = passive(system, &system.scene(scene)?, &mut *args.truth.solver(system), &mut learned, config, &mut |_| ())?;
        if report.failed > 0 {
            // Where they stood when they failed says nothing of how far they would have gone.
            return Ok(f64::INFINITY);
        }
        total += report.error.iter().sum::<f64>() / report.error.len() as f64;
    }
    Ok(total / scenes.len() as f64)
}
