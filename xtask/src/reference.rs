//! Writes the text of `docs/commands.md` from the program's help.

use clap::{Arg, Command};
use nerd_cli::commands::{GROUPS, valued};
use nerd_train::shipped::root;

use crate::prelude::*;

pub fn reference(mut program: Command) -> String {
    program.build();
    let mut text = String::from(
        "# Commands\n\nWritten by `cargo xtask results write` from the program's own help. Every command ends with exit code 0, or \
         with one line that says what, where and what to do, and exit code 1, or 2 where the command line cannot be read. Files are written whole or not at all. With `--json` a command prints \
         its tables as JSON, and nothing else.\n",
    );
    for (title, verbs) in GROUPS {
        text += &format!("\n## {title}\n");
        verbs.iter().filter_map(|name| program.find_subcommand(name)).for_each(|verb| chapter(&mut text, verb, "###"));
    }
    // Removes the workspace's path from default paths, so that the text is the same on all machines.
    let here = format!("{}/", root().display());
    if here == "/" { text } else { text.replace(&here, "") }
}

fn chapter(text: &mut String, verb: &Command, level: &str) {
    let name = verb.get_bin_name().unwrap_or(verb.get_name()).trim_start_matches("cargo xtask ");
    let about = verb.get_about().map(ToString::to_string).unwrap_or_default();
    let usage = verb.clone().render_usage().to_string();
    *text += &format!("\n{level} {name}\n\n{about}.\n\n```sh\n{}\n```\n", usage.trim_start_matches("Usage:").trim());
    let shown = verb.get_arguments().filter(|a| !a.is_hide_set() && a.get_id() != "help").collect_vec();
    for heading in shown.iter().map(|arg| arg.get_help_heading()).unique() {
        *text += &heading.map(|heading| format!("\n**{heading}**\n")).unwrap_or_default();
        *text += "\n| option | meaning | default |\n|---|---|---|\n";
        for arg in shown.iter().filter(|arg| arg.get_help_heading() == heading) {
            let (meaning, default) = meaning(arg);
            *text += &format!("| `{}` | {meaning} | {default} |\n", option(arg).replace('|', "\\|"));
        }
    }
    if let Some(more) = verb.get_after_help() {
        *text += &format!("\n```text\n{more}\n```\n");
    }
    verb.get_subcommands().for_each(|below| chapter(text, below, &format!("{level}#")));
}

/// Writes an option as it is typed: `--out <FILE>`.
fn option(arg: &Arg) -> String {
    let names = arg.get_value_names().unwrap_or_default().iter().map(|name| format!("<{name}>")).join(" ");
    match arg.get_long() {
        Some(long) if valued(arg) => format!("--{long} {names}"),
        Some(long) => format!("--{long}"),
        None => names,
    }
}

/// Returns an option's help with its possible values, and its default. A default at the end of the help is moved out of
/// the help.
fn meaning(arg: &Arg) -> (String, String) {
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default().replace('|', "\\|").replace('\n', " ");
    let said = help.strip_suffix(']').and_then(|text| text.rsplit_once(" [default: "));
    let (help, mut default) =
        said.map_or((help.as_str(), String::new()), |(help, default)| (help, default.to_string()));
    if valued(arg) && !arg.get_default_values().is_empty() {
        default = arg.get_default_values().iter().map(|value| value.to_string_lossy()).join(" ");
    }
    let words = arg.get_possible_values().iter().map(|value| value.get_name().to_string()).collect_vec();
    let untold = valued(arg) && words.iter().any(|word| !help.contains(word));
    (if untold { format!("{help}: {}", words.join(", ")) } else { help.into() }, default)
}
