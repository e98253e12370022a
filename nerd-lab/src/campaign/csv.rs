//! Tables of states, as `rollout` reads them; those that it takes are rolled out by it.

use std::io;

use rand::{Rng, RngExt};

use crate::campaign::Rollout;
use crate::campaign::bench::{Bench, write};
use crate::campaign::case::{Fault, Files, Judged, Verdict, fault};
use crate::campaign::files::whole;
use crate::campaign::mutate::{ODD, anything, one, pick, times};

/// Robots, with columns of theirs, and whether they are driven.
const TABLES: [(&str, &str, usize); 4] = [
    ("cartpole", "x,theta,v,omega,tau_x,tau_theta", 4),
    ("pendulum", "q1,q2,qd1,qd2", 4),
    ("pendulum", "q1,q2,qd1,qd2,tau1,tau2", 4),
    ("cube", "px,py,pz,qx,qy,qz,qw,wx,wy,wz,vx_s,vy_s,vz_s", 13),
];

/// A good table, changed; the file's name is the robot's.
pub fn make(rng: &mut impl Rng) -> Files {
    let (robot, columns, states) = one(rng, &TABLES);
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
        0..4 => rows[row][a] = pick(rng, ODD).into(),
        4 => rows.iter_mut().filter(|r| a.max(b) < r.len()).for_each(|r| r.swap(a, b)),
        5 => rows.iter_mut().filter(|r| a < r.len()).for_each(|r| drop(r.remove(a))),
        6 => rows[row][a] = pick(rng, "traj step q1 tau tau1 tau_x \" 1e9 qx 01 +1 0.0 ''").into(),
        _ => rows.push(rows[row].clone()),
    }
}

/// Calls the verb.
pub fn judge(files: &Files, bench: &Bench) -> io::Result<Judged> {
    let folder = bench.empty("csv")?;
    write(&folder, files)?;
    let name = files.keys().next().map_or("", String::as_str);
    let robot = name.split('.').next().unwrap_or_default();
    let (states, out) = (&folder.join(name), &folder.join("out/out.csv"));
    // Contact, where there may be.
    let scene = if robot == "cartpole" { "free" } else { "plane" };
    Ok(match (bench.program.rollout)(&Rollout { robot, scene, states, out }) {
        Ok(()) => whole(out).or_else(|words| fault(Fault::NotFinite, words)),
        Err(_) if out.exists() => fault(Fault::Untidy, "a refusal left its output"),
        Err(words) => Err(Verdict::Refused(words)),
    })
}
