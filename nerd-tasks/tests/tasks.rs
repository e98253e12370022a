//! Every task of the registry loads, resets and steps; rewards equal states worked out by hand.

use nerd_sim::prelude::*;
use nerd_tasks::{CartpoleSwingup, Episodes, Task, named, names};

fn episodes(name: &str, n: usize) -> Episodes {
    let task = named(name).expect("registered");
    let system = System::named(task.robot()).expect("built in");
    let scene = system.scene("free").expect("every robot has it");
    let solver = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    Episodes::new(task, Simulation::new(Batch::new(&system, &scene, n), solver), 7)
}

#[test]
fn every_task_steps_and_its_observations_stay_finite() {
    for name in names() {
        let mut episodes = episodes(name, 8);
        let actions = vec![0.5; 8 * episodes.task.action_dim()];
        for frame in 0..400 {
            let result = episodes.step(&actions).expect("finite physics");
            assert!(result.rewards.iter().all(|r| r.is_finite()), "{name}: reward at frame {frame}");
            assert!(episodes.observations().iter().all(|o| o.is_finite()), "{name}: observation at frame {frame}");
        }
    }
}

#[test]
fn an_ended_episode_starts_anew_and_no_episode_outlives_its_length() {
    let mut episodes = episodes("cartpole-swingup", 4);
    let mut ended = 0;
    for _ in 0..700 {
        let result = episodes.step(&[0.0; 4]).expect("finite physics");
        ended += result.terminated.iter().chain(&result.truncated).filter(|e| **e).count();
        assert!(episodes.simulation.batch.frames.iter().all(|f| *f < 300));
    }
    assert!(ended >= 8, "{ended} episodes of at most 300 frames ended in 4 x 700 frames");
}

#[test]
fn the_cartpole_reward_is_the_papers() {
    let upright = [0.0, 0.0, 0.0, 0.0];
    assert_eq!(CartpoleSwingup.reward(&upright, &[0.0, 0.0]), 5.0);
    // 5 - 1 - 0.05 * 4 - 0.1 * 9 - 0.1 * 16 = 1.3
    let reward = CartpoleSwingup.reward(&[2.0, 1.0, 4.0, 3.0], &[0.0, 0.0]);
    assert!((reward - 1.3).abs() < 1e-12, "reward {reward}, by hand 1.3");
    // A whole turn more is the same pose.
    let turned = CartpoleSwingup.reward(&[2.0, 1.0 + std::f64::consts::TAU, 4.0, 3.0], &[0.0, 0.0]);
    assert!((turned - 1.3).abs() < 1e-12, "reward {turned}, by hand 1.3");
    assert!(CartpoleSwingup.terminated(&[4.01, 0.0, 0.0, 0.0]) && !CartpoleSwingup.terminated(&[3.99, 0.0, 9.9, -9.9]));
}

#[test]
fn an_unknown_task_is_refused_by_name() {
    let message = named("juggle").err().map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("juggle") && message.contains("cartpole-swingup"), "{message}");
}
