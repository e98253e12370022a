//! Policies and model in turn: rounds follow each other, seeds never return, a loop goes on where it was, and the rule ends it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use nerd_lab::cotrain::{CoTrainConfig, End, co_train};
use nerd_model::folder::ModelConfig;
use nerd_train::{run::Recipe, settings::Given};

const RECIPE: &str = r#"
robot = "cartpole"
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

/// A loop of seconds from a model of seconds, under a rule that no policy passes.
fn tiny(folder: &Path) -> CoTrainConfig {
    let file = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).expect("written");
        path
    };
    let recipe = file("recipe.toml", RECIPE);
    let out: Given = [("out".to_string(), folder.join("first").display().to_string().into())].into_iter().collect();
    let model = Recipe::read(&recipe, &out).and_then(|recipe| recipe.train()).expect("trained");
    let mut config = CoTrainConfig::default();
    (config.model, config.recipe, config.config) = (model, Some(recipe.display().to_string()), Some(file("ppo.toml", PPO)));
    (config.seeds, config.games, config.rounds, config.mean) = (2, 3, 2, 1e-9);
    config
}

fn task() -> Vec<String> {
    vec!["cartpole-swingup".into()]
}

fn bytes(path: PathBuf) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

#[test]
fn rounds_follow_each_other_and_a_second_call_makes_nothing_anew() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (out, config) = (folder.path().join("loop"), tiny(folder.path()));
    let run = |change: fn(&mut CoTrainConfig)| {
        let mut config = config.clone();
        change(&mut config);
        co_train(task(), config, Some(out.clone()))
    };
    let done = run(|_| ()).expect("a loop");
    assert_eq!((done.end, done.rounds.len(), done.table.rows.len()), (End::Rounds, 2, 2), "{}", done.said);
    let seeds: HashSet<u64> = done.rounds.iter().flat_map(|round| &round.gaps).map(|gap| gap.seed).collect();
    assert_eq!(seeds, HashSet::from([1000, 1001, 1002, 1003]), "a seed has returned");
    // The second model learned from the first one and from what was trained in it.
    let first = ModelConfig::read(config.model.as_deref().expect("made")).expect("a model");
    let second = ModelConfig::read(&out.join("round-1/model")).expect("a model");
    assert!(first.model_sha256 == done.rounds[0].model && second.model_sha256 == done.rounds[1].model);
    assert!(first.model_sha256 != second.model_sha256, "the second model is the first");
    let policies = &second.provenance["policies"];
    for name in ["in 50 % of the trajectories: ", "cartpole-swingup-1000 ", "cartpole-swingup-1001 ", &done.rounds[0].gaps[0].sha256[..8]] {
        assert!(policies.contains(name), "`{policies}` does not say `{name}`");
    }

    // Broken off in the second round, the loop comes to the same.
    let files = ["model/model.safetensors", "metrics.jsonl", "policies/cartpole-swingup-1003/policy/policy.safetensors"];
    let made = || files.map(|file| bytes(out.join("round-1").join(file)));
    let before = made();
    std::fs::remove_file(out.join("round-1/gaps.json")).expect("removed");
    std::fs::remove_dir_all(out.join("round-1/policies/cartpole-swingup-1003")).expect("removed");
    assert_eq!(run(|_| ()).expect("a loop").rounds.len(), 2);
    assert!(made() == before, "what was broken off became another");

    // A milder rule ends it where it holds. Another loop is refused; time that is over at once ends one, too.
    let passed = run(|c| (c.mean, c.most, c.rounds) = (1e9, 1e9, 5)).expect("a loop");
    assert_eq!((passed.end, passed.rounds.len()), (End::Passed(0), 1), "{}", passed.said);
    let refused = run(|c| c.games = 4).err().map_or_else(String::new, |e| e.to_string());
    assert!(refused.contains("`games` was 3, is 4") && !refused.contains('\n'), "{refused}");
    let mut late = config.clone();
    late.minutes = Some(1e-9);
    assert_eq!(co_train(task(), late, Some(folder.path().join("late"))).expect("a loop").end, End::Time);
}
