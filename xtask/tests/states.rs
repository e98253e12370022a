//! The CSV that `rollout` reads: every fault is refused with the file, the line and the column, every order of columns is read.

mod common;

use std::path::Path;

use common::{refused, xtask};

const GOOD: &str = "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n0,1,,,,\n";

fn write(folder: &Path, name: &str, text: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("written");
    path.to_str().expect("utf-8").into()
}

#[test]
fn faults_name_file_line_and_column() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out.csv");
    let place = out.to_str().expect("utf-8");
    let cases: [(&str, &str, [&str; 2]); 16] = [
        ("twice", "traj,step,q1,q1,q2,qd1,qd2\n0,0,1,1,1,1,1\n", ["line 1", "`q1` stands there twice"]),
        ("blank", "traj,step,q1, q1,q2,qd1,qd2\n0,0,1,1,1,1,1\n", ["line 1", "`q1` stands there twice"]),
        ("again", "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,1,,,,\n0,0,1,1,1,1\n", ["line 4", "step 0 already on line 2"]),
        ("later", "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,1,,,,\n0,1,,,,\n", ["line 4", "step 1 already on line 3"]),
        ("far", "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,4294967296,,,,\n", ["line 3, column `step`", "0 to 1000000"]),
        ("farther", "traj,step,q1,q2,qd1,qd2\n0,99999999999999999999,,,,\n", ["line 2, column `step`", "whole number"]),
        ("negative", "traj,step,q1,q2,qd1,qd2\n-1,0,0,0,0,0\n", ["line 2, column `traj`", "`-1`"]),
        ("infinite", "traj,step,q1,q2,qd1,qd2\n0,0,0,inf,0,0\n", ["line 2, column `q2`", "`inf`"]),
        ("empty", "traj,step,q1,q2,qd1,qd2\n0,0,0,,0,0\n", ["line 2, column `q2`", "``"]),
        ("quoted", "traj,step,q1,q2,qd1,qd2\n0,0,\"0\n\n\",0,0,0\n0,1,,,,\n0,x,,,,\n", ["line 6, column `step`", "`x`"]),
        ("nothing", "a,b\n1,2\n", ["no column `traj`; there are a, b", "traj, step, q1, q2, qd1, qd2"]),
        ("half", "traj,step,q1,q2,qd1,qd2,tau1\n0,0,0,0,0,0,0\n", ["no column `tau2`", "for torques, tau1, tau2"]),
        ("other", "traj,step,q1,q2,qd1,qd2,tau_1,tau_2\n0,0,0,0,0,0,0,0\n", ["no column `tau1`", "there are"]),
        ("gap", "traj,step,q1,q2,qd1,qd2,tau1,tau2\n0,0,0,0,0,0,0,0\n0,2,,,,,,\n", ["gap.csv", "no torques at step 1"]),
        ("starts", "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n", ["starts.csv", "--steps"]),
        ("rows", "traj,step,q1,q2,qd1,qd2\n", ["rows.csv", "no rows"]),
    ];
    for (name, text, words) in cases {
        let states = write(folder.path(), &format!("{name}.csv"), text.as_bytes());
        let args = ["rollout", "--robot", "pendulum", "--states", &states, "--out", place];
        words.iter().chain([&states.as_str()]).for_each(|word| refused(&args, word));
        assert!(!out.exists(), "{name} left a file");
    }
    let latin = write(folder.path(), "latin.csv", b"traj,step,q1,q2,qd1,qd2\n0,0,\xe9,0,0,0\n");
    refused(&["rollout", "--robot", "pendulum", "--states", &latin, "--out", place], "latin.csv");
    let cube = "traj,step,px,py,pz,qx,qy,qz,qw,wx,wy,wz,vx_s,vy_s,vz_s\n0,0,0,0,1,0,0,0,0.5,0,0,0,0,0,0\n";
    let cube = write(folder.path(), "cube.csv", cube.as_bytes());
    refused(&["rollout", "--robot", "cube", "--states", &cube, "--steps", "1", "--out", place], "line 2, columns qx, qy, qz, qw");
}

#[test]
fn columns_go_by_their_names_in_any_order() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let rolled = |name: &str, text: &str| {
        let (states, out) = (write(folder.path(), name, text.as_bytes()), folder.path().join(format!("{name}.out")));
        let run = xtask(&["rollout", "--robot", "pendulum", "--states", &states, "--out", out.to_str().expect("utf-8")]);
        assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
        std::fs::read_to_string(out).expect("a table")
    };
    let torques = "traj,step,q1,q2,qd1,qd2,tau1,tau2\n0,0,0.1,0.2,0,0,1,-2\n0,1,,,,,,\n";
    let turned = "tau2,note,qd2,q2,step,tau1,qd1,q1,traj,tau_est\n-2,a,0,0.2,0,1,0,0.1,0,9\n,,,,1,,,,0,\n";
    assert_eq!(rolled("torques.csv", torques), rolled("turned.csv", turned));
    assert_ne!(rolled("torques.csv", torques), rolled("good.csv", GOOD), "torques act");
}

/// Joints whose names are the table's own have `q_` before them, and no column is taken for another.
#[test]
fn joints_named_like_other_columns_are_read_from_their_own() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out.csv");
    let place = out.to_str().expect("utf-8");
    let robot = |name: &str| {
        let link = |n: usize| {
            format!(
                r#"<link name="l{n}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"#
            )
        };
        let joint =
            format!(r#"<joint name="{name}" type="continuous"><parent link="l0"/><child link="l1"/><axis xyz="0 1 0"/></joint></robot>"#);
        write(folder.path(), &format!("{name}.urdf"), format!(r#"<robot name="r">{}{}{joint}"#, link(0), link(1)).as_bytes())
    };
    for name in ["step", "traj", "tau1"] {
        let rollout = |header: &str| {
            let states = write(folder.path(), "states.csv", format!("{header}\n0,0,0.5,0\n0,1,,\n").as_bytes());
            ["rollout", "--robot", &robot(name), "--states", &states, "--out", place].map(String::from)
        };
        let bare = rollout(&format!("traj,step,{name},d_{name}"));
        refused(
            &bare.each_ref().map(String::as_str),
            &format!("states.csv: line 1: {}", if name == "tau1" { "no column" } else { "column" }),
        );
        let run = xtask(&rollout(&format!("traj,step,q_{name},d_q_{name}")).each_ref().map(String::as_str));
        assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
        // Its centre of mass is on the axis: it stays where it starts.
        let text = std::fs::read_to_string(&out).expect("a table");
        assert_eq!(text.lines().nth(2), Some("0,1,0.5,0"), "{name}: {text}");
    }
}
