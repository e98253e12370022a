//! A policy that moves a cable: it learns in the truth, and in a model of the cable as well.

use crate::*;

const TASK: &str = "lead-tip";

fn config(text: &str) -> PpoConfig {
    let usual = "minibatch = 400\nepochs = 8\nhidden = [64, 32]\nactivation = \"tanh\"\ngamma = 0.97\n";
    PpoConfig::from_text(&format!("{usual}{text}")).expect("good settings")
}

#[test]
fn a_short_run_earns_more_and_comes_nearer() {
    let mut trainer =
        Trainer::new(crate::episodes(TASK, 32, 0), config("environments = 32\nhorizon = 50\n"), 0).expect("a run");
    let mean = |policy: &Policy| {
        let games = play(policy, &mut crate::episodes(TASK, 16, 500), &mut |_| ()).expect("finite physics");
        let of = |f: fn(&Game) -> f64| games.iter().map(f).sum::<f64>() / games.len() as f64;
        [of(|game| game.reward), of(|game| game.error.unwrap_or(f64::INFINITY))]
    };
    let first = mean(&trainer.state.policy);
    for _ in 0..24 {
        trainer.iterate().expect("learns");
    }
    let last = mean(&trainer.state.policy);
    assert!(last[0] > first[0] + 5.0 && last[1] < first[1], "reward and error were {first:.2?}, and are {last:.2?}");
}

/// A barely trained model of the lead.
fn model(folder: &Path) -> std::path::PathBuf {
    let mut config = RunConfig::new("lead-pegs", folder.join("model-run"));
    (config.variant, config.embedding, config.layers) = (Variant::Chain, 16, 2);
    (config.transitions, config.updates, config.batch, config.rollouts) = (300, 10, 8, 2);
    (config.record.frames, config.validation_windows) = (30, 20);
    Run::new(&config).expect("a run").train().expect("trained").expect("a model")
}

#[test]
fn a_policy_is_trained_in_a_model_of_the_lead_and_judged_in_its_truth() {
    let temporary = tempfile::tempdir().expect("a folder");
    let arena = Arena::Solver(SolverSpec::neural(model(temporary.path())));
    let config = config("environments = 4\nhorizon = 100\niterations = 2\n");
    let run = |iterations: u64| {
        let (task, config, out) =
            (TASK.into(), PpoConfig { iterations, ..config.clone() }, temporary.path().join("policy"));
        PolicyRun { task, arena: arena.clone(), config, seed: 0, minutes: None, out }.train().expect("trains")
    };
    run(1);
    let learned = run(2);
    assert_eq!(learned.iterations, 2, "it goes on where it was left");
    let (found, policy) = folder::load(&learned.policy).expect("its folder");
    assert!(found.solver.starts_with("neural"), "{}", found.solver);
    for arena in [arena, Arena::Solver(SolverSpec::default())] {
        let mut episodes = arena.episodes(TASK, 3, 500).expect("episodes");
        let games = play(&policy, &mut episodes, &mut |_| ()).expect("finite physics");
        println!("{}: {games:.2?}", arena.title().expect("a title"));
        assert!(
            games.iter().all(|game| game.error.is_some_and(|error| error > 0.0) && game.length <= 100.0),
            "{games:?}"
        );
    }
}
