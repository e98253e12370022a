//! Words that left do not come back: in public names, in options, in headings.

use std::process::Command;

use crate::{root, text};

/// Old words with their successors, and files that may have one.
const WORDS: &str = include_str!("words.txt");

/// Verbs, old options and new ones.
const RENAMED: &str = include_str!("../../../nerd-cli/src/renamed.txt");

/// Words of a name: `HeldForce`, `held_force` and `held-force` have the same two.
fn words(name: &str) -> Vec<String> {
    let mut spaced = String::new();
    for (k, c) in name.char_indices() {
        if c.is_uppercase() && name[..k].ends_with(|before: char| before.is_lowercase()) {
            spaced.push('_');
        }
        spaced.push(c.to_ascii_lowercase());
    }
    spaced.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(String::from).collect()
}

/// The public name that a line of Rust declares, if it does.
fn declared(line: &str) -> Option<&str> {
    let rest = line.trim_start().strip_prefix("pub ")?.trim_start_matches("unsafe ");
    let rest = rest.strip_prefix("const ").filter(|rest| rest.starts_with("fn ")).unwrap_or(rest);
    let kinds = ["fn ", "struct ", "enum ", "trait ", "mod ", "const ", "static ", "type "];
    let name = kinds.iter().find_map(|kind| rest.strip_prefix(kind)).or_else(|| rest.contains(": ").then_some(rest))?;
    name.split(|c: char| !c.is_alphanumeric() && c != '_').next().filter(|name| !name.is_empty())
}

#[test]
fn old_words_are_in_no_public_name_option_or_heading() {
    let lines = || WORDS.lines().filter(|line| !line.starts_with('#'));
    let old: Vec<(&str, &str)> = lines().filter_map(|line| line.split_once(" = ")).collect();
    let may: Vec<Vec<&str>> =
        lines().filter_map(|line| Some(line.strip_prefix("may ")?.split(' ').collect())).collect();
    let listed = Command::new("git").args(["ls-files"]).current_dir(root()).output().expect("git");
    let mut faults = Vec::new();
    let mut seen = 0;
    for file in String::from_utf8_lossy(&listed.stdout)
        .lines()
        .filter(|file| !file.starts_with("results/") && !file.starts_with("models/"))
    {
        let names: Vec<String> = match file {
            file if file.ends_with(".rs") && file.contains("/src/") => {
                text(root().join(file)).lines().filter_map(declared).map(String::from).collect()
            }
            "docs/commands.md" => text(root().join(file))
                .split("`--")
                .skip(1)
                .filter_map(|rest| rest.split([' ', '`']).next())
                .map(String::from)
                .collect(),
            // What was tried is told in the words of its time.
            file if file.ends_with(".md") && !["CHANGELOG.md", "docs/tried.md"].contains(&file) => {
                text(root().join(file)).lines().filter(|line| line.starts_with('#')).map(String::from).collect()
            }
            _ => continue,
        };
        seen += names.len();
        for name in names {
            let found = old.iter().filter(|(word, _)| {
                words(&name).iter().any(|own| own == word) && !may.iter().any(|own| own[..] == [file, *word])
            });
            faults.extend(found.map(|(word, new)| format!("{file}: `{}`: {new} in place of {word}", name.trim())));
        }
    }
    assert!(seen > 1000, "only {seen} names were found");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn renamed_verbs_and_options_are_in_the_commands_by_their_new_names_alone() {
    let page = text(root().join("docs/commands.md"));
    let chapter = |verb: &str| {
        page.split("\n#").find_map(|part| part.trim_start_matches('#').strip_prefix(&format!(" {verb}\n")))
    };
    for row in RENAMED.lines().filter(|line| !line.starts_with('#')) {
        let [verb, old, new] = row.split(' ').collect::<Vec<_>>()[..] else { panic!("`{row}` is not VERB OLD NEW") };
        let verb = verb.replace('/', " ");
        let has = |name: &str| match name.split('=').next().filter(|name| name.starts_with("--")) {
            Some(option) => {
                chapter(&verb).unwrap_or_else(|| panic!("no verb `{verb}`")).contains(&format!("| `{option} "))
            }
            None => chapter(if verb == "." { name.into() } else { format!("{verb} {name}") }.as_str()).is_some(),
        };
        let flag = |name: &str| has(name) || chapter(&verb).is_some_and(|text| text.contains(&format!("| `{name}` ")));
        assert!(flag(new) && !flag(old), "{row}: the commands have the old name, or not the new one");
    }
}
