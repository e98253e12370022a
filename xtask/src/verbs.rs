//! The verbs in groups, as `cargo xtask` and `docs/commands.md` show them, and what is the same for all of them.

use clap::{Arg, ArgAction, ArgMatches, Command};

/// Groups, and their verbs.
pub const GROUPS: [(&str, &[&str]); 5] = [
    ("Data", &["dataset", "inspect", "urdf"]),
    ("Learn", &["train", "stamp"]),
    ("Measure", &["rollout", "evaluate", "chart", "device", "cards", "grow", "motions", "stability", "calibrate", "reproduce"]),
    ("Policies", &["policy"]),
    ("Project", &["list", "results", "report", "gif", "completions", "reference", "campaign", "outside", "check"]),
];

/// Verbs that print tables, with all below them; they take `--json`.
const TABLES: &[&str] = &[
    "list",
    "inspect",
    "urdf",
    "evaluate",
    "chart",
    "device",
    "cards",
    "grow",
    "motions",
    "stability",
    "calibrate",
    "reproduce",
    "policy co-train",
    "policy evaluate",
    "campaign",
    "results",
];

/// Options that are folders wherever they do not say that they are files.
const FOLDERS: [&str; 7] = ["out", "model", "models", "policy", "data", "from", "parents"];

/// The program with what all its verbs have.
pub fn prepare(program: Command) -> Command {
    let groups = groups(&program);
    let program = program
        .help_template("{about}\n\n{usage-heading} {usage}{after-help}")
        .after_help(groups)
        .disable_help_subcommand(true)
        .subcommand_value_name("VERB");
    program.mut_subcommands(|verb| shared(verb, ""))
}

/// Whether the tables were asked for as JSON.
pub fn as_json(matches: &ArgMatches) -> bool {
    let below = matches.subcommand().is_some_and(|(_, matches)| as_json(matches));
    below || matches.try_get_one("json").is_ok_and(|json| json == Some(&true))
}

/// A number below zero behind an option is its value, for the option to refuse by its range.
fn shared(verb: Command, above: &str) -> Command {
    let path = format!("{above} {}", verb.get_name()).trim().to_string();
    let mut verb = verb.mut_args(|arg| {
        let valued = !arg.is_positional() && arg.get_action().takes_values();
        let file = arg.get_value_names().is_some_and(|names| names[0] == "FILE");
        let arg = if FOLDERS.contains(&arg.get_id().as_str()) && !file { arg.value_name("FOLDER") } else { arg };
        arg.allow_negative_numbers(valued)
    });
    let tabled = TABLES.iter().any(|t| path == *t || path.starts_with(&format!("{t} ")));
    if tabled && !verb.is_subcommand_required_set() {
        verb = verb.arg(Arg::new("json").long("json").action(ArgAction::SetTrue).help("Print the tables as JSON, and nothing else"));
    }
    verb.disable_help_subcommand(true).mut_subcommands(|below| shared(below, &path))
}

/// A line for each verb.
fn groups(program: &Command) -> String {
    let line = |name: &&str| {
        let about = program.find_subcommand(name).and_then(Command::get_about).map(ToString::to_string);
        format!("  {name:<12} {}\n", about.unwrap_or_default())
    };
    let group = |(title, verbs): &(&str, &[&str])| format!("{title}:\n{}\n", verbs.iter().map(line).collect::<String>());
    let end = "`cargo xtask VERB --help` says what a verb takes; docs/commands.md has it all.";
    GROUPS.iter().map(group).collect::<String>() + end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_verb_is_in_one_group() {
        let program = crate::program();
        let mut verbs: Vec<&str> = program.get_subcommands().map(Command::get_name).collect();
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, verbs)| *verbs).copied().collect();
        verbs.sort();
        grouped.sort();
        assert_eq!(verbs, grouped);
    }
    /// Commands that the manifest of results and the documents give.
    fn given() -> Vec<String> {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let manifest = nerd_lab::report::manifest::Manifest::read(&root.join("results")).expect("manifest.toml");
        let mut all: Vec<String> = manifest.artefact.iter().map(|entry| entry.command.clone()).collect();
        let docs = std::fs::read_dir(root.join("docs")).expect("docs").flatten().map(|file| file.path());
        for page in docs.chain([root.join("README.md")]).filter(|p| p.extension().is_some_and(|e| e == "md") && !p.ends_with("commands.md"))
        {
            let text = std::fs::read_to_string(&page).expect("text").replace("\\\n", " ");
            let lines = text.lines().filter_map(|line| line.trim().strip_prefix("cargo xtask "));
            all.extend(lines.map(|line| line.split(" #").next().unwrap_or_default().trim().to_string()));
        }
        all
    }

    #[test]
    fn commands_that_are_written_down_can_be_said() {
        let all = given();
        assert!(all.len() > 30, "only {} commands found", all.len());
        for command in all {
            let words = ["cargo xtask"].into_iter().chain(command.split_whitespace());
            let said = crate::program().try_get_matches_from(words).map_err(|e| crate::refusals::usage(&e));
            assert!(said.is_ok(), "{command}: {}", said.err().unwrap_or_default());
        }
    }
}
