//! Bad input ends with exit code 2, one line that names the culprit, and no file.

use crate::{Folder, command, refused};

/// Lines and the culprits that their refusals name, after `=>`; OUT is where nothing may be left.
const LINES: &str = include_str!("refusals.txt");

#[test]
fn bad_input_gets_one_line_exit_code_2_and_no_file() {
    let folder = Folder::new();
    let header = "traj,step,q1,q2,qd1,qd2\n";
    for (name, rows) in [
        ("good.csv", "0,0,0.1,0.2,0,0\n0,1,,,,\n"),
        ("letters.csv", "0,0,0.1,x,0,0\n"),
        ("late.csv", "0,1,0.1,0.2,0,0\n"),
        ("starts.csv", "0,0,0,0,0,0\n"),
        ("many.csv", &(0..2000).map(|traj| format!("{traj},0,0,0,0,0\n")).collect::<String>()),
    ] {
        folder.write(name, format!("{header}{rows}"));
    }
    folder.write("empty.csv", "");
    folder.write("mb.toml", "environments = 4\nhorizon = 8\nminibatch = 33\n");
    folder.write("wrong.toml", "robot = \"cartpole\"\nhurry = 1\n");
    let out = folder.path("out");
    let place = |word: &str| match word {
        "OUT" => out.display().to_string(),
        file if ["csv", "toml"].iter().any(|end| file.ends_with(end)) && !file.contains('/') => folder.path(file).display().to_string(),
        word => word.into(),
    };
    for (line, culprit) in LINES.lines().filter_map(|line| line.split_once(" => ")) {
        let line = line.split(' ').map(place).collect::<Vec<_>>().join(" ");
        refused(&line, &[], culprit);
        assert!(!out.exists(), "{line} left something");
    }
}

#[test]
fn asked_for_nothing_it_lists_its_verbs() {
    for (line, verbs) in [("", ["dataset", "rollout", "check"]), ("policy", ["train", "evaluate", "show"])] {
        let run = command(line, &[]).output().expect("xtask starts");
        let help = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{help}");
        assert!(verbs.iter().all(|verb| help.contains(&format!("\n  {verb} "))), "{help}");
    }
}
