//! Policies act in the requested share of the data as they do in episodes. Some trajectories begin fast, in some
//! several policies take turns, and the same seed gives the same bytes.

use nerd_tasks::Task;

use crate::*;

/// A policy that pulls all joints one way by `pull`, with little noise.
fn pulling(pull: f32, task: &str, observation: usize, action: usize, stack: usize) -> (Arc<dyn Task>, Policy) {
    let mut policy = crate::policy(observation, stack, action, &[4], Activation::Relu);
    policy.flat.fill(0.0);
    let (outputs, end) = (action + 1, policy.flat.len() - action);
    policy.flat[end - outputs..end - 1].fill(pull);
    policy.flat[end..].fill(-4.0);
    (named(task).expect("known").into(), policy)
}

/// Records trajectories; these policies act in a share of them. Also returns the robot's number of joints.
fn recorded(
    robot: &str,
    policies: Vec<(Arc<dyn Task>, Policy)>,
    share: f64,
    frames: usize,
    trajectories: usize,
) -> (Trajectories, usize) {
    let system = System::named(robot).expect("built in");
    let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    let pilot = Some((Arc::new(Policies::new(policies)) as _, share));
    let config = GenerateConfig { frames, pilot, ..Default::default() };
    (record(&system, &mut truth, &config, 0, trajectories).expect("recorded"), system.robot.joint_count())
}

#[test]
fn policies_act_in_their_share_of_the_trajectories() {
    let run = |share: f64| recorded("ant", vec![pulling(0.25, "ant-run", 29, 8, 1)], share, 12, 40);
    let (r, joints) = run(0.5);
    // A quarter of 400 N m, within six standard deviations of at most twice e^-4.
    let led = |t: &usize| {
        r.torques[t * 12 * joints..][..12 * joints].iter().all(|tau| (tau - 100.0).abs() < 400.0 * 2.0 * 0.0184 * 6.0)
    };
    let count = (0..40).filter(led).count();
    assert!((10..=30).contains(&count), "a policy acts in {count} of 40 trajectories, half were asked for");
    println!("a policy acts in {count} of 40 trajectories");
    let (none, _) = run(0.0);
    assert!(none.torques.iter().any(|tau| tau.abs() > 300.0), "random torques reach 400 N m");
}

#[test]
fn an_action_stays_for_the_frames_of_its_step_and_answers_each_state() {
    let (r, joints) = recorded("franka", vec![pulling(0.25, "franka-reach", 13, 7, 4)], 1.0, 12, 40);
    let torque = |t: usize, f: usize| &r.torques[(t * 12 + f) * joints..][..joints];
    // Resets are at rest, fast starts are not.
    let resting = |t: usize| r.states[t * 13 * 14 + 7..][..7].iter().all(|v| *v == 0.0);
    let (mut moved, mut weak) = (0, 0);
    for t in 0..40 {
        for f in (0..12).step_by(2) {
            moved += usize::from(torque(t, f) != torque(t, f + 1));
            // The target is a quarter of 0.03125 rad ahead: near rest, the PD law's first torques have one sign.
            weak += usize::from(f == 0 && resting(t) && torque(t, 0).iter().any(|tau| *tau <= 0.0));
        }
    }
    assert!(moved == 240, "the law answers the state of each of the two frames of a step: {moved} of 240 differ");
    assert_eq!(weak, 0, "joints pulled the wrong way at the start of {weak} of 40 trajectories");
}

#[test]
fn part_of_the_trajectories_begin_fast_and_in_part_policies_take_turns() {
    let ways = || vec![pulling(0.25, "ant-run", 29, 8, 1), pulling(-0.25, "ant-spin", 29, 8, 1)];
    let (frames, trajectories) = (100, 200);
    let (r, joints) = recorded("ant", ways(), 1.0, frames, trajectories);
    let (nq, d) = (15, 29);
    // Faster than any reset of a joint (rad/s).
    let fast = |t: &usize| r.states[t * (frames + 1) * d + nq + 6..][..joints].iter().any(|v| v.abs() > 0.25);
    let fast = (0..trajectories).filter(fast).count();
    assert!((30..=70).contains(&fast), "{fast} of 200 trajectories begin fast, a quarter was looked for");
    let signs = |t: usize| {
        (0..frames).map(move |f| (t, f)).map(|(t, f)| r.torques[(t * frames + f) * joints] > 0.0).collect::<Vec<_>>()
    };
    let turns: Vec<usize> = (0..trajectories).map(|t| signs(t).windows(2).filter(|w| w[0] != w[1]).count()).collect();
    let mixed = turns.iter().filter(|n| **n > 0).count();
    // Policies change every thirty frames on average, in a quarter of the trajectories. A share e^-3.3 of these has no
    // change.
    assert!((30..=70).contains(&mixed), "policies take turns in {mixed} of 200 trajectories, a quarter was looked for");
    let each = turns.iter().sum::<usize>() as f64 / mixed as f64;
    assert!((2.0..5.0).contains(&each), "{each:.1} turns in a mixed trajectory of 100 frames, 3.3 were looked for");
    println!("of 200 trajectories {fast} begin fast, in {mixed} policies take turns, {each:.1} in each");
    let (again, _) = recorded("ant", ways(), 1.0, frames, trajectories);
    assert!(r.torques == again.torques && r.states == again.states, "the same settings, other bytes");
}
