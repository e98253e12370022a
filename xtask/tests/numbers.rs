//! Numbers of the command line: out of range, below zero, no numbers, or more together than a machine can bear. Each ends at once
//! with exit code 2, one line that names the option, and no file.

mod common;

use common::refused;

/// What no option takes as a count.
const WRONG: [&str; 5] = ["0", "-1", "1e12", "18446744073709551615", "x"];

#[test]
fn counts_out_of_range_are_refused_by_every_verb() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    let place = out.to_str().expect("utf-8");
    let states = folder.path().join("states.csv");
    std::fs::write(&states, "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,1,0,0,0,0\n").expect("written");
    let states = states.to_str().expect("utf-8");
    let verbs: [(&str, &[&str]); 5] = [
        ("dataset --robot pendulum", &["--transitions", "--frames", "--hold"]),
        ("rollout --robot pendulum --states STATES", &["--frames", "--substeps"]),
        ("evaluate --robot pendulum --preset converged", &["--starts", "--frames", "--substeps"]),
        ("chart --robot pendulum", &["--starts", "--frames", "--substeps"]),
        ("reproduce", &["--starts"]),
    ];
    for (verb, options) in verbs {
        for option in options {
            for value in WRONG {
                let args: Vec<&str> = verb.split(' ').map(|w| if w == "STATES" { states } else { w }).collect();
                let all = [&args[..], &[option, value, "--out", place]].concat();
                refused(&all, option);
                refused(&all, &format!("'{value}'"));
                assert!(!out.exists(), "{all:?} left something");
            }
        }
    }
}

#[test]
fn every_other_number_has_a_range_and_the_message_says_it() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    let place = out.to_str().expect("utf-8");
    for (args, words) in [
        ("dataset --robot pendulum --torque-scale nan", ["--torque-scale", "from -10 to 1"]),
        ("dataset --robot pendulum --torque-scale -11", ["--torque-scale", "from -10 to 1"]),
        ("dataset --robot pendulum --resets 1.5", ["--resets", "from 0 to 1"]),
        ("dataset --robot pendulum --seed 18446744073709551615", ["--seed", "from 0 to 9223372036854775807"]),
        ("evaluate --robot pendulum --solver neural --drive nan", ["--drive", "from 0 to 1000"]),
        ("evaluate --robot pendulum --solver neural --drive inf", ["--drive", "from 0 to 1000"]),
        ("evaluate --robot pendulum --shake -0.1", ["--shake", "from 0 to 1000"]),
        ("evaluate --robot pendulum --tolerance 0", ["--tolerance", "above 0"]),
        ("evaluate --robot pendulum --tolerance=-1", ["--tolerance", "above 0"]),
        ("grow --tolerance 0.1,nan", ["--tolerance", "above 0"]),
        ("grow --links 4,4", ["--links", "each number once"]),
        ("inspect . --bound nan", ["--bound", "above 0"]),
        ("inspect . --bound -1", ["--bound", "above 0"]),
        ("reproduce ablations --updates 79", ["--updates", "from 80"]),
    ] {
        let all: Vec<&str> = args.split(' ').chain(["--out", place]).collect();
        words.iter().for_each(|word| refused(&all, word));
        assert!(!out.exists(), "{all:?} left something");
    }
}

/// Each of the numbers is within its range; what they come to together is not borne by any machine.
#[test]
fn products_that_no_machine_bears_are_refused_before_work_begins() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    let place = out.to_str().expect("utf-8");
    let states = folder.path().join("states.csv");
    let rows: String = (0..2000).map(|traj| format!("{traj},0,0,0,0,0\n")).collect();
    std::fs::write(&states, format!("traj,step,q1,q2,qd1,qd2\n{rows}")).expect("written");
    let states = states.to_str().expect("utf-8");
    for (args, words) in [
        ("evaluate --robot pendulum --preset converged --starts 1000000 --frames 1000000", ["--starts 1000000", "--frames 1000000"]),
        ("dataset --robot ant --transitions 1000000000 --frames 1000000", ["--frames 1000000", "TB of memory"]),
        ("chart --robot ant --starts 1000000 --frames 1000000", ["--starts 1000000 x --frames 1000000", "TB of memory"]),
        ("grow --links 256 --starts 100000 --frames 1000000", ["--links 256", "TB of memory"]),
        ("reproduce horizons --model models/cartpole-paper --starts 1000000 --frames 1000000", ["--frames 1000000", "TB of memory"]),
        ("rollout --robot pendulum --states STATES --frames 1000000", ["trajectories 2000 x --frames 1000000", "GB of memory"]),
    ] {
        let all: Vec<&str> = args.split(' ').map(|w| if w == "STATES" { states } else { w }).chain(["--out", place]).collect();
        words.iter().for_each(|word| refused(&all, word));
        assert!(!out.exists(), "{all:?} left something");
    }
}
