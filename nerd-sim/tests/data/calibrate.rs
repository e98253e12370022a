//! Calibration recovers the parameters behind the measurements, and shows which ones they do not determine.

use nerd_sim::{calibrate::*, log::Log, prelude::*};

use crate::common::{built_in, line};
use crate::tossed::{cube, folder, header, text, tosses};

/// The cube as its file describes it, on its table.
fn subject(system: &Arc<System>) -> Subject {
    // As in `tosses`: another number of substeps changes the effective friction by some percent.
    let implicit = ArticulatedConfig::implicit(16, Friction::Coulomb);
    Subject::new(system, "ground", Engine::Articulated(implicit)).expect("a table")
}

fn parameters(system: &System, names: &[&str]) -> Vec<Parameter> {
    names.iter().map(|name| Parameter::named(system, name).expect("a parameter")).collect()
}

/// Tosses of a cube with these parameter values, read as a log of the cube as described.
fn log(names: &[&str], values: &[f64]) -> Log {
    let described = subject(&cube());
    let truth = described.with(&parameters(&cube(), names), values).expect("values");
    let folder = folder(&text(&tosses(&truth.system, 12, 60)), header());
    Log::read(&folder.path().join("cube.log.toml"), None).expect("a log")
}

#[test]
fn a_shifted_mass_and_a_smooth_table_are_found() {
    let (names, truth) = (["com.z", "friction"], [0.008, 0.3]);
    let log = log(&names, &truth);
    let subject = self::subject(&log.system);
    let trials = log.trials(40, 20);
    let chosen = parameters(&log.system, &names);
    let config = FitConfig { evaluations: 400, trials: 24, seed: 1, ..FitConfig::default() };
    let mut told = 0;
    let fit = subject.fit(&chosen, &trials, config, &mut |done, _| told = done).expect("a fit");
    let off = [(fit.values[0] - truth[0]).abs(), (fit.values[1] - truth[1]).abs()];
    assert!(off[0] < 5e-4 && off[1] < 0.01, "{off:?} from what made the measurements (m, 1)");
    assert!(fit.after.position < 0.2 * fit.before.position, "{:?} of {:?}", fit.after, fit.before);
    assert!((10..300).contains(&told), "a descent of {told} evaluations");
    // A solver without gradients is searched, with the whole budget of evaluations.
    let mut searched = Subject::new(&log.system, "ground", Engine::Rapier(RapierConfig::default())).expect("a table");
    searched.lag = subject.lag;
    let other = searched.fit(&chosen, &trials, config, &mut |done, _| told = done).expect("a fit");
    assert!(told >= 300 && other.objective < 0.9, "a search of {told} evaluations, objective {}", other.objective);
    // Along each parameter the objective is least at the fit.
    let profiles = subject.profiles(&chosen, &fit, &trials, 5).expect("profiles");
    for (profile, value) in profiles.iter().zip(&fit.values) {
        let least = profile.iter().min_by(|a, b| a[1].total_cmp(&b[1])).expect("places");
        assert!(
            profile.len() == 6 && (least[0] - value).abs() < 1e-9,
            "{profile:?} is least at {}, not {value}",
            least[0]
        );
    }
}

#[test]
fn twice_the_size_under_twice_the_gravity_moves_alike() {
    let mut system = (*built_in("pendulum")).clone();
    system.robot.joints_mut().for_each(|j| (j.damping, j.armature) = (0.0, 0.0));
    let system = Arc::new(system);
    let own = Subject::new(&system, "free", Engine::Articulated(ArticulatedConfig::converged(Friction::Coulomb)))
        .expect("a scene");
    let g = system.gravity().norm();
    let large = own.with(&parameters(&system, &["size", "gravity"]), &[2.0, 2.0 * g]).expect("values");
    let start = vec![0.3, -0.7, 0.5, 1.0];
    let torques = vec![vec![0.0; 2]; 60];
    let trial = Trial {
        id: 0,
        first: 0,
        measured: vec![start[..2].to_vec(); 61],
        start,
        torques,
        earlier: [vec![0.0; 2], vec![0.0; 2]],
    };
    let last = |s: &Subject| s.roll(std::slice::from_ref(&trial)).expect("a rollout")[0][60].clone();
    let (a, b) = (last(&own), last(&large));
    let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-9 && (a[0] - 0.3).abs() > 0.1, "{off:e} rad apart after a second: {a:?}, {b:?}");
}

/// Measured positions equal the described cube's, but the cube rotates with 1.2 times the inertia. Positions without
/// error get no weight, so angles alone determine the inertia. Every seed is accepted.
#[test]
fn what_is_right_already_weighs_nothing() {
    let (log, truth) = (log(&["inertia"], &[1.2]), 1.2);
    let (subject, mut trials) = (self::subject(&log.system), log.trials(40, 20));
    let own = subject.roll(&trials).expect("rollouts");
    for (trial, own) in trials.iter_mut().zip(own) {
        trial.measured.iter_mut().zip(own).for_each(|(q, own)| q[..3].copy_from_slice(&own[..3]));
    }
    let chosen = parameters(&log.system, &["inertia"]);
    let config = FitConfig { evaluations: 200, trials: 24, seed: u64::MAX, ..FitConfig::default() };
    for gradients in [true, false] {
        let fit = subject.fit(&chosen, &trials, FitConfig { gradients, ..config }, &mut |_, _| ()).expect("a fit");
        assert!(fit.gradients == gradients && fit.before.position == 0.0, "{fit:?}");
        assert!((fit.values[0] - truth).abs() < 0.02, "gradients {gradients}: {fit:?}");
    }
}

/// Rounded corners touch the planes that sharp corners touch; nominal values change nothing.
#[test]
fn values_mean_what_they_say() {
    let system = cube();
    let subject = self::subject(&system);
    let all = Parameter::usual(&system, "ground", false).expect("parameters");
    let nominal: Vec<f64> = all.iter().map(|p| p.nominal).collect();
    let same = subject.with(&all, &nominal).expect("values");
    assert_eq!(format!("{:?}", same.system.robot), format!("{:?}", system.robot), "nominal values change the robot");
    for p in &all {
        assert!(p.low <= p.nominal && p.nominal <= p.high, "{p:?}");
        for x in [0.0, 0.3, 1.0] {
            assert!((p.place(p.at(x)) - x).abs() < 1e-12, "{}: {x} becomes {}", p.name, p.place(p.at(x)));
        }
    }
    let rounded = subject.with(&parameters(&system, &["rounding"]), &[0.004]).expect("values");
    for (sharp, round) in system.robot.contact_points.iter().zip(&rounded.system.robot.contact_points) {
        for axis in 0..3 {
            let [sharp, round] = [sharp, round].map(|p| p.local[axis].abs() + p.radius);
            assert!((round - sharp).abs() < 1e-12, "a corner reaches {round} m, a sharp one {sharp} m");
        }
    }
    for (name, what) in
        [("colour", "choose from friction"), ("com.x:wheel", "LINK of cube"), ("joint-damping:knee", "no parameter")]
    {
        let said = line(Parameter::named(&system, name));
        assert!(said.contains(what), "{said}");
    }
    // `height` and `tilt` are relative to the table's present pose.
    let raised = subject.with(&parameters(&system, &["height", "tilt.x"]), &[0.01, 0.02]).expect("values");
    let spec = &raised.system.spec.scenes[0].plane;
    assert_eq!((spec.height, spec.angles[0]), (0.01, 0.02));
    let twice = raised.with(&parameters(&system, &["height"]), &[0.01]).expect("values");
    assert_eq!(twice.system.spec.scenes[0].plane.height, 0.02);
    assert!(
        subject.with(&parameters(&system, &["friction"]), &[0.3]).is_ok_and(|s| s.system.spec.material.friction == 0.3)
    );
    assert!(Parameter::named(&system, "friction:moon").is_err());
    let restitution = parameters(&system, &["restitution"]);
    assert!(line(subject.with(&restitution, &[0.1])).contains("restitution"));
    assert!(line(subject.fit(&all, &[], FitConfig::default(), &mut |_, _| ())).contains("no trials"));
}

/// rapier refuses the arm's dry friction: an error, not an arm that stands still.
#[test]
fn what_a_solver_refuses_is_an_error() {
    let urdf = include_str!("../../assets/logs/elbow.urdf").replace("friction=\"0\"", "friction=\"0.001\"");
    let system = Arc::new(
        System::from_text("elbow", &urdf, Some(include_str!("../../assets/logs/elbow.toml"))).expect("an elbow"),
    );
    let state = system.default_state();
    let torques = vec![vec![0.0]; 2];
    let trial = Trial {
        id: 0,
        first: 0,
        measured: vec![state[..8].to_vec(); 3],
        torques,
        start: state,
        earlier: [vec![0.0], vec![0.0]],
    };
    let subject = Subject::new(&system, "ground", Engine::Rapier(RapierConfig::default())).expect("a table");
    let said = line(subject.distances(&[trial]));
    assert!(said.contains("friction"), "{said}");
    assert!(
        Parameter::usual(&system, "ground", true)
            .expect("parameters")
            .iter()
            .all(|p| !p.name.starts_with("joint-friction"))
    );
}

/// The real double pendulum, as its file describes it.
fn swung() -> Subject {
    let system = System::named(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/logs/double-pendulum.urdf"))
        .expect("the sample's robot");
    let engine = Engine::Articulated(ArticulatedConfig::accurate(&system));
    Subject::new(&system, "free", engine).expect("a scene")
}

/// Sensor readings of a subject's rollout under torques that change every frame, in pieces of 40 frames of one
/// trajectory.
fn shown(subject: &Subject, id: u64, frames: usize) -> Vec<Trial> {
    let mut rng = stream(11, id);
    let torques: Vec<Vec<f64>> =
        (0..frames).map(|_| [0.6, 0.4].map(|most| most * nerd_sim::sampling::normal(&mut rng)).to_vec()).collect();
    let mut solver = subject.engine.solver();
    let mut batch = Batch::new(&subject.system, &subject.scene, 1);
    batch.reset(0, &[0.2 * id as f64, -0.3, 0.0, 0.0]);
    let mut states = vec![batch.state(0).to_vec()];
    for k in 0..frames {
        let asked = [0, 1, 2].map(|back: usize| &torques[k.saturating_sub(back)][..]);
        solver.step(&mut batch, &subject.late(&asked)).expect("a step");
        states.push(batch.state(0).to_vec());
    }
    states.iter_mut().for_each(|state| subject.shift(&mut state[..2], -1.0));
    let trajectory = nerd_sim::log::Trajectory { id, torques: [&torques[..], &[vec![0.0; 2]]].concat(), states };
    let log = Log {
        about: None,
        cost: None,
        system: subject.system.clone(),
        scene: "free".into(),
        trajectories: vec![trajectory],
        notes: vec![],
        folds: vec![],
        published: vec![],
    };
    log.trials(41, 40)
}

/// Any delay of torques: less than a frame, a frame, more, and the largest.
#[test]
fn a_delay_is_found_over_two_frames() {
    let (nominal, config) = (swung(), FitConfig { evaluations: 200, ..FitConfig::default() });
    let mut delay = parameters(&nominal.system, &["delay"]);
    delay[0].high = nerd_sim::rig::LATEST;
    for truth in [0.3, 1.0, 1.6, 2.0] {
        let made = nominal.with(&delay, &[truth]).expect("a value");
        let fit = nominal.fit(&delay, &shown(&made, 0, 400), config, &mut |_, _| ()).expect("a fit");
        assert!((fit.values[0] - truth).abs() < 0.02, "{} frames, {truth} made the measurements", fit.values[0]);
    }
}

/// Delay and strength of torques, armature and dry friction are found together with the zeros of sensors, which differ
/// by trajectory.
#[test]
fn drives_and_sensors_are_found() {
    let nominal = swung();
    let names = ["armature:elbow", "joint-friction:shoulder", "delay", "strength:elbow"];
    let (shared, truth) = (parameters(&nominal.system, &names), [0.006, 0.05, 0.6, 0.9]);
    let own = parameters(&nominal.system, &["zero:shoulder", "zero:elbow"]);
    let zeros = [[0.06, -0.03], [-0.05, 0.1], [0.02, 0.04]];
    let trials = zeros.iter().enumerate().flat_map(|(k, zeros)| {
        let values = [&truth[..], zeros].concat();
        let made = nominal.with(&[&shared[..], &own].concat(), &values).expect("values");
        shown(&made, k as u64, 400)
    });
    let trials: Vec<Trial> = trials.collect();
    let config = FitConfig { evaluations: 1000, trials: 100, ..FitConfig::default() };
    let fit = nominal.fit_own([&shared, &own], &trials, config, &mut |_, _| ()).expect("a fit");
    assert!(fit.shared.after.joints < 0.01 * fit.shared.before.joints, "{:?}", fit.shared);
    for ((name, found), true_) in names.iter().zip(&fit.shared.values).zip(&truth) {
        assert!((found - true_).abs() < 0.02 * true_, "{name}: {found}, {true_} made the measurements");
    }
    for (k, zeros) in zeros.iter().enumerate() {
        let off = fit.own[&(k as u64)].iter().zip(zeros).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3, "trajectory {k}: zeros {:?}, {zeros:?} made the measurements", fit.own[&(k as u64)]);
    }
    // The shared parameters alone fit no trajectory.
    let told = nominal.with(&shared, &fit.shared.values).expect("values");
    let [without, with] = [told.clone(), told.with(&own, &fit.own[&1]).expect("values")].map(|s| {
        let own: Vec<Trial> = trials.iter().filter(|t| t.id == 1).cloned().collect();
        mean(&s.distances(&own).expect("rollouts")).joints
    });
    assert!(with < 0.05 * without, "{with} rad with its zeros, {without} without");
    let rapier = Subject::new(&nominal.system, "free", Engine::Rapier(RapierConfig::default())).expect("a scene");
    assert!(rapier.fit_own([&[], &own], &trials, config, &mut |_, _| ()).is_err());
}
