//! One round: its model, its policies, its gaps.

use std::path::{Path, PathBuf};

use nerd_model::folder::ModelConfig;

use super::plan::First;
use super::{CoTrain, Gap, Round, TaskGaps};
use crate::error::{Result, refuse};
use crate::report::write;
use nerd_train::ppo::{Arena, PolicyRun};
use nerd_train::run::{Run, RunConfig};

/// Iterations of a policy for one of a short one.
const SHORT: u64 = 4;
/// Between the seeds of the data of two rounds: further than runs move theirs to validate.
const DATA: u64 = 10_000;

impl CoTrain {
    /// Of a round.
    pub(super) fn folder(&self, k: usize) -> PathBuf {
        self.out.join(format!("round-{k}"))
    }

    /// Of its model.
    pub(super) fn model_of(&self, k: usize) -> PathBuf {
        self.folder(k).join("model")
    }

    /// Policies of a task in a round.
    fn policies(&self) -> usize {
        self.config.seeds + self.config.breadth
    }

    /// A seed that no other policy of the loop has: of round `k`, task `t` and its policy `j`.
    fn seed(&self, k: usize, t: usize, j: usize) -> u64 {
        self.config.seed + ((k * self.tasks.len() + t) * self.policies() + j) as u64
    }

    /// The run of that policy; those beyond the first `seeds` are the short ones.
    fn policy(&self, k: usize, t: usize, j: usize) -> PolicyRun {
        let (task, seed, fast) = (self.tasks[t].clone(), self.seed(k, t, j), j >= self.config.seeds);
        let (mut config, minutes) = (self.ppo[t].clone(), self.left());
        if fast {
            config.iterations = config.iterations.div_ceil(SHORT);
        }
        let arena = Arena::Model { folder: self.model_of(k), device: self.config.device };
        let out = self.folder(k).join("policies").join(format!("{task}-{seed}"));
        PolicyRun { task, arena, config, seed, fast, until: None, minutes, out }
    }

    /// A round that is not done yet; none if time was over before.
    pub(super) fn round(&self, k: usize) -> Result<Option<Round>> {
        if self.late() || !self.model(k)? {
            return Ok(None);
        }
        let model = ModelConfig::read(&self.model_of(k))?.model_sha256;
        let mut tasks = Vec::new();
        for (t, task) in self.tasks.iter().enumerate() {
            let mut policies = Vec::new();
            for j in 0..self.policies() {
                eprintln!("round {k}: policy {} of {} of {task}, seed {}", j + 1, self.policies(), self.seed(k, t, j));
                let run = self.policy(k, t, j);
                if !trained(&run)? {
                    return Ok(None);
                }
                if !run.fast {
                    let gap = Gap::of(&run, self.truth, self.config.games)?;
                    eprintln!("round {k}: {task}, seed {}: {}", run.seed, gap.words());
                    policies.push(gap);
                }
            }
            tasks.push(TaskGaps { task: task.clone(), policies });
        }
        let round = Round { round: k, model, tasks };
        round.write(&self.folder(k))?;
        Ok(Some(round))
    }

    /// Makes the round's model, unless it is there; whether it is now.
    fn model(&self, k: usize) -> Result<bool> {
        let run = self.onward(k);
        if run.made()?.is_some() {
            return Ok(true);
        }
        match &self.first {
            _ if k > 0 => {
                eprintln!("round {k}: the model of round {} learns from {} policies", k - 1, run.record.policy.len());
                Ok(Run::new(&run)?.train()?.is_some())
            }
            First::Model(folder) => copy(folder, &self.model_of(k)).map(|()| true),
            First::Recipe(recipe) => {
                for run in &recipe.runs {
                    let mut run = run.clone();
                    run.minutes = self.left();
                    if run.made()?.is_none() && Run::new(&run)?.train()?.is_none() {
                        return Ok(false);
                    }
                }
                let made = recipe.runs.last().map(|run| run.out.join("model")).filter(|made| *made != self.model_of(k));
                made.map_or(Ok(()), |made| copy(&made, &self.model_of(k))).map(|()| true)
            }
        }
    }

    /// The training that leads to round `k`, on data in which the policies of all rounds before act.
    fn onward(&self, k: usize) -> RunConfig {
        let mut run = self.onward.clone();
        (run.out, run.minutes) = (self.folder(k), self.left());
        run.from = k.checked_sub(1).map(|before| self.model_of(before));
        run.record.seed += DATA * k as u64;
        run.record.policy_share = self.config.policy_share;
        let each = (0..k).flat_map(|k| (0..self.tasks.len()).map(move |t| (k, t)));
        let all = each.flat_map(|(k, t)| (0..self.policies()).map(move |j| self.policy(k, t, j).out.join("policy")));
        run.record.policy.extend(all);
        run
    }

    /// Folders of the judged policies of a round.
    pub(super) fn judged(&self, k: usize) -> impl Iterator<Item = PathBuf> {
        let each = (0..self.tasks.len()).flat_map(|t| (0..self.config.seeds).map(move |j| (t, j)));
        each.map(move |(t, j)| self.policy(k, t, j).out.join("policy"))
    }
}

/// Trains a policy, unless it is done; whether it is now.
fn trained(run: &PolicyRun) -> Result<bool> {
    if Gap::read(&run.out)?.is_some() {
        return Ok(true);
    }
    if run.minutes == Some(0.0) {
        return Ok(false);
    }
    Ok(run.train()?.iterations >= run.config.iterations)
}

/// Copies a model, so that whoever replaces it leaves the loop's alone.
fn copy(from: &Path, to: &Path) -> Result<()> {
    let entries = std::fs::read_dir(from).map_err(crate::error::file(from))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|path| path.is_file()).collect();
    // Last what says that a folder is whole.
    files.sort_by_key(|path| path.ends_with("config.json"));
    for file in &files {
        let Some(name) = file.file_name() else { refuse!("{}: a file without a name", file.display()) };
        write(&to.join(name), &std::fs::read(file).map_err(crate::error::file(file))?)?;
    }
    Ok(())
}
