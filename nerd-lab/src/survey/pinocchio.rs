//! Pinocchio as a referee of the dynamics. It is optional: a Python with Pinocchio (PyPI: pin) is started on request, receives a URDF,
//! states and our results, and returns the differences from its own.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use nalgebra::{DMatrix, Vector3};
use nerd_core::dynamics::{Data, Factor, kinematics};
use nerd_core::dynamics::{Derivatives, aba, bias, crba, jacobian, rnea};
use nerd_core::robot::Robot;
use nerd_core::state::write_quaternion;
use nerd_sim::sampling::stream;
use rand::RngExt;
use serde::{Deserialize, Serialize};

const REFEREE: &str = include_str!("pinocchio.py");
/// That of Pinocchio's models.
const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
/// Frames whose Jacobians are compared, evenly chosen.
const FRAMES: usize = 8;

/// Largest relative differences by quantity: `mass`, `bias`, `inverse`, `forward`, `inverse_q` (derivative by q) and so on, `jacobian`.
pub type Differences = BTreeMap<String, f64>;

/// Why nothing was compared; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PinocchioError {
    /// No robot can be.
    #[error("{0}")]
    Absent(String),
    /// This robot cannot be.
    #[error("{0}")]
    Robot(String),
}

#[derive(Serialize)]
struct Request<'a> {
    urdf: &'a Path,
    floating: bool,
    joints: Vec<(&'a str, usize, f64, f64)>,
    frames: Vec<&'a str>,
    states: usize,
    coordinates: usize,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Said {
    Error { error: String },
    Version { version: String },
    Worst { worst: Differences },
}

/// How far a robot's dynamics are from Pinocchio's at random states, and Pinocchio's version. Turns are up to pi, slides up to 0.5 m,
/// rates and accelerations up to 1, torques up to 10.
///
/// # Errors
/// If `python` cannot be started or has no Pinocchio, or what either side says of the robot.
pub fn differences(python: &Path, urdf: &Path, robot: &Robot, states: usize, seed: u64) -> Result<(Differences, String), PinocchioError> {
    let mut command = Command::new(python);
    let child = command.args(["-c", REFEREE]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = child.spawn().map_err(|e| PinocchioError::Absent(format!("cannot start `{}`: {e}", python.display())))?;
    let (Some(mut input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(PinocchioError::Absent("no pipe to Python".into()));
    };
    let asked = request(urdf, robot, states);
    // Its own output has the reason, not the broken pipe.
    let sent = ask(&mut input, &asked, robot, states, seed);
    drop(input);
    let mut version = None;
    let mut found = Err("Python ended without an answer".to_string());
    for line in BufReader::new(output).lines() {
        let said = line.map_err(|e| e.to_string()).and_then(|line| serde_json::from_str(&line).map_err(|e| e.to_string()));
        match said {
            Ok(Said::Version { version: said }) => version = Some(said),
            Ok(Said::Worst { worst }) => found = Ok(worst),
            Ok(Said::Error { error }) | Err(error) => found = Err(error),
        }
    }
    let _ = child.wait();
    match (version, found, sent) {
        (Some(version), Ok(worst), Ok(())) => Ok((worst, version)),
        (None, Err(said), _) => Err(PinocchioError::Absent(said)),
        (_, Ok(_), Err(error)) => Err(PinocchioError::Robot(error)),
        (_, Err(said), sent) => Err(PinocchioError::Robot(sent.err().filter(|e| !e.contains("pipe")).unwrap_or(said))),
        (None, Ok(_), Ok(())) => Err(PinocchioError::Absent("Python names no Pinocchio".into())),
    }
}

fn request<'a>(urdf: &'a Path, robot: &'a Robot, states: usize) -> Request<'a> {
    let dofs = robot.dofs();
    let joints = robot.links.iter().zip(&dofs).filter_map(|(link, dof)| {
        let joint = link.joint.as_ref()?;
        Some((joint.name.as_str(), dof - robot.root_dofs(), joint.ratio(), joint.mimic().map_or(0.0, |m| m.offset)))
    });
    let frames = chosen(robot).into_iter().map(|f| f.0).collect();
    Request { urdf, floating: robot.floating(), joints: joints.collect(), frames, states, coordinates: robot.joint_count() }
}

/// Some of the links and of the frames fixed on them, evenly chosen: name, link, and place on it (m).
fn chosen(robot: &Robot) -> Vec<(&str, usize, Vector3<f64>)> {
    let links = robot.links.iter().enumerate().map(|(i, link)| (link.name.as_str(), i, Vector3::zeros()));
    let fixed = robot.frames.iter().filter_map(|f| Some((f.name.as_str(), f.link?, f.pose.translation.vector)));
    let all: Vec<_> = links.chain(fixed).collect();
    let step = all.len().div_ceil(FRAMES).max(1);
    all.into_iter().step_by(step).collect()
}

fn ask(input: &mut impl Write, asked: &Request, robot: &Robot, states: usize, seed: u64) -> Result<(), String> {
    let said = |e: std::io::Error| e.to_string();
    writeln!(input, "{}", serde_json::to_string(asked).map_err(|e| e.to_string())?).map_err(said)?;
    let (mut rng, mut data, mut factor) = (stream(seed, 0), Data::new(robot), Factor::new(robot));
    let nv = robot.nv();
    let (mut inverse, mut forward) = (Derivatives::new(robot), Derivatives::new(robot));
    let mut j = DMatrix::zeros(6, nv);
    for _ in 0..states {
        let mut draw = |n: usize, most: f64| (0..n).map(|_| rng.random_range(-most..most)).collect::<Vec<f64>>();
        let mut q = draw(robot.nq(), std::f64::consts::PI);
        for (joint, q) in robot.joints().zip(&mut q[robot.root_coords()..]) {
            *q *= if joint.kind == nerd_core::robot::JointKind::Prismatic { 0.5 / std::f64::consts::PI } else { 1.0 };
        }
        if robot.floating() {
            let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(&draw(3, 2.0)));
            write_quaternion(&mut q[3..7], &turn);
        }
        let (qd, qdd, tau) = (draw(nv, 1.0), draw(nv, 1.0), draw(nv, 10.0));
        kinematics(robot, &q, &mut data);
        crba(robot, &mut data);
        let mass = data.mass.clone();
        bias(robot, &qd, &GRAVITY, &mut data);
        let low = data.tau.clone();
        rnea(robot, &qd, &qdd, &GRAVITY, &mut data);
        let told = data.tau.clone();
        inverse.inverse(robot, &qd, &qdd, &GRAVITY, &mut data);
        if !aba(robot, &qd, &tau, &GRAVITY, &mut data) {
            return Err("a subtree has no inertia to accelerate".into());
        }
        let found: Vec<f64> = data.qdd.iter().copied().collect();
        if !forward.forward(robot, &qd, &found, &GRAVITY, &mut data, &mut factor) {
            return Err(factor.fault(robot));
        }
        let mut send = |numbers: &[f64]| input.write_all(&numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>()).map_err(said);
        [&q, &qd, &qdd, &tau].into_iter().try_for_each(|x| send(x))?;
        // Theirs are row by row.
        send(mass.transpose().as_slice())?;
        [low.as_slice(), told.as_slice(), &found].into_iter().try_for_each(&mut send)?;
        [&inverse.q, &inverse.qd, &forward.q, &forward.qd].into_iter().try_for_each(|m| send(m.transpose().as_slice()))?;
        for (_, link, place) in chosen(robot) {
            jacobian(robot, &data, link, &place, &mut j);
            send(j.transpose().as_slice())?;
        }
    }
    Ok(())
}
