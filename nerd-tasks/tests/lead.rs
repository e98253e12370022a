//! The lead whose tip follows a target: its start is at rest, the target goes on as it is told, actions are speeds, a plain law does something.

use std::sync::Arc;

use nerd_sim::prelude::*;
use nerd_sim::sampling::stream;
use nerd_tasks::{Episodes, LeadTip, Task, View, Work, named};

const STEPS: usize = 100;

fn system() -> Arc<System> {
    System::named(LeadTip.robot()).expect("built in")
}

fn episodes(n: usize, substeps: usize) -> Episodes {
    let (task, system) = (named("lead-tip").expect("registered"), system());
    let batch = Batch::new(&system, &system.scene(task.scene()).expect("a plane"), n);
    let solver = Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb));
    Episodes::new(task, Simulation::new(batch, solver), 7)
}

fn tip(episodes: &Episodes, env: usize) -> [f64; 3] {
    let seen = &episodes.observations()[env * LeadTip.observation_dim()..];
    std::array::from_fn(|k| seen[k] + episodes.view(env).goal[k])
}

#[test]
fn an_episode_begins_at_rest_with_the_tip_on_the_floor() {
    let mut episodes = episodes(8, 8);
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
    println!("in half a second the tips move by {:.2} mm, rise by {:.2} mm at most", 1e3 * moved, 1e3 * lifted);
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
            assert_eq!((goal[2], goal[3]), (before[2], before[3] + 1.0), "on the floor, frame by frame");
        }
    }
    println!("targets go at {fastest:.3} m/s at most, {first:.4} m/s in their first frame, {least:.4} m/s ahead at least");
    assert!(fastest < 0.25 && first < 0.02 && least > 0.0, "{fastest} m/s, first {first}, ahead {least}");
}

#[test]
fn what_is_seen_ahead_is_where_the_target_will_be() {
    let mut episodes = episodes(3, 1);
    let width = LeadTip.observation_dim();
    let then: Vec<Vec<f64>> = episodes.observations().chunks_exact(width).map(<[f64]>::to_vec).collect();
    let goals: Vec<[f64; 2]> = (0..3).map(|env| [0, 1].map(|i| episodes.view(env).goal[i])).collect();
    for _ in 0..5 {
        episodes.step(&[0.3; 9]).expect("finite physics");
    }
    for env in 0..3 {
        let goal = episodes.view(env).goal;
        assert_eq!(goal[3], 15.0, "a frame a frame");
        for i in 0..2 {
            let off = goal[i] - goals[env][i] - then[env][width - 6 + i];
            assert!(off.abs() < 1e-12, "environment {env}: {off:.1e} m beside what was seen a quarter of a second before");
        }
    }
}

#[test]
fn an_action_of_one_is_a_speed_within_the_box() {
    let (mut episodes, nq) = (episodes(1, 4), system().robot.nq());
    for _ in 0..10 {
        episodes.step(&[0.0, 1.0, 0.0]).expect("finite physics");
    }
    let speed = episodes.view(0).state[nq + 1];
    println!("an action of 1 along y: {speed:.3} m/s after half a second");
    assert!((speed - 0.4).abs() < 0.02, "{speed} m/s");
    for _ in 0..40 {
        episodes.step(&[0.0, 1.0, 0.0]).expect("finite physics");
    }
    let at = episodes.view(0).state[1];
    assert!((at - 0.5).abs() < 0.01, "led to {at} m, the box ends at 0.5 m");
}

#[test]
fn success_is_a_tip_near_its_target() {
    let (system, mut goal) = (system(), vec![0.0; LeadTip.goal_dim()]);
    let (scene, mut work) = (system.scene("plane").expect("a world"), Work::new(&system));
    let state = LeadTip.reset(&system, &mut stream(1, 0));
    LeadTip.draw_goal(&mut stream(2, 0), &mut goal);
    let mut seen = vec![0.0; LeadTip.observation_dim()];
    LeadTip.observe(View { state: &state, goal: &goal, scene: &scene }, &mut work, &mut seen);
    (0..3).for_each(|k| goal[k] += seen[k]);
    let on = LeadTip.reward(View { state: &state, goal: &goal, scene: &scene }, &[], &mut work);
    goal[1] += 0.04;
    let view = View { state: &state, goal: &goal, scene: &scene };
    let (miss, beside) = (LeadTip.miss(view, &mut work).expect("it speaks of success"), LeadTip.reward(view, &[], &mut work));
    assert!((on - 1.0).abs() < 1e-9, "on the target: {on}");
    assert!((miss - 2.0).abs() < 1e-9, "4 cm are twice what may be missed: {miss}");
    let by_hand = 0.7 * (-1.0f64).exp() + 0.3 * (-0.2f64).exp();
    assert!((beside - by_hand).abs() < 1e-9, "4 cm beside it: {beside}, by hand {by_hand}");
}

#[test]
fn a_snapshot_goes_on_with_targets_where_they_were() {
    let mut whole = episodes(3, 1);
    let actions = |step: usize| -> Vec<f64> { (0..9).map(|i| 0.5 * ((i * 7 + step) as f64).sin()).collect() };
    (0..30).for_each(|step| drop(whole.step(&actions(step)).expect("finite physics")));
    let mut again = episodes(3, 1);
    again.restore(&whole.snapshot()).expect("of the same sizes");
    for step in 30..STEPS + 5 {
        let (a, b) = (whole.step(&actions(step)).expect("finite"), again.step(&actions(step)).expect("finite"));
        assert_eq!(a, b, "step {step}");
    }
}
