//! Tables of rollouts: each fault is refused with file, line and column, and columns are read in any order.

use std::path::{Path, PathBuf};

use nerd_sim::rollout::{RolloutError, States};

use crate::common::*;

const GOOD: &str = "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n0,1,,,,\n";

fn write(folder: &Path, name: &str, text: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("written");
    path
}

/// Reads a table and rolls it out in the scene `free`, over the frames of the table.
fn rolled(path: &Path, system: &Arc<System>) -> Result<String, RolloutError> {
    let states = States::read(path, system)?;
    let mut solver = Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb));
    let table =
        states.roll(system, &system.scene("free").expect("scene"), &mut solver, states.frames(), &mut |_| ())?;
    Ok(String::from_utf8(table).expect("a text"))
}

#[test]
fn faults_name_file_line_and_column() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let [pendulum, cube] = ["pendulum", "cube"].map(built_in);
    let refused = |path: &Path, system: &Arc<System>, words: &[&str]| {
        let said = line(rolled(path, system));
        assert!(said.starts_with(&path.display().to_string()), "{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "`{said}` does not name {word}"));
    };
    let cases: [(&str, &str, [&str; 2]); 15] = [
        ("twice", "traj,step,q1,q1,q2,qd1,qd2\n0,0,1,1,1,1,1\n", ["line 1", "`q1` appears twice"]),
        ("blank", "traj,step,q1, q1,q2,qd1,qd2\n0,0,1,1,1,1,1\n", ["line 1", "`q1` appears twice"]),
        (
            "again",
            "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,1,,,,\n0,0,1,1,1,1\n",
            ["line 4", "step 0 already on line 2"],
        ),
        ("later", "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,1,,,,\n0,1,,,,\n", ["line 4", "step 1 already on line 3"]),
        ("far", "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,4294967296,,,,\n", ["line 3, column `step`", "0 to 1000000"]),
        ("farther", "traj,step,q1,q2,qd1,qd2\n0,99999999999999999999,,,,\n", ["line 2, column `step`", "whole number"]),
        ("negative", "traj,step,q1,q2,qd1,qd2\n-1,0,0,0,0,0\n", ["line 2, column `traj`", "`-1`"]),
        ("infinite", "traj,step,q1,q2,qd1,qd2\n0,0,0,inf,0,0\n", ["line 2, column `q2`", "`inf`"]),
        ("empty", "traj,step,q1,q2,qd1,qd2\n0,0,0,,0,0\n", ["line 2, column `q2`", "``"]),
        (
            "quoted",
            "traj,step,q1,q2,qd1,qd2\n0,0,\"0\n\n\",0,0,0\n0,1,,,,\n0,x,,,,\n",
            ["line 6, column `step`", "`x`"],
        ),
        ("nothing", "a,b\n1,2\n", ["no column `traj`; there are a, b", "traj, step, q1, q2, qd1, qd2"]),
        ("half", "traj,step,q1,q2,qd1,qd2,tau1\n0,0,0,0,0,0,0\n", ["no column `tau2`", "for torques, tau1, tau2"]),
        ("other", "traj,step,q1,q2,qd1,qd2,tau_1,tau_2\n0,0,0,0,0,0,0,0\n", ["no column `tau1`", "there are"]),
        (
            "gap",
            "traj,step,q1,q2,qd1,qd2,tau1,tau2\n0,0,0,0,0,0,0,0\n0,2,,,,,,\n",
            ["trajectory 0", "no torques at step 1"],
        ),
        ("rows", "traj,step,q1,q2,qd1,qd2\n", ["no rows", "header"]),
    ];
    for (name, text, words) in cases {
        refused(&write(folder.path(), &format!("{name}.csv"), text.as_bytes()), &pendulum, &words);
    }
    refused(&folder.path().join("absent.csv"), &pendulum, &["cannot read it"]);
    refused(
        &write(folder.path(), "latin.csv", b"traj,step,q1,q2,qd1,qd2\n0,0,\xe9,0,0,0\n"),
        &pendulum,
        &["invalid utf-8"],
    );
    let turned = "traj,step,px,py,pz,qx,qy,qz,qw,wx,wy,wz,vx_s,vy_s,vz_s\n0,0,0,0,1,0,0,0,0.5,0,0,0,0,0,0\n";
    refused(&write(folder.path(), "cube.csv", turned.as_bytes()), &cube, &["line 2, columns qx, qy, qz, qw"]);
}

#[test]
fn columns_go_by_their_names_in_any_order() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let pendulum = built_in("pendulum");
    let rolled =
        |name: &str, text: &str| rolled(&write(folder.path(), name, text.as_bytes()), &pendulum).expect("a table");
    let torques = "traj,step,q1,q2,qd1,qd2,tau1,tau2\n0,0,0.1,0.2,0,0,1,-2\n0,1,,,,,,\n";
    let turned = "tau2,note,qd2,q2,step,tau1,qd1,q1,traj,tau_est\n-2,a,0,0.2,0,1,0,0.1,0,9\n,,,,1,,,,0,\n";
    assert_eq!(rolled("torques.csv", torques), rolled("turned.csv", turned));
    assert_ne!(rolled("torques.csv", torques), rolled("good.csv", GOOD), "torques act");
    assert!(rolled("good.csv", GOOD).starts_with("traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n0,1,"));
}

/// Joints named like a column of the table get the prefix `q_`, and no column is taken for another.
#[test]
fn joints_named_like_other_columns_are_read_from_their_own() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for name in ["step", "traj", "tau1"] {
        let hinge = joint(name, "continuous", ["base", "l"], r#"<axis xyz="0 1 0"/>"#);
        let parts = [base(), link("l", 1.0, [0.0; 3], [1.0; 3], ""), hinge];
        let system = Arc::new(System::bare(name, &urdf(&parts), false).expect("a robot"));
        let table =
            |header: &str| write(folder.path(), "states.csv", format!("{header}\n0,0,0.5,0\n0,1,,\n").as_bytes());
        let said = line(rolled(&table(&format!("traj,step,{name},d_{name}")), &system));
        let words = if name == "tau1" { "states.csv: line 1: no column" } else { "states.csv: line 1: column" };
        assert!(said.contains(words), "{name}: {said}");
        // The centre of mass is on the axis, so the joint stays where it starts.
        let text = rolled(&table(&format!("traj,step,q_{name},d_q_{name}")), &system).expect("rolled out");
        assert_eq!(text.lines().nth(2), Some("0,1,0.5,0"), "{name}: {text}");
    }
}
