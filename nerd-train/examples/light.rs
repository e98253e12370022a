//! Models in half the bytes, and what that costs: reads folders of models with f32 weights below PARENTS, writes `f16.json` and
//! `f16.md` into RESULTS and the light models below MODELS.
//! `cargo run --release -p nerd-train --features report --example light -- PARENTS RESULTS MODELS` (5 minutes on two cores).

use std::path::PathBuf;

use nerd_sim::files::read_text;
use nerd_train::experiments::conduct;
use nerd_train::experiments::storage::{Rounding, Roundings, rounded};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut folders = std::env::args().skip(1).map(PathBuf::from);
    let (Some(parents), Some(results), Some(models)) = (folders.next(), folders.next(), folders.next()) else {
        return Err("three folders are needed: PARENTS RESULTS MODELS".into());
    };
    let experiment = Roundings::shipped(parents);
    for subject in &experiment.subjects {
        let (system, model) = experiment.load(subject)?;
        let mut card = read_text(&experiment.parents.join(&subject.folder).join("README.md"))?;
        let note = format!("hidden matrices as f16 (`results/f16.md`), made of f32 weights of model {}", &model.sha256()[..12]);
        if let Some((head, _)) = card.clone().split_once("\nIts errors in rollouts") {
            card = format!("{head}| storage | {note} |\n\nIts errors in rollouts stand in `results/`. Written by `cargo xtask train`.\n");
        }
        let mut light = rounded(&system, &model, Rounding::Compensated)?;
        light.config.provenance.insert("storage".into(), note);
        light.save(&models.join(&subject.folder), &card, Rounding::Compensated.storage())?;
    }
    println!("{}", conduct(&experiment, &results)?.markdown());
    Ok(())
}
