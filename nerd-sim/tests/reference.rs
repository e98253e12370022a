//! `articulated`, preset `paper`, against trajectories of the reference simulator (f32), read from `../shared/reference`
//! beside the checkout when it is there.
//!
//! Bounds: the reference computes in f32, so single steps differ by about 1e-7 and a hundred steps by 1e-6 to 1e-4
//! (chaotic near contact); a wrong term shows at 1e-2 and above.

use std::path::{Path, PathBuf};

use nerd_core::state::wrap;
use nerd_sim::prelude::*;

/// Rows of one trajectory: state columns and torques by step.
struct Trajectory {
    states: Vec<Vec<f64>>,
    torques: Vec<Vec<f64>>,
}

fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/reference");
    if !folder.is_dir() {
        println!("skipped: no reference data");
    }
    folder.is_dir().then_some(folder)
}

fn read(path: &Path, system: &System) -> Vec<Trajectory> {
    let mut reader = csv::Reader::from_path(path).expect("reference file opens");
    let header = reader.headers().expect("header").clone();
    let column = |name: &str| header.iter().position(|h| h == name).expect("column");
    let states: Vec<usize> = system.spec.state_columns.iter().map(|n| column(n)).collect();
    let torques: Vec<usize> = header.iter().enumerate().filter(|(_, h)| h.starts_with("tau")).map(|(i, _)| i).collect();
    let mut out: Vec<Trajectory> = Vec::new();
    for record in reader.records() {
        let record = record.expect("row");
        let number = |i: usize| record[i].parse::<f64>().unwrap_or(0.0);
        if number(column("step")) == 0.0 {
            out.push(Trajectory { states: Vec::new(), torques: Vec::new() });
        }
        let last = out.last_mut().expect("step 0 comes first");
        last.states.push(states.iter().map(|&i| number(i)).collect());
        last.torques.push(if torques.is_empty() {
            vec![0.0; system.robot.joint_count()]
        } else {
            torques.iter().map(|&i| number(i)).collect()
        });
    }
    out
}

/// Largest |difference| over the coordinates of q at the last step, by trajectory, sorted.
fn drift(file: &Path, robot: &str, scene: &str, friction: Friction) -> Vec<f64> {
    let system = System::named(robot).expect("built in");
    let trajectories = read(file, &system);
    let mut batch = Batch::new(&system, &system.scene(scene).expect("scene"), trajectories.len());
    for (env, t) in trajectories.iter().enumerate() {
        batch.reset(env, &t.states[0]);
    }
    let mut solver = Articulated::new(ArticulatedConfig::paper(&system, friction));
    let steps = trajectories[0].states.len() - 1;
    for step in 0..steps {
        let torques: Vec<f64> = trajectories.iter().flat_map(|t| t.torques[step].clone()).collect();
        solver.step(&mut batch, &torques).expect("finite");
    }
    let nq = system.robot.nq();
    let gap = |env: usize, k: usize| {
        let d = batch.state(env)[k] - trajectories[env].states[steps][k];
        if system.robot.joints().nth(k).is_some_and(|j| j.wraps()) { wrap(d).abs() } else { d.abs() }
    };
    let mut drifts: Vec<f64> = (0..trajectories.len()).map(|env| (0..nq).map(|k| gap(env, k)).fold(0.0, f64::max)).collect();
    drifts.sort_by(f64::total_cmp);
    drifts
}

#[test]
fn contact_free_trajectories_are_reproduced_to_1e_4_at_step_100() {
    let Some(folder) = folder() else { return };
    for (name, robot) in [
        ("cartpole_passive", "cartpole"),
        ("cartpole_random_torque", "cartpole"),
        ("pendulum_passive_config0", "pendulum"),
        ("pendulum_random_torque_config0", "pendulum"),
    ] {
        for version in ["1.5.1", "1.8.1"] {
            let drifts = drift(&folder.join(format!("{name}_warp{version}.csv")), robot, "free", Friction::Coulomb);
            let (median, max) = (drifts[drifts.len() / 2], drifts[drifts.len() - 1]);
            println!("{name} {version}: median {median:.2e}, largest {max:.2e}");
            assert!(max < 1e-4, "{name} {version}: {max:.2e} rad or m at step 100, bound 1e-4");
        }
    }
}

#[test]
fn contact_trajectories_with_coulomb_friction_are_reproduced() {
    let Some(folder) = folder() else { return };
    let mut all = Vec::new();
    for ground in 1..=6 {
        let file = folder.join(format!("pendulum_passive_config{ground}_warp1.5.1.csv"));
        let drifts = drift(&file, "pendulum", &format!("ground{ground}"), Friction::Coulomb);
        println!("ground{ground}: median {:.2e}, largest {:.2e}", drifts[drifts.len() / 2], drifts[drifts.len() - 1]);
        all.extend(drifts);
    }
    all.sort_by(f64::total_cmp);
    let (median, max) = (all[all.len() / 2], all[all.len() - 1]);
    println!("all grounds: median {median:.2e}, largest {max:.2e}");
    assert!(median < 1e-5, "median {median:.2e} rad at step 100, bound 1e-5");
    assert!(max < 1e-3, "largest {max:.2e} rad at step 100, bound 1e-3");
}

#[test]
fn the_friction_laws_are_told_apart() {
    let Some(folder) = folder() else { return };
    let file = folder.join("pendulum_passive_config1_warp1.8.1.csv");
    let [huber, coulomb] = [Friction::Huber, Friction::Coulomb].map(|law| drift(&file, "pendulum", "ground1", law));
    let median = |d: &[f64]| d[d.len() / 2];
    println!("1.8.1 file: Huber {:.2e}, Coulomb {:.2e}", median(&huber), median(&coulomb));
    // Near rest the Huber law's force has a jump that f32 and f64 take at different substeps: 1e-3 is its level.
    assert!(
        median(&huber) < 1e-3 && median(&coulomb) > 10.0 * median(&huber),
        "Huber {:.2e}, Coulomb {:.2e}",
        median(&huber),
        median(&coulomb)
    );
}
