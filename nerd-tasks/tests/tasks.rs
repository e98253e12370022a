//! Every task of the registry loads, resets and steps on every analytic solver; episodes begin, end and go on as they should.

use nerd_sim::prelude::*;
use nerd_sim::sampling::stream;
use nerd_sim::system::Source;
use nerd_tasks::{Episodes, Fast, View, Work, fast_start, named, names};

fn solver(which: &str, system: &System) -> Box<dyn Solver> {
    match which {
        "rapier" => Box::new(Rapier::new(RapierConfig::default())),
        // A cable's springs want an implicit method.
        _ if system.source == Source::Cable => Box::new(Articulated::new(ArticulatedConfig::implicit(2, Friction::Coulomb))),
        _ => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
    }
}

fn episodes(name: &str, which: &str, n: usize) -> Episodes {
    let task = named(name).expect("registered");
    let system = System::named(task.robot()).expect("built in");
    let scene = system.scene(task.scene()).expect("a scene of the robot");
    let solver = solver(which, &system);
    Episodes::new(task, Simulation::new(Batch::new(&system, &scene, n), solver), 7)
}

/// Actions that are neither zero nor the same for two environments or frames.
fn actions(episodes: &Episodes, step: usize) -> Vec<f64> {
    let n = episodes.len() * episodes.task.action_dim();
    (0..n).map(|i| 0.7 * ((i * 37 + step * 11) as f64).sin()).collect()
}

#[test]
fn every_task_resets_and_steps_on_every_solver() {
    for which in ["articulated", "rapier"] {
        for name in names() {
            let mut episodes = episodes(name, which, 4);
            assert_eq!(episodes.observations().len(), 4 * episodes.task.observation_dim(), "{name}");
            let (mut total, mut ended) = (0.0, 0);
            for step in 0..60 {
                let result = episodes.step(&actions(&episodes, step)).expect("finite physics");
                assert!(result.rewards.iter().all(|r| r.is_finite()), "{which}, {name}: reward at step {step}");
                let seen = result.reached.iter().chain(episodes.observations());
                assert!(seen.into_iter().all(|o| o.is_finite()), "{which}, {name}: observation at step {step}");
                assert_eq!(result.failed, 0, "{which}, {name}: failed at step {step}");
                total += result.rewards.iter().sum::<f64>();
                ended += result.terminated.iter().chain(&result.truncated).filter(|e| **e).count();
            }
            println!("{which:12} {name:20} mean reward of a step {:8.4}, {ended} episodes ended", total / 240.0);
        }
    }
}

#[test]
fn no_episode_outlives_its_length_and_an_ended_one_begins_anew() {
    let (mut episodes, mut steps, mut truncated) = (episodes("franka-reach", "articulated", 3), 0, 0);
    let first: Vec<f64> = episodes.observations().to_vec();
    for step in 0..300 {
        let result = episodes.step(&[0.1; 21]).expect("finite physics");
        steps += 1;
        assert!(episodes.simulation.batch.frames.iter().all(|f| *f < 256), "two frames a step");
        for env in 0..3 {
            assert!(!result.terminated[env], "reaching is never over");
            assert_eq!(result.truncated[env], steps == 128, "environment {env} at step {step}");
            let (now, reached) = (&episodes.observations()[env * 13..][..13], &result.reached[env * 13..][..13]);
            assert_eq!(now == reached, steps < 128, "an ended episode is seen at its end, a fresh one at its start");
            assert!(steps < 128 || now != &first[env * 13..][..13], "another start and another target");
            truncated += usize::from(result.truncated[env]);
        }
        steps %= 128;
    }
    assert_eq!(truncated, 6, "three environments, 300 steps, episodes of 128");
}

#[test]
fn the_first_action_follows_the_fresh_observation() {
    // The reference system observes before it resets, so that an episode's first action answers the last one's end.
    let mut episodes = episodes("cartpole-swingup", "articulated", 1);
    for _ in 0..2000 {
        let result = episodes.step(&[1.0]).expect("finite physics");
        let state = episodes.simulation.batch.state(0);
        assert_eq!(episodes.observations(), [state[0], state[1], state[2], state[3]]);
        if result.terminated[0] || result.truncated[0] {
            return;
        }
    }
    panic!("full force for 2000 frames ends no episode");
}

#[test]
fn a_snapshot_goes_on_as_if_nothing_had_happened() {
    for name in ["ant-run", "franka-reach"] {
        let mut whole = episodes(name, "articulated", 5);
        for step in 0..140 {
            whole.step(&actions(&whole, step)).expect("finite physics");
        }
        let mut again = episodes(name, "articulated", 5);
        again.restore(&whole.snapshot()).expect("of the same sizes");
        assert_eq!(again.observations(), whole.observations(), "{name}");
        for step in 140..280 {
            let action = actions(&whole, step);
            assert_eq!(whole.step(&action).expect("finite"), again.step(&action).expect("finite"), "{name} at step {step}");
        }
        let mut other = episodes(name, "articulated", 4);
        assert!(other.restore(&whole.snapshot()).is_err(), "{name}: a snapshot of five environments for four");
    }
}

/// Ends the world of one environment at its 20th frame.
struct Breaks(Box<dyn Solver>);

impl Solver for Breaks {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        if batch.frames[1] == 20 {
            batch.state_mut(1)[0] = f64::NAN;
        }
        self.0.step(batch, torques)
    }
}

#[test]
fn an_environment_that_cannot_be_stepped_ends_its_episode_alone() {
    let [mut broken, mut whole] = [(); 2].map(|_| episodes("ant-run", "articulated", 3));
    let inner = solver("articulated", &broken.simulation.batch.system);
    broken.simulation.solver = Box::new(Breaks(inner));
    for step in 0..60 {
        let action = actions(&whole, step);
        let (result, undisturbed) = (broken.step(&action).expect("goes on"), whole.step(&action).expect("finite"));
        let expected = step % 21 == 20;
        assert_eq!((result.failed, result.terminated[1]), (usize::from(expected), expected), "step {step}");
        if expected {
            assert_eq!((result.rewards[1], broken.simulation.batch.frames[1]), (0.0, 0), "step {step}");
        }
        for env in [0, 2] {
            let (found, wanted) = (broken.view(env).state, whole.view(env).state);
            assert_eq!(found, wanted, "step {step}: environment {env} noticed its neighbour");
            assert_eq!(result.rewards[env], undisturbed.rewards[env], "step {step}");
        }
    }
    assert!(broken.step(&[0.0]).is_err(), "one action for three Ants");
}

#[test]
fn an_unknown_task_is_refused_by_name() {
    let message = named("juggle").err().map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("juggle") && message.contains("cartpole-swingup"), "{message}");
}

#[test]
fn fast_starts_are_faster_than_resets_and_end_no_episode() {
    for name in names() {
        let task = named(name).expect("registered");
        let system = System::named(task.robot()).expect("built in");
        let (scene, goal) = (system.scene(task.scene()).expect("known"), vec![0.0; task.goal_dim()]);
        let (nq, mut work) = (system.robot.nq(), Work::new(&system));
        let speed = |state: &[f64]| state[nq..].iter().map(|v| v * v).sum::<f64>().sqrt();
        let (mut slow, mut fast, mut over, mut placed) = (0.0_f64, 0.0_f64, 0, true);
        for k in 0..200 {
            let rng = || stream(3, k);
            let (usual, hurried) = (task.reset(&system, &mut rng()), fast_start(&*task, &system, &mut rng()));
            placed &= usual[..nq] == hurried[..nq];
            (slow, fast) = (slow.max(speed(&usual)), fast.max(speed(&hurried)));
            let over_at = |state: &[f64], work: &mut Work| task.terminated(View { state, goal: &goal, scene: &scene }, work);
            over += usize::from(over_at(&hurried, &mut work) && !over_at(&usual, &mut work));
        }
        println!("{name}: fastest start {slow:.2} by reset, {fast:.2} hurried");
        assert!(placed, "{name}: a hurried start stands elsewhere");
        // A cable is at rest wherever data and resets begin.
        let still = slow == 0.0 && fast == 0.0;
        assert!(still == (system.source == Source::Cable), "{name}: starts of {slow:.2} by reset, {fast:.2} hurried");
        assert!(still || fast > 2.0 * slow && fast.is_finite(), "{name}: hurried starts have {fast:.2} at most, resets {slow:.2}");
        assert_eq!(over, 0, "{name}: {over} of 200 hurried starts are over at once");
        // Its episodes begin so, and are the task's own otherwise.
        let solver = solver("articulated", &system);
        let wrapped = Box::new(Fast::new(task, &system));
        let mut episodes = Episodes::new(wrapped, Simulation::new(Batch::new(&system, &scene, 8), solver), 7);
        assert_eq!(episodes.task.name(), name);
        let fastest = (0..8).map(|env| speed(episodes.view(env).state)).fold(0.0, f64::max);
        assert!(still || fastest > slow, "{name}: episodes begin at {fastest:.2} at most, resets at {slow:.2}");
        for step in 0..10 {
            let result = episodes.step(&actions(&episodes, step)).expect("finite physics");
            assert!(result.rewards.iter().all(|r| r.is_finite()), "{name}: reward at step {step}");
        }
    }
}
