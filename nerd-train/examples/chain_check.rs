//! Checks chains whose batch stays on the GPU at hand, among pegs: the learned one against the CPU's, the analytic solver with its springs and
//! whips, and updates of training. All checks are made; one that fails ends the program with an error.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example chain_check
//! ```

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use nerd_model::chain::{Chain, ChainSolver};
use nerd_model::folder::Model;
use nerd_model::pick::Setting;
use nerd_sim::articulated::device::{Real, Roll};
use nerd_sim::dataset::{GenerateConfig, begin};
use nerd_sim::prelude::*;
use nerd_train::chain::{ChainLearner, Motions, scales};
use nerd_train::device::resident;
use nerd_train::learner::cuda::{CudaUnroll, Precision};
use nerd_train::learner::{Learner, LearnerConfig, LearnerState, Optimizer};
use nerd_train::ranks::Ranks;

/// Leads, and frames in which they fall onto floor and pegs.
const LEADS: usize = 64;
const FALL: usize = 40;

type Caught<T> = Result<T, Box<dyn Error>>;

fn main() -> Caught<()> {
    let (fallen, mut failed) = (fallen()?, 0);
    let learned = || Setting::Neural("models/lead-pegs".into());
    let mut demand = |right: bool, what: String| {
        println!("{} {what}", if right { "  " } else { "NO" });
        failed += usize::from(!right);
    };
    for (setting, precision) in [
        (learned(), Precision::F32),
        (learned(), Precision::Tf32),
        (Setting::Implicit(1), Precision::F32),
        (Setting::Implicit(4), Precision::F32),
        (Setting::Implicit(32), Precision::F32),
    ] {
        match pace(&setting, precision, &fallen, 4096) {
            Ok(pace) => demand(true, format!("{setting}, {precision:?}: {pace:.3} us a frame and environment, of 4096")),
            Err(error) => demand(false, format!("{setting}: {error}")),
        }
    }
    let (full, short) = (Precision::F32, Precision::Tf32);
    for (setting, kind, frames, most) in [
        (learned(), (Real::F32, full), 1, 1e-4),
        (learned(), (Real::F32, full), 30, 0.05),
        // Roundings are 2^13 times as large as with 32 bits, whose median was 1.4e-6.
        (learned(), (Real::F32, short), 1, 1e-2),
        (learned(), (Real::F32, short), 30, 0.1),
        (Setting::Implicit(1), (Real::F64, full), 1, 1e-6),
        (Setting::Implicit(4), (Real::F64, full), 1, 1e-6),
        (Setting::Implicit(4), (Real::F64, full), 10, 1e-3),
        (Setting::Implicit(4), (Real::F32, full), 1, 1e-2),
        (Setting::Implicit(16), (Real::F32, full), 1, 1e-2),
    ] {
        match apart(&setting, kind, frames, &fallen) {
            Ok([middle, worst]) => {
                let what = format!("{setting}, {kind:?}, {frames} frames: {middle:.1e} from the CPU in the median, {worst:.1e} at most");
                demand(middle < most, what);
            }
            Err(error) => demand(false, format!("{setting}, {kind:?}: {error}")),
        }
    }
    for (setting, precision) in [(learned(), full), (learned(), short), (Setting::Implicit(4), full)] {
        let kind = (Real::F32, precision);
        match in_a_row(&setting, kind, &fallen) {
            Ok(same) => demand(same, format!("{setting}, {precision:?}: frames one by one and in a row, the same bits")),
            Err(error) => demand(false, format!("{setting}, {precision:?}: {error}")),
        }
        match harmed(&setting, kind, &fallen) {
            Ok((others, said)) => {
                demand(others && said.contains("environment 7"), format!("{setting}, {precision:?}, one that is no number: {said}"));
            }
            Err(error) => demand(false, format!("{setting}, {precision:?}: {error}")),
        }
    }
    match learned_alike() {
        Ok((apart, said)) => demand(apart[0] < 1e-3 && apart[1] < 1e-2, said),
        Err(error) => demand(false, format!("training: {error}")),
    }
    if failed == 0 { Ok(()) } else { Err(format!("{failed} checks failed").into()) }
}

/// How far apart losses and gradient norms of the CPU's and the card's updates are, as shares; and what an update of many takes on the card.
fn learned_alike() -> Caught<([f32; 2], String)> {
    let system = System::named("lead-pegs")?;
    let motions = |trajectories: usize| -> Caught<Arc<Motions>> {
        let config = GenerateConfig { transitions: trajectories * FALL, frames: FALL, ..GenerateConfig::default() };
        let solver = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))) };
        Ok(Arc::new(Motions::record(&system, &solver, &config, &|_| ())?))
    };
    let (model, train) = (Model::load(Path::new("models/lead-pegs"), &system, None)?, motions(LEADS)?);
    let (chain, scale) = (Chain::of(&system)?, ChainSolver::scale(&model.normalizer)?);
    let (_, velocity) = scales(&chain, &train);
    let sets = [train.clone(), train];
    let config = LearnerConfig { batch: 24, clip: 1.0, average: 0.9, seed: 0, huber: None, optimizer: Optimizer::Adam };
    let state = LearnerState::new(model.weights.clone());
    let mut here = ChainLearner::new(chain, config, state.clone(), sets.clone(), (scale, velocity), 8)?;
    let there = |batch: usize, precision: Precision, frames: usize| {
        let config = LearnerConfig { batch, ..config };
        CudaUnroll::new(&system, (config, precision), state.clone(), sets.clone(), (scale, velocity), frames, &Ranks::default())
    };
    let (mut device, mut apart, mut last) = (there(24, Precision::F32, 8)?, [0.0f32; 2], [0.0f32; 2]);
    for _ in 0..6 {
        here.update(1e-4)?;
        device.update(1e-4)?;
        let (a, b) = (here.progress()?, device.progress()?);
        let off = [b.loss / a.loss - 1.0, b.gradient_norm / a.gradient_norm - 1.0];
        apart.iter_mut().zip(off).for_each(|(apart, off)| *apart = larger((*apart).into(), off.abs().into()) as f32);
        last = [a.loss, b.loss];
    }
    let mut paces = Vec::new();
    for (batch, frames) in [(512, 1), (512, 16), (512, 32), (2048, 32)] {
        let mut device = there(batch, Precision::Tf32, frames)?;
        (0..3).try_for_each(|_| device.update(1e-5))?;
        device.progress()?;
        let began = Instant::now();
        (0..5).try_for_each(|_| device.update(1e-5))?;
        device.progress()?;
        paces.push(format!("{batch} through {frames} frames {:.2} ms", 200.0 * began.elapsed().as_secs_f64()));
    }
    let said = format!(
        "six updates through 8 frames: losses {last:?}, {:.1e} apart, gradients' norms {:.1e}; an update of {}",
        apart[0],
        apart[1],
        paces.join(", ")
    );
    Ok((apart, said))
}

/// Leads that lie across floor and pegs.
fn fallen() -> Caught<Batch> {
    let system = System::named("lead-pegs")?;
    let config = GenerateConfig { transitions: LEADS * FALL, frames: FALL, ..GenerateConfig::default() };
    let mut batch = begin(&system, &config, 0, LEADS)?;
    let mut solver = Setting::Implicit(4).solver(&system)?;
    (0..FALL).try_for_each(|frame| solver.step(&mut batch, &torques(LEADS, frame)))?;
    Ok(batch)
}

/// Of so many grippers, on their slides and turns.
fn torques(n: usize, frame: usize) -> Vec<f64> {
    (0..86 * n).map(|k| if k % 86 < 6 { 3.0 * ((k + 31 * frame) as f64 * 0.7).sin() } else { 0.0 }).collect()
}

/// What is reckoned within a frame, and a network's products.
type Kind = (Real, Precision);

fn solver(setting: &Setting, (real, precision): Kind, batch: &Batch) -> Caught<Box<dyn Roll>> {
    Ok(resident(setting, &batch.system, real, precision)?)
}

/// The larger one; what is no number is the largest of all.
fn larger(most: f64, off: f64) -> f64 {
    if most.is_nan() || off <= most { most } else { off }
}

/// Differences after so many frames, by environment: in the median, and the largest.
fn apart(setting: &Setting, kind: Kind, frames: usize, fallen: &Batch) -> Caught<[f64; 2]> {
    let (mut here, mut there, d) = (fallen.clone(), fallen.clone(), fallen.system.robot.state_dim());
    let (mut own, mut device) = (setting.solver(&fallen.system)?, solver(setting, kind, fallen)?);
    for frame in 0..frames {
        own.step(&mut here, &torques(LEADS, frame))?;
        device.step(&mut there, &torques(LEADS, frame))?;
    }
    let largest = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, larger);
    let mut all: Vec<f64> = there.states.chunks(d).zip(here.states.chunks(d)).map(largest).collect();
    all.sort_by(f64::total_cmp);
    Ok([all[LEADS / 2], all[LEADS - 1]])
}

fn in_a_row(setting: &Setting, kind: Kind, fallen: &Batch) -> Caught<bool> {
    let (mut one, mut all) = (fallen.clone(), fallen.clone());
    let mut stepped = solver(setting, kind, fallen)?;
    (0..5).try_for_each(|frame| stepped.step(&mut one, &torques(LEADS, frame)))?;
    let every: Vec<f64> = (0..5).flat_map(|frame| torques(LEADS, frame)).collect();
    solver(setting, kind, fallen)?.roll(&mut all, &every, 5)?;
    Ok(one.states == all.states && one.frames == all.frames)
}

/// A state that is none is set aside: whether no other environment notices, and what is said.
fn harmed(setting: &Setting, kind: Kind, fallen: &Batch) -> Caught<(bool, String)> {
    let (mut sound, mut harmed, d) = (fallen.clone(), fallen.clone(), fallen.system.robot.state_dim());
    harmed.states[7 * d + 9] = f64::NAN;
    solver(setting, kind, fallen)?.step(&mut sound, &torques(LEADS, 0))?;
    let said = solver(setting, kind, fallen)?.step(&mut harmed, &torques(LEADS, 0)).err().ok_or("nothing was said")?;
    let others = |b: &Batch| [&b.states[..7 * d], &b.states[8 * d..]].concat();
    Ok((others(&sound) == others(&harmed), said.to_string()))
}

/// Microseconds of a frame of one of so many environments, over ten frames.
fn pace(setting: &Setting, precision: Precision, fallen: &Batch, n: usize) -> Caught<f64> {
    const FRAMES: usize = 10;
    let mut many = Batch::new(&fallen.system, &fallen.scenes[0], n);
    for env in 0..n {
        many.reset(env, fallen.state(env % LEADS));
        many.scenes[env] = fallen.scenes[env % LEADS].clone();
    }
    let mut solver = resident(setting, &fallen.system, Real::F32, precision)?;
    solver.roll(&mut many, &torques(n, 0), FRAMES)?;
    let began = Instant::now();
    solver.roll(&mut many, &torques(n, 0), FRAMES)?;
    Ok(1e6 * began.elapsed().as_secs_f64() / (n * FRAMES) as f64)
}
