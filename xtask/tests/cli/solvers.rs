//! One text of a solver is one motion, wherever it is named.

use nerd_cli::experiments::calibrated::engine;
use nerd_lab::experiments::stability::method;
use nerd_sim::prelude::*;
use nerd_train::spec::SolverSpec;

use crate::{Folder, done, root};

const FRAMES: usize = 50;
const TEXTS: [&str; 6] = [
    "articulated",
    "articulated(substeps=4)",
    "articulated(method=euler,substeps=64)",
    "rapier",
    "rapier(steps=1,iterations=8,axes=world)",
    "neural(models/ant)",
];

/// The Ant falls limp on its ground: bits of its state after 50 frames by command line, library (as Python and charts
/// have it), suite and calibration.
#[test]
fn command_line_library_suite_and_calibration_step_alike_to_the_bit() {
    let (folder, system) = (Folder::new(), System::named("ant").expect("built in"));
    let (scene, start) = (system.scene("ground").expect("its scene"), system.default_state());
    let states = folder.path("start.csv");
    let numbers = |state: &[f64]| state.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(",");
    let table = format!("traj,step,{}\n0,0,{}\n", system.spec.state_columns.join(","), numbers(&start));
    std::fs::write(&states, table).expect("a table");
    let rolled = |solver: &mut dyn Solver| {
        let mut batch = Batch::new(&system, &scene, 1);
        batch.reset(0, &start);
        let torques = vec![0.0; system.robot.joint_count()];
        (0..FRAMES).for_each(|_| solver.step(&mut batch, &torques).expect("a frame"));
        batch.state(0).to_vec()
    };
    let model = format!("neural({})", root().join("models/ant").display());
    for (k, text) in TEXTS.map(|text| if text.starts_with("neural") { &model } else { text }).into_iter().enumerate() {
        let (out, spec) = (folder.path(&format!("{k}.csv")), text.parse::<SolverSpec>().expect("a solver"));
        let line = format!("rollout --robot ant --scene ground --frames {FRAMES} --solver {text} --states");
        done(&line, &[&states, "--out".as_ref(), &out]);
        let table = std::fs::read_to_string(&out).expect("a table");
        let last: Vec<f64> =
            table.lines().last().expect("rows").split(',').skip(2).map(|x| x.parse().expect("a number")).collect();
        let library = rolled(&mut *spec.solver(&system, 1).expect("a solver"));
        let mut all = vec![("library", library), ("suite", rolled(&mut *method(text, spec.clone()).solver(&system)))];
        if spec.folder().is_none() {
            all.push(("calibration", rolled(&mut *engine(&spec, &system).expect("an engine").solver())));
        }
        println!(
            "{text}: root at {:?} by command line, {}",
            &last[..3],
            all.iter().map(|(who, s)| format!("{:?} by {who}", &s[..3])).collect::<Vec<_>>().join(", ")
        );
        assert!(last != start, "{text}: it did not move");
        for (who, state) in all {
            let bits = |state: &[f64]| state.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&state), bits(&last), "{text}: {who} beside the command line");
        }
    }
}
