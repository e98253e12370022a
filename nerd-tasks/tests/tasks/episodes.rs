//! Every task loads, resets and steps on every analytic solver; episodes start, end and continue correctly.

use nerd_sim::{prelude::*, system::Source};
use nerd_tasks::{Compiled, View, Work, fast_start, named, names};

use crate::{GAIT, actions, episodes, solver};

#[test]
fn every_task_resets_and_steps_on_every_solver() {
    for (which, name) in
        ["articulated", "rapier"].into_iter().flat_map(|which| names().into_iter().map(move |name| (which, name)))
    {
        let mut episodes = episodes(name, which, 4);
        assert_eq!(episodes.observations().len(), 4 * episodes.task.observation_dim(), "{name}");
        for step in 0..60 {
            let result = episodes.step(&actions(&episodes, step)).expect("finite physics");
            let numbers = result.rewards.iter().chain(&result.reached).chain(episodes.observations());
            assert!(numbers.into_iter().all(|x| x.is_finite()), "{which}, {name}: step {step}");
            assert_eq!(result.failed, [false; 4], "{which}, {name}: failed at step {step}");
        }
    }
}

/// The reward is the sum of its terms, and the clock tells the time of the episode.
#[test]
fn a_file_has_terms_and_a_clock() {
    let mut episodes = episodes(GAIT, "articulated", 3);
    assert_eq!(episodes.task.terms(), ["alive", "load", "rhythm"]);
    let (width, still) = (episodes.task.observation_dim(), vec![0.0; 3 * episodes.task.action_dim()]);
    for k in 1..=40 {
        let result = episodes.step(&still).expect("finite physics");
        for (env, (seen, terms)) in result.reached.chunks(width).zip(result.terms.chunks(3)).enumerate() {
            let time = 0.02 * f64::from((k - 1) % 36 + 1);
            let sum: f64 = terms.iter().sum();
            assert!((sum - result.rewards[env]).abs() < 1e-12 && terms[0] == 0.02, "step {k}: {terms:?}");
            assert!((seen[5] - time).abs() < 1e-12 && result.terminated[env] == (k == 36), "step {k}: {} s", seen[5]);
        }
    }
}

#[test]
fn an_episode_is_asked_for_what_its_user_names() {
    let mut episodes = episodes("walk@anymal", "articulated", 2);
    let width = episodes.task.observation_dim();
    let before = episodes.observations().to_vec();
    episodes.ask(1, "yaw_rate=0.25, vx=-0.5").expect("commands of walk");
    let seen = episodes.observations();
    assert!(seen[..width] == before[..width], "the other episode");
    let asked = [-0.5, before[width + 10], 0.25];
    assert_eq!(seen[width + 9..width + 12], asked);
    let cases = [
        ("vz=1", "has no command `vz`: choose from vx, vy, yaw_rate"),
        ("vx=3", "vx is 3; a number from -1 to 1 is needed"),
        ("vx=fast", "`vx` is `fast`; a number is needed"),
        ("vx", "`vx` is no NAME=NUMBER"),
    ];
    for (text, expected) in cases {
        let said = episodes.ask(1, text).expect_err("refused");
        assert!(said.contains(expected), "{text}: {said}");
    }
    assert_eq!(episodes.observations()[width + 9..width + 12], asked);
    episodes.ask(1, "ahead=-0.5").expect("the old name of vx");
    assert_eq!(episodes.observations()[width + 9..width + 12], asked);
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
fn a_snapshot_goes_on_as_if_nothing_had_happened() {
    for name in ["ant-run", "franka-reach", "lead-tip"] {
        let mut whole = episodes(name, "articulated", 3);
        for step in 0..80 {
            whole.step(&actions(&whole, step)).expect("finite physics");
        }
        let mut again = episodes(name, "articulated", 3);
        again.restore(&whole.snapshot()).expect("of the same sizes");
        assert_eq!(again.observations(), whole.observations(), "{name}");
        for step in 80..150 {
            let action = actions(&whole, step);
            assert_eq!(
                whole.step(&action).expect("finite"),
                again.step(&action).expect("finite"),
                "{name} at step {step}"
            );
        }
        let mut other = episodes(name, "articulated", 4);
        assert!(other.restore(&whole.snapshot()).is_err(), "{name}: a snapshot of three environments for four");
    }
}

/// Makes the state of environment 1 NaN at its 20th frame.
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
        assert_eq!(
            (&result.failed[..], result.terminated[1]),
            (&[false, expected, false][..], expected),
            "step {step}"
        );
        if expected {
            assert_eq!((result.rewards[1], broken.simulation.batch.frames[1]), (0.0, 0), "step {step}");
        }
        for env in [0, 2] {
            let (found, wanted) = (broken.view(env).state, whole.view(env).state);
            assert_eq!(found, wanted, "step {step}: environment {env} noticed its neighbour");
            assert_eq!(result.rewards[env], undisturbed.rewards[env], "step {step}");
        }
    }
    assert!(broken.fault.is_some() && whole.fault.is_none(), "{:?}", broken.fault);
    assert!(broken.step(&[0.0]).is_err(), "one action for three Ants");
}

#[test]
fn fast_starts_are_faster_than_resets_and_end_no_episode() {
    for name in names() {
        let task = named(name).expect("registered");
        let system = task.system().expect("built in");
        let (scene, goal) = (system.scene(task.scene()).expect("known"), vec![0.0; task.goal_dim()]);
        let (nq, mut work) = (system.robot.nq(), Work::new(&system));
        let task = Compiled::new(task, &system);
        let speed = |state: &[f64]| state[nq..].iter().map(|v| v * v).sum::<f64>().sqrt();
        let (mut slow, mut fast) = (0.0_f64, 0.0_f64);
        for k in 0..200 {
            let rng = || stream(3, k);
            let (usual, hurried) = (task.reset(&system, &mut rng()), fast_start(&task, &mut rng()));
            assert_eq!(usual[..nq], hurried[..nq], "{name}: a hurried start stands elsewhere");
            (slow, fast) = (slow.max(speed(&usual)), fast.max(speed(&hurried)));
            let mut over_at = |state: &[f64]| task.terminated(View { state, goal: &goal, scene: &scene }, &mut work);
            assert!(!over_at(&hurried) || over_at(&usual), "{name}: hurried start {k} is over at once");
        }
        // A cable is at rest in all data and resets.
        let still = system.source == Source::Cable;
        assert!(
            if still { fast == 0.0 } else { fast > 2.0 * slow && fast.is_finite() },
            "{name}: {slow:.2} by reset, {fast:.2} hurried"
        );
    }
}

#[test]
fn an_episode_of_a_number_and_a_seed_is_the_same_again() {
    let mut all = episodes("franka-reach", "articulated", 3);
    let first = all.observations().to_vec();
    (0..130).for_each(|_| drop(all.step(&[0.1; 21]).expect("finite physics")));
    assert_eq!(all.numbers(), [2; 3]);
    let second = all.observations().to_vec();
    all.begin_numbered(&[(1, 1)]);
    assert_eq!(all.numbers(), [2, 1, 2]);
    let now = all.observations();
    assert_eq!((&now[..13], &now[13..26], &now[26..]), (&second[..13], &first[13..26], &second[26..]));
    all.seeded(8);
    assert!(all.observations() != first, "another seed");
    all.seeded(7);
    assert_eq!(all.observations(), first);
    assert_eq!(all.numbers(), [1; 3]);
}
