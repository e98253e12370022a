//! Writes the result of a run: a folder with its best policy, a card and the learning curve.

use super::folder::{self, PolicyConfig, save};
use super::*;
use crate::files::{read_record, write};
use crate::records::{Session, rows};
use nerd_sim::files::renamed::{self, Kind};

/// Approximate number of iterations in `curve.csv`.
const POINTS: usize = 100;

/// Writes `<out>/policy`; `identity` names task and solver by content.
pub fn export(out: &Path, solver: &str, identity: &str, trainer: &Trainer) -> Result<()> {
    let task = &*trainer.episodes.task;
    let spent = Session::all(out)?.last().map(|s| s.spent.clone()).unwrap_or_default();
    let mut about = vec![("spent", spent), ("learned in", identity.into())];
    about.extend([(folder::ROBOT, task.system()?.sha256()), (folder::TEXT, folder::text_hash(task))]);
    let Batch { system, systems, .. } = &trainer.episodes.simulation.batch;
    about.extend(
        system.spec.vary.as_ref().filter(|_| !systems.is_empty()).map(|vary| ("robots differ by", vary.title())),
    );
    let (provenance, table) = rows(out, trainer.seed, about)?;
    let (policy, reward) = trainer.best();
    let shape = policy.shape.clone();
    let ppo = trainer.config.clone();
    let iterations = trainer.state.iteration;
    let config =
        PolicyConfig { task: task.name().into(), solver: solver.into(), shape, ppo, iterations, reward, provenance };
    let to = out.join("policy");
    if let Some(text) = folder::own(task) {
        write(&to.join(folder::TASK), text)?;
    }
    save(&to, &config, policy, &card(&config, policy.flat.len(), &table))?;
    write_curve(out, &to)
}

fn card(config: &PolicyConfig, parameters: usize, table: &str) -> String {
    let PolicyConfig { task, solver, shape, ppo, iterations, reward, .. } = config;
    format!(
        "# A policy of `{task}`\n\nTrained by {} in `{solver}`: {iterations} iterations of {} environments x {} steps. Network {:?} {:?}, \
         {parameters} parameters; the best of the run by mean training reward{}.\n\n{table}\n\
         `cargo xtask policy evaluate` plays it in the truth and in the learned simulator. Written by `cargo xtask policy train`.\n",
        format!("{:?}", ppo.algorithm).to_uppercase(),
        ppo.environments,
        ppo.horizon,
        shape.widths(),
        shape.activation,
        reward.map_or_else(String::new, |r| format!(", {r:.1}")),
    )
}

/// Writes `curve.csv` from the metrics of the run in `out`, for about [`POINTS`] iterations. Columns: steps, training
/// time (s), mean return and mean length of episodes.
fn write_curve(out: &Path, folder: &Path) -> Result<()> {
    let metrics = out.join("metrics.jsonl");
    let lines = read_record(&metrics)?;
    let read = |line: &str| {
        let mut line = serde_json::from_str(line).map_err(Error::file(&metrics))?;
        // A run that an earlier version began has lines with old keys.
        renamed::json(Kind::Metrics, &mut line).map_err(Error::file(&metrics))?;
        serde_json::from_value(line).map_err(Error::file(&metrics))
    };
    let lines = lines.lines().map(read).collect::<Result<Vec<Iteration>>>()?;
    let every = lines.len().div_ceil(POINTS).max(1);
    let mut text = String::from("steps,seconds,reward,length\n");
    let mut seconds = 0.0;
    for line in &lines {
        seconds += line.rollout_seconds + line.update_seconds;
        if let (true, Some(reward), Some(length)) =
            ((line.step as usize).is_multiple_of(every), line.reward, line.length)
        {
            text.push_str(&format!("{},{seconds:.1},{reward:.2},{length:.1}\n", line.frames));
        }
    }
    write(&folder.join("curve.csv"), text)
}
