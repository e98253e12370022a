//! Of a model's own states, targets are the truth's next ones.

use std::sync::Arc;

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_sim::dataset::{GenerateConfig, record};
use nerd_sim::prelude::*;
use nerd_train::own::{Judged, is_own};
use nerd_train::prepare::{tokens, tokens_towards};

fn truth(system: &Arc<System>) -> Box<dyn Solver> {
    Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb)))
}

/// The truth, but that it keeps only nine tenths of every velocity.
struct Lazy(Box<dyn Solver>);

impl Solver for Lazy {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.0.step(batch, torques)?;
        let nq = batch.system.robot.nq();
        (0..batch.len()).for_each(|env| batch.state_mut(env)[nq..].iter_mut().for_each(|v| *v *= 0.9));
        Ok(())
    }

    fn reset(&mut self, env: usize) {
        self.0.reset(env);
    }
}

#[test]
fn a_models_states_have_the_truths_targets() {
    let system = System::named("pendulum").expect("pendulum");
    let config = GenerateConfig { frames: 9, ..Default::default() };
    let form = Form::from(Base::State);
    // A model that is the truth has the truth's data.
    let plain = record(&system, &mut *truth(&system), &config, 0, 20).expect("the truth steps");
    let mut same = Judged::new(truth(&system), truth(&system));
    let recording = record(&system, &mut same, &config, 0, 20).expect("steps");
    let (a, b) =
        (tokens(&system, &plain, 4, form).expect("tokens"), tokens_towards(&system, &recording, &same.truths, 4, form).expect("tokens"));
    assert!(a.x == b.x && a.y == b.y, "a model that is the truth changed its data");
    // One that is not goes elsewhere, and each of its frames is led back to where the truth goes.
    let mut lazy = Judged::new(Box::new(Lazy(truth(&system))), truth(&system));
    let recording = record(&system, &mut lazy, &config, 0, 20).expect("steps");
    let windows = tokens_towards(&system, &recording, &lazy.truths, 4, form).expect("tokens");
    let (d, outputs) = (system.robot.state_dim(), Features::outputs(&system));
    let mut batch = Batch::new(&system, &Arc::new(Scene::free(system.gravity())), 1);
    let (mut features, mut target, mut checked) = (Features::new(&system, form), vec![0.0f32; outputs], 0);
    for trajectory in 0..20 {
        for frame in 0..9 {
            let state: Vec<f64> = recording.states[(trajectory * 10 + frame) * d..][..d].iter().map(|x| f64::from(*x)).collect();
            let torques: Vec<f64> = recording.torques[(trajectory * 9 + frame) * 2..][..2].iter().map(|x| f64::from(*x)).collect();
            // Scenes are random; those out of reach of the ground are a free one's.
            let near = recording.depths[(trajectory * 9 + frame) * system.robot.contact_points.len()..]
                [..system.robot.contact_points.len()]
                .iter()
                .any(|depth| *depth < 1.0);
            if near {
                continue;
            }
            batch.reset(0, &state);
            batch.scenes[0] = Arc::new(Scene::free(nalgebra::Vector3::from_fn(|k, _| f64::from(recording.gravity[3 * trajectory + k]))));
            truth(&system).step(&mut batch, &torques).expect("a frame");
            features.target(&state, &state, batch.state(0), &mut target);
            let found = &windows.y[(trajectory * 9 + frame) * outputs..][..outputs];
            // States and torques were recorded in f32.
            let worst = found.iter().zip(&target).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 2e-4, "trajectory {trajectory}, frame {frame}: {worst} off the truth");
            checked += 1;
        }
    }
    assert!(checked > 10, "{checked} frames out of reach of the ground");
    assert!(recording.states != plain.states, "the model did not step");
}

#[test]
fn shares_are_kept_at_every_length() {
    for share in [0.0, 0.25, 0.5, 1.0] {
        for n in [4u64, 10, 100] {
            let count = (0..n).filter(|k| is_own(*k, share)).count() as f64;
            assert!((count - share * n as f64).abs() < 1.0, "{count} of {n} for a share of {share}");
        }
    }
}
