//! Checks, on the GPUs at hand, that several of them make the updates that one makes, and times them.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example ranks_check
//! ```
//!
//! On one GPU: the gradients of parts of a batch add up to that of the whole. On several: as many ranks as there are, which this program
//! starts itself, come to the losses of one rank alone, and to equal weights. The first check that fails ends the program with an error.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use nerd_cuda::Device;
use nerd_model::transformer::Weights;
use nerd_train::learner::cuda::{CudaLearner, Precision};
use nerd_train::learner::{Learner, LearnerConfig, LearnerState};
use nerd_train::ranks::{self, End, Place, RankError, Ranks};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Windows in an update, updates between two losses, losses.
const BATCH: usize = 512;
const UPDATES: usize = 20;
const LOSSES: usize = 10;
/// Updates that are timed.
const TIMED: usize = 1000;
/// Losses drift apart as rounding grows, update by update: by this factor more at most than those of a run alone whose weights began a rounding
/// away, or by this much at all.
const MORE: f32 = 10.0;
const ROUNDING: f32 = 1e-5;

fn main() -> Outcome {
    let place = Place::here()?;
    if place.world > 1 {
        ranks::with_launcher();
        let ranks = Ranks::join(place, end)?;
        let done = several(&ranks).map_err(|e| e.to_string());
        ranks.leave(done.as_ref().err().map(String::as_str));
        return Ok(done?);
    }
    parts()?;
    let count = Device::count()?;
    if count == 1 {
        println!("one GPU: there is nothing to add up");
        return Ok(());
    }
    match ranks::launch(count)? {
        End::Well => Ok(()),
        End::Said => Err("the ranks did not end well".into()),
        End::Ill(reason) => Err(reason.into()),
    }
}

fn end(error: &RankError) {
    eprintln!("error: {error}");
    std::process::exit(2);
}

fn configuration() -> LearnerConfig {
    LearnerConfig { batch: BATCH, clip: 1.0, average: 0.999, seed: 5, huber: None, optimizer: Default::default() }
}

fn state() -> LearnerState {
    LearnerState::new(Weights::init(network(), 1))
}

/// The gradients of two parts of a batch, a small one and a large one, against that of the whole.
fn parts() -> Outcome {
    let data = windows();
    let of = |rows| -> Outcome<(f32, Vec<f32>)> {
        Ok(CudaLearner::of_rows(rows, configuration(), Precision::F32, state(), &data, &data)?.gradient()?)
    };
    let (whole, parts) = (of(0..BATCH)?, [of(0..100)?, of(100..BATCH)?]);
    let scale = whole.1.iter().map(|g| g.abs()).fold(0.0, f32::max);
    let sums = whole.1.iter().zip(parts[0].1.iter().zip(&parts[1].1)).map(|(whole, (a, b))| (whole - a - b).abs());
    let (gradient, loss) = (sums.fold(0.0, f32::max) / scale, (parts[0].0 + parts[1].0) / whole.0 - 1.0);
    println!("parts of a batch: the gradient off by {gradient:.1e} of its largest entry, the loss by {loss:.1e}");
    if gradient < 1e-4 && loss.abs() < 1e-4 { Ok(()) } else { Err("parts do not add up".into()) }
}

/// Losses of some updates, what they led to, and the time of one update (s).
fn run(learner: &mut CudaLearner) -> Outcome<(Vec<f32>, LearnerState, f64)> {
    let mut losses = Vec::new();
    for _ in 0..LOSSES {
        (0..UPDATES).try_for_each(|_| learner.update(1e-3))?;
        losses.push(learner.progress()?.loss);
    }
    let (state, started) = (learner.state()?, Instant::now());
    (0..TIMED).try_for_each(|_| learner.update(1e-4))?;
    learner.progress()?;
    Ok((losses, state, started.elapsed().as_secs_f64() / TIMED as f64))
}

/// All ranks together, then rank 0 alone.
fn several(ranks: &Ranks) -> Outcome {
    let data = Arc::new(windows());
    let mut learner = CudaLearner::among(ranks, configuration(), Precision::F32, state(), &data, &data)?;
    let (losses, reached, time) = run(&mut learner)?;
    ranks.agree("weights", &ranks::bytes(&reached.weights.flat), |_, _| "they should be the same bits".into())?;
    ranks.wait()?;
    drop(learner);
    if !ranks.leads() {
        return Ok(());
    }
    let (alone, _, one) = run(&mut CudaLearner::new(configuration(), Precision::F32, state(), &data, &data)?)?;
    let mut near = state();
    near.weights.flat.iter_mut().for_each(|w| *w *= 1.0 + f32::EPSILON);
    let (moved, ..) = run(&mut CudaLearner::new(configuration(), Precision::F32, near, &data, &data)?)?;
    let off = |other: &[f32]| -> Vec<f32> { other.iter().zip(&alone).map(|(a, b)| (a / b - 1.0).abs()).collect() };
    let (off, rounding) = (off(&losses), off(&moved));
    println!("{} ranks: losses {losses:.4?}; weights are equal on all", ranks.world());
    let words = |all: &[f32]| all.iter().map(|x| format!("{x:.1e}")).collect::<Vec<_>>().join(" ");
    println!("off those of one rank by {}; one rank that began a rounding away is off by {}", words(&off), words(&rounding));
    println!("an update of {BATCH} windows, f32: {:.3} ms, alone {:.3} ms", 1e3 * time, 1e3 * one);
    let mut most: f32 = 0.0;
    for (off, rounding) in off.iter().zip(&rounding) {
        // What has grown does not shrink.
        most = most.max(MORE * rounding).max(ROUNDING);
        if off.is_nan() || *off > most {
            return Err("other losses than those of one rank".into());
        }
    }
    Ok(())
}

/// The paper's network.
fn network() -> TransformerConfig {
    TransformerConfig::paper(37, 4, 192)
}

/// Windows to learn from: uniform inputs, and targets that mix two of them.
fn windows() -> Windows {
    let TransformerConfig { inputs, outputs, .. } = network();
    let (trajectories, frames) = (200, 100);
    let noise = |i: usize| draw(2, 0, i as u64, 1 << 24) as f32 / (1 << 23) as f32 - 1.0;
    let x: Vec<f32> = (0..trajectories * frames * inputs).map(noise).collect();
    let y = (0..trajectories * frames * outputs).map(|k| {
        let token = &x[k / outputs * inputs..][..inputs];
        token[k % outputs] - token[0] * token[inputs - 1]
    });
    Windows { inputs, outputs, frames, history: network().sequence(), y: y.collect(), x }
}
