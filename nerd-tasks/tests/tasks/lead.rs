//! The lead that follows a target: its start is at rest, the target moves as specified, actions are velocities.

use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, LeadTip, Plain, Task};

use crate::{episodes, rewards::Bench};

fn tip(episodes: &Episodes, env: usize) -> [f64; 3] {
    let seen = &episodes.observations()[env * LeadTip.observation_dim()..];
    std::array::from_fn(|k| seen[k] + episodes.view(env).goal[k])
}

#[test]
fn an_episode_begins_at_rest_with_the_tip_on_the_floor() {
    let mut episodes = episodes("lead-tip", "articulated", 8);
    episodes.simulation.solver = Box::new(Articulated::new(ArticulatedConfig::implicit(8, Friction::Coulomb)));
    let start: Vec<[f64; 3]> = (0..8).map(|env| tip(&episodes, env)).collect();
    let (mut moved, mut lifted) = (0.0f64, 0.0f64);
    for (env, start) in start.iter().enumerate() {
        assert!((start[2] - 0.004).abs() < 1e-6, "environment {env}: the tip begins {:.4} m high", start[2]);
        assert!((start[0] - 0.75).hypot(start[1]) < 0.05, "environment {env}: it begins at {start:?}");
    }
    for _ in 0..10 {
        episodes.step(&[0.0; 24]).expect("finite physics");
        for (env, start) in start.iter().enumerate() {
            let now = tip(&episodes, env);
            moved = moved.max((now[0] - start[0]).hypot(now[1] - start[1]));
            lifted = lifted.max((now[2] - start[2]).abs());
        }
    }
    assert!(moved < 0.01 && lifted < 1e-3, "a start is not at rest: {moved:.4} m along, {lifted:.4} m up");
}

#[test]
fn the_target_sets_off_from_rest_and_never_turns_back() {
    let frames = LeadTip.episode_length() * LeadTip.frames();
    let (mut fastest, mut least, mut first) = (0.0f64, f64::INFINITY, 0.0f64);
    for k in 0..200 {
        let mut goal = vec![0.0; LeadTip.goal_dim()];
        LeadTip.draw_goal(&mut stream(3, k), &mut goal);
        let ahead = [-goal[7].cos(), -goal[7].sin()];
        for frame in 0..frames {
            let before = goal.clone();
            LeadTip.advance(&mut goal);
            let step = [0, 1].map(|i| 60.0 * (goal[i] - before[i]));
            let (speed, on) = (step[0].hypot(step[1]), step[0] * ahead[0] + step[1] * ahead[1]);
            (fastest, least) = (fastest.max(speed), least.min(on));
            first = if frame == 0 { first.max(speed) } else { first };
        }
    }
    assert!(fastest < 0.25 && first < 0.02 && least > 0.0, "{fastest} m/s, first {first}, ahead {least}");
}

#[test]
fn what_is_seen_ahead_is_where_the_target_will_be_and_an_action_of_one_is_a_speed() {
    let mut episodes = episodes("lead-tip", "articulated", 1);
    let (width, nq) = (LeadTip.observation_dim(), episodes.simulation.batch.system.robot.nq());
    let (then, begun) = (episodes.observations().to_vec(), episodes.view(0).goal.to_vec());
    (0..5).for_each(|_| drop(episodes.step(&[0.0, 1.0, 0.0]).expect("finite physics")));
    let goal = episodes.view(0).goal;
    assert_eq!(goal[3], 15.0, "a frame a frame");
    for i in 0..2 {
        let off = goal[i] - begun[i] - then[width - 6 + i];
        assert!(off.abs() < 1e-12, "{off:.1e} m beside what was seen a quarter of a second before");
    }
    (0..5).for_each(|_| drop(episodes.step(&[0.0, 1.0, 0.0]).expect("finite physics")));
    let speed = episodes.view(0).state[nq + 1];
    assert!((speed - 0.4).abs() < 0.02, "an action of 1 along y: {speed:.3} m/s after half a second");
    (0..40).for_each(|_| drop(episodes.step(&[0.0, 1.0, 0.0]).expect("finite physics")));
    let at = episodes.view(0).state[1];
    assert!((at - 0.5).abs() < 0.01, "led to {at} m, the box ends at 0.5 m");
}

#[test]
fn success_is_a_tip_near_its_target() {
    let (mut bench, mut goal) = (Bench::new("lead-tip"), vec![0.0; LeadTip.goal_dim()]);
    let state = LeadTip.reset(&bench.work.system, &mut stream(1, 0));
    LeadTip.draw_goal(&mut stream(2, 0), &mut goal);
    let seen = bench.observe(&state, &goal);
    (0..3).for_each(|k| goal[k] += seen[k]);
    let on = bench.reward(&state, &goal, &[]);
    goal[1] += 0.04;
    let (error, beside) = (bench.error(&state, &goal).expect("it speaks of success"), bench.reward(&state, &goal, &[]));
    assert!((on - 1.0).abs() < 1e-9, "on the target: {on}");
    assert!((error - 2.0).abs() < 1e-9, "4 cm are twice what is tolerated: {error}");
    let by_hand = 0.7 * (-1.0f64).exp() + 0.3 * (-0.2f64).exp();
    assert!((beside - by_hand).abs() < 1e-9, "4 cm beside it: {beside}, by hand {by_hand}");
}
