//! Many robots of one URDF, each with its own masses and friction: error and frames per second on one core, beside MuJoCo on the same
//! robots.

use std::time::Instant;

use nerd_sim::range::Range;
use nerd_sim::vary::{self, VarySpec};
use rand::RngExt;

use super::file::{Found, reason};
use super::stand::{lowest, ready};
use crate::mujoco::{Referee, Scheme};
use crate::prelude::*;
use nerd_train::cost::on_one_core;

/// Frames of a rollout: half a second.
pub const CROWD: usize = 30;
/// Robots whose errors are looked at.
const JUDGED: usize = 256;
/// Substeps that are tried, and those of what their error is measured from.
const TRIED: [usize; 6] = [1, 2, 4, 8, 16, 32];
const FINE: usize = 256;
/// Our engine; then MuJoCo with elliptic cones and an impratio of 100, and with its default friction, pyramids and 1.
const OURS: &str = "articulated";
const THEIRS: [(bool, &str); 2] = [(false, "MuJoCo"), (true, "MuJoCo, default friction")];
/// How far (rad or m) joints begin from where their drives hold them, at most, and how high the feet are (m).
const SHAKEN: f64 = 0.3;
const HIGH: f64 = 0.02;

type Frames = Vec<Vec<f64>>;

struct Pace {
    engine: &'static str,
    substeps: usize,
    /// Mean distances of joints (rad or m) and of the root (m) from the same engine at fine substeps.
    errors: [f64; 2],
    /// Frames of one robot in a second, on one core.
    frames: f64,
}

/// A table of each robot; and why some cannot be measured.
pub fn crowds(files: &[Found], mujoco: &Path, n: usize) -> Result<(Vec<Table>, Vec<String>)> {
    let (mut tables, mut failed) = (Vec::new(), Vec::new());
    for file in files {
        // One that cannot be measured ends no other's turn.
        match crowd(file, mujoco, n, 0) {
            Ok(table) => tables.push(table),
            Err(reason) => failed.push(format!("{}: {reason}", file.name)),
        }
    }
    if tables.is_empty() {
        bail!(failed.join("; "));
    }
    Ok((tables, failed))
}

/// `n` of a robot, masses of links times U(0.8, 1.2) each and frictions from U(0.3, 1.0), fall 2 cm onto a plane, each joint off by up to
/// 0.3 rad from where its drive holds it.
fn crowd(found: &Found, python: &Path, n: usize, seed: u64) -> Result<Table> {
    let mut ready = ready(found)?;
    let spec = VarySpec { mass: Some(Range { low: 0.8, high: 1.2 }), friction: Some(Range { low: 0.3, high: 1.0 }), ..Default::default() };
    std::sync::Arc::make_mut(&mut ready.system).spec.vary = Some(spec);
    let (system, coords) = (&ready.system, ready.system.robot.root_coords());
    let mut all = vary::batch(system, "plane", n, seed).map_err(|e| Error::msg(reason(&e, &found.name)))?;
    for env in 0..n {
        let (mut rng, mut state) = (stream(seed, (n + env) as u64), ready.state.clone());
        for (q, joint) in state[coords..].iter_mut().zip(system.robot.joints()) {
            let shaken = *q + SHAKEN * (2.0 * rng.random::<f64>() - 1.0);
            *q = joint.limit.map_or(shaken, |l| shaken.clamp(l.lower, l.upper));
        }
        state[2] -= lowest(system, &state) - HIGH;
        all.reset(env, &state);
    }
    all.drives = ready.drives.repeat(n);
    let judged = first(&all, JUDGED.min(n));
    let ours = |batch: &Batch, substeps| on_one_core(|| roll(batch, substeps));
    let (mut few, mut many) = (Referee::new(python, &judged, CROWD)?, Referee::new(python, &all, CROWD)?);
    let truth = ours(&judged, FINE)?.0;
    let mut fine = |plain: bool| -> Result<Frames> {
        few.plain = plain;
        Ok(few.play(Scheme::ImplicitFast, FINE, false)?.frames)
    };
    let theirs = [fine(false)?, fine(true)?];
    let pace = |engine, substeps, seconds: f64, states: &Frames, truth: &Frames| Pace {
        engine,
        substeps,
        errors: distance(system, states, truth),
        frames: (n * CROWD) as f64 / seconds,
    };
    let (mut paces, bar) = (Vec::new(), bar("settings", TRIED.len() as u64));
    for (k, substeps) in TRIED.into_iter().enumerate() {
        bar.set(k as u64);
        paces.push(pace(OURS, substeps, ours(&all, substeps)?.1, &ours(&judged, substeps)?.0, &truth));
        for ((plain, name), truth) in THEIRS.into_iter().zip(&theirs) {
            (few.plain, many.plain) = (plain, plain);
            let states = few.play(Scheme::ImplicitFast, substeps, false)?.frames;
            paces.push(pace(name, substeps, many.time(Scheme::ImplicitFast, substeps)?, &states, truth));
        }
    }
    bar.finish();
    let note = format!(
        "{n} of the robot, masses of links times U(0.8, 1.2), frictions from U(0.3, 1.0), fall 2 cm onto a plane, joints up to 0.3 rad from \
         where drives hold them; {CROWD} frames of 1/60 s, one core, MuJoCo {} (IMPLICITFAST, its default contacts; elliptic cones and an \
         impratio of 100, so that feet do not creep, or its default friction). Errors: mean distance from the same engine at {FINE} substeps, \
         of the first {JUDGED} robots. Last column: frames/s of ours over MuJoCo's, at ours' fewest substeps that err by no more than that row \
         in joints and in root. At {FINE} substeps the engines' joints are {} apart.",
        few.version,
        digits(distance(system, &truth, &theirs[0])[0])
    );
    let row = |p: &Pace| {
        let beside = cheapest(&paces, p).map(|(substeps, ratio)| format!("{} ({substeps} substeps)", digits(ratio)));
        let [joints, root] = p.errors.map(digits);
        vec![p.engine.into(), p.substeps.to_string(), joints, root, digits(p.frames), or_dash(beside)]
    };
    let header = ["engine", "substeps", "joints (rad or m)", "root (m)", "frames/s", "ours over MuJoCo, errors no larger"];
    Ok(Table::new(&format!("crowd of {}", found.name), &header).with(paces.iter().map(row)).noted(&note))
}

fn first(all: &Batch, n: usize) -> Batch {
    let (d, joints) = (all.system.robot.state_dim(), all.system.robot.joint_count());
    let mut few = all.clone();
    few.states.truncate(n * d);
    few.systems.truncate(n);
    few.scenes.truncate(n);
    few.frames.truncate(n);
    few.drives.truncate(n * joints);
    few
}

/// States by frame, and the seconds it took; the first frame, in which memory is made, is not among them.
fn roll(begun: &Batch, substeps: usize) -> Result<(Frames, f64)> {
    let (mut solver, mut batch) = (Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb)), begun.clone());
    let tau = vec![0.0; batch.len() * batch.system.robot.joint_count()];
    solver.step(&mut batch, &tau)?;
    batch.states.clone_from(&begun.states);
    let (mut states, mut seconds) = (Vec::with_capacity(CROWD), 0.0);
    for _ in 0..CROWD {
        let start = Instant::now();
        solver.step(&mut batch, &tau)?;
        seconds += start.elapsed().as_secs_f64();
        states.push(batch.states.clone());
    }
    Ok((states, seconds))
}

/// Mean distances of joints and of the root, over all frames and robots.
fn distance(system: &System, a: &Frames, b: &Frames) -> [f64; 2] {
    let (d, coords, nq) = (system.robot.state_dim(), system.robot.root_coords(), system.robot.nq());
    let pairs = a.iter().flat_map(|f| f.chunks(d)).zip(b.iter().flat_map(|f| f.chunks(d)));
    let (mut sums, mut count) = ([0.0, 0.0], 0);
    for (x, y) in pairs {
        let between = |part: std::ops::Range<usize>| x[part.clone()].iter().zip(&y[part]).map(|(x, y)| (x - y).abs());
        sums[0] += between(coords..nq).sum::<f64>() / (nq - coords).max(1) as f64;
        sums[1] += between(0..3).map(|x| x * x).sum::<f64>().sqrt();
        count += 1;
    }
    sums.map(|sum| sum / f64::from(count.max(1)))
}

/// Of a row of MuJoCo's: our fewest substeps that err by no more, and by how much those are faster.
fn cheapest(paces: &[Pace], other: &Pace) -> Option<(usize, f64)> {
    let fits = |p: &&Pace| p.engine == OURS && p.errors[0] <= other.errors[0] && p.errors[1] <= other.errors[1];
    let best = paces.iter().filter(fits).min_by_key(|p| p.substeps).filter(|_| other.engine != OURS)?;
    Some((best.substeps, best.frames / other.frames))
}
