//! Named changes of one run: each is trained, unless its model is there, and measured.

use std::sync::Arc;
use std::time::Instant;

use nerd_model::folder::{Model, ModelConfig};
use nerd_sim::prelude::*;

use crate::error::{Result, refuse};
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport, passive};
use nerd_train::run::{Run, RunConfig};

/// One change.
#[derive(Clone, Copy, Debug)]
pub struct Change {
    /// In tables.
    pub name: &'static str,
    /// What it does to the run that all are held against.
    pub change: fn(&mut RunConfig),
}

impl Change {
    /// Letters and digits of its name, for a folder and a command line.
    pub fn slug(&self) -> String {
        let lower = self.name.to_lowercase().replace(|c: char| !c.is_ascii_alphanumeric(), " ");
        lower.split_whitespace().collect::<Vec<_>>().join("-")
    }

    /// The changed run, in a folder of its own inside the base's.
    pub fn run(&self, base: &RunConfig) -> RunConfig {
        let mut run = base.clone();
        (self.change)(&mut run);
        run.out = base.out.join(self.slug());
        run
    }
}

/// Those of these names, and the base.
///
/// # Errors
/// If there is none of a name.
pub fn chosen<'a>(all: &[&'a Change], only: &[String], base: &str) -> Result<Vec<&'a Change>> {
    let slugs: Vec<String> = all.iter().map(|c| c.slug()).collect();
    if let Some(name) = only.iter().find(|name| !slugs.contains(name)) {
        refuse!("--only {name}: known are {}", slugs.join(", "));
    }
    Ok(all.iter().filter(|c| only.is_empty() || c.name == base || only.contains(&c.slug())).copied().collect())
}

/// Trains a run unless its model is there; the model's card.
///
/// # Errors
/// Those of [`Run::train`], and if its minutes were over before its updates.
pub fn trained(run: &RunConfig) -> Result<ModelConfig> {
    let model = run.out.join("model");
    if !model.join("config.json").exists() && Run::new(run)?.train()?.is_none() {
        refuse!("{}: training did not finish; the same command continues it", run.out.display());
    }
    Ok(ModelConfig::read(&model)?)
}

/// Trains and measures runs, one after the other.
///
/// # Errors
/// The first of a training or a measurement.
pub fn each<T>(runs: &[(&Change, RunConfig)], mut measure: impl FnMut(&Change, &RunConfig, &ModelConfig) -> Result<T>) -> Result<Vec<T>> {
    let (started, mut all) = (Instant::now(), Vec::new());
    for (k, (change, run)) in runs.iter().enumerate() {
        let left = started.elapsed().as_secs_f64() / k as f64 * (runs.len() - k) as f64 / 60.0;
        let left = if k == 0 { String::new() } else { format!(", about {left:.0} min left") };
        eprintln!("{}/{}: {}, {}, seed {}{left}", k + 1, runs.len(), run.robot, change.name, run.record.seed);
        all.push(measure(change, run, &trained(run)?)?);
    }
    Ok(all)
}

/// A run's model, and as a solver.
///
/// # Errors
/// If it cannot be read.
pub fn model(run: &RunConfig, system: &Arc<System>, starts: usize) -> Result<(Model, Box<dyn Solver>)> {
    let model = Model::load(&run.out.join("model"), system, Some(&run.record.truth(system).name()))?;
    let solver = run.device.solver(model.clone(), system, starts, |network| network)?;
    Ok((model, solver))
}

/// Its passive motion against the truth, from the starts of all evaluations.
///
/// # Errors
/// If one of them cannot step.
pub fn moved(learned: &mut dyn Solver, system: &Arc<System>, scene: &str, (starts, steps): (usize, usize)) -> Result<PassiveReport> {
    let protocol = PassiveConfig { starts, steps, seed: 500, action: Action::Zero };
    let mut truth = system.spec.truth.solver(system);
    Ok(passive(system, &system.scene(scene)?, &mut *truth, learned, protocol, &mut |_| ())?)
}
