//! Policies and model in turn: rounds follow each other, seeds never return, a loop goes on where it was, and the rule ends it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use nerd_lab::cotrain::{CoTrain, CoTrainConfig, End};
use nerd_lab::report::artifact::Head;
use nerd_model::folder::ModelConfig;

const RECIPE: &str = r#"
robot = "cartpole"
base = "draft"
stream = true
history = 2
embedding = 16
layers = 1
batch = 8
updates = 30
transitions = 800
frames = 40
torque-scale = -1
rollouts = 2
"#;

const PPO: &str = "environments = 8\nhorizon = 16\niterations = 2\nminibatch = 64\nepochs = 2\nhidden = [8]\n";

/// A loop of seconds, under a rule that no policy and every policy passes.
fn tiny(folder: &Path, change: impl Fn(&mut CoTrainConfig)) -> CoTrainConfig {
    let mut config = CoTrainConfig::default();
    let file = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).expect("written");
        path
    };
    config.recipe = Some(file("recipe.toml", RECIPE).display().to_string());
    config.config = Some(file("ppo.toml", PPO));
    (config.seeds, config.breadth, config.games, config.rounds, config.mean) = (2, 1, 3, 2, 1e-9);
    change(&mut config);
    config
}

fn task() -> Vec<String> {
    vec!["cartpole-swingup".into()]
}

fn bytes(path: PathBuf) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// What a loop made, by file.
fn made(out: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for k in 0..2 {
        let round = out.join(format!("round-{k}"));
        for file in ["model/model.safetensors", "gaps.json"] {
            all.push((format!("{k}/{file}"), bytes(round.join(file))));
        }
        let mut policies: Vec<_> = std::fs::read_dir(round.join("policies")).expect("policies").flatten().map(|e| e.path()).collect();
        policies.sort();
        for policy in policies {
            all.push((policy.display().to_string(), bytes(policy.join("policy/policy.safetensors"))));
        }
    }
    all
}

#[test]
fn rounds_follow_each_other_and_a_second_call_makes_nothing_anew() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("loop");
    let run = |change: fn(&mut CoTrainConfig)| {
        let config = tiny(folder.path(), change);
        CoTrain::new(task(), config, Some(out.clone())).and_then(|l| l.run()).expect("a loop")
    };
    let done = run(|_| ());
    assert_eq!((done.end, done.rounds.len()), (End::Rounds, 2), "{}", done.said);
    // Seeds never return, short policies' neither.
    let mut seeds = HashSet::new();
    for k in 0..2 {
        let names = std::fs::read_dir(out.join(format!("round-{k}/policies"))).expect("policies").flatten();
        let new = names.filter(|e| seeds.insert(e.file_name())).count();
        assert_eq!(new, 3, "round {k} has {new} policies of seeds never used before");
    }
    let judged: Vec<u64> = done.rounds.iter().flat_map(|r| &r.tasks[0].policies).map(|p| p.seed).collect();
    assert_eq!(judged, [1000, 1001, 1003, 1004], "short ones are not judged");
    // The second model learned from the first one and from what was trained in it.
    let [first, second] = [0, 1].map(|k| ModelConfig::read(&out.join(format!("round-{k}/model"))).expect("a model"));
    assert!(first.model_sha256 == done.rounds[0].model && second.model_sha256 == done.rounds[1].model);
    assert!(first.model_sha256 != second.model_sha256, "the second model is the first");
    assert_eq!(first.provenance["policies"], "in none of the trajectories");
    let said = &second.provenance["policies"];
    for name in ["in 50 % of the trajectories: ", "cartpole-swingup-1000 ", "cartpole-swingup-1001 ", "cartpole-swingup-1002 "] {
        assert!(said.contains(name), "`{said}` does not say `{name}`");
    }
    assert!(said.contains(&done.rounds[0].tasks[0].policies[0].sha256[..8]), "`{said}` has no hash of the first policy");
    let result = Head::read(&out, "rounds").expect("rounds.json");
    assert_eq!((result.tables[0].rows.len(), result.tables[1].rows.len()), (2, 4));
    assert!(["md", "svg", "png"].iter().all(|end| out.join(format!("rounds.{end}")).exists()));

    let (before, lines) = (made(&out), bytes(out.join("round-1/metrics.jsonl")));
    let when = |path: &str| std::fs::metadata(out.join(path)).and_then(|m| m.modified()).expect("a time");
    let files = ["round-0/model/config.json", "round-1/model/config.json", "round-1/gaps.json"];
    let times = files.map(when);
    assert_eq!(run(|_| ()).end, End::Rounds);
    assert!(made(&out) == before && files.map(when) == times, "the second call made something anew");
    // Broken off in the second round, the loop comes to the same.
    for file in ["gaps.json", "policies/cartpole-swingup-1004"] {
        let path = out.join("round-1").join(file);
        if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.expect("removed");
    }
    run(|_| ());
    let after = made(&out);
    let other: Vec<_> = before.iter().zip(&after).filter(|(a, b)| a != b).map(|(a, _)| &a.0).collect();
    // Gaps that were read and written again may differ in a last digit.
    assert!(other.iter().all(|name| name.ends_with("1/gaps.json")), "what was broken off became another: {other:?}");
    assert!(bytes(out.join("round-1/metrics.jsonl")) == lines, "the second model was trained again");

    // A milder rule ends it where it holds, and nothing more is made. Another loop is refused.
    let passed = run(|c| (c.mean, c.most, c.rounds) = (1e9, 1e9, 5));
    assert_eq!((passed.end, passed.rounds.len()), (End::Passed(0), 2), "{}", passed.said);
    assert!(!out.join("round-2").exists());
    let other = CoTrain::new(task(), tiny(folder.path(), |c| c.games = 4), Some(out.clone())).expect("a loop").run();
    let said = other.err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("`games` was 3, is 4") && !said.contains('\n'), "{said}");
}

#[test]
fn the_rule_stops_the_first_round_and_a_model_that_is_there_is_frozen() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let mild = |c: &mut CoTrainConfig| (c.mean, c.most, c.seeds, c.breadth) = (1e9, 1e9, 1, 0);
    let done = CoTrain::new(task(), tiny(folder.path(), mild), Some(one.clone())).and_then(|l| l.run()).expect("a loop");
    assert_eq!((done.end, done.rounds.len()), (End::Passed(0), 1), "{}", done.said);
    assert!(!one.join("round-1").exists(), "a round after the rule held");
    // Of its model, without a recipe: the settings are the model's own.
    let from = |c: &mut CoTrainConfig| {
        mild(c);
        (c.model, c.recipe, c.updates) = (Some(one.join("round-0/model")), None, Some(20));
    };
    let done = CoTrain::new(task(), tiny(folder.path(), from), Some(two.clone())).and_then(|l| l.run()).expect("a loop");
    let weights = |out: &Path| bytes(out.join("round-0/model/model.safetensors"));
    assert!(done.end == End::Passed(0) && weights(&one) == weights(&two), "{}", done.said);
    // Time that is over at once ends it, too.
    let late = |c: &mut CoTrainConfig| {
        from(c);
        (c.minutes, c.seed) = (Some(1e-9), 5000);
    };
    let done = CoTrain::new(task(), tiny(folder.path(), late), Some(folder.path().join("late"))).and_then(|l| l.run()).expect("a loop");
    assert_eq!((done.end, done.rounds.len()), (End::Time, 0), "{}", done.said);
}

#[test]
fn what_is_no_loop_is_refused_in_one_line_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("loop");
    let wrong = |tasks: &[&str], change: fn(&mut CoTrainConfig), words: &str| {
        let tasks = tasks.iter().map(ToString::to_string).collect();
        let said = CoTrain::new(tasks, tiny(folder.path(), change), Some(out.clone())).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains(words) && !said.contains('\n') && !out.exists(), "`{said}` is not one line that names {words}");
    };
    wrong(&["cartpole-swingup", "ant-run"], |_| (), "`ant`");
    wrong(&["juggle"], |_| (), "juggle");
    wrong(&["cartpole-swingup", "cartpole-swingup"], |_| (), "twice");
    wrong(&["ant-run"], |_| (), "trains `cartpole`");
    wrong(&[], |_| (), "task");
    let one = ["cartpole-swingup"];
    wrong(&one, |c| c.rounds = 0, "--rounds 0");
    wrong(&one, |c| c.seeds = 0, "--seeds 0");
    wrong(&one, |c| c.mean = -1.0, "--mean -1");
    wrong(&one, |c| c.recipe = None, "--recipe is needed");
    wrong(&one, |c| c.recipe = Some("unicorn".into()), "unicorn");
    wrong(&one, |c| c.model = Some("/nowhere".into()), "/nowhere");
    wrong(&one, |c| c.config = Some("/nowhere.toml".into()), "/nowhere.toml");
    wrong(&one, |c| c.model = Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/cartpole-paper")), "cartpole-paper");
}
