//! Calibrated solvers beside the truth and beside models.

use std::path::Path;

use nerd_cli::experiments::Experiment;
use nerd_cli::experiments::calibrated::{CalibratedAll, Calibration, Runs};
use nerd_model::{base::Base, transformer::Storage};
use nerd_sim::prelude::*;

use super::{common, models, refusal};

#[test]
fn tosses_that_nothing_was_fitted_to_are_predicted_better() {
    let mut settings = Calibration::default();
    settings.log = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-sim/assets/logs/cube.log.toml")];
    (settings.solver, settings.splits, settings.frames, settings.every) = (vec!["articulated".into()], 3, 40, 16);
    (settings.evaluations, settings.rollouts) = (60, 24);
    settings.parameters = vec!["com.z".into(), "damping".into(), "lag".into()];
    // Models beside: one that adds nothing to the state, one of random weights that remembers, and one of another
    // robot.
    let (folder, cubes) = (tempfile::tempdir().expect("a folder"), System::named("cube-family").expect("built in"));
    let save = |name: &str, model: nerd_model::folder::Model| {
        let path = folder.path().join(name);
        model.save(&path, name, Storage::F32).expect("saved");
        path
    };
    let mut still = models::model(&cubes, Base::State);
    still.weights.flat.fill(0.0);
    // The identity quaternion: no rotation.
    still.normalizer.outputs.mean[6] = 1.0;
    let other = save("other", models::model(&System::named("pendulum").expect("built in"), Base::State));
    settings.model = vec![other];
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("of another robot than the log"), "{reason}");
    let mut remembers = models::placed(&cubes, Base::State, nerd_model::transformer::Positions::Rotary);
    remembers.normalizer.outputs =
        nerd_model::normalizer::Moments { variance: vec![1e-8; 13], ..still.normalizer.outputs.clone() };
    settings.model = vec![save("still", still), save("remembers", remembers)];
    let measured = settings.measure().expect("a calibration");
    let found: CalibratedAll = serde_json::from_value(measured.data.into()).expect("its data");
    let splits = &found.fitted[0].splits;
    assert!(splits.len() == 3 && splits.iter().any(|s| s.judged != splits[0].judged), "three splits of one kind");
    for split in splits {
        assert_eq!(split.judged.len(), 2, "half of the three tosses that 68 % of ten leave");
        assert!(split.fit.objective < 1.0, "the objective is {} of that without a fit", split.fit.objective);
        let [low, mean, high] = [&split.after.low, &split.after.mean, &split.after.high].map(|g| g.position);
        assert!(low <= mean && mean <= high, "{mean} m is not between {low} and {high}");
    }
    for (k, motionless) in found.still.iter().enumerate() {
        let [still, remembers] = &found.modelled[..] else { panic!("two models") };
        let apart = |g: &nerd_sim::calibrate::Distance| {
            (g.position - motionless.mean.position).abs() + (g.rotation - motionless.mean.rotation).abs()
        };
        assert!(apart(&still.shown[k].mean) < 1e-9 && apart(&still.withheld[k].mean) < 1e-9, "what adds nothing stays");
        let [shown, withheld] = [&remembers.shown[k].mean, &remembers.withheld[k].mean].map(|g| g.position);
        assert!(shown != withheld && shown.is_finite() && withheld.is_finite(), "shown {shown}, withheld {withheld}");
    }
    let text: String = measured.tables.iter().map(|table| table.markdown()).collect();
    assert!(
        ["no motion", "articulated(substeps=4), calibrated", "com.z (m)", "still, shown none"]
            .iter()
            .all(|word| text.contains(word)),
        "{text}"
    );
}

/// Five runs of a real double pendulum, with encoder zeros set by hand.
#[test]
fn what_a_run_has_of_its_own_is_told_by_its_first_frames() {
    let mut settings = Calibration::default();
    settings.log = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-sim/assets/logs/double-pendulum.log.toml")];
    let names = |all: &[&str]| all.iter().map(|name| name.to_string()).collect::<Vec<_>>();
    settings.per_trajectory = names(&["zero:shoulder", "zero:elbow"]);
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("--per-trajectory, --regularized and --context-frames belong together"), "{reason}");
    settings.parameters = names(&[
        "com.z:upper",
        "com.z:lower",
        "inertia:upper",
        "joint-friction:shoulder",
        "joint-friction:elbow",
        "delay",
    ]);
    settings.regularized = names(&["joint-friction:elbow", "strength:elbow"]);
    (settings.context_frames, settings.frames, settings.every, settings.splits) = (300, 60, 60, 2);
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("too few folds"), "{reason}");
    settings.solver = vec!["rapier".into()];
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("--solver says nothing"), "{reason}");
    settings.solver = Calibration::default().solver;
    (settings.splits, settings.every, settings.evaluations, settings.rollouts) = (3, 30, 400, 60);
    let measured = settings.measure().expect("a calibration");
    let found: Runs = serde_json::from_value(measured.data.into()).expect("its data");
    let mut ids: Vec<u64> = found.judged.iter().map(|run| run.id).collect();
    ids.sort_unstable();
    assert_eq!(
        (ids, found.lengths.clone(), found.weights.len()),
        (vec![10, 11, 12, 13, 17], vec![30, 60, 120], 3),
        "each once"
    );
    let error =
        |method: usize, length: usize| found.judged.iter().map(|run| run.errors[method][length]).sum::<f64>() / 5.0;
    let all: Vec<f64> = (0..6).map(|method| error(method, 1)).collect();
    println!("{all:.4?}, weights {:?}", found.weights);
    assert!(all[2] < 0.3 * all[0] && all[3] < 0.8 * all[2] && all[5] < 0.8 * all[2], "{all:?}");
    assert!((0..6).all(|method| error(method, 0) < error(method, 2)), "long rollouts err more");
    let text: String = measured.tables.iter().map(|table| table.markdown()).collect();
    assert!(
        text.contains("calibrated, with its own zero:shoulder, zero:elbow")
            && text.contains("held near what all share"),
        "{text}"
    );
}

/// rapier has no dry friction: it is left out, and the other solvers go on.
#[test]
fn a_solver_that_cannot_is_left_out_and_the_others_go_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    file("dry.urdf", common::DRY);
    file(
        "dry.log.toml",
        "file = \"dry.csv\"\nrobot = \"dry.urdf\"\nscene = \"free\"\ntrajectory = \"n\"\ntime = \"t\"\n[[joint]]\nname = \"j\"\nposition = \"q\"\nvelocity = \"v\"\n",
    );
    let row = |n: usize, k: usize| {
        let (t, w) = (k as f64 / 60.0, 5.7f64);
        let (sin, cos) = (w * t).sin_cos();
        format!("{n},{t},{},{}\n", 0.01 * n as f64 * cos, -0.01 * n as f64 * w * sin)
    };
    file(
        "dry.csv",
        &(1..9).flat_map(|n| (0..12).map(move |k| row(n, k))).fold("n,t,q,v\n".into(), |all: String, row| all + &row),
    );
    let mut settings = Calibration::default();
    settings.log = vec![folder.path().join("dry.log.toml")];
    (settings.splits, settings.frames, settings.every, settings.evaluations, settings.rollouts) = (1, 6, 3, 40, 8);
    let found = settings.all().expect("a calibration");
    let solvers: Vec<_> = found.fitted.iter().map(|fitted| &fitted.solver[..]).collect();
    assert_eq!(solvers, ["articulated(substeps=4)"]);
    settings.solver = vec!["rapier".into()];
    let reason = refusal(settings.all());
    assert!(reason.contains("`j` has dry friction"), "{reason}");
}
