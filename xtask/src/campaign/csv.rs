//! Tables of states, as `rollout` reads them; those that it takes are rolled out by it.

use std::path::Path;

use anyhow::Result;
use rand::{Rng, RngExt};

use super::bench::Bench;
use super::case::{Fault, Files, Verdict};
use super::files::whole;
use super::mutate::{ODD, anything, one, times};
use crate::rollout::{RolloutArgs, run};
use crate::solvers::SolverArgs;

/// Robots, with columns of theirs, and whether they are driven.
const TABLES: [(&str, &str, usize); 4] = [
    ("cartpole", "x,theta,v,omega,tau_x,tau_theta", 4),
    ("pendulum", "q1,q2,qd1,qd2", 4),
    ("pendulum", "q1,q2,qd1,qd2,tau1,tau2", 4),
    ("cube", "px,py,pz,qx,qy,qz,qw,wx,wy,wz,vx_s,vy_s,vz_s", 13),
];

/// A good table, changed; the file's name is the robot's.
pub fn make(rng: &mut impl Rng) -> Files {
    let (robot, columns, states) = TABLES[rng.random_range(0..TABLES.len())];
    let width = columns.split(',').count();
    let mut rows = vec![["traj", "step"].into_iter().chain(columns.split(',')).map(String::from).collect::<Vec<_>>()];
    for traj in 0..2 {
        for step in 0..4 {
            let cell = |k: usize| if robot == "cube" && k == 6 { 1.0 } else { f64::from(rng.random_range(-100..100)) / 100.0 };
            let cells: Vec<f64> = (0..width).map(cell).collect();
            let torqueless = |k: usize| k >= states && step == 3;
            let cells = cells.iter().enumerate().map(|(k, x)| if torqueless(k) { String::new() } else { x.to_string() });
            rows.push([traj.to_string(), step.to_string()].into_iter().chain(cells).collect());
        }
    }
    let mut raw = 0;
    for _ in 0..times(rng) {
        match rng.random_range(0..4) {
            0 => raw += 1,
            _ => change(rng, &mut rows),
        }
    }
    let mut file = rows.iter().map(|r| r.join(",") + "\n").collect::<String>().into_bytes();
    for _ in 0..raw {
        anything(rng, &mut file);
    }
    Files::from([(format!("{robot}.csv"), file)])
}

/// A change of a cell, a column or a row.
fn change(rng: &mut impl Rng, rows: &mut Vec<Vec<String>>) {
    let row = rng.random_range(0..rows.len());
    let columns = rows[row].len();
    if columns == 0 {
        return;
    }
    let (a, b) = (rng.random_range(0..columns), rng.random_range(0..columns));
    match rng.random_range(0..8) {
        0..4 => rows[row][a] = one(rng, &ODD).into(),
        4 => rows.iter_mut().filter(|r| a.max(b) < r.len()).for_each(|r| r.swap(a, b)),
        5 => rows.iter_mut().filter(|r| a < r.len()).for_each(|r| drop(r.remove(a))),
        6 => {
            let odd = ["traj", "step", "q1", "tau", "tau1", "tau_x", "\"", "1e9", "qx", " ", "01", "+1", "0.0"];
            rows[row][a] = one(rng, &odd).into();
        }
        _ => {
            let again = rows[row].clone();
            rows.push(again);
        }
    }
}

/// Calls the verb.
pub fn judge(files: &Files, bench: &Bench) -> Result<Verdict> {
    let folder = bench.empty("csv")?;
    let Some((name, bytes)) = files.iter().next() else { return Ok(Verdict::Refused("nothing there".into())) };
    let robot = name.split('.').next().unwrap_or_default().to_string();
    let (states, out) = (folder.join(name), folder.join("out/out.csv"));
    std::fs::write(&states, bytes)?;
    // Contact, where there may be.
    let scene = if robot == "cartpole" { "free" } else { "plane" }.to_string();
    let args = RolloutArgs { robot, scene, solver: SolverArgs::default(), states, steps: None, out: out.clone() };
    Ok(match run(args) {
        Ok(()) => check(&out),
        Err(_) if out.exists() => Verdict::Fault(Fault::Untidy, "a refusal left its output".into()),
        Err(e) => Verdict::Refused(format!("{e:#}")),
    })
}

fn check(out: &Path) -> Verdict {
    match whole(out) {
        Ok(()) => Verdict::Accepted,
        Err(words) => Verdict::Fault(Fault::NotFinite, words),
    }
}
