//! A real double pendulum: its runs differ in the zeros of its encoders, which the first seconds of a run determine.

use std::path::Path;

use nerd_sim::{calibrate::*, log::Log, prelude::*};

/// Parameters that all runs share.
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
/// Parameters of each run, and shared ones that a run may vary slightly.
const ZEROS: [&str; 2] = ["zero:shoulder", "zero:elbow"];
const FRICTION: [&str; 2] = ["joint-friction:shoulder", "joint-friction:elbow"];
/// The held-out run, and its frames used to fit its zeros.
const JUDGED: u64 = 12;
const KNOWN: usize = 300;

fn parameters(system: &System, names: &[&str]) -> Vec<Parameter> {
    names.iter().map(|name| Parameter::named(system, name).expect("a parameter")).collect()
}

fn apart(subject: &Subject, trials: &[Trial]) -> f64 {
    mean(&subject.distances(trials).expect("rollouts")).joints
}

/// Errors over 1 s from 3 s on, the mean of both joints (rad). The held-out run repeats no command of the others.
#[test]
fn a_run_tells_its_own_zeros() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/logs/double-pendulum.log.toml");
    let log = Log::read(&path, None).expect("the sample");
    assert_eq!(
        log.trajectories.iter().map(|t| (t.id, t.states.len())).collect::<Vec<_>>(),
        [10, 11, 12, 13, 17].map(|id| (id, 997))
    );
    let engine = Engine::Articulated(ArticulatedConfig::accurate(&log.system));
    let nominal = Subject::new(&log.system, "free", engine).expect("a scene");
    let learned: Vec<Trial> = log.trials(60, 30).into_iter().filter(|t| t.id != JUDGED).collect();
    let config = FitConfig { evaluations: 600, trials: 300, ..FitConfig::default() };
    let shared = parameters(&log.system, &SHARED);
    let plain = nominal.fit(&shared, &learned, config, &mut |_, _| ()).expect("a fit");
    let fit =
        nominal.fit_own([&shared, &parameters(&log.system, &ZEROS)], &learned, config, &mut |_, _| ()).expect("a fit");
    let fitted = nominal.with(&shared, &fit.shared.values).expect("values");
    let of = |length: usize, every: usize| {
        log.trials(length, every).into_iter().filter(|t| t.id == JUDGED).collect::<Vec<_>>()
    };
    let (mut trials, mut seen) = (of(101, 25), of(51, 10));
    trials.retain(|t| t.first >= KNOWN);
    seen.retain(|t| t.first + 51 <= KNOWN + 1);
    let told = |names: &[&str], weight: f64| {
        let all = parameters(&fitted.system, names);
        let all: Vec<Parameter> = all
            .iter()
            .map(|p| if FRICTION.contains(&&p.name[..]) { p.near(p.nominal, weight) } else { p.clone() })
            .collect();
        let fit = fitted.fit(&all, &seen, config, &mut |_, _| ()).expect("a fit");
        let ways: f64 =
            all.iter().zip(&fit.values).skip(ZEROS.len()).map(|(p, v)| (p.place(*v) - p.place(p.nominal)).abs()).sum();
        (apart(&fitted.with(&all, &fit.values).expect("values"), &trials), ways)
    };
    let still = |t: &Trial| distance(&log.system, &vec![t.measured[0].clone(); t.measured.len()], &t.measured);
    let hold = mean(&trials.iter().map(still).collect::<Vec<_>>()).joints;
    let calibrated = apart(&nominal.with(&shared, &plain.values).expect("values"), &trials);
    assert!(hold > 0.4 && calibrated < 0.2 * hold, "{calibrated} of {hold}");
    let (zeros, own) = (told(&ZEROS, 0.0).0, [ZEROS, FRICTION].concat());
    let found = [0.0, 10.0, 1e5].map(|weight| told(&own, weight));
    println!(
        "calibrated {calibrated:.4}, its zeros {zeros:.4}, and its friction, ever nearer what all share {found:.5?}"
    );
    assert!(zeros < 0.4 * calibrated && found.iter().all(|f| f.0 < 0.4 * calibrated), "{zeros} {found:?}");
    // The higher the cost of leaving the nominal value, the less a parameter moves; finally not at all.
    assert!(found[0].1 > found[1].1 && found[1].1 > found[2].1 && found[2].1 < 1e-3, "{found:?}");
    assert!((found[2].0 - zeros).abs() < 1e-3 * hold, "{zeros} {found:?}");
}
