//! Good files that cases are made from: robots, states, models, a data set, a policy; and what is like them, and is not.

use std::{path::Path, process::Command};

use anyhow::{Result, ensure};
use nerd_sim::prelude::*;

use super::files::{Files, read, write};

const TEXTS: [(&str, &str); 8] = [
    ("robot.toml", include_str!("../../assets/campaign/robot.toml")),
    ("robot.urdf", include_str!("../../assets/campaign/robot.urdf")),
    ("robot.csv", "traj,step,arm,d_arm\n0,0,0.1,0.2\n"),
    ("states.csv", "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n1,0,-1,0.5,0,1\n"),
    ("cartpole.csv", include_str!("../../assets/campaign/cartpole.csv")),
    ("cube.csv", include_str!("../../assets/campaign/cube.csv")),
    ("driven.csv", include_str!("../../assets/campaign/driven.csv")),
    ("pendulum.csv", include_str!("../../assets/campaign/pendulum.csv")),
];

/// Trains the smallest model there is.
const TRAIN: &str = "train --robot pendulum --recipe small --embedding 8 --layers 2 --history 4 --transitions 200 --frames 20 --updates 2 \
                     --batch 4 --rollouts 1";

/// Makes the good files in a folder's `f`, with the program itself.
pub fn build(program: &Path, folder: &Path) -> Result<()> {
    let mut files: Files = TEXTS.iter().map(|(name, text)| (name.to_string(), text.as_bytes().to_vec())).collect();
    let [(_, spec), (_, xml), ..] = TEXTS;
    let (pendulum, urdf) = System::texts("pendulum").unwrap_or_default();
    for (name, text) in [
        // The same names, other physics.
        ("other/robot.toml", spec),
        ("other/robot.urdf", &xml.replace("mass value=\"1\"", "mass value=\"2\"")),
        ("other/pendulum.toml", pendulum),
        ("other/pendulum.urdf", &urdf.replace("mass value=\"25", "mass value=\"2")),
        ("misnamed/robot.toml", &spec.replace("robot.urdf", "nobody.urdf")),
        ("misnamed/robot.urdf", xml),
        ("deep/robot.toml", &spec.replace("1/60", &format!("1{}", "/1".repeat(200_000)))),
        ("deep/robot.urdf", xml),
        ("mixed/robot.urdf", xml),
    ] {
        files.insert(name.into(), text.into());
    }
    files.insert("mixed/latin.urdf".into(), b"<robot name=\"\xe9\"/>".into());
    let folder = &folder.join("f");
    write(folder, &files)?;
    for (line, from, to) in [
        ("dataset --robot pendulum --transitions 200 --frames 20".into(), "", "data"),
        ("policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8".into(), "policy", "policy"),
        (TRAIN.into(), "model", "paper"),
        (format!("{TRAIN} --stream --sequence 6 --base trapezoid"), "model", "model"),
    ] {
        let made = tempfile::tempdir()?;
        let mut command = Command::new(program);
        let out = command.args(line.split(' ')).arg("--out").arg(made.path()).env("NERD_COMMIT", "campaign").output()?;
        ensure!(out.status.success(), "`{line}` failed: {}", String::from_utf8_lossy(&out.stderr));
        write(&folder.join(to), &read(&made.path().join(from))?)?;
    }
    Ok(())
}
