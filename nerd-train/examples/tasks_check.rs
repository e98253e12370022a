//! Checks, on the GPU at hand, that rollouts whose tasks are there are those of tasks on the CPU, that what is learned from them there is what the
//! CPU learns, and that a run goes on from a snapshot.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example tasks_check
//! ```
//!
//! The first check that fails ends the program with an error.

use std::error::Error;
use std::path::Path;

use nerd_model::pick::Setting;
use nerd_sim::sampling::stream;
use nerd_sim::system::System;
use nerd_tasks::{Episodes, named, names};
use nerd_train::device::Device;
use nerd_train::ppo::{Activation, Adam, Arena, CudaEngine, Engine, OnCpu, Policy, PpoConfig, Rollout, Running, Shape, StreamKey, Taken};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Environments, and steps of a rollout.
const N: usize = 512;
const HORIZON: usize = 16;
const SEED: u64 = 3;
/// Numbers that differ by more than this are apart; so many of all may be, since contact now and then falls otherwise.
const APART: f64 = 1e-4;
const SHARE: f64 = 0.02;

fn main() -> Outcome {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let models = if models.exists() { models } else { "models".into() };
    for name in names() {
        let task = named(name)?;
        if task.kernels(&*System::named(task.robot())?, 1).is_err() {
            continue;
        }
        both(name, &Arena::Model { folder: models.join(task.robot()), device: Device::Cuda })?;
        both(name, &Arena::Card(Setting::Implicit(4)))?;
    }
    Ok(())
}

/// Weights of the card's update within this share of their way.
const LEARNED: f64 = 1e-2;

/// One side of the comparison.
struct Side {
    episodes: Episodes,
    engine: CudaEngine,
    running: Running,
}

impl Side {
    /// Whose episodes are stepped on the card, or by their own solver.
    fn new(episodes: Episodes, on_card: bool, shape: &Shape, config: &PpoConfig) -> Outcome<Self> {
        let (running, mut engine) = (Running::new(&episodes, shape.stack), CudaEngine::new(shape, config)?);
        engine.steps_episodes = on_card;
        Ok(Self { episodes, engine, running })
    }

    /// How far apart, as a share of their way, weights are that card and CPU learn from the last rollout.
    fn learn(&mut self, first: &Policy, config: &PpoConfig) -> Outcome<f64> {
        let adam = Adam::new(first.flat.len(), 1e-3);
        let [mut one, mut other] = [(first.clone(), adam.clone()), (first.clone(), adam)];
        let (mut cpu, orders) = (OnCpu::default(), StreamKey { seed: 5, number: 0 });
        cpu.rollout = self.engine.rollout()?;
        cpu.update(&mut one.0, &mut one.1, config, orders)?;
        self.engine.update(&mut other.0, &mut other.1, config, orders)?;
        let norm = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
        Ok(norm(&one.0.flat, &other.0.flat) / norm(&one.0.flat, &first.flat))
    }

    fn roll(&mut self, policy: &Policy, config: &PpoConfig, number: usize) -> Outcome<(Rollout, Taken)> {
        let noise = StreamKey { seed: 7, number: (number * HORIZON) as u64 };
        let taken = self.engine.roll(&mut self.episodes, &mut self.running, policy, config, noise)?;
        Ok((self.engine.rollout()?, taken))
    }
}

/// Episodes of which some will soon run out of time.
fn episodes(task: &str, arena: &Arena) -> Outcome<Episodes> {
    let mut episodes = arena.episodes(task, N, SEED)?;
    let length = episodes.task.episode_length() * episodes.task.frames();
    let mut kept = episodes.snapshot();
    kept.frames.iter_mut().enumerate().filter(|(env, _)| env % 5 == 0).for_each(|(env, f)| *f = length - 1 - (env as u64 % 40));
    episodes.restore(&kept)?;
    Ok(episodes)
}

fn both(task: &str, arena: &Arena) -> Outcome {
    // The last minibatch of a pass is smaller; the rate is left alone, since a rounding may carry a divergence across its threshold.
    let config = PpoConfig {
        environments: N,
        horizon: HORIZON,
        minibatch: 1000,
        epochs: 2,
        kl: 0.0,
        stack: if task == "franka-reach-torque" { 3 } else { 1 },
        hidden: vec![64, 32],
        activation: Activation::Elu,
        ..PpoConfig::default()
    };
    let host = episodes(task, arena)?;
    let shape = Shape::of(&*host.task, &config);
    let policy = Policy::new(shape.clone(), &mut stream(8, 0));
    let (mut cpu, mut gpu) = (Side::new(host, false, &shape, &config)?, Side::new(episodes(task, arena)?, true, &shape, &config)?);
    let title = format!("{task} on {}", arena.title()?);
    for number in 0..2 {
        let ((one, told), (other, said)) = (cpu.roll(&policy, &config, number)?, gpu.roll(&policy, &config, number)?);
        if !gpu.engine.has_episodes() {
            return Err(format!("{title}: it was not rolled on the device").into());
        }
        let numbers = [
            ("observations", share(&one.observations, &other.observations)),
            ("actions", share(&wide(&one.actions), &wide(&other.actions))),
            ("values", share(&one.values, &other.values)),
            ("advantages", share(&one.advantages, &other.advantages)),
            ("rows", share(&cpu.running.stack.rows, &gpu.running.stack.rows)),
        ];
        let ends = [told.ended.len(), said.ended.len(), told.failed, said.failed];
        println!("{title}, rollout {number}: episodes ended, failed on CPU and device {ends:?}");
        numbers.iter().for_each(|(what, (share, most))| println!("  {what}: {share:.1e} of them apart, {most:.1e} at most"));
        let near = told.ended.len().abs_diff(said.ended.len()) as f64 <= 1.0 + SHARE * told.ended.len() as f64;
        if !near || numbers.iter().any(|(_, (share, _))| *share > SHARE) {
            return Err(format!("{title}: tasks on the device are not those of the CPU").into());
        }
    }
    let apart = gpu.learn(&policy, &config)?;
    println!("{title}: weights {apart:.1e} of their way from those that the CPU learns");
    if apart.is_nan() || apart > LEARNED {
        return Err(format!("{title}: the device learns otherwise").into());
    }
    let kept = gpu.engine.snapshot(&gpu.episodes)?;
    let mut other = Side::new(arena.episodes(task, N, SEED)?, true, &shape, &config)?;
    other.engine.restore(&mut other.episodes, &kept)?;
    other.running = gpu.running.clone();
    let (gone_on, begun_again) = (gpu.roll(&policy, &config, 2)?.0, other.roll(&policy, &config, 2)?.0);
    let (share, most) = share(&gone_on.observations, &begun_again.observations);
    println!("{title}, gone on from a snapshot: {share:.1e} apart, {most:.1e} at most");
    let exact = matches!(arena, Arena::Card(_));
    if share > SHARE || (exact && most > 0.0) { Err(format!("{title}: it goes on otherwise").into()) } else { Ok(()) }
}

fn wide(numbers: &[f32]) -> Vec<f64> {
    numbers.iter().copied().map(f64::from).collect()
}

/// Share of the numbers that are apart, and the largest difference.
fn share(a: &[f64], b: &[f64]) -> (f64, f64) {
    assert_eq!(a.len(), b.len());
    let off = || a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs()));
    let beyond = off().filter(|x| x.is_nan() || *x > APART).count();
    (beyond as f64 / a.len().max(1) as f64, off().fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most }))
}
