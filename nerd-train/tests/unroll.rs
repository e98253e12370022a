//! Learning from many predicted frames: slopes against differences, and a disturbance that one frame hides and many show.

#![cfg(feature = "report")]

use std::path::Path;

use nerd_sim::calibrate::{Distance, Engine, Parameter, Subject, Trial, mean};
use nerd_sim::log::Log;
use nerd_sim::prelude::*;
use nerd_train::nerd_model::base::Base;
use nerd_train::nerd_model::folder::Model;
use nerd_train::unroll::{SmallModel, Unroll, UnrollConfig, distances, slope};

const UNIT: Distance = Distance { position: 0.01, rotation: 0.1, joints: 0.0, other_side: 0.0 };

fn sample() -> Log {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-sim/assets/logs/cube.log.toml");
    Log::read(&path, None).expect("the sample of tosses")
}

fn subject(log: &Log) -> Subject {
    let engine = Engine::Articulated(ArticulatedConfig::implicit(4, Friction::Coulomb));
    Subject::new(&log.system, &log.scene, engine).expect("a subject")
}

fn silent(log: &Log, sequence: usize) -> Model {
    let shape = SmallModel { base: Base::Draft(4), embedding: 16, layers: 1, history: 1, sequence, scale: 1.0 };
    let recording = log.recording(sequence).expect("its frames");
    shape.silent(&subject(log), "measured", &recording, 7).expect("a model")
}

/// Adds to what the network says, number by number, always the same.
fn said(model: &Model, k: usize, by: f32) -> Model {
    let mut model = model.clone();
    let (n, outputs) = (model.weights.flat.len(), model.config.network.outputs);
    model.weights.flat[n - outputs + k] += by;
    model
}

#[test]
fn a_silent_model_moves_as_its_base() {
    let log = sample();
    let (subject, trials) = (subject(&log), log.trials(60, 30));
    let own = mean(&subject.distances(&trials).expect("rollouts"));
    let model = mean(&distances(&silent(&log, 8), &subject, &trials).expect("rollouts"));
    // A draft holds contact planes over a frame where the solver looks for them anew: on a plane that is the same.
    let off = (own.position - model.position).abs();
    assert!(off < 0.02 * own.position, "{} m alone, {} m in the model", own.position, model.position);
}

#[test]
fn in_flight_slopes_are_those_of_differences() {
    let log = sample();
    let (subject, sequence) = (subject(&log), 12);
    let model = said(&silent(&log, sequence), 8, 0.05);
    // Half a diagonal of the cube is 0.091 m: above that it touches nothing.
    let high = |t: &Trial| t.measured.iter().all(|q| q[2] > 0.1);
    let trials: Vec<Trial> = log.trials(sequence + 1, 3).into_iter().filter(high).collect();
    let of = |model: &Model| slope(model, &subject, &trials, &UNIT).expect("a slope");
    let found = of(&model);
    for k in 0..13 {
        let told = found.slopes.iter().skip(k).step_by(13).sum::<f64>() / trials.len() as f64;
        let h = 1e-2;
        let measured = (of(&said(&model, k, h)).error - of(&said(&model, k, -h)).error) / (2.0 * f64::from(h));
        let off = (told - measured).abs();
        assert!(off < 0.02 * measured.abs() + 1e-3, "number {k}: slope {told:.4}, by differences {measured:.4}");
    }
}

#[test]
fn where_nothing_is_asked_there_is_no_slope() {
    // On a base of flight the network is not asked in the air, so nothing it could say there changes the rollout.
    let log = sample();
    let (subject, sequence) = (subject(&log), 8);
    let shape = SmallModel { base: Base::ExactFlight, embedding: 16, layers: 1, history: 1, sequence, scale: 1.0 };
    let model = shape.silent(&subject, "measured", &log.recording(sequence).expect("its frames"), 7).expect("a model");
    let trials = log.trials(sequence + 1, 3);
    let lowest = |t: &Trial| t.measured.iter().map(|q| q[2]).fold(f64::INFINITY, f64::min);
    // Half a diagonal is 0.091 m, and a centimetre more is looked at.
    let (high, low): (Vec<Trial>, Vec<Trial>) = trials.into_iter().partition(|t| lowest(t) > 0.11);
    let flown = slope(&model, &subject, &high, &UNIT).expect("a slope");
    assert!(flown.asked == 0 && flown.slopes.iter().all(|s| *s == 0.0), "asked in {} frames of flight", flown.asked);
    let before = flown.windows.y.clone();
    assert_eq!(flown.targets().y, before, "targets where nothing is asked");
    let touched = slope(&model, &subject, &low, &UNIT).expect("a slope");
    let frames = low.len() * sequence;
    assert!(touched.asked > 0 && touched.asked <= frames, "asked in {} of {frames} frames near the ground", touched.asked);
    let steep = touched.slopes.chunks_exact(13).filter(|s| s.iter().any(|x| *x != 0.0)).count();
    assert!(steep > 0 && steep <= touched.asked, "{steep} frames have a slope, {} were asked", touched.asked);
}

#[test]
fn a_rollout_that_cannot_be_finished_teaches_nothing() {
    let log = sample();
    let (subject, sequence) = (subject(&log), 8);
    let model = silent(&log, sequence);
    let mut trials: Vec<Trial> = log.trials(sequence + 1, 30).into_iter().take(6).collect();
    let alone = slope(&model, &subject, &trials[..1], &UNIT).expect("a slope").error;
    // A start at 1e300 m/s ends in no number.
    let speed = trials[0].start.len() - 1;
    trials.iter_mut().skip(1).for_each(|t| t.start[speed] = 1e300);
    let found = slope(&model, &subject, &trials, &UNIT).expect("a slope");
    assert_eq!(found.windows.trajectories(), 6, "the one that can be finished stands in the place of the others");
    assert!((found.error - alone).abs() < 1e-12 * alone, "{} with lost rollouts, {alone} alone", found.error);
    trials[0].start[speed] = 1e300;
    let said = slope(&model, &subject, &trials, &UNIT).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("none of 6 rollouts"), "{said}");
}

#[test]
fn down_the_slope_contact_comes_nearer() {
    // Contact has kinks, so slopes there are not those of differences. What counts is that the error falls along them.
    let log = sample();
    let (subject, sequence) = (subject(&log), 12);
    let model = silent(&log, sequence);
    let low = |t: &Trial| t.measured.iter().any(|q| q[2] < 0.08);
    let trials: Vec<Trial> = log.trials(sequence + 1, 3).into_iter().filter(low).collect();
    let of = |model: &Model| slope(model, &subject, &trials, &UNIT).expect("a slope");
    let found = of(&model);
    let along: Vec<f64> = (0..13).map(|k| found.slopes.iter().skip(k).step_by(13).sum::<f64>() / trials.len() as f64).collect();
    let steep = along.iter().map(|s| s * s).sum::<f64>().sqrt();
    // Larger ones throw about what lies still.
    let step = 0.002;
    let moved = along.iter().enumerate().fold(model, |model, (k, s)| said(&model, k, (-step * s / steep) as f32));
    let (fell, told) = (found.error - of(&moved).error, step * steep);
    assert!((0.7..1.5).contains(&(fell / told)), "the error fell by {fell:.2e}, the slope told {told:.2e}");
}

#[test]
fn what_a_calibration_left_out_is_learned() {
    // The truth has a centre of mass 6 mm off, the model's base has not.
    let log = sample();
    let wrong = subject(&log);
    let off = Parameter::named(&log.system, "com.z").expect("a parameter");
    let right = wrong.with(&[off], &[0.006]).expect("a subject");
    let moved = |trials: Vec<Trial>| -> Vec<Trial> {
        let motions = right.roll(&trials).expect("rollouts");
        trials.into_iter().zip(motions).map(|(t, measured)| Trial { measured, ..t }).collect()
    };
    let sequence = 16;
    let (train, validation) = (moved(log.trials(sequence + 1, 3)), moved(log.trials(40, 8)));
    let model = silent(&log, sequence);
    let unit = mean(&wrong.distances(&validation).expect("rollouts"));
    let unroll = Unroll { subject: &wrong, train: &train, validation: &validation, unit };
    let config = UnrollConfig { updates: 150, batch: 32, rate: 1e-3, validate_every: 15, seed: 0 };
    let (_, worth) = unroll.train(&model, config, &mut |_, _, _| ()).expect("training");
    assert!(worth < 0.9, "objective {worth:.3} of that without learning");
}
