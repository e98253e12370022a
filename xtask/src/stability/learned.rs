//! The same question for learned models (`--model FOLDER,..`): each against the truth it learned, from starts in and out of
//! the box it learned in, beside two predictors that know no dynamics and another engine.
//!
//! Errors are shares of the hold-last floor's: 1 is a predictor that knows nothing.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use nalgebra::Vector3;
use nerd_core::dynamics::{Data, totals};
use nerd_core::robot::Base;
use nerd_model::folder::ModelConfig;
use nerd_sim::dataset::Drive;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use nerd_train::evaluate::{Action, PassiveConfig, passive};

use super::Line;
use super::row::Cell;
use crate::common::Device;
use crate::solvers::neural;
use crate::truth::Truth;

const STARTS: usize = 32;

/// A robot in the scene it is judged in.
struct Case {
    system: Arc<System>,
    scene: Arc<Scene>,
    model: PathBuf,
    truth: Truth,
}

/// What is asked: name, figure, source of the limit, limit, measure.
type Ask = (&'static str, &'static str, &'static str, f64, fn(&Case, &Maker) -> Result<f64>);
/// Makes the solver under test for a system like the case's.
type Maker<'a> = dyn Fn(&Arc<System>) -> Result<Box<dyn Solver>> + 'a;

const FLOOR: &str = "a tenth of what knowing nothing gives";
const ROUND: &str = "rounding of f32";

const ASKS: [Ask; 14] = [
    ("10 frames", "error (of hold-last's)", FLOOR, 0.1, |c, m| horizon(c, m, 10)),
    ("100 frames", "error (of hold-last's)", FLOOR, 0.1, |c, m| horizon(c, m, 100)),
    ("1000 frames", "error (of hold-last's)", FLOOR, 0.1, |c, m| horizon(c, m, 1000)),
    ("gone in 1000 frames", "rollouts that left, of 32", "none may", 0.0, gone),
    ("velocities x 1.25", "error of 50 frames (of hold-last's)", FLOOR, 0.1, |c, m| outside(c, m, 1.25, 0.0)),
    ("velocities x 1.5", "error of 50 frames (of hold-last's)", FLOOR, 0.1, |c, m| outside(c, m, 1.5, 0.0)),
    ("velocities x 2", "error of 50 frames (of hold-last's)", FLOOR, 0.1, |c, m| outside(c, m, 2.0, 0.0)),
    ("random torques", "error of 50 frames (of hold-last's)", FLOOR, 0.1, |c, m| outside(c, m, 1.0, 1.0)),
    ("torques x 2", "error of 50 frames (of hold-last's)", FLOOR, 0.1, |c, m| outside(c, m, 1.0, 2.0)),
    ("moved 1 m", "difference of 20 frames", ROUND, 1e-4, |c, m| moved(c, m, 1.0)),
    ("moved 1 km", "difference of 20 frames", ROUND, 1e-4, |c, m| moved(c, m, 1e3)),
    ("moved 100 km", "difference of 20 frames", ROUND, 1e-4, |c, m| moved(c, m, 1e5)),
    ("history", "after a reset, and after a gap, against fresh", ROUND, 1e-4, history),
    ("energy in flight", "change beyond the truth's in 100 frames (of the largest kinetic)", "energy is the truth's", 0.05, flight),
];

/// Title, names of the columns, lines.
type Table = (String, Vec<String>, Vec<Line>);

/// Tables of all models.
pub fn tables(models: &[PathBuf], words: &[String]) -> Result<Vec<Table>> {
    super::known(words, &ASKS.map(|a| a.0))?;
    models.iter().map(|folder| table(folder, words)).collect()
}

fn table(folder: &Path, words: &[String]) -> Result<Table> {
    let config = ModelConfig::read(folder)?;
    let system = System::named(&config.robot)?;
    let scene = system.scene(system.usual_scenes().last().copied().unwrap_or("free"))?;
    let case = Case { system, scene, model: folder.into(), truth: Truth::named(&config.truth)? };
    let makers: [(&str, &Maker); 4] = [
        ("learned", &|system| Ok(Box::new(neural(&case.model, system, None, Device::Cpu, STARTS)?))),
        ("hold last", &|_| Ok(Box::new(Blind { glide: false }))),
        ("constant velocity", &|_| Ok(Box::new(Blind { glide: true }))),
        ("rapier 4x4", &|_| Ok(Box::new(Rapier::new(RapierConfig::default())))),
    ];
    let asks: Vec<&Ask> = ASKS.iter().filter(|a| words.is_empty() || words.iter().any(|w| a.0.contains(w.as_str()))).collect();
    let bar = crate::common::bar(&format!("{}: cells", case.system.name), (asks.len() * makers.len()) as u64);
    let mut lines = Vec::new();
    for (row, figure, source, limit, measure) in asks.iter().map(|a| **a) {
        let mut cells = Vec::new();
        for (_, maker) in &makers {
            cells.push(Cell::new(measure(&case, *maker).map_err(|e| format!("{e:#}")), None, limit));
            bar.set((lines.len() * makers.len() + cells.len()) as u64);
        }
        lines.push(Line { row, figure, source, limit, cells });
    }
    bar.finish();
    let title = format!("{} in {}, learned from {}", folder.display(), case.scene.name, case.truth.name());
    Ok((title, makers.iter().map(|m| m.0.to_string()).collect(), lines))
}

fn horizon(case: &Case, maker: &Maker, steps: usize) -> Result<f64> {
    let config = PassiveConfig { starts: STARTS, steps, seed: 21, action: Action::Zero };
    let (mut truth, mut solver) = (case.truth.solver(&case.system), maker(&case.system)?);
    let report = passive(&case.system, &case.scene, &mut *truth, &mut *solver, config, &mut |_| ())?;
    Ok(report.error.iter().sum::<f64>() / report.hold.iter().sum::<f64>().max(1e-12))
}

fn gone(case: &Case, maker: &Maker) -> Result<f64> {
    let config = PassiveConfig { starts: STARTS, steps: 1000, seed: 22, action: Action::Zero };
    let (mut truth, mut solver) = (case.truth.solver(&case.system), maker(&case.system)?);
    Ok(passive(&case.system, &case.scene, &mut *truth, &mut *solver, config, &mut |_| ())?.diverged as f64)
}

/// Starts of the training box with all velocities times `factor`, driven as the training data times `drive`.
fn outside(case: &Case, maker: &Maker, factor: f64, drive: f64) -> Result<f64> {
    let (nq, joints) = (case.system.robot.nq(), case.system.robot.joint_count());
    let mut batch = starts(&case.system, &case.scene);
    for env in 0..STARTS {
        batch.state_mut(env)[nq..].iter_mut().for_each(|v| *v *= factor);
    }
    let (first, mut real, mut solvers) = (batch.clone(), batch.clone(), (case.truth.solver(&case.system), maker(&case.system)?));
    let (mut rng, mut law, mut torques) = (stream(23, 0), Drive::new(&case.system), vec![0.0; STARTS * joints]);
    let (mut error, mut hold) = (0.0, 0.0);
    for _ in 0..50 {
        for env in 0..STARTS {
            law.draw(real.state(env), drive, &mut rng, &mut torques[env * joints..(env + 1) * joints]);
        }
        solvers.0.step(&mut real, &torques)?;
        solvers.1.step(&mut batch, &torques)?;
        error += distance(&case.system, &real, &batch);
        hold += distance(&case.system, &real, &first);
    }
    Ok(error / hold.max(1e-12))
}

/// The world moved along x: the robot's base or pose, and every collider.
fn moved(case: &Case, maker: &Maker, by: f64) -> Result<f64> {
    let by = Vector3::new(by, 0.0, 0.0);
    let mut system = (*case.system).clone();
    let mut scene = (*case.scene).clone();
    for collider in &mut scene.colliders {
        collider.pose.translation.vector += by;
        collider.plane.iter_mut().for_each(|p| p.offset += p.normal.dot(&by));
    }
    if let Base::Fixed(pose) = &mut system.robot.base {
        pose.translation.vector += by;
    }
    let (here, system) = (starts(&case.system, &case.scene), Arc::new(system));
    let scene = Arc::new(scene);
    let mut there = Batch { system: system.clone(), scenes: vec![scene; STARTS], ..here.clone() };
    shift(&mut there, &by);
    let (here, mut there) = (run(here, &mut *maker(&case.system)?, 20)?, run(there, &mut *maker(&system)?, 20)?);
    shift(&mut there, &-by);
    Ok(here.states.iter().zip(&there.states).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max))
}

/// Moves floating robots: `p += by`, and the twist about the world's origin keeps its velocity, `v += by x w`.
fn shift(batch: &mut Batch, by: &Vector3<f64>) {
    let (nq, floating) = (batch.system.robot.nq(), batch.system.robot.floating());
    for env in (0..batch.len()).filter(|_| floating) {
        let state = batch.state_mut(env);
        let w = Vector3::from_column_slice(&state[nq..nq + 3]);
        let moment = by.cross(&w);
        for k in 0..3 {
            state[k] += by[k];
            state[nq + 3 + k] += moment[k];
        }
    }
}

fn history(case: &Case, maker: &Maker) -> Result<f64> {
    let fresh = run(starts(&case.system, &case.scene), &mut *maker(&case.system)?, 15)?;
    let gap = |batch: Batch| fresh.states.iter().zip(&batch.states).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    // Told to forget.
    let mut solver = maker(&case.system)?;
    run(starts(&case.system, &case.scene), &mut *solver, 12)?;
    (0..STARTS).for_each(|env| solver.reset(env));
    let reset = run(starts(&case.system, &case.scene), &mut *solver, 15)?;
    // Not told: another solver steps some frames in between, then the start is put back by hand.
    let mut solver = maker(&case.system)?;
    let begun = run(starts(&case.system, &case.scene), &mut *solver, 5)?;
    let mut skipped = run(begun, &mut *case.truth.solver(&case.system), 3)?;
    skipped.states.clone_from(&starts(&case.system, &case.scene).states);
    let skipped = run(skipped, &mut *solver, 15)?;
    Ok(gap(reset).max(gap(skipped)))
}

fn flight(case: &Case, maker: &Maker) -> Result<f64> {
    let free = Arc::new(Scene::free(case.scene.gravity));
    let (mut real, mut made) = (starts(&case.system, &free), starts(&case.system, &free));
    let (mut truth, mut solver) = (case.truth.solver(&case.system), maker(&case.system)?);
    let torques = vec![0.0; STARTS * case.system.robot.joint_count()];
    let mut data = Data::new(&case.system.robot);
    let (mut worst, mut kinetic) = (vec![0.0f64; STARTS], vec![1e-9f64; STARTS]);
    for _ in 0..100 {
        truth.step(&mut real, &torques)?;
        solver.step(&mut made, &torques)?;
        for env in 0..STARTS {
            let [a, b] = [&real, &made].map(|batch| totals(&case.system.robot, batch.state(env), &mut data));
            worst[env] = worst[env].max((a.energy(&free.gravity) - b.energy(&free.gravity)).abs());
            kinetic[env] = kinetic[env].max(a.kinetic);
        }
    }
    let shares = worst.iter().zip(&kinetic).map(|(w, k)| w / k);
    Ok(shares.sum::<f64>() / STARTS as f64)
}

/// A batch from the training box.
fn starts(system: &Arc<System>, scene: &Arc<Scene>) -> Batch {
    let mut batch = Batch::new(system, scene, STARTS);
    (0..STARTS).for_each(|env| batch.reset(env, &start(system, Start::Sample, &mut stream(24, env as u64))));
    batch
}

fn run(mut batch: Batch, solver: &mut dyn Solver, frames: usize) -> Result<Batch> {
    let torques = vec![0.0; batch.len() * batch.system.robot.joint_count()];
    for _ in 0..frames {
        solver.step(&mut batch, &torques)?;
    }
    Ok(batch)
}

/// Mean |difference| of positions, endless angles wrapped.
fn distance(system: &System, a: &Batch, b: &Batch) -> f64 {
    let (d, nq, coords) = (system.robot.state_dim(), system.robot.nq(), system.robot.root_coords());
    let wraps: Vec<bool> = system.robot.joints().map(|j| j.wraps()).collect();
    let gap = |(i, (a, b)): (usize, (&f64, &f64))| {
        let turns = i % d >= coords && wraps[i % d - coords];
        if turns { nerd_core::state::wrap(a - b).abs() } else { (a - b).abs() }
    };
    a.states.iter().zip(&b.states).enumerate().filter(|(i, _)| i % d < nq).map(gap).sum()
}

/// A predictor without dynamics: stays where it is, or goes on as it goes.
struct Blind {
    glide: bool,
}

impl Solver for Blind {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        if self.glide {
            let (d, h) = (batch.system.robot.state_dim(), batch.system.frame_time);
            for state in next.chunks_exact_mut(d) {
                nerd_train::evaluate::glide(&batch.system, state, h);
            }
        }
        nerd_sim::solver::commit(batch, &mut next, &mut Vec::new())
    }
}
