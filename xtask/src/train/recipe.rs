//! `train --preset ant`: how a model in `models/` was trained, run by run (`xtask/assets/models.toml`).

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use clap::Parser;
use serde::Deserialize;

use super::TrainArgs;

const RECIPES: &str = include_str!("../../assets/models.toml");

#[derive(Deserialize)]
struct Recipe {
    robot: String,
    /// Of every run.
    options: String,
    /// Of each.
    runs: Vec<String>,
}

/// A line of options.
#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: TrainArgs,
}

fn recipes() -> Result<BTreeMap<String, Recipe>> {
    toml::from_str(RECIPES).context("xtask/assets/models.toml")
}

/// The runs of a model, each in a folder of its own below `--out`. Device, minutes, --finish and, as caps for a rehearsal, updates and
/// transitions are those of `asked`; all else is the recipe's.
pub fn runs(name: &str, asked: &TrainArgs) -> Result<Vec<TrainArgs>> {
    let recipes = recipes()?;
    let Some(recipe) = recipes.get(name) else {
        bail!("--preset {name}: known are paper, small, {}", recipes.keys().cloned().collect::<Vec<_>>().join(", "));
    };
    if recipe.robot != asked.robot {
        bail!("--preset {name} trains `{}`, not `{}`", recipe.robot, asked.robot);
    }
    // What the recipe says and the command line says otherwise would be read by nobody.
    let words = ["train", "--robot", &asked.robot, "--out", "x", "--preset", name];
    let plain = Line::try_parse_from(words)?.args;
    let TrainArgs { device, minutes, finish, updates, transitions, .. } = *asked;
    let plain = TrainArgs { out: asked.out.clone(), device, minutes, finish, updates, transitions, ..plain };
    if format!("{plain:?}") != format!("{asked:?}") {
        bail!("--preset {name} says all else: only --device, --minutes, --finish, --updates and --transitions may stand beside it");
    }
    let mut runs: Vec<TrainArgs> = Vec::new();
    for (k, options) in recipe.runs.iter().enumerate() {
        let words = format!("train --robot {} --out x {} {options}", recipe.robot, recipe.options);
        let line = Line::try_parse_from(words.split_whitespace()).with_context(|| format!("xtask/assets/models.toml, {name}"))?;
        let cap = |asked: Option<usize>, own: usize| asked.map_or(own, |a| a.min(own));
        runs.push(TrainArgs {
            out: asked.out.join(format!("{}", k + 1)),
            from: runs.last().map(|r| r.out.join("model")),
            device: asked.device,
            minutes: asked.minutes,
            finish: asked.finish,
            updates: line.args.updates.map(|own| asked.updates.map_or(own, |a| a.min(own))),
            validate_every: line.args.validate_every.filter(|_| asked.updates.is_none()),
            transitions: line.args.transitions.map(|own| cap(asked.transitions, own)),
            fresh: cap(asked.transitions, line.args.fresh),
            ..line.args
        });
    }
    Ok(runs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_recipe_can_be_read_and_starts_from_its_run_before() {
        for (name, recipe) in recipes().expect("models.toml") {
            let words = ["train", "--robot", &recipe.robot, "--out", "out/x", "--preset", &name, "--transitions", "1000", "--finish"];
            let asked = Line::try_parse_from(words).expect("options").args;
            let runs = runs(&name, &asked).unwrap_or_else(|e| panic!("{name}: {e:#}"));
            assert_eq!(runs.len(), recipe.runs.len());
            for (k, run) in runs.iter().enumerate() {
                assert_eq!(run.from.is_some(), k > 0, "{name}, run {k}");
                assert!(run.finish, "{name}, run {k} would train on");
                assert!(run.transitions == Some(1000) && run.updates.is_some_and(|u| u > 10_000), "{name}, run {k}: {run:?}");
            }
        }
    }
}
