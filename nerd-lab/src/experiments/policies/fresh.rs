//! The strict protocol: the model is frozen, then policies of seeds never used before are trained in it and in its truth, and all
//! are played in both. So no policy that judges a model was known to anybody when it was made.

use std::path::PathBuf;

use nerd_sim::prelude::*;

use super::{Policies, Row, percent};
use crate::error::{Result, refuse};
use crate::experiments::games::truth_of;
use crate::paper::policy_reward;
use crate::report::{Input, Inputs, Table};
use nerd_train::ppo::{Arena, PolicyRun, PpoConfig, folder};

impl Policies {
    /// The runs of all policies.
    pub(super) fn plan(&self) -> Result<Vec<PolicyRun>> {
        if !self.policy.is_empty() {
            refuse!("--fresh trains its own policies: leave --policy out");
        }
        let known = nerd_tasks::names().into_iter().filter(|task| policy_reward(task).is_some());
        let tasks = if self.task.is_empty() { known.map(String::from).collect() } else { self.task.clone() };
        let mut runs = Vec::new();
        for task in tasks {
            let (model, truth) = self.host(&task)?;
            let learned = Arena::Model { folder: model, device: self.device };
            for (word, arena, seeds) in [("neural", learned, &self.fresh), ("truth", Arena::Truth(truth), &self.truth_seeds)] {
                let config = PpoConfig::choose(&task, &arena, Some(&self.recipe), None)?;
                for seed in seeds {
                    let out = self.runs.join(format!("{task}-{word}-{seed}"));
                    let (task, arena, config) = (task.clone(), arena.clone(), config.clone());
                    runs.push(PolicyRun { task, arena, config, seed: *seed, fast: false, until: None, minutes: self.minutes, out });
                }
            }
        }
        Ok(runs)
    }

    /// What the protocol depends on: its policies are its own.
    pub(super) fn frozen(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for run in self.plan()? {
            let robot = nerd_tasks::named(&run.task)?.robot();
            let (model, truth) = self.host(&run.task)?;
            inputs.add(Input::robot(&*System::named(robot)?));
            inputs.add(truth_of(&run.task, truth)?);
            inputs.add(Input::model(&model)?);
        }
        Ok(inputs)
    }

    /// Folders of all policies, trained now unless they are there.
    pub(super) fn train(&self) -> Result<Vec<PathBuf>> {
        let runs = self.plan()?;
        for (k, run) in runs.iter().enumerate() {
            if !done(run)? {
                eprintln!("policy {} of {}: {}", k + 1, runs.len(), run.out.display());
                run.train()?;
            }
        }
        Ok(runs.iter().map(|run| run.out.join("policy")).collect())
    }
}

/// Whether a run's policy is there, of these settings and this very arena.
fn done(run: &PolicyRun) -> Result<bool> {
    let path = run.out.join("policy");
    if !path.join("config.json").exists() {
        return Ok(false);
    }
    let found = folder::load(&path)?.0;
    let system = System::named(nerd_tasks::named(&run.task)?.robot())?;
    let identity = format!("{} on {}", run.task, run.arena.identity(&system)?);
    if found.provenance.get("learned in") != Some(&identity) || found.ppo != run.config {
        refuse!("{} holds a policy of another arena or other settings: take another --runs", path.display());
    }
    Ok(run.minutes.is_some() || found.iterations >= run.config.iterations)
}

/// The same without seeds.
pub(super) fn summary(rows: &[Row]) -> Table {
    let mut table = gaps(rows);
    table.name = "summary".into();
    for row in table.rows.iter_mut().chain([&mut table.header]) {
        *row = [0, 1, 2, 6].map(|column| row[column].clone()).into();
    }
    table
}

/// The policies of a task that were trained in a learned simulator, or those of the truth.
fn of<'a>(rows: &'a [Row], task: &str, learned: bool) -> Vec<&'a Row> {
    rows.iter().filter(|r| r.task == task && r.trained_in.starts_with("neural") == learned).collect()
}

/// Gaps by task and seed, and what policies earn in the truth by where they were trained.
pub(super) fn gaps(rows: &[Row]) -> Table {
    let lines = nerd_tasks::names().into_iter().filter_map(|task| {
        let (learned, truth) = (of(rows, task, true), of(rows, task, false));
        if learned.is_empty() && truth.is_empty() {
            return None;
        }
        let gaps = |rows: &[&Row]| rows.iter().filter_map(|r| r.gap).collect::<Vec<_>>();
        let sizes = |rows: &[&Row]| gaps(rows).iter().map(|g| g.abs()).collect::<Vec<_>>();
        let mean = |of: &[f64]| if of.is_empty() { f64::NAN } else { of.iter().sum::<f64>() / of.len() as f64 };
        let most = |of: &[f64]| of.iter().copied().fold(f64::NAN, f64::max);
        let seeds = |rows: &[&Row]| rows.iter().filter_map(|r| r.gap.map(|g| percent(g, r.gap_error))).collect::<Vec<_>>().join(", ");
        let earned = |rows: &[&Row]| mean(&rows.iter().map(|r| r.real.mean).collect::<Vec<_>>());
        let word = |x: f64, digits: usize| if x.is_finite() { format!("{x:.digits$}") } else { "-".into() };
        let share = 100.0 * earned(&learned) / earned(&truth);
        let (l, t) = (sizes(&learned), sizes(&truth));
        let head = vec![task.to_string(), word(mean(&l), 2), word(most(&l), 2), seeds(&learned), word(most(&t), 2), seeds(&truth)];
        Some(head.into_iter().chain([word(earned(&learned), 1), word(earned(&truth), 1), word(share, 1)]).collect())
    });
    let header = [
        "task",
        "mean gap (%)",
        "largest (%)",
        "gaps of policies trained in NeRD",
        "largest of the truth's (%)",
        "gaps of policies trained in the truth",
        "trained in NeRD, reward in the truth",
        "trained in the truth",
        "share (%)",
    ];
    let note = "Policies of seeds that the model never met. Gap: (reward in NeRD - in the truth) / |reward in the truth|, +- its standard \
                error over games; means and largest are of sizes, without sign. Share: what NeRD's policies earn in the truth, of what \
                the truth's own earn there after as many steps.";
    Table::new("fresh", &header).with(lines).noted(note)
}
