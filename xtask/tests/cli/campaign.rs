//! Hostile input is refused in words or used to the end: the corpus, which has a small case for each fault that was found once, and
//! 12 000 changed files and command lines, of which none may panic, abort, take more than 4 GiB or 10 s, give a number that is not
//! finite, or leave files behind a refusal. `NERD_CAMPAIGN=1000000` makes it long, and so does
//! `cargo xtask campaign --cases 1000000 --kills 500`.

use crate::{Folder, done};

#[test]
fn every_case_of_the_corpus_ends_as_it_should() {
    println!("{}", done("campaign --replay", &[]).0);
}

#[test]
fn changed_files_and_command_lines_are_refused_or_used() {
    let cases = std::env::var("NERD_CAMPAIGN").unwrap_or_else(|_| "12000".into());
    let folder = Folder::new();
    let table = done(&format!("campaign --cases {cases} --seed 16 --faults"), &[folder.0.path()]).0;
    println!("{table}");
    // A campaign that refuses everything tries nothing.
    for row in table.lines().filter(|line| ["urdf", "toml", "csv", "model", "line"].iter().any(|k| line.starts_with(&format!("| {k} ")))) {
        let cells: Vec<u64> = row.split('|').filter_map(|cell| cell.trim().parse().ok()).collect();
        assert!(cells[2] * 20 >= cells[0], "fewer than a twentieth of the cases are accepted: {row}");
    }
}

#[test]
fn killed_runs_leave_whole_files_and_go_on() {
    println!("{}", done("campaign --cases 0 --kills 24 --seed 16", &[]).0);
}
