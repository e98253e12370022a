//! A cable from its TOML, through the verbs: what means nothing of it is refused in one line.

mod common;

use common::{refused, replays, shows_a_cable, xtask};

const LEAD: &str = "nerd-sim/assets/cables/lead.toml";

#[test]
fn what_means_nothing_of_a_cable_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("data");
    let out = out.to_str().expect("utf-8");
    let dataset = |option: [&str; 2], culprit: &str| {
        refused(&["dataset", "--robot", LEAD, "--transitions", "8", "--out", out, option[0], option[1]], culprit);
    };
    dataset(["--frames", "0"], "--frames");
    dataset(["--hold", "4"], "smooth");
    dataset(["--truth", "paper"], "spring");
    for option in ["--truth", "--preset"] {
        refused(&["evaluate", "--robot", LEAD, "--scene", "plane", "--starts", "1", "--frames", "2", option, "paper"], "spring");
    }
    assert!(!folder.path().join("data/manifest.json").exists(), "nothing is written");
}

#[test]
fn what_inspect_prints_of_a_cable_stands_beside_its_section() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("printed.toml");
    let printed = xtask(&["inspect", "--robot", LEAD]);
    assert!(printed.status.success(), "{}", String::from_utf8_lossy(&printed.stderr));
    let printed = String::from_utf8(printed.stdout).expect("utf-8");
    let lead = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../nerd-sim/assets/cables/lead.toml")).expect("the lead");
    let section = &lead[lead.find("[cable]").expect("its section")..];
    let section = section.split("\n\n").next().expect("itself");
    std::fs::write(&path, format!("{printed}\n{section}\n")).expect("the file");
    let again = xtask(&["inspect", "--robot", path.to_str().expect("utf-8")]);
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    let keys = |text: &str| text.lines().filter(|line| !line.starts_with('#')).map(str::to_string).collect::<Vec<_>>();
    assert_eq!(keys(&String::from_utf8_lossy(&again.stdout)), keys(&printed));
}

#[test]
fn data_of_a_frame_each_are_recorded_and_ask_for_the_cables_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, own) = (folder.path().join("data"), folder.path().join("own.toml"));
    let [out, own] = [&out, &own].map(|path| path.to_str().expect("utf-8"));
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/../nerd-sim/assets/cables/lead.toml"), own).expect("a cable that is not built in");
    for (robot, known) in [(own, false), (LEAD, true)] {
        let made = xtask(&["dataset", "--robot", robot, "--transitions", "4", "--frames", "1", "--out", out]);
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        match known {
            true => assert!(xtask(&["inspect", out]).status.success(), "what is built in needs no file"),
            false => refused(&["inspect", out], "PATH/own.toml"),
        }
        std::fs::remove_dir_all(out).expect("the data");
    }
}

#[test]
fn a_model_of_another_form_is_refused_in_words() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let run = ["train", "--robot", "pendulum", "--recipe", "quick", "--from", "models/pendulum", "--transitions", "2000", "--out"];
    let args: Vec<&str> = run.into_iter().chain([out.to_str().expect("utf-8")]).collect();
    refused(&args, "base is draft 4, here state");
    assert!(!String::from_utf8_lossy(&xtask(&args).stderr).contains("Config {"), "as Rust prints it");
}
