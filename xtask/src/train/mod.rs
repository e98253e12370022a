//! `cargo xtask train --robot pendulum --out out/pendulum`: data, normaliser, training, model folder.
//!
//! Data is recorded in memory from the truth (`--truth`; 10 million transitions in seconds to minutes, of rapier in minutes
//! to hours) or read from `--data`.
//! The run folder holds `run.json`, `metrics.jsonl`, `last.safetensors`, `best.safetensors`; running the same command
//! again continues it. When all updates are done the model is written to `<out>/model`; with `--finish` at once, of the best so far.
//! The paper's size on two CPU cores is for the patient (about 1 s an update at batch 512); `--preset small` trains in
//! minutes and is what `reproduce --train` uses.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nerd_model::folder::Model;
use nerd_model::form::Form;
use nerd_model::transformer::Weights;
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::prelude::*;
use nerd_train::learner::{Learner, LearnerState};
use nerd_train::prepare::{moments, normalize, read};
use nerd_train::supply::{Supply, SupplyConfig};
use nerd_train::trainer::Trainer;

mod args;
mod card;
mod criterion;
mod data;
mod engine;
mod recipe;
mod settings;
mod variant;

pub use args::{BaseName, OptimizerName, Preset, TrainArgs};
use card::{Run, export, history, log_time, resume};
use criterion::rollout_error;
use data::{pilot, recorded, recording};
use engine::engine;
pub use engine::network;
use settings::Settings;
pub use variant::Variant;

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
        if done.join("config.json").exists() {
            last = Some(done);
            continue;
        }
        last = one(&run)?;
        if last.is_none() || run.finish {
            break;
        }
    }
    Ok(last)
}

/// One run.
fn one(args: &TrainArgs) -> Result<Option<PathBuf>> {
    let started = Instant::now();
    let system = System::named(&args.robot)?;
    let Settings { base, form, network, learner, trainer, transitions } = Settings::new(args, &system)?;
    let updates = trainer.updates;
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
    let mut logged = (first, Duration::ZERO);
    let mut log = |step: u64| -> Result<()> {
        let now = started.elapsed();
        log_time(&args.out, logged.0, step, (now - logged.1).as_secs_f64())?;
        logged = (step, now);
        Ok(())
    };
    let mut hook = |learner: &mut dyn Learner, step: u64| -> Result<Option<f64>, nerd_train::trainer::HookError> {
        let error = if args.rollouts > 0 {
            let weights = Weights { config: network, flat: learner.state()?.average };
            // Early weights may leave; that is an infinite error, not the end of the run.
            Some(rollout_error(&system, &run, &normalizer, weights, args).unwrap_or_else(|e| {
                eprintln!("{e:#}");
                f64::INFINITY
            }))
        } else {
            None
        };
        log(step)?;
        Ok(error)
    };
    // More minutes than a duration holds are no limit.
    let stop_at = args.minutes.and_then(|m| Duration::try_from_secs_f64((60.0 * m - started.elapsed().as_secs_f64()).max(1.0)).ok());
    let outcome = trainer.stop_at(stop_at).run(&mut *engine, supply.transpose()?, &mut hook)?;
    log(outcome.step)?;
    if !outcome.finished {
        let seconds = started.elapsed().as_secs();
        eprintln!("stopped at update {} of {updates} after {seconds} s; the same command continues", outcome.step);
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
