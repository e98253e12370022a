//! `cargo xtask train --robot pendulum --out out/pendulum`: data, normaliser, training, model folder.
//!
//! Data is recorded in memory from the truth (10 million transitions in seconds to minutes) or read from `--data`.
//! The run folder holds `run.json`, `metrics.jsonl`, `last.safetensors`, `best.safetensors`; running the same command
//! again continues it. When all updates are done the model is written to `<out>/model`.
//! The paper's size on two CPU cores is for the patient (about 1 s an update at batch 512); `--preset small` trains in
//! minutes and is what `reproduce --train` uses.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nerd_model::features::Features;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_model::normalizer::Normalizer;
use nerd_model::transformer::{Forward, TransformerConfig, Weights};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::law::Law;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{PassiveConfig, passive};
use nerd_train::learner::{BurnLearner, Learner, LearnerConfig, LearnerState, Optimizer};
use nerd_train::prepare::{Prepared, generate, moments, normalize, read};
use nerd_train::schedule::Schedule;
use nerd_train::trainer::{Trainer, TrainerConfig};
use serde::{Deserialize, Serialize};

use crate::common::Device;
use crate::paper;
use crate::provenance::Provenance;

/// Train a NeRD model.
#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// Robot: cartpole, pendulum, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Folder of the run; the same command continues it
    #[arg(long)]
    pub out: PathBuf,
    /// Size of the network and of the run: `paper` (E 192, 6 layers, batch 512) or `small` (E 48, 2 layers, batch 128)
    #[arg(long, value_enum, default_value_t = Preset::Paper)]
    pub preset: Preset,
    /// Folder of shards made by `dataset`; recorded in memory if absent
    #[arg(long)]
    pub data: Option<PathBuf>,
    /// Model folder to start from, normaliser and all [default: random weights]
    #[arg(long)]
    pub from: Option<PathBuf>,
    /// Transitions to record
    #[arg(long)]
    pub transitions: Option<usize>,
    /// Least factor on the random torques, drawn once a trajectory from U(this, 1); the paper's data has 1
    #[arg(long, default_value_t = 1.0)]
    pub torque_scale: f64,
    /// Optimiser updates in the whole run
    #[arg(long)]
    pub updates: Option<u64>,
    /// Windows in an update
    #[arg(long)]
    pub batch: Option<usize>,
    /// Learning rate of the first update
    #[arg(long, default_value_t = 1e-3)]
    pub rate: f64,
    /// Learning rate the linear decay ends at
    #[arg(long, default_value_t = 1e-4)]
    pub last_rate: f64,
    /// Share of the run, at its end, over which the rate falls on to zero (paper: 0)
    #[arg(long, default_value_t = 0.0)]
    pub tail: f64,
    /// Updates over which the rate rises from zero (paper: 0)
    #[arg(long, default_value_t = 0)]
    pub warmup: u64,
    /// What updates the hidden matrices: adam (the paper) or muon
    #[arg(long, value_enum, default_value_t = OptimizerName::Adam)]
    pub optimizer: OptimizerName,
    /// Decay of the moving average of the weights, per update
    #[arg(long, default_value_t = 0.9995)]
    pub average: f64,
    /// Updates between validations (default: a fiftieth of the run)
    #[arg(long)]
    pub validate_every: Option<u64>,
    /// Starts of the rollout evaluation at each validation; its error picks the best weights. 0: the loss does
    #[arg(long, default_value_t = 64)]
    pub rollouts: usize,
    /// Stop, with a checkpoint, after so many minutes; the same command continues
    #[arg(long)]
    pub minutes: Option<f64>,
    /// Matrix arithmetic on CUDA: f32 throughout instead of TF32
    #[arg(long)]
    pub f32: bool,
    /// Where to compute: flex (CPU) or cuda (needs a build with `--features cuda`)
    #[arg(long, value_enum, default_value_t = Device::Flex)]
    pub device: Device,
    /// Seed of data, weights and windows
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

impl TrainArgs {
    /// What `reproduce --train` trains: minutes on two cores.
    pub fn small(robot: &str, out: PathBuf, device: Device) -> Self {
        Self {
            robot: robot.into(),
            out,
            preset: Preset::Small,
            data: None,
            from: None,
            transitions: None,
            torque_scale: 0.0,
            updates: None,
            batch: None,
            rate: 1e-3,
            last_rate: 1e-4,
            tail: 0.3,
            warmup: 0,
            optimizer: OptimizerName::Muon,
            average: 0.9995,
            validate_every: None,
            rollouts: 64,
            minutes: None,
            f32: false,
            device,
            seed: 0,
        }
    }
}

/// Size of network and run.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// E 192, 6 layers, 12 heads, block 32, 10 million transitions, batch 512.
    Paper,
    /// E 48, 2 layers, 4 heads, block 16, 400 000 transitions, batch 128, 6000 updates.
    Small,
}

/// Optimisers of the hidden matrices.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum OptimizerName {
    /// Adam, as in the paper.
    Adam,
    /// Orthogonalised momentum.
    Muon,
}

/// What decides a run's bytes; kept in its checkpoints, so that no run is continued as another one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Run {
    robot: String,
    truth: String,
    network: TransformerConfig,
    learner: LearnerConfig,
    trainer: TrainerConfig,
    torque_scale: f64,
    data_sha256: String,
    transitions: usize,
    /// What the weights it started from had been through.
    from: Option<String>,
}

/// The truth every model of this program learns: the reference simulator's preset with Coulomb friction.
pub const TRUTH: &str = "articulated paper coulomb";

/// The solver of [`TRUTH`].
pub fn truth(system: &System) -> Box<dyn Solver> {
    Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb)))
}

/// A network on a device.
pub fn forward(weights: &Weights, device: Device, windows: usize) -> Result<Box<dyn Forward>> {
    match device {
        Device::Flex => Ok(Box::new(nerd_model::transformer::BurnForward::new(weights, &burn_device()))),
        #[cfg(feature = "cuda")]
        Device::Cuda => {
            Ok(Box::new(nerd_train::learner::cuda::CudaForward::new(weights, nerd_train::learner::cuda::Precision::F32, windows)?))
        }
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => {
            let _ = windows;
            bail!("--device cuda needs a build with `--features cuda`")
        }
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
    let started = Instant::now();
    let system = System::named(&args.robot)?;
    let small = args.preset == Preset::Small;
    let (inputs, outputs) = (Features::inputs(&system), Features::outputs(&system));
    let mut network = TransformerConfig::paper(inputs, outputs, 192);
    if small {
        network = TransformerConfig { embedding: 48, layers: 2, heads: 4, block: 16, ..network };
    }
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
    if !(0.0..=1.0).contains(&args.torque_scale) {
        bail!("--torque-scale {} is outside [0, 1]", args.torque_scale);
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;

    let mut data = match &args.data {
        Some(folder) => read(&system, folder, network.history)?,
        None => recorded(&system, args, transitions, args.seed, network.history)?,
    };
    let mut validation = recorded(&system, args, 200_000.min(transitions), args.seed + 10, network.history)?.windows;
    let parent = args.from.as_ref().map(|folder| Model::load(folder, &system, Some(TRUTH))).transpose()?;
    if let Some(parent) = parent.as_ref().filter(|p| p.config.network != network) {
        bail!("--from: its network is {:?}, this run's {network:?}", parent.config.network);
    }
    let normalizer = parent.as_ref().map_or_else(|| moments(&data.windows), |p| p.normalizer.clone());
    normalize(&mut data.windows, &normalizer);
    normalize(&mut validation, &normalizer);
    let transitions = data.windows.trajectories() * data.windows.frames;
    let run = Run {
        robot: system.name.clone(),
        truth: TRUTH.into(),
        network,
        learner,
        trainer,
        torque_scale: args.torque_scale,
        data_sha256: data.sha256.clone(),
        transitions,
        from: parent.as_ref().map(|p| history(&p.config)),
    };
    let first_weights = || parent.map_or_else(|| Weights::init(network, args.seed), |p| p.weights);
    let text = serde_json::to_string(&run)?;
    let state = resume(&args.out, &network, &text)?.unwrap_or_else(|| LearnerState::new(first_weights()));
    crate::files::write(&args.out.join("run.json"), serde_json::to_string_pretty(&run)?.as_bytes())?;
    eprintln!("{} parameters, {} windows, update {} of {updates}", network.parameters(), data.windows.len(), state.step);

    let first = state.step;
    let mut engine = engine(args, learner, state, data, validation)?;
    let mut hook = |learner: &mut dyn Learner, _step: u64| -> Result<Option<f64>, nerd_train::trainer::HookError> {
        if args.rollouts == 0 {
            return Ok(None);
        }
        let state = learner.state()?;
        let weights = Weights { config: network, flat: state.average };
        Ok(Some(rollout_error(&system, &run, &normalizer, weights, args).map_err(|e| format!("{e:#}"))?))
    };
    let outcome = Trainer::new(trainer, learner.batch, &args.out, &text)
        .stop_at(args.minutes.map(|m| Duration::from_secs_f64((60.0 * m - started.elapsed().as_secs_f64()).max(1.0))))
        .run(&mut *engine, &mut hook)?;
    let seconds = started.elapsed().as_secs_f64();
    log_time(&args.out, first, outcome.step, seconds)?;
    if !outcome.finished {
        eprintln!("stopped at update {} of {updates} after {seconds:.0} s; the same command continues", outcome.step);
        return Ok(None);
    }
    let folder = args.out.join("model");
    let best = std::fs::read(args.out.join("best.safetensors")).context("best.safetensors of the run")?;
    let mut weights = Weights::from_bytes(network, &best)?;
    let (step, criterion) = outcome.best.unwrap_or((updates, f64::NAN));
    let mut chosen = format!("moving average {} at update {step}, chosen by criterion {criterion:.5}", learner.average);
    if args.rollouts > 0 {
        // Where the rate has fallen to zero the last weights need no average, and may be better than it.
        let last = engine.state()?.weights;
        let found = rollout_error(&system, &run, &normalizer, last.clone(), args)?;
        if found < criterion {
            (weights, chosen) = (last, format!("last, not averaged, at update {updates}, chosen by criterion {found:.5}"));
        }
    }
    export(&folder, &args.out, &run, normalizer, weights, chosen, args)?;
    eprintln!("model written to {}", folder.display());
    Ok(Some(folder))
}

fn recorded(system: &Arc<System>, args: &TrainArgs, transitions: usize, seed: u64, history: usize) -> Result<Prepared> {
    let torque_scale = Law { low: args.torque_scale, high: 1.0 };
    let config = GenerateConfig { transitions, seed, torque_scale, shard_trajectories: 512, ..Default::default() };
    let bar = crate::common::bar("recording transitions", (config.trajectories() * config.frames) as u64);
    let done = AtomicUsize::new(0);
    let tell = |n: usize| bar.set((done.fetch_add(n, Ordering::Relaxed) + n) as u64);
    let prepared = generate(system, &|| truth(system), &config, history, &tell)?;
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
        Device::Flex => Ok(Box::new(BurnLearner::new(config, state, Arc::new(data.windows), Arc::new(validation), &burn_device())?)),
        #[cfg(feature = "cuda")]
        Device::Cuda => {
            use nerd_train::learner::cuda::{CudaLearner, Precision};
            let precision = if args.f32 { Precision::F32 } else { Precision::Tf32 };
            Ok(Box::new(CudaLearner::new(config, precision, state, &data.windows, &validation)?))
        }
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => bail!("--device cuda needs a build with `--features cuda`"),
    }
}

/// Mean error by coordinate over the paper's horizon in free space and, where there is one, on the first ground.
fn rollout_error(system: &Arc<System>, run: &Run, normalizer: &Normalizer, weights: Weights, args: &TrainArgs) -> Result<f64> {
    let steps = paper::horizon(&system.name);
    let config = PassiveConfig { starts: args.rollouts, steps, seed: 1_000 + args.seed };
    let scenes: Vec<&str> = system.scene_names().into_iter().take(2).collect();
    let mut total = 0.0;
    for scene in &scenes {
        let model = Model { config: model_config(run, &Default::default()), normalizer: normalizer.clone(), weights: weights.clone() };
        let network = forward(&model.weights, args.device, args.rollouts)?;
        let mut learned = Neural::new(model, system, network);
        let report = passive(system, &system.scene(scene)?, &mut *truth(system), &mut learned, config, &mut |_| ())?;
        total += report.error.iter().sum::<f64>() / report.error.len() as f64;
    }
    Ok(total / scenes.len() as f64)
}

fn model_config(run: &Run, provenance: &std::collections::HashMap<String, String>) -> ModelConfig {
    ModelConfig {
        robot: run.robot.clone(),
        truth: run.truth.clone(),
        network: run.network,
        data_sha256: run.data_sha256.clone(),
        transitions: run.transitions,
        updates: run.trainer.updates,
        batch: run.learner.batch,
        provenance: provenance.clone(),
    }
}

/// What a model has been through, in one line.
fn history(config: &ModelConfig) -> String {
    let row = |k: &str| config.provenance.get(k).map_or("?", String::as_str);
    let run = format!(
        "{} of a run of {} updates of {} windows on {} transitions",
        row("weights"),
        config.updates,
        config.batch,
        config.transitions
    );
    let run = format!("{run} (`{}`, {} minutes on {}, commit {})", row("command"), row("minutes"), row("machine"), row("commit"));
    config.provenance.get("started from").map_or(run.clone(), |before| format!("{run}, which started from {before}"))
}

/// One line a session: which updates took how long where.
fn log_time(out: &Path, first: u64, last: u64, seconds: f64) -> Result<()> {
    use std::io::Write;
    let line = serde_json::json!({ "first": first, "last": last, "seconds": seconds, "machine": Provenance::machine() });
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(out.join("sessions.jsonl"))?;
    Ok(writeln!(file, "{line}")?)
}

/// Writes the model folder with a card made of what the run recorded.
fn export(folder: &Path, out: &Path, run: &Run, normalizer: Normalizer, weights: Weights, chosen: String, args: &TrainArgs) -> Result<()> {
    let sessions: Vec<serde_json::Value> =
        std::fs::read_to_string(out.join("sessions.jsonl"))?.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let seconds: f64 = sessions.iter().filter_map(|s| s["seconds"].as_f64()).sum();
    let machine = sessions.last().map_or_else(String::new, |s| s["machine"].as_str().unwrap_or_default().to_string());
    let stamp = Provenance::now(args.seed);
    let minutes = format!("{:.1}", seconds / 60.0);
    let rows = [
        ("commit", stamp.commit.clone()),
        ("command", stamp.command.clone()),
        ("seed", args.seed.to_string()),
        ("machine", machine),
        ("minutes", minutes),
        ("date", stamp.date.clone()),
        ("weights", chosen),
        ("optimizer", format!("{:?}", run.learner.optimizer)),
        ("schedule", format!("{:?}", run.trainer.schedule)),
        ("torque_scale", format!("U({}, 1)", run.torque_scale)),
    ];
    let rows: Vec<_> = rows.into_iter().chain(run.from.clone().map(|from| ("started from", from))).collect();
    let provenance = rows.iter().map(|(k, v)| (k.to_string(), v.clone())).collect();
    let config = model_config(run, &provenance);
    let mut card = format!(
        "# NeRD of `{}`\n\nA causal Transformer ({} parameters, E {}, {} layers, window {}) that learned one frame of `{}`.\n\
         {} updates of {} windows on {} random transitions (SHA-256 `{}`).\n\n| | |\n|---|---|\n",
        run.robot,
        run.network.parameters(),
        run.network.embedding,
        run.network.layers,
        run.network.history,
        run.truth,
        run.trainer.updates,
        run.learner.batch,
        run.transitions,
        run.data_sha256,
    );
    rows.iter().for_each(|(k, v)| card.push_str(&format!("| {k} | {v} |\n")));
    card.push_str("\nIts errors in rollouts stand in `results/`. Written by `cargo xtask train`.\n");
    Ok(Model { config, normalizer, weights }.save(folder, &card)?)
}
