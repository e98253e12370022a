//! Instruments around a solver have their documented effect and no other.

use nerd_sim::instruments::{Glide, Hold, Recorder, Replay, Shaken, Timed};
use nerd_suite::bodies::Body;

use super::common::*;

fn pendulums(n: usize) -> Batch {
    let mut batch = batch(&built_in("pendulum"), "ground1", n);
    (0..n).for_each(|env| batch.reset(env, &[0.1 * env as f64, 0.2, 0.0, 0.0]));
    batch
}

fn paper(system: &System) -> Articulated {
    Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))
}

#[test]
fn timed_and_recorded_motion_is_the_same_and_replays() {
    let (mut bare, mut watched, mut again) = (pendulums(3), pendulums(3), pendulums(3));
    let (mut solver, mut instrument) = (paper(&bare.system), Timed::new(Recorder::new(paper(&bare.system))));
    for _ in 0..20 {
        solver.step(&mut bare, &[0.0; 6]).expect("a frame");
        instrument.step(&mut watched, &[0.0; 6]).expect("a frame");
    }
    assert_eq!(bare.states, watched.states);
    assert!(!instrument.spent.is_zero());
    let frames = instrument.solver.frames;
    let mut replay = Replay::new(&frames);
    (0..20).for_each(|_| replay.step(&mut again, &[0.0; 6]).expect("a recorded frame"));
    assert_eq!((&again.states, &again.frames), (&bare.states, &bare.frames));
    let refused = line(replay.step(&mut again, &[0.0; 6]));
    assert!(refused.contains("frame 20") && refused.contains("only 20"), "{refused}");
    let refused = line(Replay::new(&frames).step(&mut pendulums(2), &[0.0; 4]));
    assert!(refused.contains("12 numbers") && refused.contains("has 8"), "{refused}");
}

/// If one environment fails, the frame is recorded for the others.
#[test]
fn a_recorder_misses_no_frame() {
    let mut batch = pendulums(2);
    batch.state_mut(1)[0] = f64::NAN;
    let mut recorder = Recorder::new(paper(&batch.system));
    for _ in 0..5 {
        recorder.step(&mut batch, &[0.0; 4]).expect_err("environment 1 is not a number");
    }
    assert_eq!(recorder.frames.len(), 5);
    assert!(recorder.frames[4][1] != recorder.frames[3][1], "environment 0 moves");
}

#[test]
fn shaking_is_normal_and_repeats() {
    let run = |seed: u64| {
        let mut batch = pendulums(500);
        Shaken::new(Hold, 0.1, seed).step(&mut batch, &[0.0; 1000]).expect("a frame");
        batch.states
    };
    let states = run(3);
    assert!(states == run(3) && states != run(4));
    let noise: Vec<f64> = states.chunks_exact(4).flat_map(|s| &s[2..]).copied().collect();
    let spread = (noise.iter().map(|x| x * x).sum::<f64>() / noise.len() as f64).sqrt();
    // With 1000 numbers, the relative error of the standard deviation is 2.2 %.
    assert!((spread / 0.1 - 1.0).abs() < 0.1, "standard deviation {spread}, 0.1 asked for");
}

/// A ball that flies and spins without gravity keeps both velocities: gliding is exact there.
#[test]
fn gliding_is_exact_where_nothing_pulls() {
    let ball = Body { shape: r#"<sphere radius="0.1"/>"#.into(), gravity: 0.0, ..Default::default() }
        .system()
        .expect("a ball");
    let mut glided = Batch::new(&ball, &ball.scene("free").expect("free"), 1);
    glided.reset(0, &Body::state([1.0, 2.0, 3.0], [0.0, 0.6, 0.0, 0.8], [0.3, -0.4, 0.5], [1.0, 0.5, -2.0]));
    let mut stepped = glided.clone();
    let mut exact = Articulated::new(ArticulatedConfig::converged(Friction::Coulomb));
    for _ in 0..60 {
        Glide.step(&mut glided, &[]).expect("a frame");
        exact.step(&mut stepped, &[]).expect("a frame");
    }
    let gap = glided.states.iter().zip(&stepped.states).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(gap < 1e-9, "{gap} apart after a second");
}
