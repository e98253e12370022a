//! Checks solvers whose batch stays on the GPU at hand: that they move as on the CPU, and that harm to one environment, a full memory or
//! too large a robot ends in a line; and PPO's updates there against the CPU's. The first check that fails ends the program with an error.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example device_check
//! ```

use std::error::Error;
use std::sync::Arc;

use nerd_model::pick::Setting;
use nerd_sim::articulated::device::{CudaArticulated, Real, Roll};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, normal, start, stream};
use nerd_train::device::resident;
use nerd_train::learner::cuda::Precision;
use nerd_train::ppo::rollout::Rollout;
use nerd_train::ppo::update::{Adam, OnCpu, Updated, Updater};
use nerd_train::ppo::{Activation, CudaUpdater, Policy, PpoConfig, Shape, loss};

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    for setting in [Setting::Accurate, Setting::Neural("models/ant".into())] {
        let solver = || resident(&setting, &ant()?, Real::F64, Precision::F32).map_err(Box::<dyn Error>::from);
        println!("{setting}");
        frames_in_a_row(&setting, &solver)?;
        one_that_is_no_number(&solver)?;
        begun_anew(&solver)?;
        full(&solver)?;
    }
    too_large()?;
    passes()
}

fn ant() -> Result<Arc<System>, Box<dyn Error>> {
    Ok(System::named("ant")?)
}

fn batch(n: usize) -> Result<Batch, Box<dyn Error>> {
    let system = ant()?;
    let mut batch = Batch::new(&system, &system.scene("ground")?, n);
    (0..n).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(3, env as u64))));
    Ok(batch)
}

/// Of so many Ants.
fn torques(n: usize, frame: usize) -> Vec<f64> {
    (0..8 * n).map(|k| 5.0 * ((k + 31 * frame) as f64 * 0.7).sin()).collect()
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max)
}

fn demand(right: bool, what: String) -> Outcome {
    println!("  {what}");
    if right { Ok(()) } else { Err(what.into()) }
}

type Make<'a> = &'a dyn Fn() -> Result<Box<dyn Roll>, Box<dyn Error>>;

/// Frames one by one are those of a roll, to the bit; and nearly those of the CPU.
fn frames_in_a_row(setting: &Setting, solver: Make) -> Outcome {
    const FRAMES: usize = 30;
    let (mut one, mut all, mut cpu) = (batch(100)?, batch(100)?, batch(100)?);
    let (mut stepped, mut rolled, mut own) = (solver()?, solver()?, setting.solver(&ant()?)?);
    for frame in 0..FRAMES {
        stepped.step(&mut one, &torques(100, frame))?;
        own.step(&mut cpu, &torques(100, frame))?;
    }
    let every: Vec<f64> = (0..FRAMES).flat_map(|frame| torques(100, frame)).collect();
    rolled.roll(&mut all, &every, FRAMES)?;
    demand(one.states == all.states && one.frames == all.frames, format!("{FRAMES} frames one by one and in a row: the same bits"))?;
    let mut apart: Vec<f64> = one.states.chunks(29).zip(cpu.states.chunks(29)).map(|(a, b)| largest(a, b)).collect();
    apart.sort_by(f64::total_cmp);
    // Where an edge is met a motion may part; most do not.
    demand(apart[50] < 1e-4, format!("after them {:.1e} from the CPU in the median of 100, {:.1e} at most", apart[50], apart[99]))
}

/// A state that is none is set aside, and no other environment notices.
fn one_that_is_no_number(solver: Make) -> Outcome {
    let (mut sound, mut harmed) = (batch(100)?, batch(100)?);
    let d = harmed.system.robot.state_dim();
    harmed.states[41 * d + 9] = f64::NAN;
    solver()?.step(&mut sound, &torques(100, 0))?;
    let said = solver()?.step(&mut harmed, &torques(100, 0)).err().ok_or("nothing was said")?.to_string();
    let others = |b: &Batch| [&b.states[..41 * d], &b.states[42 * d..]].concat();
    demand(said.contains("environment 41") && others(&sound) == others(&harmed), format!("one that is no number: {said}"))
}

/// An environment that begins anew moves as a fresh one.
fn begun_anew(solver: Make) -> Outcome {
    let (mut long, mut fresh) = (batch(8)?, batch(8)?);
    let mut used = solver()?;
    for frame in 0..5 {
        used.step(&mut long, &torques(8, frame))?;
    }
    let begin = batch(8)?.state(3).to_vec();
    long.reset(3, &begin);
    used.reset(3);
    let mut new = solver()?;
    for frame in 0..3 {
        used.step(&mut long, &torques(8, frame))?;
        new.step(&mut fresh, &torques(8, frame))?;
    }
    demand(long.state(3) == fresh.state(3), "an environment that begins anew: the bits of a fresh one".into())
}

/// A device whose memory others have.
fn full(solver: Make) -> Outcome {
    let device = nerd_cuda::Device::open("", &[])?;
    let mut taken = Vec::new();
    let mut piece = 1usize << 34;
    while piece > 1 << 16 {
        match device.zeros::<u8>(piece) {
            Ok(memory) => taken.push(memory),
            Err(_) => piece /= 2,
        }
    }
    let mut batch = batch(2000)?;
    let said = solver()?.step(&mut batch, &torques(2000, 0)).err().map_or_else(|| "nothing was said".into(), |e| e.to_string());
    drop(taken);
    demand(["allocating", "MEMORY", "ALLOC"].iter().any(|word| said.contains(word)), format!("a full memory: {said}"))?;
    solver()?.step(&mut batch, &torques(2000, 0))?;
    Ok(())
}

/// A robot that no thread has room for.
fn too_large() -> Outcome {
    let link = |k: usize| {
        format!(
            r#"<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="j{k}" type="revolute"><parent link="{}"/><child link="l{k}"/><axis xyz="0 1 0"/>
            <limit lower="-3" upper="3" effort="1" velocity="9"/></joint>"#,
            if k == 0 { "base".into() } else { format!("l{}", k - 1) }
        )
    };
    let text = format!(r#"<robot name="chain"><link name="base"/>{}</robot>"#, (0..400).map(link).collect::<String>());
    let system = Arc::new(System::bare("chain", &text, false)?);
    let mut batch = Batch::new(&system, &system.scene("free")?, 2);
    let mut solver = CudaArticulated::new(ArticulatedConfig::accurate(&system), Real::F32);
    let said = solver.step(&mut batch, &[0.0; 800]).err().map_or_else(|| "nothing was said".into(), |e| e.to_string());
    demand(said.contains("too large") && !said.contains('\n'), format!("400 joints: {said}"))
}

/// PPO's passes over a rollout are the CPU's to rounding, for every kind of policy.
fn passes() -> Outcome {
    for (activation, spread_by_state, value_clip) in
        [(Activation::Relu, false, 0.0), (Activation::Elu, true, 0.2), (Activation::Tanh, false, 0.0)]
    {
        let shape = Shape { observation: 36, stack: 1, action: 8, hidden: vec![128, 64, 32], activation, spread_by_state };
        let config =
            PpoConfig { environments: 128, horizon: 33, minibatch: 1000, epochs: 2, value_clip, entropy: 0.01, ..PpoConfig::default() };
        let (n, mut rng) = (config.steps(), stream(8, 0));
        let first = Policy::new(shape.clone(), &mut rng);
        let mut noise = |n: usize| -> Vec<f64> { (0..n).map(|_| normal(&mut rng)).collect() };
        let observations = noise(n * 36);
        let said = first.answer(&observations);
        let actions: Vec<f32> = said.mean.iter().zip(noise(n * 8)).map(|(mean, x)| mean + x as f32).collect();
        let rows = actions.chunks(8).zip(said.mean.chunks(8)).zip(said.spread.chunks(8));
        let surprise = rows.map(|((a, mean), spread)| loss::surprise(a, mean, spread)).collect();
        let (values, advantages) = (first.values(&said), noise(n));
        let (mean, spread) = (said.mean.clone(), said.spread.clone());
        let rollout = Rollout { observations, actions, mean, spread, surprise, values, advantages, ..Rollout::default() };
        let pass = |updater: &mut dyn Updater| -> Result<_, Box<dyn Error>> {
            let (mut policy, mut adam) = (first.clone(), Adam::new(first.flat.len(), 1e-3));
            let updated = updater.update(&mut policy, &mut adam, &rollout, &config, (5, 3))?;
            Ok((policy, adam, updated))
        };
        let (cpu, gpu) = (pass(&mut OnCpu)?, pass(&mut CudaUpdater::new(&shape, &config)?)?);
        let norm = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
        let apart = norm(&cpu.0.flat, &gpu.0.flat) / norm(&cpu.0.flat, &first.flat);
        let terms = |u: &Updated| [u.actor_loss, u.critic_loss, u.bounds_loss, u.entropy, u.kl, u.clipped, u.gradient_norm];
        let of_terms = largest(&terms(&gpu.2), &terms(&cpu.2));
        let same = cpu.1.rate == gpu.1.rate && cpu.1.step == gpu.1.step && cpu.0.seen == gpu.0.seen;
        let what =
            format!("PPO, {activation:?}: weights {apart:.1e} of their way from the CPU's, terms {of_terms:.1e}, rate {:.1e}", gpu.1.rate);
        demand(apart < 1e-2 && of_terms < 1e-3 && same, what)?;
    }
    Ok(())
}
