//! A policy that moves a cable: it learns, it learns in a model of the cable as well, its success is counted, and it acts in data.

use std::path::Path;
use std::sync::Arc;

use nerd_sim::dataset::{GenerateConfig, record};
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use nerd_train::device::Device;
use nerd_train::ppo::{Arena, Game, Policies, Policy, PolicyRun, PpoConfig, Trainer, folder, play};
use nerd_train::run::{Run, RunConfig, Variant};

use crate::episodes;

const TASK: &str = "lead-tip";

fn config(text: &str) -> PpoConfig {
    let usual = "minibatch = 400\nepochs = 8\nhidden = [64, 32]\nactivation = \"tanh\"\ngamma = 0.97\n";
    PpoConfig::from_text(&format!("{usual}{text}")).expect("good settings")
}

/// Games of a policy on `articulated` at few substeps.
fn games(policy: &Policy, n: usize) -> Vec<Game> {
    let mut episodes = episodes(TASK, n, 500);
    play(policy, &mut episodes, &mut |_| ()).expect("finite physics")
}

#[test]
fn a_short_run_earns_more_and_comes_nearer() {
    let config = config("environments = 32\nhorizon = 50\niterations = 24\n");
    let episodes = episodes(TASK, config.environments, 0);
    let mut trainer = Trainer::new(episodes, config.clone(), 0).expect("a run");
    let mean = |policy: &Policy| {
        let games = games(policy, 16);
        let of = |f: fn(&Game) -> f64| games.iter().map(f).sum::<f64>() / games.len() as f64;
        [of(|game| game.reward), of(|game| game.miss.unwrap_or(f64::INFINITY))]
    };
    let first = mean(&trainer.state.policy);
    for _ in 0..config.iterations {
        trainer.iterate().expect("learns");
    }
    let last = mean(&trainer.state.policy);
    println!(
        "reward {:.1} of 100, {:.2} of what may be missed; after {} steps {:.1} and {:.2}",
        first[0],
        first[1],
        24 * 1600,
        last[0],
        last[1]
    );
    assert!(last[0] > first[0] + 5.0 && last[1] < first[1], "reward and miss were {first:.2?}, and are {last:.2?}");
}

/// A model of the lead that was hardly trained.
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
    let arena = Arena::Model { folder: model(temporary.path()), device: Device::Cpu };
    let config = config("environments = 4\nhorizon = 100\niterations = 2\n");
    let run = |iterations: u64| {
        let (task, config, out) = (TASK.into(), PpoConfig { iterations, ..config.clone() }, temporary.path().join("policy"));
        PolicyRun { task, arena: arena.clone(), config, seed: 0, until: None, minutes: None, out }.train().expect("trains")
    };
    run(1);
    let learned = run(2);
    assert_eq!(learned.iterations, 2, "it goes on where it was left");
    let (found, policy) = folder::load(&learned.policy).expect("its folder");
    assert!(found.solver.starts_with("neural"), "{}", found.solver);
    for arena in [arena, Arena::Truth(Truth::Articulated)] {
        let mut episodes = arena.episodes(TASK, 3, 500).expect("episodes");
        let games = play(&policy, &mut episodes, &mut |_| ()).expect("finite physics");
        println!("{}: {games:.2?}", arena.title().expect("a title"));
        assert!(games.iter().all(|game| game.miss.is_some_and(|miss| miss > 0.0) && game.length <= 100.0), "{games:?}");
    }
}

#[test]
fn only_a_task_that_speaks_of_success_counts_misses() {
    for (task, spoken) in [(TASK, true), ("cartpole-swingup", false)] {
        let mut episodes = episodes(task, 2, 0);
        let actions = vec![0.0; 2 * episodes.task.action_dim()];
        let misses = episodes.step(&actions).expect("finite physics").misses;
        assert!(misses.len() == 2 && misses.iter().all(|miss| miss.is_some() == spoken), "{task}: {misses:?}");
    }
}

#[test]
fn policies_of_the_lead_act_in_its_data() {
    let mut trainer = {
        let config = config("environments = 2\nhorizon = 4\niterations = 1\n");
        let episodes = episodes(TASK, 2, 0);
        Trainer::new(episodes, config, 0).expect("a run")
    };
    trainer.iterate().expect("learns");
    let system = System::named("lead-pegs").expect("built in");
    let pilot = Some((Arc::new(Policies::new(vec![(TASK.into(), trainer.state.policy.clone())]).expect("known")) as _, 1.0));
    let config = GenerateConfig { frames: 30, pilot, ..GenerateConfig::default() };
    let mut solver = Articulated::new(ArticulatedConfig::implicit(2, Friction::Coulomb));
    let data = record(&system, &mut solver, &config, 0, 6).expect("data");
    let (d, nq) = (system.robot.state_dim(), system.robot.nq());
    let fastest = data.states.chunks_exact(d).flat_map(|state| state[nq..nq + 3].to_vec()).fold(0.0f64, |most, v| most.max(v.abs()));
    println!("a policy's gripper goes at {fastest:.2} m/s at most");
    assert!(fastest > 0.02 && fastest < 0.5, "{fastest} m/s: an action of 1 is 0.4 m/s");
}
