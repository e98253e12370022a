//! The strict protocol: policies with new seeds are trained in a frozen model. All policies are then played in the
//! model and in its truth.

use nerd_train::ppo::{PolicyRun, folder};

use super::Policies;
use crate::{paper::policy_reward, prelude::*};

impl Policies {
    fn plan(&self) -> Result<Vec<PolicyRun>> {
        if !self.policy.is_empty() {
            bail!("--fresh-seeds trains its own policies: leave --policy out");
        }
        let known = nerd_tasks::names().into_iter().filter(|task| policy_reward(task).is_some());
        let tasks = if self.task.is_empty() { known.map(String::from).collect() } else { self.task.clone() };
        let mut runs = Vec::new();
        for task in tasks {
            let arena = Arena::Solver(SolverSpec::neural(self.host(&task)?.0).on(self.device));
            let config = arena.settings(&task, Some(&self.recipe), None)?;
            for seed in &self.fresh_seeds {
                let out = self.runs.join(format!("{}-neural-{seed}", nerd_tasks::word(&task)));
                let task = task.clone();
                let arena = arena.clone();
                let config = config.clone();
                runs.push(PolicyRun { task, arena, config, seed: *seed, minutes: self.minutes, out });
            }
        }
        Ok(runs)
    }

    /// Counts the policies of the strict protocol, and collects the inputs of their episodes.
    pub(super) fn frozen(&self) -> Result<(usize, Inputs)> {
        let runs = self.plan()?;
        let mut inputs = Inputs::default();
        runs.iter().try_for_each(|run| self.played(&run.task, true, &mut inputs))?;
        Ok((runs.len(), inputs))
    }

    /// Trains the policies that are missing, and returns the folders of all.
    pub(super) fn train(&self) -> Result<Vec<PathBuf>> {
        let runs = self.plan()?;
        for (k, run) in runs.iter().enumerate() {
            if !done(run)? {
                tell!("policy {} of {}: {}", k + 1, runs.len(), run.out.display());
                run.train()?;
                if nerd_train::stop::asked().is_some() {
                    bail!("stopped; policies that are done are kept, and the same command goes on");
                }
            }
        }
        Ok(runs.iter().map(|run| run.out.join("policy")).collect())
    }
}

/// Whether the run's policy is complete. Fails if the policy has other settings or was trained in another arena.
fn done(run: &PolicyRun) -> Result<bool> {
    let path = run.out.join("policy");
    if !path.join("config.json").exists() {
        return Ok(false);
    }
    let found = folder::load(&path)?.0;
    let task = nerd_tasks::named(&run.task)?;
    let identity = format!("{} on {}", folder::identity(&*task), run.arena.identity(&*task.system()?)?);
    if found.provenance.get("learned in") != Some(&identity) || found.ppo != run.config {
        bail!("{} holds a policy of another arena or other settings: take another --runs", path.display());
    }
    Ok(run.minutes.is_some() || found.iterations >= run.config.iterations)
}
