//! Recorded motion as the truth: training, held-out trajectories, and solvers beside the model.

use std::fmt::Write;

use nerd_sim::log::Trajectory;
use nerd_train::evaluate::Pieces;
use nerd_train::measured::Measured;
use nerd_train::verdict::recorded::{Beside, recorded};
use serde_json::Value;

use crate::*;

/// A wheel on a vertical axle with damping.
pub const WHEEL: &str = r#"<robot name="wheel"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02"
    ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit effort="1" velocity="8"/><dynamics damping="0.05"/></joint></robot>"#;
const LOG: &str = "file = \"turns.csv\"\nrobot = \"wheel.urdf\"\nscene = \"free\"\ntrajectory = \"run\"\ntime = \"t\"\n\
    [[joint]]\nname = \"j\"\nposition = \"q\"\nvelocity = \"v\"\ntorque = \"u\"\n";

/// A log of `runs` runs of 60 frames; every fifth begins `odd` times as fast.
fn log(folder: &Path, runs: u64, odd: f64) {
    std::fs::write(folder.join("wheel.urdf"), WHEEL).expect("written");
    std::fs::write(folder.join("wheel.toml"), "like = \"urdf\"\nfloating = false\nframe_time = 0.02\n")
        .expect("written");
    std::fs::write(folder.join("log.toml"), LOG).expect("written");
    let system = System::named(&folder.join("wheel.urdf").display().to_string()).expect("a robot");
    let mut solver = Truth::Articulated.solver(&system);
    let mut text = String::from("run,t,q,v,u\n");
    for run in 0..runs {
        let mut rng = stream(3, run);
        let mut batch = Batch::new(&system, &system.scene("free").expect("a scene"), 1);
        let fast = if run % 5 == 4 { odd } else { 1.0 };
        batch.reset(0, &[normal(&mut rng), fast * normal(&mut rng)]);
        for frame in 0..60 {
            let (torque, state) = (0.3 * normal(&mut rng), batch.state(0).to_vec());
            let cell = if frame < 59 { torque.to_string() } else { String::new() };
            writeln!(text, "{run},{},{},{},{cell}", f64::from(frame) * 0.02, state[0], state[1]).expect("a text");
            solver.step(&mut batch, &[torque]).expect("a step");
        }
    }
    std::fs::write(folder.join("turns.csv"), text).expect("written");
}

fn config(folder: &Path, out: &str) -> RunConfig {
    let mut run = RunConfig::recipe("quick", "wheel", folder.join(out)).expect("shipped");
    (run.data, run.robot) = (Some(folder.into()), String::new());
    (run.embedding, run.layers, run.batch) = (16, 1, 64);
    (run.updates, run.rollouts, run.warmup, run.log_every) = (400, 8, 10, 100);
    run
}

#[test]
fn recorded_motion_is_learned_and_judged_by_what_was_held_out() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path(), 12, 1.0);
    let done = Run::new(&config(folder.path(), "a")).expect("a run").train().expect("trained").expect("a model");
    let system = System::named(&folder.path().join("wheel.urdf").display().to_string()).expect("a robot");
    let model = Model::load(&done, &system, None).expect("a model");
    let measured = Measured::of(&folder.path().join("log.toml"), &model).expect("its log");
    let card = &model.config;
    assert_eq!(card.truth, Measured::name(&folder.path().join("log.toml")));
    assert!(card.truth.starts_with("recorded ") && card.data_sha256 == measured.sha256, "{card:?}");
    assert_eq!((card.provenance["held out"].as_str(), measured.size()), ("4, 9", [9, 9 * 59]), "{card:?}");
    assert_eq!(measured.choosing.iter().map(|t| t.id).collect::<Vec<_>>(), [6]);
    let text = std::fs::read_to_string(done.join("README.md")).expect("a card");
    assert!(text.contains("531 transitions of 9 recorded trajectories") && text.contains("What it is worth"), "{text}");

    let pieces = measured.pieces(&measured.held_out, [0, 50, 50], 64).expect("pieces");
    let analytic = [
        ("as described", measured.described().expect("a scene")),
        ("calibrated", measured.calibrated(50, 60).expect("a fit")),
    ];
    let found = recorded(&measured, &pieces, &model, &analytic, None).expect("a verdict").expect("of a network");
    assert!(found.model.mean() < 0.5 * found.base.mean(), "{found}");
    // The motion is linear, and the solver made it.
    assert!(found.linear.mean() < 1e-3 * found.base.mean(), "{found}");
    assert!(found.articulated.iter().all(|row| row.mean() < 1e-6), "{found}");
    assert!(found.line().starts_with("use the solver"), "{found}");
    assert!(found.to_string().contains("2 starts, 50 frames with their torques, 0 frames seen before each"), "{found}");

    // Another log of the same motions, from frame 10 on, offset by 0.1 rad.
    let off = |t: &Trajectory| {
        let state = |(k, s): (usize, &Vec<f64>)| vec![s[0] + if k > 0 { 0.1 } else { 0.0 }, s[1]];
        Trajectory {
            id: 0,
            states: t.states[10..].iter().enumerate().map(state).collect(),
            torques: t.torques[10..].to_vec(),
        }
    };
    let mut other =
        nerd_sim::log::Log { trajectories: measured.held_out.iter().map(off).collect(), ..measured.log.clone() };
    let (pieces, states) = measured.beside(&other, 3, None, 64).expect("pieces");
    assert_eq!(
        (pieces.count(), pieces.before, pieces.frames(), pieces.all.state(0, 3)),
        (2, 3, 49, &measured.held_out[0].states[10][..])
    );
    let beside = Some(Beside { of: "off".into(), states, microseconds: 0.0 });
    let found = recorded(&measured, &pieces, &model, &analytic[..1], beside).expect("a verdict").expect("of a network");
    assert!(found.beside.first().is_some_and(|row| (row.errors[0] - 0.1).abs() < 1e-12), "{found}");
    assert!(found.to_string().contains("| off") && found.line().contains("; off "), "{found}");
    other.trajectories.iter_mut().for_each(|t| t.states[0][0] += 1e-9);
    let said = measured.beside(&other, 3, None, 64).map(drop).expect_err("other starts").to_string();
    assert!(said.starts_with("--beside") && said.lines().count() == 1, "{said}");

    // Held-out trajectories do not affect the weights.
    let weights = |folder: &Path| std::fs::read(folder.join("model.safetensors")).expect("weights");
    let before = weights(&done);
    log(folder.path(), 12, 3.0);
    let again = Run::new(&config(folder.path(), "b")).expect("a run").train().expect("trained").expect("a model");
    assert!(weights(&again) == before, "other held-out trajectories make another model");
    // This log was not learned: the model is evaluated where the calibrated solver was not fitted.
    let other = Measured::of(&folder.path().join("log.toml"), &model).expect("a log");
    assert_eq!((other.held_out.iter().map(|t| t.id).collect::<Vec<_>>(), other.size()[0]), (vec![4, 9], 9));
    assert!(Truth::named(&card.truth).is_err_and(|e| e.contains("evaluate --data")), "no solver is what was recorded");
}

/// Windows, streams and training through rollouts. With too few trajectories, the last fifth of each is held out.
#[test]
fn every_form_learns_from_a_log() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path(), 3, 1.0);
    let run = |out: &str, change: &dyn Fn(&mut RunConfig)| {
        let mut run = config(folder.path(), out);
        (run.updates, run.validate_every) = (2, Some(1));
        change(&mut run);
        Run::new(&run).and_then(|run| run.train()).unwrap_or_else(|e| panic!("{out}: {e}")).expect("a model")
    };
    let first = run("first", &|_| ());
    run("window", &|run| (run.history, run.head_width, run.base) = (5, 8, nerd_model::base::Base::Trapezoid));
    run("stream", &|run| (run.stream, run.history, run.head_width, run.sequence) = (true, 4, 8, Some(6)));
    run("rolled", &|run| (run.from, run.sequence, run.epsilon, run.huber) = (Some(first.clone()), Some(6), None, None));
    let text = std::fs::read_to_string(first.join("README.md")).expect("a card");
    assert!(text.contains("the last 1/5 of each trajectory"), "{text}");
}

#[test]
fn what_means_nothing_beside_a_log_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path(), 6, 1.0);
    let cases: [(&str, Value, &str); 6] = [
        ("fresh-transitions", 1000.into(), "--fresh-transitions"),
        ("transitions", 1000.into(), "--transitions"),
        ("robot", "pendulum".into(), "names it"),
        ("truth", "paper".into(), "--truth"),
        ("held-out", vec![7].into(), "--held-out 7"),
        ("history", 200.into(), "no sequence"),
    ];
    for (key, value, words) in cases {
        let [data, out] =
            [folder.path().to_path_buf(), folder.path().join("x")].map(|path| Value::from(path.display().to_string()));
        let given: Given = [("data", data), ("out", out), (key, value)]
            .map(|(key, value)| (key.to_string(), value))
            .into_iter()
            .collect();
        let said = Recipe::plain(&given).and_then(|recipe| recipe.train()).expect_err(key).to_string();
        assert!(said.contains(words) && said.lines().count() == 1, "{key}: {said}");
    }
}

/// Moves nothing, and records the states and frame numbers that it is given.
#[derive(Default)]
struct Spy(Vec<(Vec<f64>, u64)>);

impl Solver for Spy {
    fn step(&mut self, batch: &mut Batch, _: &[f64]) -> Result<(), StepError> {
        self.0.push((batch.states.clone(), batch.frames[0]));
        batch.frames.iter_mut().for_each(|f| *f += 1);
        Ok(())
    }
}

/// A solver is given frames without a gap, and its errors count from the last given frame on.
#[test]
fn frames_before_a_start_are_shown_as_they_were() {
    let system = System::named("pendulum").expect("built in");
    let scene = system.scene("free").expect("a scene");
    let states = (0..6).flat_map(|k| [0.1 * f64::from(k), 0.0, 0.0, 0.0]).collect();
    let all =
        Trajectories { count: 1, frames: 5, scenes: vec![scene], torques: vec![0.0; 10], states, ..Default::default() };
    let pieces = Pieces { system, before: 3, all };
    let mut spy = Spy::default();
    let report = pieces.compare(&mut spy).expect("a report");
    let seen: Vec<f64> = spy.0.iter().map(|(states, _)| states[0]).collect();
    assert_eq!(seen, [0.0, 0.1, 0.2, 0.1 * 3.0, 0.1 * 3.0], "what it was shown, and where it stayed");
    assert_eq!(spy.0.iter().map(|(_, frame)| *frame).collect::<Vec<_>>(), [0, 1, 2, 3, 4], "no gap");
    assert!((report.error[0] - 0.15).abs() < 1e-12 && report.error == report.hold, "{report:?}");
}
