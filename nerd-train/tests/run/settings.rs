//! Runs from their settings: files, options that override them, chains of runs, and results.

use nerd_train::ppo::PpoConfig;
use nerd_train::settings::{Settings, listed};

use crate::*;

fn given(pairs: &[(&str, serde_json::Value)]) -> Given {
    pairs.iter().map(|(key, value)| (key.to_string(), value.clone())).collect()
}

fn tiny(out: PathBuf) -> RunConfig {
    let mut run = RunConfig::recipe("quick", "pendulum", out).expect("shipped");
    (run.embedding, run.layers, run.history, run.batch) = (24, 1, 4, 8);
    (run.updates, run.rollouts, run.transitions) = (4, 1, 400);
    (run.record.frames, run.record.torque_scale, run.record.hold, run.record.resets) = (20, -1.0, 3, 0.3);
    run
}

fn weights(model: Option<PathBuf>) -> Vec<u8> {
    std::fs::read(model.expect("a model").join("model.safetensors")).expect("weights")
}

#[test]
fn every_shipped_recipe_can_be_read_and_each_run_starts_from_the_one_before() {
    // Some compute in f32 on a GPU.
    let robot = given(&[
        ("out", "out/x".into()),
        ("transitions", 1000.into()),
        ("finish", true.into()),
        ("device", "cuda".into()),
    ]);
    for name in Recipe::names() {
        let recipe = Recipe::named(name, &robot).unwrap_or_else(|e| panic!("{name}: {e}"));
        for (k, run) in recipe.runs.iter().enumerate() {
            let before = k.checked_sub(1).map(|before| recipe.runs[before].out.join("model"));
            assert_eq!(run.from, before, "{name}, run {}", k + 1);
            // An update through rollouts covers several frames.
            let mode = run.mode().unwrap_or_else(|e| panic!("{name}, run {}: {e}", k + 1));
            let frames = run.updates * mode.frames().unwrap_or(1) as u64;
            // A batch may be larger than the paper's 512.
            let frames = frames.max(frames * run.batch as u64 / 512);
            assert!(run.finish && run.transitions == 1000 && frames >= 6000, "{name}, run {}: {run:?}", k + 1);
            if !run.robot.is_empty() {
                let system = System::named(&run.robot).expect("built in");
                mode.network(&system, run.embedding, run.layers)
                    .unwrap_or_else(|e| panic!("{name}, run {}: {e}", k + 1));
            }
        }
    }
    let paper = Recipe::named("paper", &Given::new()).expect("paper");
    assert_eq!(paper.runs, [RunConfig::default()], "paper.toml says the defaults");
}

#[test]
fn defaults_are_within_their_ranges_and_every_key_says_what_it_means() {
    let all = RunConfig::new("pendulum", "out/x").given();
    assert_eq!(all.len(), RunConfig::keys().len(), "keys and fields");
    for key in RunConfig::keys() {
        let value = &all[&key.name()];
        assert!(
            value.is_null() || key.values.check(value).is_ok(),
            "{}: {value} is none of {:?}",
            key.name(),
            key.values
        );
        assert!(key.help().len() > 10, "{} says too little", key.name());
    }
}

#[test]
fn old_keys_of_a_file_are_read_as_the_new_ones() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let read = |keys: [&str; 4]| {
        let [rate, last, told, fresh] = keys;
        let path = folder.path().join("my.toml");
        let text = format!(
            "robot = \"ant-family\"\n{rate} = 0.5\n{told} = true\n[[run]]\n{last} = 0.25\n[[run]]\n{fresh} = 7\n"
        );
        std::fs::write(&path, text).expect("written");
        Recipe::read(&path, &Given::new())
    };
    let new = ["learning-rate", "final-learning-rate", "condition-on-params", "fresh-transitions"];
    let recipe = read(new).expect("a recipe");
    assert_eq!((recipe.runs[0].learning_rate, recipe.runs[1].fresh_transitions), (0.5, 7));
    assert_eq!(read(["rate", "last-rate", "told", "fresh"]).expect("a recipe"), recipe);
    let said = read(["rate", "last-rate", "hurry", "fresh"]).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("`hurry` is not a setting"), "{said}");
}

/// Settings of a run, and of a policy's training.
#[test]
fn every_number_of_settings_has_bounds() {
    for key in RunConfig::keys() {
        for odd in [serde_json::json!(-1e300), serde_json::json!(1e300)] {
            assert!(key.values.check(&odd).is_err(), "{} may be {odd}", key.name());
        }
    }
    let usual = serde_json::json!(PpoConfig::default());
    let keys =
        usual.as_object().expect("keys").iter().filter(|(_, value)| value.is_number()).map(|(key, _)| key.as_str());
    let keys: Vec<&str> = keys.chain(["init_noise_std"]).collect();
    assert!(keys.len() > 12, "{keys:?}");
    for key in keys {
        for odd in ["1e300", "-1", "9223372036854775807", "nan", "inf"] {
            let said =
                PpoConfig::from_text(&format!("{key} = {odd}")).map_err(|e| e.to_string()).err().unwrap_or_default();
            assert!(said.contains(key) && said.lines().count() == 1, "{key} = {odd}: `{said}`");
        }
    }
}

#[test]
fn a_folder_whose_name_has_commas_is_one_of_a_list() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let [one, two] = ["a,b", "c,d,e"].map(|name| folder.path().join(name).display().to_string());
    std::fs::create_dir(&two).expect("a folder");
    assert_eq!(listed(&one).len(), 2, "there is none yet");
    std::fs::create_dir(&one).expect("a folder");
    assert_eq!(listed(&format!("x,{one},y,{two},")), ["x", &one, "y", &two, ""]);
}

#[test]
fn a_file_is_read_under_what_is_given() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("my.toml");
    std::fs::write(&path, "robot = \"cube\"\nupdates = 70\nhuber = 0.02\ntorque-scale = -1\n").expect("written");
    let run = &Recipe::read(&path, &given(&[("updates", 90.into()), ("hold", 7.into())])).expect("a recipe").runs[0];
    assert_eq!((run.updates, run.record.hold, run.huber, run.record.torque_scale), (90, 7, Some(0.02), -1.0));
    // A model to start from has its own epsilon.
    let onto =
        Recipe::named("quick", &given(&[("robot", "cube".into()), ("from", "models/cube".into())])).expect("a recipe");
    assert_eq!((onto.runs[0].epsilon, onto.runs[0].from.is_some()), (None, true));
    // For several runs, given lengths are upper bounds.
    std::fs::write(&path, "out = \"o\"\nrobot = \"cube\"\n[[run]]\nupdates = 70\nfresh = 50\n[[run]]\nupdates = 20\n")
        .expect("written");
    let chain =
        Recipe::read(&path, &given(&[("updates", 30.into()), ("transitions", 40.into())])).expect("a chain").runs;
    let found: Vec<_> = chain
        .iter()
        .map(|r| (r.updates, r.transitions, r.fresh_transitions, r.out.to_str().unwrap_or_default()))
        .collect();
    assert_eq!(found, [(30, 40, 40, "o/1"), (20, 40, 0, "o/2")]);
}

#[test]
fn what_a_file_should_not_say_is_refused_with_its_name_and_the_key() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("my.toml");
    for (text, key) in [
        ("updatez = 3", "updatez"),
        ("updates = 0", "updates"),
        ("updates = \"x\"", "updates"),
        ("huber = nan", "huber"),
        ("base = \"air\"", "base"),
        ("policy = \"one\"", "policy"),
        ("resets = 1.5", "resets"),
        ("robot = \"\"", "robot"),
        ("[[run]]\nbatch = 0", "run 1: `batch`"),
        ("[[run]]\n[[run]]\nfrom = \"models/cube\"", "run 2: `from`"),
        ("[[run]]\nout = \"a\"", "run 1: `out`"),
        ("run = 3", "[[run]]"),
        ("run = []", "`run`"),
        ("updates = 1 2", "my.toml"),
    ] {
        std::fs::write(&path, text).expect("written");
        let said = Recipe::read(&path, &Given::new()).expect_err(text).to_string();
        assert!(said.contains("my.toml") && said.contains(key), "{text}: {said}");
    }
    for (wrong, words) in [("unicorn", "choose from"), ("ant", "trains `ant`")] {
        let said = Recipe::named(wrong, &given(&[("robot", "cube".into())])).expect_err(wrong).to_string();
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn a_setting_that_its_mode_does_not_use_is_refused_by_its_key() {
    let mode = |text: &str| RunConfig::default().with(&toml::from_str(text).expect("TOML")).expect("settings").mode();
    let rolled = "history = 1\nsequence = 4\nfrom = 'x'\n";
    for (head, keys) in [
        ("variant = 'chain'", "stream base view condition-on-params fresh-transitions epsilon huber device"),
        (rolled, "condition-on-params fresh-transitions huber epsilon head-width device"),
        ("data = 'x'", "fresh-transitions policy held-out"),
        ("from = 'x'", "epsilon"),
        ("history = 1", "head-width"),
        ("", "sequence f32 held-out"),
    ] {
        mode(head).expect(head);
        for key in keys.split(' ') {
            let value = match key {
                "stream" | "condition-on-params" | "f32" => "true",
                "base" => "'trapezoid'",
                "view" => "'moving'",
                "device" => "'wgpu'",
                "policy" => "['x']",
                "held-out" => "[1]",
                "epsilon" | "huber" => "0.1",
                _ => "8",
            };
            let said = mode(&format!("{key} = {value}\n{head}")).expect_err(key).to_string();
            assert!(said.starts_with(&format!("--{key} ")) && said.lines().count() == 1, "{head}, {key}: {said}");
        }
    }
    for (text, words) in
        [("history = 1\nsequence = 4", "give it with --from"), ("device = 'cuda-f32'", "--device cuda-f32")]
    {
        let said = mode(text).expect_err(text).to_string();
        assert!(said.contains(words), "{text}: {said}");
    }
}

#[test]
fn a_data_set_holds_what_a_run_would_have_recorded() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let alone = tiny(folder.path().join("alone"));
    let mut read = tiny(folder.path().join("read"));
    let data = folder.path().join("data");
    let system = System::named("pendulum").expect("built in");
    alone.record.write(&system, alone.transitions, &data).expect("shards");
    read.data = Some(data);
    let train = |run: &RunConfig| weights(Run::new(run).expect("settings").train().expect("trained"));
    assert!(train(&alone) == train(&read), "data from a folder led to other weights");
}

#[test]
fn a_chain_goes_on_where_it_was_left() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut first = tiny(folder.path().join("1"));
    first.updates = 2;
    let mut second = first.clone();
    (second.from, second.out, second.epsilon) = (Some(folder.path().join("1/model")), folder.path().join("2"), None);
    let recipe = Recipe { runs: vec![first, second] };
    let whole = weights(recipe.train().expect("trained"));
    std::fs::remove_dir_all(folder.path().join("2")).expect("removed");
    let time = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).expect("a time");
    let card = folder.path().join("1/model/config.json");
    let before = time(&card);
    assert!(weights(recipe.train().expect("trained")) == whole, "the second run made again is another one");
    assert!(time(&card) == before, "the first run was made again");
}

/// Initial tokens, fresh tokens and the rollouts that choose weights all use the run's base, which the model records.
/// Without a named truth a run learns from its robot's.
#[test]
fn a_model_is_on_its_runs_base_and_of_its_robots_truth() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for (robot, truth) in [("cartpole", Truth::Articulated), ("pendulum-paper", Truth::Paper)] {
        let train = |name: &str, fresh: usize, stream: bool| {
            let mut run = tiny(folder.path().join(format!("{robot}-{name}")));
            (run.robot, run.base, run.fresh_transitions, run.stream) = (robot.into(), Base::Trapezoid, fresh, stream);
            run.sequence = stream.then_some(16);
            let model = Run::new(&run).expect("settings").train().expect("trained").expect("a model");
            let system = System::named(robot).expect("built in");
            let model = Model::load(&model, &system, Some(&truth.name())).expect("of its robot and truth");
            assert_eq!(model.config.base, Base::Trapezoid, "{robot}");
            assert!(model.weights.flat.iter().all(|w| w.is_finite()), "{robot}, {name}: weights");
            model.config.model_sha256
        };
        let once = train("once", 0, false);
        assert_eq!(once, train("again", 0, false), "{robot}: the same run made another model");
        assert_ne!(once, train("streamed", 0, true), "{robot}: streaming changes nothing");
        train("fresh", 32, false);
    }
}
