//! Good files that command lines name.

use std::io;
use std::path::Path;

use super::judge::prepare;
use crate::campaign::bench::{Bench, write};
use crate::campaign::case::Files;
use crate::campaign::robots::texts;

/// A robot with a specification, states, a model, a data set, a policy; and what is like them, and is not.
pub fn files(bench: &Bench, folder: &Path) -> io::Result<()> {
    let file = |folder: &'static str, name: &str, text: &str| (folder, name.to_string(), text.as_bytes().to_vec());
    let (xml, spec) = (include_str!("../../../corpus/toml/robot.urdf"), include_str!("../../../corpus/toml/robot.toml"));
    let half = bench.path("half");
    // The same names, other physics.
    let (pendulum, urdf) = texts("pendulum");
    let files = [
        file("", "robot.urdf", xml),
        file("", "robot.toml", spec),
        file("", "states.csv", "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n1,0,-1,0.5,0,1\n"),
        file("", "robot.csv", "traj,step,arm,d_arm\n0,0,0.1,0.2\n"),
        file("other", "robot.urdf", &xml.replace("mass value=\"1\"", "mass value=\"2\"")),
        file("other", "robot.toml", spec),
        file("other", "pendulum.urdf", &urdf.replace("mass value=\"25", "mass value=\"2")),
        file("other", "pendulum.toml", pendulum),
        file("misnamed", "robot.urdf", xml),
        file("misnamed", "robot.toml", &spec.replace("robot.urdf", "nobody.urdf")),
        file("deep", "robot.urdf", xml),
        file("deep", "robot.toml", &spec.replace("1/60", &format!("1{}", "/1".repeat(200_000)))),
        file("mixed", "robot.urdf", xml),
        ("mixed", "latin.urdf".to_string(), b"<robot name=\"\xe9\"/>".to_vec()),
    ];
    for (folder, name, bytes) in files {
        write(&half.join(folder), &Files::from([(name, bytes)]))?;
    }
    write(&half.join("model"), &bench.models[1])?;
    for line in [
        "dataset --robot pendulum --transitions 200 --frames 20 --out data",
        "policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8 --out run",
    ] {
        prepare(line, &half, bench)?;
    }
    std::fs::rename(half.join("run/policy"), half.join("policy"))?;
    std::fs::rename(&half, folder)
}
