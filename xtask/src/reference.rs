//! `cargo xtask reference`: writes `docs/commands.md` from the program's own help.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Result;
use clap::{Arg, Command};
use nerd_train::shipped::root;

use crate::verbs::GROUPS;

/// Write the reference of all commands.
#[derive(clap::Args, Clone, Debug)]
pub struct ReferenceArgs {
    /// File to write [default: docs/commands.md of the workspace]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: ReferenceArgs) -> Result<()> {
    let out = args.out.unwrap_or_else(|| root().join("docs/commands.md"));
    crate::files::write(&out, reference()?.as_bytes())
}

/// The document.
fn reference() -> Result<String> {
    let mut program = crate::program();
    program.build();
    let mut text = String::from(
        "# Commands\n\nWritten by `cargo xtask reference` from the program's own help. Every command ends with exit code 0, or with 2 \
         and one line that says what, where and what to do. Files are written whole or not at all.\n",
    );
    for (title, verbs) in GROUPS {
        writeln!(text, "\n## {title}")?;
        for verb in verbs.iter().filter_map(|name| program.find_subcommand(name)) {
            chapter(&mut text, verb, "###")?;
        }
    }
    // Defaults are found from where this runs.
    let here = format!("{}/", root().display());
    Ok(if here == "/" { text } else { text.replace(&here, "") })
}

/// A verb, then those below it.
fn chapter(text: &mut String, verb: &Command, level: &str) -> Result<()> {
    let name = verb.get_bin_name().unwrap_or(verb.get_name()).trim_start_matches("cargo xtask ");
    let about = verb.get_about().map(ToString::to_string).unwrap_or_default();
    writeln!(text, "\n{level} {name}\n\n{about}.\n")?;
    let usage = verb.clone().render_usage().to_string();
    writeln!(text, "```sh\n{}\n```", usage.trim_start_matches("Usage:").trim())?;
    let shown: Vec<&Arg> = verb.get_arguments().filter(|a| !a.is_hide_set() && a.get_id() != "help").collect();
    if !shown.is_empty() {
        writeln!(text, "\n| option | meaning | default |\n|---|---|---|")?;
    }
    for arg in shown {
        let (meaning, default) = meaning(arg);
        writeln!(text, "| `{}` | {meaning} | {default} |", option(arg))?;
    }
    if let Some(more) = verb.get_after_help() {
        writeln!(text, "\n```text\n{more}\n```")?;
    }
    verb.get_subcommands().try_for_each(|below| chapter(text, below, &format!("{level}#")))
}

/// Whether a value stands behind it.
fn valued(arg: &Arg) -> bool {
    arg.get_action().takes_values() && arg.get_num_args().is_none_or(|n| n.max_values() > 0)
}

/// As it is given: `--out <FILE>`.
fn option(arg: &Arg) -> String {
    let names = arg.get_value_names().unwrap_or_default().iter().map(|name| format!("<{name}>")).collect::<Vec<_>>().join(" ");
    match arg.get_long() {
        Some(long) if valued(arg) => format!("--{long} {names}"),
        Some(long) => format!("--{long}"),
        None => names,
    }
}

/// What it does with the words it takes, and its default, of which some helps speak themselves.
fn meaning(arg: &Arg) -> (String, String) {
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default().replace('|', "\\|").replace('\n', " ");
    let said = help.strip_suffix(']').and_then(|text| text.rsplit_once(" [default: "));
    let (help, mut default) = said.map_or((help.as_str(), String::new()), |(help, default)| (help, default.to_string()));
    if valued(arg) && !arg.get_default_values().is_empty() {
        default = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect::<Vec<_>>().join(" ");
    }
    let words: Vec<String> = arg.get_possible_values().iter().map(|value| value.get_name().to_string()).collect();
    let untold = valued(arg) && words.iter().any(|word| !help.contains(word));
    (if untold { format!("{help}: {}", words.join(", ")) } else { help.into() }, default)
}
