//! `cargo xtask results`: checks which results still hold, makes them again, writes their figures into the documents.

use std::process::Command;

use nerd_cli::report::{Table, write};
use nerd_lab::experiments::worth::unworthy;
use nerd_lab::report::marks::{Marks, documents, unmarked};
use nerd_lab::report::{Manifest, Status};
use nerd_train::shipped::{models, root};

use crate::prelude::*;

#[derive(clap::Args)]
pub struct ResultsArgs {
    #[command(subcommand)]
    pub part: Option<Part>,
}

#[derive(clap::Subcommand)]
pub enum Part {
    /// End with an error unless every result holds, every document agrees, and every shipped model beats its baselines.
    /// The baselines, its base alone and a linear map, must err five times as much
    Check,
    /// Remake results by their commands in `results/manifest.toml`
    Make {
        /// Names of results [default: all that no longer hold, except records]
        #[arg(value_name = "NAME")]
        names: Vec<String>,
    },
    /// Write the figures of the results into README and docs
    Write,
}

/// Runs the verb; `reference` is the text of `docs/commands.md`.
pub fn run(args: ResultsArgs, reference: String) -> Result<()> {
    let manifest = Manifest::read(&results())?;
    match args.part {
        None => list(&manifest),
        Some(Part::Check) => check(&manifest, &reference),
        Some(Part::Make { names }) => make(&manifest, &names),
        Some(Part::Write) => {
            fill(&reference, true)?.iter().for_each(|words| tell!("{words}"));
            Ok(())
        }
    }
}

fn list(manifest: &Manifest) -> Result<()> {
    let made = manifest.artefact.iter().map(|entry| {
        let status = entry.status(&results()).to_string();
        [entry.name.clone(), status, entry.about.clone(), format!("cargo xtask {}", entry.command)]
    });
    let strangers = manifest.strangers(&results()).into_iter();
    let strangers = strangers.map(|name| [name, "not in the manifest".into(), String::new(), String::new()]);
    let rows = made.chain(strangers);
    nerd_cli::out::table(&Table::new("results", ["result", "status", "what it shows", "made by"]).with(rows));
    Ok(())
}

fn check(manifest: &Manifest, reference: &str) -> Result<()> {
    let mut wrong = manifest
        .strangers(&results())
        .into_iter()
        .map(|name| format!("{name}.json: not in the manifest"))
        .collect_vec();
    for entry in &manifest.artefact {
        let status = entry.status(&results());
        if !status.holds() {
            wrong.push(format!("{}: {status}", entry.name));
        }
    }
    wrong.extend(unworthy(manifest, &results(), &models())?);
    wrong.extend(fill(reference, false)?);
    if !wrong.is_empty() {
        bail!("{}", wrong.join("; "));
    }
    let n = manifest.artefact.len();
    say!("{n} results hold, the models are worth their networks, and the documents say so");
    Ok(())
}

/// Fills the results' figures into the documents, and writes them if `write_them`. Returns what does not agree, by
/// document.
fn fill(reference: &str, write_them: bool) -> Result<Vec<String>> {
    let mut marks = Marks::new(&results());
    let mut wrong = Vec::new();
    for path in documents(&root()) {
        let text = nerd_sim::files::read_text(&path).with_context(|| path.display().to_string())?;
        let commands = path.ends_with("docs/commands.md");
        let filled = match marks.fill(&text) {
            _ if commands => reference.to_string(),
            Ok(filled) => filled,
            Err(e) => {
                wrong.push(format!("{}: {e}", path.display()));
                continue;
            }
        };
        if filled != text && write_them {
            write(&path, filled.as_bytes())?;
            say!("{} written", path.display());
        } else if filled != text {
            let what = if commands { "not this program's commands" } else { "figures that its results do not have" };
            wrong.push(format!("{}: {what}; `cargo xtask results write` mends it", path.display()));
        }
        let loose = unmarked(&filled).into_iter().filter(|_| !commands);
        wrong.extend(loose.map(|(line, figure)| format!("{}:{line}: {figure} comes from no result", path.display())));
    }
    Ok(wrong)
}

fn make(manifest: &Manifest, names: &[String]) -> Result<()> {
    if let Some(unknown) = names.iter().find(|name| manifest.artefact.iter().all(|entry| entry.name != **name)) {
        bail!("no result `{unknown}` in results/manifest.toml; `cargo xtask results` lists them");
    }
    let mut commands: Vec<&str> = Vec::new();
    for entry in manifest.artefact.iter().filter(|entry| names.is_empty() || names.contains(&entry.name)) {
        let asked = names.contains(&entry.name) || (!entry.record && entry.status(&results()) != Status::Current);
        // Runs each command once, since one command may make several results.
        if asked && !commands.contains(&entry.command.as_str()) {
            commands.push(&entry.command);
        }
    }
    for (k, command) in commands.iter().enumerate() {
        tell!("{} of {}: cargo xtask {command}", k + 1, commands.len());
        let program = std::env::current_exe().context("cannot find this program")?;
        let status = Command::new(program).args(command.split_whitespace()).arg("--out").arg(results()).status()?;
        if !status.success() {
            bail!("`cargo xtask {command}` failed");
        }
    }
    Ok(())
}
