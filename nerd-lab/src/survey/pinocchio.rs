//! Pinocchio as a referee of the dynamics. It is optional: a Python with Pinocchio (PyPI: pin) is started on request, receives a URDF,
//! states and our results, and returns the differences from its own.

use std::collections::BTreeMap;
use std::io;

use nalgebra::Vector3;
use nerd_core::dynamics::{Axes, Data, Derivatives, Factor, aba, bias, crba, kinematics, rnea};
use nerd_core::robot::{FixedFrame, JointKind, Robot};
use nerd_core::state::write_quaternion;
use rand::RngExt;

use super::file::Found;
use super::robot::Surveyed;
use crate::prelude::*;
use crate::python::{Python, Version};

const REFEREE: &str = include_str!("pinocchio.py");
/// That of Pinocchio's models.
const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
/// Frames whose Jacobians are compared, evenly chosen.
const FRAMES: usize = 8;
/// What is compared: the mass matrix, torques at rest, inverse and forward dynamics, their derivatives by q and qd, Jacobians of frames.
const QUANTITIES: [&str; 9] = ["mass", "bias", "inverse", "forward", "inverse_q", "inverse_qd", "forward_q", "forward_qd", "jacobian"];
/// Closer than this, two dynamics are the same.
const SAME: f64 = 1e-9;

#[derive(Serialize)]
struct Request<'a> {
    urdf: &'a Path,
    floating: bool,
    joints: Vec<(&'a str, usize, f64, f64)>,
    frames: Vec<String>,
    states: usize,
    coordinates: usize,
}

#[derive(Deserialize)]
struct Differences {
    worst: BTreeMap<String, f64>,
}

/// Largest relative differences from Pinocchio's dynamics, of both bases of each robot.
pub(super) fn beside(python: &Path, states: usize, files: &[Found], robots: &[Surveyed]) -> Result<Table> {
    let bar = bar("robots", robots.len() as u64);
    let (mut rows, mut version, mut same) = (Vec::new(), String::new(), 0);
    for (k, (file, robot)) in files.iter().zip(robots).enumerate() {
        let path = std::fs::canonicalize(&file.path).with_context(|| format!("cannot read {}", file.path.display()))?;
        bar.set(k as u64);
        for (base, robot) in ["fixed", "floating"].into_iter().zip(&robot.robots) {
            let Some(robot) = robot else { continue };
            let mut cells = vec![file.name.clone(), base.to_string()];
            let mut started = Python::start(python, REFEREE, "Pinocchio").context("--pinocchio")?;
            Version { version } = started.ask(&request(&path, robot, states)).context("--pinocchio")?;
            match differences(&mut started, robot, states, 0) {
                Ok(Differences { worst }) => {
                    same += usize::from(worst.values().all(|x| *x < SAME));
                    cells.extend(QUANTITIES.map(|q| or_dash(worst.get(q).map(|x| format!("{x:.0e}")))));
                }
                Err(reason) => {
                    cells.push(reason.to_string());
                    cells.resize(2 + QUANTITIES.len(), String::new());
                }
            }
            rows.push(cells);
        }
    }
    bar.finish();
    let header: Vec<&str> = ["file", "base"].into_iter().chain(QUANTITIES).collect();
    let note = format!(
        "Dynamics beside Pinocchio {version} at {states} random states: largest entry of the difference over the largest of Pinocchio's \
         (or over 1e-6, where that is more), the worst state. {same} of {} rows are below {SAME:.0e} in everything.",
        rows.len()
    );
    Ok(Table::new("pinocchio", &header).with(rows).noted(&note))
}

fn request<'a>(urdf: &'a Path, robot: &'a Robot, states: usize) -> Request<'a> {
    let dofs = robot.dofs();
    let joints = robot.links.iter().zip(&dofs).filter_map(|(link, dof)| {
        let joint = link.joint.as_ref()?;
        Some((joint.name.as_str(), dof - robot.root_dofs(), joint.ratio(), joint.mimic().map_or(0.0, |m| m.offset)))
    });
    let frames = chosen(robot).into_iter().map(|frame| frame.name).collect();
    Request { urdf, floating: robot.floating(), joints: joints.collect(), frames, states, coordinates: robot.joint_count() }
}

/// Some of the links and of the frames fixed on them, evenly chosen.
fn chosen(robot: &Robot) -> Vec<FixedFrame> {
    let fixed = robot.frames.iter().filter(|frame| frame.link.is_some()).map(|frame| &frame.name);
    let names: Vec<&String> = robot.links.iter().map(|link| &link.name).chain(fixed).collect();
    names.iter().step_by(names.len().div_ceil(FRAMES).max(1)).filter_map(|name| robot.frame(name).ok()).collect()
}

/// How far a robot's dynamics are from Pinocchio's at random states: turns are up to pi, slides up to 0.5 m, rates and accelerations up to
/// 1, torques up to 10. What it has said of a robot counts before a pipe that broke then.
fn differences(python: &mut Python, robot: &Robot, states: usize, seed: u64) -> Result<Differences> {
    match send(python, robot, states, seed) {
        Err(error) if !error.is::<io::Error>() => Err(error),
        _ => python.answer(),
    }
}

fn send(python: &mut Python, robot: &Robot, states: usize, seed: u64) -> Result<()> {
    let (mut rng, mut data, mut factor) = (stream(seed, 0), Data::new(robot), Factor::new(robot));
    let nv = robot.nv();
    let (mut inverse, mut forward) = (Derivatives::new(robot), Derivatives::new(robot));
    for _ in 0..states {
        let mut draw = |n: usize, most: f64| (0..n).map(|_| rng.random_range(-most..most)).collect::<Vec<f64>>();
        let mut q = draw(robot.nq(), std::f64::consts::PI);
        for (joint, q) in robot.joints().zip(&mut q[robot.root_coords()..]) {
            *q *= if joint.kind == JointKind::Prismatic { 0.5 / std::f64::consts::PI } else { 1.0 };
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
            bail!("a subtree has no inertia to accelerate");
        }
        let found: Vec<f64> = data.qdd.iter().copied().collect();
        if !forward.forward(robot, &qd, &found, &GRAVITY, &mut data, &mut factor) {
            bail!(factor.fault(robot));
        }
        let mut send = |numbers: &[f64]| python.send(numbers);
        [&q, &qd, &qdd, &tau].into_iter().try_for_each(|x| send(x))?;
        // Theirs are row by row.
        send(mass.transpose().as_slice())?;
        [low.as_slice(), told.as_slice(), &found].into_iter().try_for_each(&mut send)?;
        [&inverse.q, &inverse.qd, &forward.q, &forward.qd].into_iter().try_for_each(|m| send(m.transpose().as_slice()))?;
        for frame in chosen(robot) {
            send(data.jacobian(robot, &q, &frame, Axes::World).transpose().as_slice())?;
        }
    }
    Ok(())
}
