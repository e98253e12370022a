//! Simulated tosses of the sample's cube, written as people write measurements.
#![allow(dead_code)]

use std::ops::Range;

use nerd_core::dynamics::to_local;
use nerd_sim::{prelude::*, sampling::normal};
use nerd_suite::bodies::Body;

use crate::common::{at, implicit, motion};

/// One toss, and how it is altered in writing.
#[derive(Clone, Debug)]
pub struct Toss {
    pub id: u64,
    pub states: Vec<Vec<f64>>,
    /// Rotated by this angle about the vertical.
    pub turned: f64,
    /// Writes every `stride`-th state.
    pub stride: usize,
    /// Skips these rows.
    pub skip: Range<usize>,
    /// Number of frames that the cube is first held at its start.
    pub held: usize,
}

pub fn cube() -> Arc<System> {
    System::named(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/logs/cube.urdf")).expect("the sample's cube")
}

pub fn tosses(system: &Arc<System>, count: u64, frames: usize) -> Vec<Toss> {
    let toss = |id: u64| {
        let mut rng = stream(7, id);
        let mut draw = |scale: f64| [0; 3].map(|_| scale * normal(&mut rng));
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(draw(1.0)));
        let [w, v] = [draw(4.0), draw(0.5)];
        let start = Body::state([0.1, -0.2, 0.25], [turn.i, turn.j, turn.k, turn.w], w, [v[0], v[1], 0.3]);
        let mut states = vec![start.clone()];
        states.extend(motion(&mut implicit(16), at(system, "ground", &start), 0.0, frames - 1));
        Toss { id, states, turned: 0.0, stride: 1, skip: 0..0, held: 0 }
    };
    (0..count).map(toss).collect()
}

/// The first columns of a frame's row: toss and time (s).
pub fn stamp(id: u64, frame: usize) -> String {
    format!("{id},{:.9}", frame as f64 / 148.0)
}

pub fn text(tosses: &[Toss]) -> String {
    let system = cube();
    let mut out = String::from("toss,t,px,py,pz,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz\n");
    for toss in tosses {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), toss.turned);
        let first = toss.states.iter().take(1).cycle().take(toss.held).enumerate().map(|(k, s)| (k, s, true));
        let rest = toss.states.iter().enumerate().step_by(toss.stride).filter(|(k, _)| !toss.skip.contains(k));
        for (frame, state, still) in first.chain(rest.map(|(k, s)| (k + toss.held, s, false))) {
            let (q, mut qd) = (&state[..7], state[7..].to_vec());
            to_local(&system.robot, q, &mut qd);
            if still {
                qd.fill(0.0);
            }
            let (p, turn) = (yaw * vector(q), yaw * quaternion(&q[3..]));
            let (w, v) = (quaternion(&q[3..]).inverse() * vector(&qd), yaw * vector(&qd[3..]));
            let mut row = vec![stamp(toss.id, frame)];
            let x = [p.as_slice(), &[turn.w, turn.i, turn.j, turn.k], v.as_slice(), w.as_slice()].concat();
            row.extend(x.iter().map(|x| format!("{x:.9}")));
            out += &format!("{}\n", row.join(","));
        }
    }
    out
}

pub fn header() -> &'static str {
    r#"file = "cube.csv"
robot = "cube.urdf"
trajectory = "toss"
time = "t"
[root]
position = ["px", "py", "pz"]
quaternion = ["qw", "qx", "qy", "qz"]
order = "wxyz"
velocity = ["vx", "vy", "vz"]
ang_vel = ["wx", "wy", "wz"]
axes = "body"
"#
}

/// A folder with a table, its TOML and robots.
pub fn folder(rows: &str, toml: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let put = |file: &str, text: &str| std::fs::write(folder.path().join(file), text).expect("written");
    put("cube.csv", rows);
    put("cube.log.toml", toml);
    for (name, gravity) in [("cube", "-9.81"), ("heavy", "-10.0")] {
        put(&format!("{name}.urdf"), include_str!("../../assets/logs/cube.urdf"));
        put(&format!("{name}.toml"), &include_str!("../../assets/logs/cube.toml").replace("-9.81", gravity));
    }
    folder
}
