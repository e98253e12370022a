//! `rollout` on a file of the reference's trajectories, as anyone checks us; nerd-sim's own tests have all of them.

use std::collections::BTreeMap;
use std::path::Path;

use crate::{Folder, done, root};

/// Two columns of a CSV by (trajectory, step).
fn table(path: &Path, columns: [&str; 2]) -> BTreeMap<(u64, u64), [f64; 2]> {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    let rows = reader.deserialize::<BTreeMap<String, String>>().map(|row| row.expect("a row"));
    rows.map(|row| {
        ((row["traj"].parse().expect("traj"), row["step"].parse().expect("step")), columns.map(|c| row[c].parse().expect("a number")))
    })
    .collect()
}

#[test]
fn a_reference_file_given_as_it_is_comes_out_again() {
    let folder = Folder::new();
    // 1e-4 at the last step without contact, 1e-3 with it.
    for (file, robot, scene, columns, allowed) in [
        ("cartpole_random_torque_warp1.5.1.csv", "cartpole-paper", "free", ["x", "theta"], 1e-4),
        ("pendulum_passive_config3_warp1.5.1.csv", "pendulum-paper", "ground3", ["q1", "q2"], 1e-3),
    ] {
        let path = root().join("../shared/reference").join(file);
        if !path.exists() {
            println!("skipped: no reference data ({file})");
            continue;
        }
        let out = folder.path("out.csv");
        done(&format!("rollout --robot {robot} --scene {scene} --states {} --out", path.display()), &[&out]);
        let (ours, theirs) = (table(&out, columns), table(&path, columns));
        assert_eq!(ours.len(), theirs.len(), "{file}: rows");
        let last = ours.keys().map(|k| k.1).max().expect("rows");
        let gap = |(a, b): (&f64, &f64)| nerd_core::state::wrap(a - b).abs();
        let rows = ours.iter().filter(|(id, _)| id.1 == last);
        let most = rows.flat_map(|(id, row)| row.iter().zip(&theirs[id]).map(gap)).fold(0.0, f64::max);
        assert!(most < allowed, "{file}: off by {most:.1e} at step {last}, allowed {allowed:.0e}");
    }
}
