//! Hostile input is refused in words or used to the end: the corpus, which has a small file for each fault that was found
//! once, and some thousands of changed files and command lines. `NERD_CAMPAIGN=1000000` makes it long, and so does
//! `cargo xtask campaign --cases 1000000 --kills 500`.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

fn campaign(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_xtask")).arg("campaign").args(args).output().expect("xtask starts")
}

/// What must become of each file, by folder: `accepted`, or the words of its refusal.
type Expected = BTreeMap<String, BTreeMap<String, String>>;

#[test]
fn every_file_of_the_corpus_ends_as_it_should() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-lab/corpus");
    let expected: Expected = toml::from_str(&std::fs::read_to_string(corpus.join("expected.toml")).expect("expected.toml")).expect("TOML");
    let run = campaign(&["--replay", corpus.to_str().expect("utf-8")]);
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found: BTreeMap<&str, &str> = said.lines().filter_map(|line| line.split_once(": ")).collect();
    let mut wrong = Vec::new();
    let wanted = expected.iter().flat_map(|(kind, files)| files.iter().map(move |(file, words)| (format!("{kind}/{file}"), words)));
    let wanted: BTreeMap<String, &String> = wanted.collect();
    for (file, words) in &wanted {
        let became = found.get(file.as_str()).copied().unwrap_or("not tried");
        let right = if *words == "accepted" { became == "accepted" } else { became.starts_with("refused: ") && became.contains(*words) };
        if !right {
            wrong.push(format!("{file}: {became}, expected `{words}`"));
        }
    }
    wrong.extend(found.keys().filter(|file| !wanted.contains_key(**file)).map(|file| format!("{file} is not in expected.toml")));
    assert!(wrong.is_empty(), "{} of {} files:\n{}", wrong.len(), found.len(), wrong.join("\n"));
}

#[test]
fn changed_files_and_command_lines_are_refused_or_used() {
    let cases = std::env::var("NERD_CAMPAIGN").unwrap_or_else(|_| "40000".into());
    let folder = tempfile::tempdir().expect("temporary folder");
    let run = campaign(&["--cases", &cases, "--seed", "16", "--faults", folder.path().to_str().expect("utf-8")]);
    let (table, faults) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{table}\n{faults}");
    // A campaign that refuses everything tries nothing.
    for row in table.lines().filter(|line| ["urdf", "toml", "csv", "model", "line"].iter().any(|k| line.starts_with(&format!("| {k} ")))) {
        let cells: Vec<u64> = row.split('|').filter_map(|cell| cell.trim().parse().ok()).collect();
        assert!(cells[2] * 20 >= cells[0], "fewer than a twentieth of the cases are accepted: {row}");
    }
}

#[test]
fn killed_runs_leave_whole_files_and_go_on() {
    let run = campaign(&["--cases", "0", "--kills", "24", "--seed", "16"]);
    assert!(run.status.success(), "{}{}", String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
}
