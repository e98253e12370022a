//! Many robots of one URDF, each with its own masses and friction: error and frames per second on one core, beside MuJoCo on the same
//! robots.

use std::path::Path;
use std::time::Instant;

use anyhow::Error;
use nerd_sim::prelude::*;
use nerd_sim::range::Range;
use nerd_sim::sampling::stream;
use nerd_sim::vary::{self, VarySpec};
use rand::RngExt;

use super::file::{Found, reason};
use super::stand::{lowest, ready};
use crate::error::Result;
use crate::mujoco::{Referee, Scheme};

/// Frames of a rollout: half a second.
pub const CROWD: usize = 30;
/// Numbers of substeps that are tried.
pub const SETTINGS: usize = 6;
/// Robots whose errors are looked at.
const JUDGED: usize = 256;
/// Substeps that are tried, and those of what their error is measured from.
const TRIED: [usize; SETTINGS] = [1, 2, 4, 8, 16, 32];
const FINE: usize = 256;
/// Name of our engine.
const OURS: &str = "articulated";
/// Name of MuJoCo with its default friction.
const PLAIN: &str = "MuJoCo, default friction";
/// How far (rad or m) joints begin from where their drives hold them, at most, and how high the feet are (m).
const SHAKEN: f64 = 0.3;
const HIGH: f64 = 0.02;

/// One engine at one number of substeps.
#[derive(Clone, Debug)]
pub struct Pace {
    /// `articulated`; `MuJoCo`, with elliptic cones and an impratio of 100; or that with its default friction, pyramids and 1.
    pub engine: &'static str,
    /// Substeps of a frame.
    pub substeps: usize,
    /// Mean distance of joints (rad or m) from the same engine at fine substeps, over all frames and joints.
    pub joints: f64,
    /// Mean distance of the root from there (m).
    pub root: f64,
    /// Frames of one robot in a second, on one core.
    pub frames: f64,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Crowd {
    /// MuJoCo's version.
    pub version: String,
    /// Both engines, by substeps.
    pub paces: Vec<Pace>,
    /// Mean distance (rad or m) between the joints of the two engines at fine substeps: they differ in their contacts.
    pub apart: f64,
}

/// `n` of a robot, masses of links times U(0.8, 1.2) each and frictions from U(0.3, 1.0), fall 2 cm onto a plane, each joint off by up to
/// 0.3 rad from where its drive holds it.
///
/// # Errors
/// If it cannot be read or stepped, or MuJoCo does not answer.
pub fn crowd(found: &Found, python: &Path, n: usize, seed: u64, progress: &mut dyn FnMut(usize)) -> Result<Crowd> {
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
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let ours = |batch: &Batch, substeps| pool.install(|| roll(batch, substeps));
    let (mut few, mut many) = (Referee::of(python, &judged, CROWD)?, Referee::of(python, &all, CROWD)?);
    let mut fine = |plain: bool| -> Result<_> {
        few.plain = plain;
        Ok(few.play(Scheme::ImplicitFast, FINE, false)?.frames)
    };
    let (truth, theirs) = (ours(&judged, FINE)?.0, [fine(false)?, fine(true)?]);
    let mut paces = Vec::new();
    for (k, substeps) in TRIED.into_iter().enumerate() {
        let frames = (n * CROWD) as f64;
        let (states, seconds) = (ours(&judged, substeps)?.0, ours(&all, substeps)?.1);
        paces.push(pace(system, OURS, substeps, frames / seconds, &states, &truth));
        for ((plain, name), truth) in [(false, "MuJoCo"), (true, PLAIN)].into_iter().zip(&theirs) {
            (few.plain, many.plain) = (plain, plain);
            let (states, seconds) = (few.play(Scheme::ImplicitFast, substeps, false)?.frames, many.time(Scheme::ImplicitFast, substeps)?);
            paces.push(pace(system, name, substeps, frames / seconds, &states, truth));
        }
        progress(k + 1);
    }
    let apart = distance(system, &truth, &theirs[0])[0];
    Ok(Crowd { version: few.version.clone(), paces, apart })
}

/// The first environments of a batch.
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
fn roll(begun: &Batch, substeps: usize) -> Result<(Vec<Vec<f64>>, f64)> {
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

fn pace(system: &System, engine: &'static str, substeps: usize, frames: f64, states: &[Vec<f64>], truth: &[Vec<f64>]) -> Pace {
    let [joints, root] = distance(system, states, truth);
    Pace { engine, substeps, joints, root, frames }
}

/// Mean distances of joints and of the root.
fn distance(system: &System, a: &[Vec<f64>], b: &[Vec<f64>]) -> [f64; 2] {
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

impl Crowd {
    /// Of a row of MuJoCo's: our fewest substeps that err by no more, and by how much those are faster.
    pub fn cheapest(&self, other: &Pace) -> Option<(usize, f64)> {
        let fits = |p: &&Pace| p.engine == OURS && p.joints <= other.joints && p.root <= other.root;
        let best = self.paces.iter().filter(fits).min_by_key(|p| p.substeps).filter(|_| other.engine != OURS)?;
        Some((best.substeps, best.frames / other.frames))
    }
}
