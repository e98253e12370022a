//! Groups the verbs for a program's help.

use std::any::TypeId;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command};

use crate::prelude::*;

/// All verbs by group. The Python package has those that need no checkout.
pub const GROUPS: [(&str, &[&str]); 5] = [
    ("Data", &["dataset", "inspect", "check-robots"]),
    ("Learn", &["train", "calibrate"]),
    ("Measure", &["rollout", "live", "evaluate", "chart", "stability", "measure", "reproduce"]),
    ("Policies", &["policy"]),
    ("Project", &["list", "results", "report", "fuzz", "check"]),
];

/// Names of option values in the help, with the options that take them. An option whose value name is FILE keeps it.
const VALUES: [(&str, &[&str]); 5] = [
    ("FOLDER", &["out", "model", "policy", "from", "runs", "keep"]),
    ("PYTHON", &["mujoco"]),
    ("PATH", &["data", "beside"]),
    ("FILE", &["log"]),
    ("NAME,...", &["parameters", "per-trajectory", "regularized", "kinds"]),
];

/// Adds the grouped help and the options shared by all verbs.
pub fn prepare(program: Command) -> Command {
    let line = |name: &&str| {
        let about = program.find_subcommand(name)?.get_about().map(ToString::to_string).unwrap_or_default();
        Some(format!("  {name:<12} {about}\n"))
    };
    let group =
        |(title, verbs): &(&str, &[&str])| format!("{title}:\n{}\n", verbs.iter().filter_map(line).collect::<String>());
    let end = format!(
        "`{} VERB --help` explains a verb, docs/commands.md explains all. With --json, a verb prints its tables as JSON.",
        program.get_bin_name().unwrap_or(program.get_name())
    );
    let groups = GROUPS.iter().map(group).collect::<String>() + &end;
    let json = Arg::new("json").long("json").action(clap::ArgAction::SetTrue).global(true).hide(true);
    let program = program.help_template("{about}\n\n{usage-heading} {usage}{after-help}").after_help(groups).arg(json);
    program.disable_help_subcommand(true).subcommand_value_name("VERB").mut_subcommands(shared)
}

/// Lets negative numbers be option values, so that an option's range refuses them.
fn shared(verb: Command) -> Command {
    let verb = verb.mut_args(|arg| {
        let takes = !arg.is_positional() && valued(&arg);
        let arg = if takes { named(arg) } else { arg };
        arg.allow_negative_numbers(takes)
    });
    verb.disable_help_subcommand(true).mut_subcommands(shared)
}

/// Names an option's value in the help by its kind: a number, a folder, one of its words.
fn named(arg: Arg) -> Arg {
    let words = arg.get_possible_values().iter().map(|value| value.get_name().to_string()).collect_vec();
    let kind = arg.get_value_parser().type_id();
    let file = arg.get_value_names().is_some_and(|names| names[0] == "FILE");
    let own = VALUES.iter().find(|(_, options)| !file && options.contains(&arg.get_id().as_str()));
    match own {
        Some((name, _)) => arg.value_name(*name),
        None if kind == TypeId::of::<usize>() || kind == TypeId::of::<u64>() => arg.value_name("N"),
        None if kind == TypeId::of::<f64>() => arg.value_name("NUMBER"),
        None if !words.is_empty() => arg.value_name(words.join("|")),
        None => arg,
    }
}

/// Whether an option or a positional takes a value.
pub fn valued(arg: &Arg) -> bool {
    arg.get_action().takes_values() && arg.get_num_args().is_none_or(|n| n.max_values() > 0)
}

/// Explains an unknown verb that only the program of a checkout has; returns other errors unchanged.
pub fn explained(error: clap::Error, program: &mut Command) -> clap::Error {
    let Some(ContextValue::String(verb)) = error.get(ContextKind::InvalidSubcommand) else { return error };
    let known = GROUPS.iter().any(|(_, verbs)| verbs.contains(&verb.as_str()));
    if !known || program.find_subcommand(verb).is_some() {
        return error;
    }
    let said = format!("`{verb}` works in a checkout of the project alone; docs/commands.md explains it");
    program.error(ErrorKind::InvalidSubcommand, said)
}
