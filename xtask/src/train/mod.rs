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
use nerd_model::transformer::{Positions, Weights};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::files::claim;
use nerd_sim::prelude::*;
use nerd_train::best::Best;
use nerd_train::learner::{Learner, LearnerState};
use nerd_train::prepare::{moments, normalize, read};
use nerd_train::supply::{Supply, SupplyConfig};
use nerd_train::trainer::Trainer;

mod args;
mod card;
mod criterion;
mod data;
mod engine;
mod memory;
mod recipe;
mod settings;
mod variant;

pub use args::{BaseName, OptimizerName, Preset, TrainArgs};
use card::{Run, export, history, resume};
use criterion::rollout_error;
use data::{pilot, recorded, recording};
pub use engine::network;
use engine::{arithmetic, engine};
use settings::Settings;
pub use variant::Variant;

use crate::common::Device;
use crate::flags::unused;
use crate::sessions;

/// Runs the verb.
pub fn run(args: TrainArgs) -> Result<()> {
    train(&args).map(|_| ())
}

/// Trains, or goes on training; the folder of the model once all updates are done.
pub fn train(args: &TrainArgs) -> Result<Option<PathBuf>> {
    let Preset::Shipped(name) = &args.preset else {
        unused(&[("--f32", args.f32 && args.device != Device::Cuda)], "without --device cuda")?;
        return one(args);
    };
    let (runs, system) = (recipe::runs(name, args)?, System::named(&args.robot)?);
    let mut last = None;
    for run in runs {
        let done = run.out.join("model");
        match Model::load(&done, &system, Some(&run.truth.name())) {
            Ok(_) => {
                last = Some(done);
                continue;
            }
            Err(e) if done.exists() => eprintln!("{e}; it is made anew"),
            Err(_) => {}
        }
        last = one(&run)?;
        if last.is_none() || run.finish {
            break;
        }
    }
    Ok(last)
}

/// What a run starts from, if not from random weights.
fn parent(args: &TrainArgs, system: &System, settings: &Settings) -> Result<Option<Model>> {
    let Some(folder) = &args.from else { return Ok(None) };
    // It may have learned another truth: most of what it knows holds in this one, too.
    let mut parent = Model::load(folder, system, None)?;
    let (network, form, like) = (settings.network, settings.form, |form: Form| (form.view, form.base.flies()));
    if network.positions == Positions::Rotary {
        // No weight depends on how long its training sequences were.
        parent.config.network.block = network.block;
        parent.weights.config.block = network.block;
    }
    if parent.config.network != network || like(parent.config.form()) != like(form) {
        bail!("--from: its network is {:?} in {:?}, this run's {network:?} in {form:?}", parent.config.network, parent.config.form());
    }
    Ok(Some(parent))
}

/// One run. All that can be refused is refused before anything is recorded or written.
fn one(args: &TrainArgs) -> Result<Option<PathBuf>> {
    let started = Instant::now();
    let system = System::named(&args.robot)?;
    let settings = Settings::new(args, &system)?;
    let (pilot, parent, arithmetic) = (pilot(args, &system)?, parent(args, &system, &settings)?, arithmetic(args, &settings.network)?);
    let Settings { base, form, network, learner, trainer, transitions } = settings;
    let updates = trainer.updates;
    let recording = |transitions, seed| GenerateConfig { pilot: pilot.clone(), ..recording(args, transitions, seed) };
    let mut config = recording(transitions, args.seed);
    if args.fresh > 0 {
        config.transitions = transitions.next_multiple_of(config.frames * config.shard_trajectories);
    }
    config.check(&system)?;
    if args.data.is_none() && network.sequence() > args.frames {
        bail!("--frames {}: no sequence of {} tokens fits in", args.frames, network.sequence());
    }
    let _claim = claim(&args.out)?;
    let mut run = Run {
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        system_sha256: system.sha256(),
        truth: args.truth.name(),
        base,
        variant: args.variant,
        network,
        learner,
        trainer,
        epsilon: args.epsilon,
        arithmetic,
        rollouts: args.rollouts,
        frames: args.frames,
        torque_scale: args.torque_scale,
        hold: args.hold,
        resets: args.resets,
        policies: config.pilot.as_ref().map(|p| format!("{p:?}")),
        data_sha256: String::new(),
        transitions,
        fresh: args.fresh,
        from: parent.as_ref().map(|p| history(&p.config)),
        from_sha256: parent.as_ref().map(|p| p.config.model_sha256.clone()),
    };
    resume(&args.out, &run)?;
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
    let own = || {
        let mut own = args.variant.normalizer(moments(&data.windows));
        own.outputs.epsilon = args.epsilon.unwrap_or(own.outputs.epsilon);
        own
    };
    let normalizer = parent.as_ref().map_or_else(own, |p| p.normalizer.clone());
    normalize(&mut data.windows, &normalizer);
    normalize(&mut validation, &normalizer);
    run.transitions = data.windows.trajectories() * data.windows.frames;
    run.data_sha256 = data.sha256.clone();
    let run = run;
    let first_weights = || parent.map_or_else(|| Weights::init(network, args.seed), |p| p.weights);
    let text = serde_json::to_string(&run)?;
    let state = resume(&args.out, &run)?.unwrap_or_else(|| LearnerState::new(first_weights()));
    let (trainer, folder) = (Trainer::new(trainer, learner.batch, &args.out, &text), args.out.join("model"));
    let averaged =
        |best: &Best| format!("moving average {} at update {}, chosen by criterion {:.5}", learner.average, best.step, best.criterion);
    if args.finish {
        let best = trainer.best()?.with_context(|| format!("{}: no validated weights of this very run", args.out.display()))?;
        let chosen = format!("{}; the run was ended there", averaged(&best));
        export(&folder, &args.out, &run, normalizer, best.weights, chosen, args)?;
        eprintln!("model written to {}", folder.display());
        return Ok(Some(folder));
    }
    crate::files::write(&args.out.join("run.json"), serde_json::to_string_pretty(&run)?.as_bytes())?;
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
        sessions::log(&args.out, logged.0, step, (now - logged.1).as_secs_f64(), "")?;
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
    let trainer = trainer.stop_at(stop_at);
    let outcome = trainer.run(&mut *engine, supply.transpose()?, &mut hook)?;
    log(outcome.step)?;
    if !outcome.finished {
        let (step, seconds) = (outcome.step, started.elapsed().as_secs());
        let so_far = match outcome.best {
            Some((step, _)) => format!("with --finish it makes a model of the best weights so far, those of update {step}"),
            None => format!("there is no model yet: the first validation is at update {}", run.trainer.validate_every.max(1).min(updates)),
        };
        eprintln!("stopped at update {step} of {updates} after {seconds} s; the same command continues; {so_far}");
        return Ok(None);
    }
    let Some(best) = trainer.best()? else {
        bail!("{}: in no validation did the rollouts end in numbers; give it more --updates", args.out.display());
    };
    let mut chosen = (best.weights.clone(), averaged(&best));
    if args.rollouts > 0 {
        // Where the rate has fallen to zero the last weights need no average, and may be better than it.
        let last = engine.state()?.weights;
        let found = rollout_error(&system, &run, &normalizer, last.clone(), args).unwrap_or(f64::INFINITY);
        if found < best.criterion {
            chosen = (last, format!("last, not averaged, at update {updates}, chosen by criterion {found:.5}"));
        }
    }
    export(&folder, &args.out, &run, normalizer, chosen.0, chosen.1, args)?;
    eprintln!("model written to {}", folder.display());
    Ok(Some(folder))
}
