//! Checks solvers whose batch stays on the GPU at hand: that they move as on the CPU, and that harm to one environment, a full memory or
//! too large a robot ends in a line; and PPO's answers, rollouts and updates there against the CPU's. The first check that fails ends the program with an error.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example device_check
//! ```

use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use nerd_model::pick::Setting;
use nerd_sim::articulated::device::{CudaArticulated, Real, Roll};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, normal, start, stream};
use nerd_tasks::StepResult;
use nerd_train::device::{Device, resident};
use nerd_train::learner::cuda::Precision;
use nerd_train::ppo::{Activation, Adam, CudaEngine, Engine, OnCpu, Policy, PpoConfig, Shape, StreamKey, Updated};

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
    without_joints()?;
    hills()?;
    too_large()?;
    learning()
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
    let d = one.system.robot.state_dim();
    let mut apart: Vec<f64> = one.states.chunks(d).zip(cpu.states.chunks(d)).map(|(a, b)| largest(a, b)).collect();
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
    let device = nerd_cuda::Device::open(0, "", &[])?;
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

/// A cube, which has no torques to send, moves as on the CPU.
fn without_joints() -> Outcome {
    let system = System::named("cube")?;
    let config = ArticulatedConfig::accurate(&system);
    let batch = |n: usize| -> Result<Batch, Box<dyn Error>> {
        let mut batch = Batch::new(&system, &system.scene("ground")?, n);
        (0..n).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(3, env as u64))));
        Ok(batch)
    };
    let (mut there, mut here) = (batch(4)?, batch(4)?);
    CudaArticulated::new(config, Real::F64).roll(&mut there, &[], 3)?;
    let mut solver = Articulated::new(config);
    (0..3).try_for_each(|_| solver.step(&mut here, &[]))?;
    let off = largest(&there.states, &here.states);
    demand(off < 1e-9, format!("cubes, three frames: {off:.1e} from the CPU"))
}

/// A ground that has no kernels: the network alone is on the device, and moves as on the CPU.
fn hills() -> Outcome {
    let (system, folder) = (ant()?, Path::new("models/ant"));
    let mut device = batch(100)?;
    device.scenes.fill(system.scene("hills")?);
    let mut cpu = device.clone();
    let mut solvers = [Device::Cuda, Device::Cpu].map(|d| d.neural(folder, &system, None, 100));
    for (solver, batch) in solvers.iter_mut().zip([&mut device, &mut cpu]) {
        let solver = solver.as_mut().map_err(|e| e.to_string())?;
        (0..3).try_for_each(|frame| solver.step(batch, &torques(100, frame)))?;
    }
    let apart = largest(&device.states, &cpu.states);
    demand(apart < 1e-4, format!("hills, by the network alone: {apart:.1e} from the CPU after 3 frames"))
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

/// Environments, numbers of an observation and of an action, observations that are seen, steps.
const BLIND: [usize; 5] = [128, 18, 7, 2, 33];

/// A rollout in environments that heed no action, so that whoever acts sees the same: numbers drawn anew, episodes that end at random.
fn blind(engine: &mut dyn Engine, policy: &Policy, config: &PpoConfig, iteration: u64) -> Outcome {
    let [n, observation, _, stack, steps] = BLIND;
    let mut rng = stream(9, iteration);
    let mut draw = |n: usize| (0..n).map(|k| 3.0 + normal(&mut rng) * (1.0 + k as f64 % 5.0)).collect::<Vec<f64>>();
    let (width, mut actions) = (observation * stack, Vec::new());
    engine.begin(policy)?;
    for t in 0..steps {
        engine.act(&draw(n * width), StreamKey { seed: 5, number: steps as u64 * iteration + t as u64 }, &mut actions)?;
        if actions.iter().any(|a| a.abs() > 1.0) {
            return Err(format!("step {t}: an action beyond +-1").into());
        }
        let (rewards, ends) = (draw(n), draw(n));
        let (terminated, truncated) = (ends.iter().map(|x| *x > 6.0).collect(), ends.iter().map(|x| *x < 0.0).collect());
        let reached = draw(ends.iter().filter(|x| **x < 0.0).count() * width);
        engine.arrive(&StepResult { rewards, terminated, truncated, ..StepResult::default() }, &reached)?;
    }
    Ok(engine.finish(&draw(n * width), config)?)
}

/// PPO's rollouts and passes over them are the CPU's to rounding, for every kind of policy, also after an update.
fn learning() -> Outcome {
    for (activation, spread_by_state, value_clip) in
        [(Activation::Relu, false, 0.0), (Activation::Elu, true, 0.2), (Activation::Tanh, false, 0.0)]
    {
        let hidden = vec![128, 64, 32];
        let [environments, observation, action, stack, horizon] = BLIND;
        let shape = Shape { observation, stack, action, hidden, activation, spread_by_state };
        let config = PpoConfig { environments, horizon, minibatch: 1000, epochs: 2, value_clip, entropy: 0.01, ..PpoConfig::default() };
        let first = Policy::new(shape.clone(), &mut stream(8, 0));
        let (mut cpu, mut gpu) = (OnCpu::default(), CudaEngine::new(&shape, &config)?);
        let mut sides = [(first.clone(), Adam::new(first.flat.len(), 1e-3)), (first.clone(), Adam::new(first.flat.len(), 1e-3))];
        for iteration in 0..2 {
            let before = sides[0].0.clone();
            // Both by the CPU's policy: what one rounding made of the other is not asked again.
            sides[1] = sides[0].clone();
            blind(&mut cpu, &before, &config, iteration)?;
            blind(&mut gpu, &before, &config, iteration)?;
            let (one, other) = (&cpu.rollout, gpu.rollout()?);
            let single =
                |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs() / (1.0 + b.abs()))).fold(0.0, f64::max);
            let apart = [
                single(&other.mean, &one.mean),
                single(&other.spread, &one.spread),
                single(&other.actions, &one.actions),
                single(&other.surprise, &one.surprise),
                largest(&other.values, &one.values),
                largest(&other.advantages, &one.advantages),
            ];
            let sizes = other.actions.len() == one.actions.len() && other.advantages.len() == one.advantages.len();
            let apart = apart.into_iter().fold(0.0, f64::max);
            let what = format!("PPO, {activation:?}: answers, actions, surprise, values and advantages {apart:.1e} from the CPU's");
            demand(sizes && other.observations == one.observations && apart < 1e-4, what)?;
            let ask = |engine: &mut dyn Engine, (policy, adam): &mut (Policy, Adam)| {
                engine.update(policy, adam, &config, StreamKey { seed: 5, number: iteration })
            };
            let said = [ask(&mut cpu, &mut sides[0])?, ask(&mut gpu, &mut sides[1])?];
            let [(one, one_adam), (other, other_adam)] = &sides;
            let norm = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
            let apart = norm(&one.flat, &other.flat) / norm(&one.flat, &before.flat);
            let terms = |u: &Updated| {
                [u.terms.actor, u.terms.critic, u.terms.bounds, u.terms.entropy, u.terms.kl, u.terms.clipped, u.gradient_norm]
            };
            let of_terms = largest(&terms(&said[1]), &terms(&said[0]));
            let moments = |p: &Policy| [&p.seen, &p.returns].map(|m| [&m.mean[..], &m.variance[..], &[m.count][..]].concat()).concat();
            let of_moments = largest(&moments(other), &moments(one));
            let same = one_adam.rate == other_adam.rate && one_adam.step == other_adam.step;
            let what = format!(
                "PPO, {activation:?}: weights {apart:.1e} of their way from the CPU's, terms {of_terms:.1e}, moments {of_moments:.1e}, rate {:.1e}",
                other_adam.rate
            );
            demand(apart < 1e-2 && of_terms < 1e-3 && of_moments < 1e-4 && same, what)?;
        }
    }
    Ok(())
}
