//! Options that mean nothing together, and the truth against itself: refused by name, also where a value is the default's.

mod common;

use common::{refused, xtask};

#[test]
fn options_that_nothing_reads_are_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    let place = out.to_str().expect("utf-8");
    let states = folder.path().join("states.csv");
    std::fs::write(&states, "traj,step,q1,q2,qd1,qd2\n0,0,0,0,0,0\n0,1,0,0,0,0\n").expect("written");
    let states = states.to_str().expect("utf-8");
    let both: [(&str, [&str; 2]); 13] = [
        ("--model models/pendulum", ["--model", "--solver neural"]),
        ("--model /nowhere", ["--model", "--solver neural"]),
        ("--solver rapier --model models/pendulum", ["--model", "--solver neural"]),
        ("--device cpu", ["--device", "--solver neural"]),
        ("--device cuda", ["--device", "--solver neural"]),
        ("--solver neural --substeps 4", ["--substeps", "--solver neural"]),
        ("--solver rapier --preset paper", ["--preset", "--solver rapier"]),
        ("--solver rapier --friction coulomb", ["--friction", "--solver rapier"]),
        ("--tolerance 0.1 --solver articulated", ["--solver", "--tolerance"]),
        ("--tolerance 0.1 --model models/pendulum", ["--model", "--tolerance"]),
        ("--tolerance 0.1 --substeps 4", ["--substeps", "--tolerance"]),
        ("--solver neural --preset accurate", ["--truth", "--preset"]),
        ("--solver neural --truth rapier --friction coulomb", ["--truth", "--friction"]),
    ];
    let rollout = ["rollout", "--robot", "pendulum", "--states", states];
    let evaluate = ["evaluate", "--robot", "pendulum", "--starts", "2", "--frames", "2"];
    let mut cases: Vec<(Vec<&str>, [&str; 2])> = Vec::new();
    for (options, words) in both {
        cases.extend([&rollout[..], &evaluate].map(|verb| (verb.iter().copied().chain(options.split(' ')).collect(), words)));
    }
    for (verb, options, words) in [
        (&rollout[..], "--truth articulated", ["--truth", "--solver neural"]),
        (&rollout, "--solver rapier --truth rapier", ["--truth", "--solver neural"]),
        (&evaluate, "--drive 1 --limp", ["--drive", "--limp"]),
        (&evaluate, "--solver rapier --control", ["--control", "articulated"]),
        (&evaluate, "--shake 0.1 --control", ["--control", "articulated"]),
        (&["stability"], "--fault no-floor", ["--out", "--fault"]),
        (&["stability"], "--rows bowling", ["bowling", "ANYmal"]),
        (&["stability", "--model", "models/pendulum"], "--rows bowling", ["bowling", "torques x 2"]),
    ] {
        cases.push((verb.iter().copied().chain(options.split(' ')).collect(), words));
    }
    for (args, words) in cases {
        let all = [&args[..], &["--out", place]].concat();
        words.iter().for_each(|word| refused(&all, word));
        assert!(!out.exists(), "{all:?} left something");
    }
    refused(&["stability", "--fault", "no-floor", "--model", "models/pendulum"], "--model");
}

#[test]
fn the_truth_is_held_against_itself_only_as_a_control() {
    let measure = ["evaluate", "--robot", "pendulum", "--scene", "ground1", "--starts", "2", "--frames", "3"];
    // The robot's own substeps, given by hand, are the same settings.
    let substeps = nerd_sim::prelude::System::named("pendulum").expect("built in").spec.substeps.to_string();
    for more in [&[][..], &["--solver", "articulated"], &["--preset", "accurate", "--friction", "coulomb"], &["--substeps", &substeps]] {
        refused(&[&measure[..], more].concat(), "--control");
    }
    let done = |more: &[&str]| {
        let run = xtask(&[&measure[..], more].concat());
        assert!(run.status.success(), "{more:?}: {}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8(run.stdout).expect("utf-8")
    };
    let control = done(&["--control"]);
    assert!(control.starts_with("control:") && control.contains("| 0 / 0 ") && !control.contains("0.0120 / 0.0150"), "{control}");
    // The reference's robot has its preset for a truth.
    let paper = ["evaluate", "--robot", "pendulum-paper", "--scene", "ground1", "--starts", "2", "--frames", "3"];
    for more in [&[][..], &["--preset", "paper"], &["--truth", "paper"]] {
        refused(&[&paper[..], more].concat(), "articulated paper coulomb");
    }
    // Another friction law, preset, noise, another truth: something to measure.
    for more in [
        &["--friction", "huber"][..],
        &["--preset", "paper"],
        &["--truth", "paper"],
        &["--shake", "0.1"],
        &["--truth", "rapier"],
        &["--solver", "rapier"],
    ] {
        assert!(!done(more).starts_with("control:"), "{more:?}");
    }
}

#[test]
fn asked_for_nothing_it_lists_its_verbs() {
    for (args, verbs) in [(&[][..], ["dataset", "rollout", "check"]), (&["policy"], ["train", "evaluate", "show"])] {
        let run = xtask(args);
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{said}");
        assert!(verbs.iter().all(|verb| said.contains(&format!("\n  {verb} "))), "{said}");
    }
}
