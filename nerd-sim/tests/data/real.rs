//! A real double pendulum: its runs differ in the zeros of its encoders, which the first seconds of a run tell.

use std::path::{Path, PathBuf};

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
/// Frames that are known of a run, of a rollout, and between the starts of two.
const KNOWN: usize = 300;
const FRAMES: usize = 100;
const EVERY: usize = 25;

/// Errors of 1 s from 3 s on, the mean of both joints (rad), by run.
#[derive(Default)]
struct Errors {
    hold: Vec<f64>,
    calibrated: Vec<f64>,
    zeros: Vec<f64>,
    own: Vec<f64>,
}

fn parameters(system: &System, names: &[&str]) -> Vec<Parameter> {
    names.iter().map(|name| Parameter::named(system, name).expect("a parameter")).collect()
}

fn apart(subject: &Subject, trials: &[Trial]) -> f64 {
    mean(&subject.distances(trials).expect("rollouts")).joints
}

/// Calibrates on some runs and judges the others, which nothing but their first three seconds is known of.
fn judge(log: &Log, judged: &[u64], found: &mut Errors) {
    let engine = Engine::Articulated(ArticulatedConfig::accurate(&log.system));
    let nominal = Subject::new(&log.system, "free", engine).expect("a scene");
    let (learned, others): (Vec<Trial>, Vec<Trial>) = log.trials(60, 30).into_iter().partition(|t| !judged.contains(&t.id));
    assert!(!others.is_empty());
    let config = FitConfig { evaluations: 600, trials: 300, ..FitConfig::default() };
    let shared = parameters(&log.system, &SHARED);
    let fit = nominal.fit_own([&shared, &parameters(&log.system, &ZEROS)], &learned, config, &mut |_, _| ()).expect("a fit");
    let plain = nominal.fit(&shared, &learned, config, &mut |_, _| ()).expect("a fit");
    let fitted = nominal.with(&shared, &fit.shared.values).expect("values");
    let plain = nominal.with(&shared, &plain.values).expect("values");
    for id in judged {
        let of = |length: usize, every: usize| log.trials(length, every).into_iter().filter(|t| t.id == *id).collect::<Vec<_>>();
        let mut trials = of(FRAMES + 1, EVERY);
        trials.retain(|t| t.first >= KNOWN);
        let mut seen = of(51, 10);
        seen.retain(|t| t.first + 51 <= KNOWN + 1);
        let still = |t: &Trial| distance(&log.system, &vec![t.measured[0].clone(); t.measured.len()], &t.measured);
        found.hold.push(mean(&trials.iter().map(still).collect::<Vec<_>>()).joints);
        found.calibrated.push(apart(&plain, &trials));
        for (names, errors) in [(&ZEROS[..], &mut found.zeros), (&OWN[..], &mut found.own)] {
            let own = parameters(&fitted.system, names);
            let fit = fitted.fit(&own, &seen, config, &mut |_, _| ()).expect("a fit");
            errors.push(apart(&fitted.with(&own, &fit.values).expect("values"), &trials));
        }
        println!(
            "run {id}: hold {:.3}, calibrated {:.4}, its zeros {:.4}, its zeros and friction {:.4} ({:.4?})",
            found.hold[found.hold.len() - 1],
            found.calibrated[found.hold.len() - 1],
            found.zeros[found.hold.len() - 1],
            found.own[found.hold.len() - 1],
            fit.shared.values
        );
    }
}

fn average(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// The sample that comes with the crate: what a run's first three seconds tell makes a third of the error.
#[test]
fn a_run_tells_its_own_zeros() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/logs/double-pendulum.log.toml");
    let log = Log::read(&path, None).expect("the sample");
    assert_eq!(log.trajectories.iter().map(|t| (t.id, t.states.len())).collect::<Vec<_>>(), [10, 11, 12, 13, 17].map(|id| (id, 997)));
    let mut found = Errors::default();
    judge(&log, &[12], &mut found);
    assert!(found.hold[0] > 0.4 && found.calibrated[0] < 0.2 * found.hold[0], "{} of {}", found.calibrated[0], found.hold[0]);
    assert!(found.zeros[0] < 0.4 * found.calibrated[0] && found.own[0] < 0.4 * found.calibrated[0], "{:?} {:?}", found.zeros, found.own);
}

/// All runs under sinusoidal torques, in the folder that NERD_DOUBLE_PENDULUM names (`meta.csv`, `100hz`): three folds by run, for each of the
/// three builds on its own. Another study's calibration with zeros and friction of each run erred by .0211 rad, on four runs more.
#[test]
fn all_runs_in_three_folds() {
    let Some(data) = std::env::var_os("NERD_DOUBLE_PENDULUM").map(PathBuf::from) else { return };
    let meta = std::fs::read_to_string(data.join("meta.csv")).expect("meta.csv");
    let names: Vec<&str> = meta.lines().next().expect("a header").split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).expect("a column");
    let [traj, design, kind, fold] = ["traj", "design", "kind", "cv_fold"].map(column);
    let rows: Vec<Vec<&str>> =
        meta.lines().skip(1).map(|l| l.split(',').collect()).filter(|r: &Vec<&str>| r[kind] == "sine_feedforward").collect();
    let (assets, folder) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/logs"), tempfile::tempdir().expect("a folder"));
    let text = |name: &str| std::fs::read_to_string(assets.join(name)).expect("the sample's");
    std::fs::write(folder.path().join("double-pendulum.toml"), text("double-pendulum.toml")).expect("written");
    let mut found = Errors::default();
    for build in ["A.0", "C.0", "C.1"] {
        let urdf = text("double-pendulum.urdf");
        // The lengths of C are the other way round.
        let urdf = if build == "A.0" { urdf } else { urdf.replace("xyz=\"0 0 -0.3\"", "xyz=\"0 0 -0.2\"").replace("-0.15", "-0.22") };
        std::fs::write(folder.path().join("double-pendulum.urdf"), urdf).expect("written");
        let own: Vec<&Vec<&str>> = rows.iter().filter(|r| r[design] == build).collect();
        let ids: Vec<&str> = own.iter().map(|r| r[traj]).collect();
        let log = text("double-pendulum.log.toml")
            .replace("trajectory = \"run\"", &format!("trajectory = \"traj\"\nonly = [{}]", ids.join(", ")));
        let log = log.replace("\"double-pendulum.csv\"", &format!("{:?}", data.join("100hz").display().to_string()));
        let path = folder.path().join("log.toml");
        std::fs::write(&path, log).expect("written");
        let log = Log::read(&path, None).expect("the data");
        for part in ["0", "1", "2"] {
            let judged: Vec<u64> = own.iter().filter(|r| r[fold] == part).map(|r| r[traj].parse().expect("a number")).collect();
            judge(&log, &judged, &mut found);
        }
    }
    let [hold, calibrated, zeros, own] = [&found.hold, &found.calibrated, &found.zeros, &found.own].map(|x| average(x));
    println!(
        "{} runs: hold {hold:.3}, calibrated {calibrated:.4}, with zeros of the run {zeros:.4}, and friction {own:.4}",
        found.hold.len()
    );
    assert_eq!(found.hold.len(), 22);
    assert!(zeros < 0.7 * calibrated && own < 0.0211, "{zeros} and {own} of {calibrated} rad");
}
