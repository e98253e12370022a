//! A real double pendulum: its runs differ in the zeros of its encoders, which the first seconds of a run tell.

use std::path::Path;

use nerd_sim::{calibrate::*, log::Log, prelude::*};

/// What runs share.
const SHARED: [&str; 10] = [
    "com.z:upper",
    "com.z:lower",
    "inertia:upper",
    "inertia:lower",
    "armature:elbow",
    "joint-damping:shoulder",
    "joint-damping:elbow",
    "joint-friction:shoulder",
    "joint-friction:elbow",
    "delay",
];
/// What each has of its own: what is fitted of all, and what is fitted to the first seconds of a run that is judged.
const ZEROS: [&str; 2] = ["zero:shoulder", "zero:elbow"];
const OWN: [&str; 4] = ["zero:shoulder", "zero:elbow", "joint-friction:shoulder", "joint-friction:elbow"];
/// The run that is judged. Frames that are known of it, of a rollout, and between the starts of two.
const JUDGED: u64 = 12;
const KNOWN: usize = 300;
const FRAMES: usize = 100;
const EVERY: usize = 25;

fn parameters(system: &System, names: &[&str]) -> Vec<Parameter> {
    names.iter().map(|name| Parameter::named(system, name).expect("a parameter")).collect()
}

/// The sample that comes with the crate: what a run's first three seconds tell makes a third of the error of 1 s from there on, the mean of both
/// joints (rad). Nothing else of the run is known.
#[test]
fn a_run_tells_its_own_zeros() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/logs/double-pendulum.log.toml");
    let log = Log::read(&path, None).expect("the sample");
    assert_eq!(log.trajectories.iter().map(|t| (t.id, t.states.len())).collect::<Vec<_>>(), [10, 11, 12, 13, 17].map(|id| (id, 997)));
    let engine = Engine::Articulated(ArticulatedConfig::accurate(&log.system));
    let nominal = Subject::new(&log.system, "free", engine).expect("a scene");
    let learned: Vec<Trial> = log.trials(60, 30).into_iter().filter(|t| t.id != JUDGED).collect();
    let config = FitConfig { evaluations: 600, trials: 300, ..FitConfig::default() };
    let shared = parameters(&log.system, &SHARED);
    let fit = nominal.fit_own([&shared, &parameters(&log.system, &ZEROS)], &learned, config, &mut |_, _| ()).expect("a fit");
    let plain = nominal.fit(&shared, &learned, config, &mut |_, _| ()).expect("a fit");
    let fitted = nominal.with(&shared, &fit.shared.values).expect("values");
    let plain = nominal.with(&shared, &plain.values).expect("values");
    let of = |length: usize, every: usize| log.trials(length, every).into_iter().filter(|t| t.id == JUDGED);
    let trials: Vec<Trial> = of(FRAMES + 1, EVERY).filter(|t| t.first >= KNOWN).collect();
    let seen: Vec<Trial> = of(51, 10).filter(|t| t.first + 51 <= KNOWN + 1).collect();
    let still = |t: &Trial| distance(&log.system, &vec![t.measured[0].clone(); t.measured.len()], &t.measured);
    let hold = mean(&trials.iter().map(still).collect::<Vec<_>>()).joints;
    let apart = |subject: &Subject| mean(&subject.distances(&trials).expect("rollouts")).joints;
    let calibrated = apart(&plain);
    let [zeros, own] = [&ZEROS[..], &OWN].map(|names| {
        let own = parameters(&fitted.system, names);
        let fit = fitted.fit(&own, &seen, config, &mut |_, _| ()).expect("a fit");
        apart(&fitted.with(&own, &fit.values).expect("values"))
    });
    assert!(hold > 0.4 && calibrated < 0.2 * hold, "{calibrated} of {hold}");
    assert!(zeros < 0.4 * calibrated && own < 0.4 * calibrated, "{zeros} and {own} of {calibrated}");
}
