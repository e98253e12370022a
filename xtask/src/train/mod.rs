//! `cargo xtask train --robot pendulum --out out/pendulum`: data, normaliser, training, model folder.
//!
//! Data is recorded in memory from the truth (`--truth`; 10 million transitions in seconds to minutes, of rapier in minutes
//! to hours) or read from `--data`.
//! The run folder holds `run.json`, `metrics.jsonl`, `last.safetensors`, `best.safetensors`; running the same command
//! again continues it. When all updates are done the model is written to `<out>/model`.
//! The paper's size on two CPU cores is for the patient (about 1 s an update at batch 512); `--preset small` trains in
//! minutes and is what `reproduce --train` uses.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::folder::Model;
use nerd_model::form::Form;
use nerd_model::neural::Neural;
use nerd_model::normalizer::Normalizer;
use nerd_model::transformer::{Architecture, Positions, Stream, TransformerConfig, Weights};
use nerd_sim::dataset::{GenerateConfig, Pilot};
use nerd_sim::law::Law;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive};
use nerd_train::learner::{BurnLearner, CpuLearner, Learner, LearnerConfig, LearnerState, Optimizer};
use nerd_train::ppo::Policies;
use nerd_train::prepare::{Prepared, generate, moments, normalize, read};
use nerd_train::schedule::Schedule;
use nerd_train::supply::{Supply, SupplyConfig};
use nerd_train::trainer::{Trainer, TrainerConfig};

mod args;
mod card;
mod recipe;
mod variant;

pub use args::{BaseName, OptimizerName, Preset, TrainArgs};
use card::{Run, export, history, log_time, model_config};
pub use variant::Variant;

use crate::common::Device;
use crate::paper;

/// A network on a device, for so many environments.
pub fn network(weights: &Weights, device: Device, envs: usize) -> Result<Box<dyn Stream>> {
    match device {
        Device::Flex => Ok(nerd_model::network::on_cpu(weights)),
        Device::Cuda => on_cuda(weights, envs),
    }
}

#[cfg(feature = "cuda")]
fn on_cuda(weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
    transformer_only(&weights.config)?;
    Ok(nerd_train::learner::cuda::stream(weights, nerd_train::learner::cuda::Precision::F32, envs)?)
}

#[cfg(not(feature = "cuda"))]
fn on_cuda(_weights: &Weights, _envs: usize) -> Result<Box<dyn Stream>> {
    bail!("--device cuda needs a build with `--features cuda`")
}

/// The fused engine is one network's.
#[cfg(feature = "cuda")]
fn transformer_only(network: &TransformerConfig) -> Result<()> {
    match network.architecture {
        Architecture::Transformer => Ok(()),
        other => bail!("--device cuda computes Transformers, no {other:?}; leave it out"),
    }
}

fn burn_device() -> nerd_model::BurnDevice {
    nerd_model::BurnDevice::flex()
}

/// Runs the verb.
pub fn run(args: TrainArgs) -> Result<()> {
    train(&args).map(|_| ())
}

/// Trains, or goes on training; the folder of the model once all updates are done.
pub fn train(args: &TrainArgs) -> Result<Option<PathBuf>> {
    let Preset::Shipped(name) = &args.preset else { return one(args) };
    let mut last = None;
    for run in recipe::runs(name, args)? {
        let done = run.out.join("model");
        last = if done.join("config.json").exists() { Some(done) } else { one(&run)? };
        if last.is_none() {
            return Ok(None);
        }
    }
    Ok(last)
}

/// One run.
fn one(args: &TrainArgs) -> Result<Option<PathBuf>> {
    let started = Instant::now();
    let system = System::named(&args.robot)?;
    let small = args.preset == Preset::Small;
    let base = match args.base {
        BaseName::State => Base::State,
        BaseName::Flight if system.robot.contact_points.is_empty() => {
            bail!(
                "`{}` has nothing to touch: a frame of flight is its whole motion and needs no network; use --solver articulated",
                args.robot
            )
        }
        BaseName::Flight => args.truth.flight(),
    };
    args.variant.check(base)?;
    let form = args.variant.form(base);
    let (inputs, outputs) = (Features::inputs(&system, form), Features::outputs(&system));
    let mut network = TransformerConfig::paper(inputs, outputs, 192);
    if small {
        network = TransformerConfig { embedding: 48, layers: 2, heads: 4, block: 16, ..network };
    }
    network.history = args.history.unwrap_or(network.history);
    network.block = network.block.max(network.history);
    if args.stream {
        network = TransformerConfig { positions: Positions::Rotary, block: args.sequence.max(network.history), ..network };
    }
    network.layers = args.layers.unwrap_or(network.layers);
    if let Some(embedding) = args.embedding {
        // Heads keep their width.
        let heads = (embedding * network.heads).div_euclid(network.embedding).max(1);
        network = TransformerConfig { embedding, heads, ..network };
    }
    let network = args.variant.network(network);
    network.check().map_err(anyhow::Error::msg)?;
    let updates = args.updates.unwrap_or(if small { 6_000 } else { 500_000 });
    let optimizer = match args.optimizer {
        OptimizerName::Adam => Optimizer::Adam,
        OptimizerName::Muon => Optimizer::Muon,
    };
    let learner = LearnerConfig {
        batch: args.batch.unwrap_or(if small { 128 } else { 512 }),
        clip: 1.0,
        average: args.average,
        seed: args.seed,
        huber: args.huber,
        optimizer,
    };
    let tail = (args.tail.clamp(0.0, 1.0) * updates as f64) as u64;
    let every = args.validate_every.unwrap_or(updates.div_ceil(50));
    let trainer = TrainerConfig {
        updates,
        schedule: Schedule { start: args.rate, end: args.last_rate, warmup: args.warmup, tail },
        validate_every: every,
        checkpoint_every: updates.div_ceil(10),
        validation_windows: if small { 4096 } else { 16_384 },
        log_every: if small { 20 } else { 500 },
    };
    let transitions = args.transitions.unwrap_or(if small { 400_000 } else { 10_000_000 });
    if !(-10.0..=1.0).contains(&args.torque_scale) {
        bail!("--torque-scale {} is outside [-10, 1]", args.torque_scale);
    }
    if args.hold == 0 || !(0.0..=1.0).contains(&args.resets) {
        bail!("--hold is at least 1, --resets within 0 and 1");
    }
    if args.huber.is_some_and(|d| !(d > 0.0 && d.is_finite())) {
        bail!("--huber {}: an error above 0; leave it out for squares alone", args.huber.unwrap_or_default());
    }
    if args.frames == 0 {
        bail!("--frames 0: at least one is needed");
    }

    let pilot = pilot(args, &system)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    let recording = |transitions, seed| GenerateConfig { pilot: pilot.clone(), ..recording(args, transitions, seed) };
    let mut config = recording(transitions, args.seed);
    if args.fresh > 0 {
        if args.data.is_some() {
            bail!("--fresh records by itself: leave out --data");
        }
        config.transitions = transitions.next_multiple_of(config.frames * config.shard_trajectories);
    }
    let mut data = match &args.data {
        Some(folder) => read(&system, &args.truth.name(), folder, network.sequence(), form)?,
        None => recorded(&system, args, &config, network.sequence(), form)?,
    };
    let validation = recording(200_000.min(transitions), args.seed + 10);
    let mut validation = recorded(&system, args, &validation, network.sequence(), form)?.windows;
    if data.windows.is_empty() || validation.is_empty() {
        bail!(
            "{} trajectories of {} frames hold no sequence of {} tokens",
            data.windows.trajectories(),
            data.windows.frames,
            network.sequence()
        );
    }
    // A parent may have learned another truth: most of what it knows holds in this one, too.
    let parent = args.from.as_ref().map(|folder| Model::load(folder, &system, None)).transpose()?;
    let like = |form: Form| (form.view, form.base.flies());
    if let Some(parent) = parent.as_ref().filter(|p| p.config.network != network || like(p.config.form()) != like(form)) {
        bail!("--from: its network is {:?} in {:?}, this run's {network:?} in {form:?}", parent.config.network, parent.config.form());
    }
    let normalizer = parent.as_ref().map_or_else(|| args.variant.normalizer(moments(&data.windows)), |p| p.normalizer.clone());
    normalize(&mut data.windows, &normalizer);
    normalize(&mut validation, &normalizer);
    let transitions = data.windows.trajectories() * data.windows.frames;
    let run = Run {
        robot: system.name.clone(),
        truth: args.truth.name(),
        base,
        variant: args.variant,
        network,
        learner,
        trainer,
        torque_scale: args.torque_scale,
        hold: args.hold,
        resets: args.resets,
        policies: config.pilot.as_ref().map(|p| format!("{p:?}")),
        data_sha256: data.sha256.clone(),
        transitions,
        fresh: args.fresh,
        from: parent.as_ref().map(|p| history(&p.config)),
    };
    let first_weights = || parent.map_or_else(|| Weights::init(network, args.seed), |p| p.weights);
    let text = serde_json::to_string(&run)?;
    let state = resume(&args.out, &network, &text)?.unwrap_or_else(|| LearnerState::new(first_weights()));
    crate::files::write(&args.out.join("run.json"), serde_json::to_string_pretty(&run)?.as_bytes())?;
    let (trainer, folder) = (Trainer::new(trainer, learner.batch, &args.out, &text), args.out.join("model"));
    let averaged = |(step, criterion): (u64, f64)| -> Result<(Weights, String)> {
        let best = std::fs::read(args.out.join("best.safetensors")).context("best.safetensors of the run")?;
        let chosen = format!("moving average {} at update {step}, chosen by criterion {criterion:.5}", learner.average);
        Ok((Weights::from_bytes(network, &best)?, chosen))
    };
    if args.finish {
        let best = trainer.best().with_context(|| format!("{}: no validated weights of this very run", args.out.display()))?;
        let (weights, chosen) = averaged(best)?;
        export(&folder, &args.out, &run, normalizer, weights, format!("{chosen}; the run was ended there"), args)?;
        eprintln!("model written to {}", folder.display());
        return Ok(Some(folder));
    }
    eprintln!("{} parameters, {} windows, update {} of {updates}", network.parameters(), data.windows.len(), state.step);

    let first = state.step;
    let supply = (args.fresh > 0).then(|| {
        let (truth, shards) = (args.truth, args.fresh.div_ceil(config.frames * config.shard_trajectories) as u64);
        let (history, normalizer, of) = (network.sequence(), normalizer.clone(), system.clone());
        let config = SupplyConfig { data: config, shards, updates, step: first, history, form, normalizer };
        Supply::new(&system, move || truth.solver(&of), config)
    });
    let mut engine = engine(args, learner, state, data, validation)?;
    let mut hook = |learner: &mut dyn Learner, _step: u64| -> Result<Option<f64>, nerd_train::trainer::HookError> {
        if args.rollouts == 0 {
            return Ok(None);
        }
        let state = learner.state()?;
        let weights = Weights { config: network, flat: state.average };
        // Early weights may leave; that is an infinite error, not the end of the run.
        Ok(Some(rollout_error(&system, &run, &normalizer, weights, args).unwrap_or_else(|e| {
            eprintln!("{e:#}");
            f64::INFINITY
        })))
    };
    // More minutes than a duration holds are no limit.
    let stop_at = args.minutes.and_then(|m| Duration::try_from_secs_f64((60.0 * m - started.elapsed().as_secs_f64()).max(1.0)).ok());
    let outcome = trainer.stop_at(stop_at).run(&mut *engine, supply.transpose()?, &mut hook)?;
    let seconds = started.elapsed().as_secs_f64();
    log_time(&args.out, first, outcome.step, seconds)?;
    if !outcome.finished {
        eprintln!("stopped at update {} of {updates} after {seconds:.0} s; the same command continues", outcome.step);
        return Ok(None);
    }
    let Some(best) = outcome.best else {
        bail!("{}: in no validation did the rollouts end in numbers; give it more --updates", args.out.display());
    };
    let (mut weights, mut chosen) = averaged(best)?;
    if args.rollouts > 0 {
        // Where the rate has fallen to zero the last weights need no average, and may be better than it.
        let last = engine.state()?.weights;
        let found = rollout_error(&system, &run, &normalizer, last.clone(), args).unwrap_or(f64::INFINITY);
        if found < best.1 {
            (weights, chosen) = (last, format!("last, not averaged, at update {updates}, chosen by criterion {found:.5}"));
        }
    }
    export(&folder, &args.out, &run, normalizer, weights, chosen, args)?;
    eprintln!("model written to {}", folder.display());
    Ok(Some(folder))
}

fn recording(args: &TrainArgs, transitions: usize, seed: u64) -> GenerateConfig {
    let torque_scale = Law { low: args.torque_scale, high: 1.0 };
    // Small shards come soon, whatever the truth.
    let shard_trajectories = if args.fresh > 0 { 64 } else { 512 };
    let TrainArgs { frames, hold, resets, .. } = *args;
    GenerateConfig { transitions, seed, torque_scale, shard_trajectories, frames, hold, resets, pilot: None }
}

/// The policies that act in part of the data.
fn pilot(args: &TrainArgs, system: &System) -> Result<Option<(Arc<dyn Pilot>, f64)>> {
    if args.policy.is_empty() {
        return Ok(None);
    }
    if !(0.0..=1.0).contains(&args.policy_share) || args.data.is_some() {
        bail!("--policy records by itself: leave out --data; --policy-share is within 0 and 1");
    }
    let mut policies = Vec::new();
    for folder in &args.policy {
        let (config, policy) = nerd_train::ppo::folder::load(folder)?;
        let robot = nerd_tasks::named(&config.task)?.robot();
        if robot != system.name {
            bail!("{} acts on `{robot}`, not on `{}`", folder.display(), system.name);
        }
        policies.push((config.task, policy));
    }
    Ok(Some((Arc::new(Policies::new(policies)?), args.policy_share)))
}

fn recorded(system: &Arc<System>, args: &TrainArgs, config: &GenerateConfig, history: usize, form: Form) -> Result<Prepared> {
    let bar = crate::common::bar("recording transitions", (config.trajectories() * config.frames) as u64);
    let done = AtomicUsize::new(0);
    let tell = |n: usize| bar.set((done.fetch_add(n, Ordering::Relaxed) + n) as u64);
    let prepared = generate(system, &|| args.truth.solver(system), config, history, form, &tell)?;
    bar.finish();
    Ok(prepared)
}

/// The state to go on from, if the folder holds one of this very run.
fn resume(out: &Path, network: &TransformerConfig, run: &str) -> Result<Option<LearnerState>> {
    let path = out.join("last.safetensors");
    if !path.exists() {
        return Ok(None);
    }
    let (state, found) = nerd_train::checkpoint::load(&path, network)?;
    if found != run {
        bail!(
            "{}: belongs to a run with other settings; use another --out, or the settings in {}",
            path.display(),
            out.join("run.json").display()
        );
    }
    Ok(Some(state))
}

fn engine(
    args: &TrainArgs,
    config: LearnerConfig,
    state: LearnerState,
    data: Prepared,
    validation: nerd_train::windows::Windows,
) -> Result<Box<dyn Learner>> {
    match args.device {
        Device::Flex => {
            let (windows, validation) = (Arc::new(data.windows), Arc::new(validation));
            Ok(match state.weights.config.architecture {
                Architecture::Transformer => Box::new(CpuLearner::new(config, state, windows, validation)?),
                _ => Box::new(BurnLearner::new(config, state, windows, validation, &burn_device())?),
            })
        }
        #[cfg(feature = "cuda")]
        Device::Cuda => {
            use nerd_train::learner::cuda::{CudaLearner, Precision};
            transformer_only(&state.weights.config)?;
            let precision = if args.f32 { Precision::F32 } else { Precision::Tf32 };
            Ok(Box::new(CudaLearner::new(config, precision, state, &data.windows, &validation)?))
        }
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => bail!("--device cuda needs a build with `--features cuda`"),
    }
}

/// Mean error over the paper's horizon: in free space and, where there is one, on the first ground; of a model on flight, on
/// all grounds.
fn rollout_error(system: &Arc<System>, run: &Run, normalizer: &Normalizer, weights: Weights, args: &TrainArgs) -> Result<f64> {
    let steps = paper::horizon(&system.name);
    let config = PassiveConfig { starts: args.rollouts, steps, seed: 1_000 + args.seed, action: Action::Zero };
    // Flight has no error where there is nothing to touch.
    let scenes: Vec<&str> = match run.base {
        Base::State | Base::Nothing => system.usual_scenes().into_iter().take(2).collect(),
        Base::Flight | Base::ExactFlight => system.usual_scenes().into_iter().filter(|s| *s != "free").collect(),
    };
    let mut total = 0.0;
    for scene in &scenes {
        let model = Model { config: model_config(run, &Default::default()), normalizer: normalizer.clone(), weights: weights.clone() };
        let network = self::network(&model.weights, args.device, args.rollouts)?;
        let mut learned = Neural::new(model, system, network);
        let report = passive(system, &system.scene(scene)?, &mut *args.truth.solver(system), &mut learned, config, &mut |_| ())?;
        total += report.error.iter().sum::<f64>() / report.error.len() as f64;
    }
    Ok(total / scenes.len() as f64)
}
